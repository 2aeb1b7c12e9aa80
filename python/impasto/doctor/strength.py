"""Lamps that are brighter or weaker than the others, or were exposed differently."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import counted, factor, scatter
from impasto.doctor.diagnosis import Finding
from impasto.doctor.lights import elevation
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import fit_surface, shading
from impasto.rig import Rig
from impasto.stack import Stack

Floats = NDArray[np.float64]

_OFF = 0.2
"""Errors of strengths beyond this share tilt normals by degrees."""
_FEWEST = 5
_ROUNDS = 3
_SIGMAS = 5.0
_SAME = 1e-3
"""Degrees: closer heights of lights count as equal. Files have six digits."""
_OPPOSITE = 1e-12
"""A shorter sum of two unit vectors means that they are opposite: there is no half vector."""


def strengths(stack: Stack, sampled: SampledTiles) -> list[Finding]:
    """The strength of each light in the photographs, relative to the others."""
    if len(stack.rig) < _FEWEST:
        return []
    gain = measure_strengths(sampled, stack.rig.views)
    if gain is None:
        return []
    height = _height(stack.rig)
    expected = _usual(gain, height)
    log = np.log(gain / expected)
    spread = 1.4826 * float(np.nanmedian(np.abs(log)))
    limit = max(np.log1p(_OFF), _SIGMAS * spread)
    # Gloss brightens whole photographs under lights near the camera; it darkens none.
    gloss = np.where(height > 75.0, np.inf, np.where(height > 60.0, np.log(3.0), 0.0))
    off = np.flatnonzero((log < -limit) | (log > np.maximum(limit, gloss)))
    numbers = {"gain": np.round(gain / expected, 4).tolist(), "spread": round(spread, 4)}
    if len(off) == 0:
        return [_none_stands_out(spread, numbers)]
    off = off[np.argsort(-np.abs(log[off]), kind="stable")]
    text = ", ".join(f"{stack.names[i]} {np.exp(log[i]):.2f}" for i in off[:4].tolist())
    more = f" and {len(off) - 4} more" if len(off) > 4 else ""
    return [
        Finding(
            "strengths",
            "warning",
            f"{counted(len(off), 'photograph')} of unexpected brightness, relative to the others: "
            f"{text}{more}",
            "if the lamp or the exposure differed, give intensities= (one number per light), "
            "photograph a white board under each light (white=) or estimate the strengths "
            "(impasto.fit_strengths); otherwise the direction of that light is wrong",
            tuple(sorted(off.tolist())),
            numbers=numbers,
        )
    ]


def _none_stands_out(spread: float, numbers: dict[str, Any]) -> Finding:
    """Ok if a lamp that is off by :data:`_OFF` would stand out; otherwise no check is possible."""
    words = f"their strengths scatter by {scatter(spread)}"
    limit = _SIGMAS * spread
    if limit <= np.log1p(_OFF):
        return Finding("strengths", "ok", f"no light stands out: {words}", numbers=numbers)
    return Finding(
        "strengths",
        "note",
        f"cannot check whether lamps differ: {words}, including gloss and changing views; only "
        f"one {factor(np.exp(min(limit, 700.0)))} times as strong as the others would stand out",
        "if the lamps were not measured, impasto.fit_strengths (impasto fit --strengths) estimates "
        "their strengths with gloss in its model",
        numbers=numbers,
    )


def _height(rig: Rig) -> Floats:
    """Elevation in degrees of the light that shows as much gloss to a camera in front."""
    half = rig.directions + rig.views
    length = np.linalg.norm(half, axis=1, keepdims=True)
    return 2.0 * elevation(half / np.maximum(length, _OPPOSITE)) - 90.0


def measure_strengths(sampled: SampledTiles, views: Floats) -> Floats | None:
    """Strength of each light ``(obs,)`` relative to the given ones.

    A robust semi-calibrated estimate: surface and strengths are fitted alternately. Only pixels far
    from shadow and from the mirror direction are used.
    """
    gain = np.ones(len(sampled.grey))
    lights = sampled.lights
    for _ in range(_ROUNDS):
        surface = fit_surface(sampled.grey / gain[:, None], lights)
        known = np.isfinite(surface).all(axis=0)
        if known.sum() < 30:
            return None
        shown = shading(surface, lights)
        albedo = np.linalg.norm(surface, axis=0)
        half = _half_cosine(surface / np.maximum(albedo, 1e-30), lights, views)
        ratio = np.full(len(gain), np.nan)
        for index, row in enumerate(sampled.grey):
            lit = known & np.isfinite(row) & (shown[index] > 0.2 * albedo)
            if lit.sum() < 30:
                continue
            far = lit & (half[index] <= np.quantile(half[index, lit], 0.4))
            ratio[index] = np.median(row[far] / shown[index, far])
        if np.isfinite(ratio).sum() < _FEWEST:
            return None
        gain = np.where(np.isfinite(ratio) & (ratio > 1e-3), ratio, 1e-3)
        gain = gain / np.median(gain)
    return gain


def _half_cosine(normal: Floats, lights: Floats, views: Floats) -> Floats:
    """Cosine between normal and half vector ``(obs, n)``."""
    if lights.ndim == 2:
        half = lights + views
        half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), _OPPOSITE)
        return np.asarray(half @ normal)
    half = lights / np.linalg.norm(lights, axis=2, keepdims=True) + views[:, None]
    half = half / np.maximum(np.linalg.norm(half, axis=2, keepdims=True), _OPPOSITE)
    return np.asarray(np.einsum("kni,in->kn", half, normal))


def _usual(gain: Floats, height: Floats) -> Floats:
    """Median gain of lights of similar height: sheen and a wrong tone curve depend on it."""
    if len(gain) < 12:
        return np.full(len(gain), np.median(gain))
    ranked = np.sort(height)
    reach = max(3, len(gain) // 8)
    places = np.arange(len(height))
    low, high = (
        ranked[np.clip(places + step, 0, places[-1])] + np.sign(step) * _SAME
        for step in (-reach, reach)
    )
    usual = np.empty(len(gain))
    # Hundreds of views are often lit from one height: all of them count, in any order.
    first, last = (np.searchsorted(ranked, height + side * _SAME, "left") for side in (-1, 1))
    for index, place in enumerate((first + last - 1) // 2):
        near = (height >= low[place]) & (height <= high[place])
        # With enough lights the median does not include the light that is checked.
        near[index] = False
        usual[index] = np.median(gain[near])
    return usual

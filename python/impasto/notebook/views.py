"""HTML of each thing that a notebook shows.

The things call these, so nothing here may import them: they come as what they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.notebook.page import grid, normal_thumbnail, reduced, share_of, table, thumbnail
from impasto.status import Status

SOME = 8
"""Photographs whose mean is shown."""
MOST_PIXELS = 1 << 22
"""A stored result without smaller scales is only read for its pictures if it has no more."""


def stack_view(stack: Any) -> str:
    """Size, lights, and the mean of some photographs of a :class:`impasto.Stack`."""
    observations, _, height, width = stack.shape
    some = np.linspace(0, observations - 1, min(observations, SOME)).astype(int)
    light = [stack._linear(reduced(stack.samples[index])) for index in some]
    mean = np.mean([np.nan_to_num(plane, posinf=1.0) for plane in light], axis=0)
    rows = {
        "photographs": observations,
        "size": f"{width} x {height} pixels",
        "bands": ", ".join(stack.bands),
        "samples": stack.samples.dtype,
        "tone curve": stack._curve_words,
        "rig": repr(stack.rig).strip("<>").removeprefix("Rig "),
    }
    return table("Stack", rows, {f"mean of {len(some)} photographs": thumbnail(mean)})


def normals_view(normals: Any) -> str:
    """Size, method, predicted error, albedo and normals of :class:`impasto.Normals`."""
    height, width = normals.shape
    sigma = normals.sigma[np.isfinite(normals.sigma)]
    rows = {
        "size": f"{width} x {height} pixels",
        "bands": len(normals.albedo),
        "method": normals.method,
        "estimated": share_of(normals.status < Status.DARK),
        "error": f"{np.degrees(np.median(sigma)):.2g}° (median)" if len(sigma) else "unknown",
    }
    return table("Normals", rows, _maps("albedo", normals.albedo, normals.normal))


def reflectance_view(reflectance: Any) -> str:
    """Size, basis, estimator and colours under D65 of a :class:`impasto.Reflectance`."""
    from impasto.colour import display_from_coefficients

    count, height, width = reflectance.coefficients.shape
    wavelengths = reflectance.wavelengths
    rows = {
        "size": f"{width} x {height} pixels",
        "basis": f"{count} spectra, {wavelengths[0]:g} to {wavelengths[-1]:g} nm",
        "estimator": reflectance.info.get("estimator", "unknown"),
        "estimated": share_of(reflectance.status < Status.DARK),
    }
    fold = display_from_coefficients(reflectance.basis, wavelengths, "D65")
    light = np.tensordot(fold.diffuse, reduced(reflectance.coefficients), axes=1)
    return table("Reflectance", rows, {"under D65": thumbnail(light)})


def sbrdf_view(sbrdf: Any) -> str:
    """Size, gloss, diffuse colours and normals of every :class:`impasto.Sbrdf`."""
    height, width = sbrdf.shape
    gloss = sbrdf.gloss
    rows = {
        "size": f"{width} x {height} pixels",
        "bands": ", ".join(sbrdf.bands),
        "estimated": share_of(sbrdf.estimated),
        "gloss": sbrdf._gloss(),
    }
    if gloss.source == "pixels":
        rows["median lobe"] = str(gloss)
    if sbrdf.chosen is not None:
        rows["chosen"] = str(sbrdf.chosen)
    if sbrdf.residuals is not None:
        rows["residuals"] = f"predict new lights {sbrdf.residuals.gain:.1f} dB better"
    if sbrdf.relief is not None:
        rows["relief"] = str(sbrdf.relief)
    return table(type(sbrdf).__name__, rows, _maps("diffuse", sbrdf.diffuse, sbrdf.normal))


def stored_view(stored: Any) -> str:
    """Size, tiles and scales of a :class:`impasto.StoredSbrdf`; its smallest scale as pictures."""
    height, width = stored.shape
    rows = {
        "size": f"{width} x {height} pixels",
        "bands": ", ".join(stored.bands),
        "holds": f"{stored.kind.__name__} in tiles of {stored.tile}",
        "smaller scales": ", ".join(f"1/{factor}" for factor in stored.factors) or "none",
        "store": stored.path.name,
    }
    if stored.factors:
        small = stored.level(max(stored.factors)).surface()
    elif height * width <= MOST_PIXELS:
        small = stored.visible(slice(None), slice(None))
    else:
        return table("StoredSbrdf", rows, {})
    return table("StoredSbrdf", rows, _maps("diffuse", small.diffuse, small.normal))


def decisions_view(decisions: Any) -> str:
    """A row for every effect of a :class:`impasto.Plan`: what is decided, and why."""
    rows = []
    for effect in decisions.effects:
        tiles = f" ({effect.tiles}/{decisions.tiles} tiles)" if effect.decision == "on" else ""
        error = "0" if effect.error == 0.0 else f"≤ {effect.error:.2g} {decisions.unit}"
        saves = "" if effect.saves is None else f"{1e3 * effect.saves:.1f} ms"
        rows.append((effect.name, effect.decision + tiles, effect.reason, error, saves))
    total = f"{decisions.error:.2g} {decisions.unit}".strip()
    note = f"tolerance {decisions.tolerance}; left out in any tile: at most {total}"
    heads = ("effect", "decision", "why", "error", "saves")
    # Seconds are only known of a plan that was measured.
    shown = len(heads) if any(row[-1] for row in rows) else len(heads) - 1
    return grid(type(decisions).__name__, heads[:shown], [row[:shown] for row in rows], note)


def relightable_view(image: Any) -> str:
    """A relightable image of another program in two lights."""
    lit = {"light from above": (0.0, 0.71, 0.71), "raking light": (-0.9, 0.3, 0.31)}
    shown = {name: thumbnail(image.linear(light)[0]) for name, light in lit.items()}
    facts = {name.replace("_", " "): value for name, value in image.report().items()}
    return table("RelightableImage", facts, shown)


def comparison_view(comparison: Any) -> str:
    """The table of a :class:`impasto.Comparison`, before and after, and what changed."""
    overview = comparison.overview
    both = np.concatenate([overview.before, overview.after], axis=2)
    shown = thumbnail(both)
    marks = np.nan_to_num(overview.changed).clip(0.0, 1.0)
    pictures = {
        "before, after": shown,
        "changed: normal red, colour green, gloss blue": thumbnail(marks),
    }
    return table("Comparison", comparison.rows(), pictures)


def _maps(name: str, colours: NDArray[Any], normal: NDArray[Any]) -> dict[str, NDArray[np.uint8]]:
    return {name: thumbnail(colours), "normals": normal_thumbnail(normal)}

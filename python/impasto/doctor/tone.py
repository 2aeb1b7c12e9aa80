"""Whether the files were decoded with the right tone curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from impasto.doctor.diagnosis import Finding
from impasto.doctor.specimen import linear
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.tone import ToneEstimate, estimate_tone
from impasto.stack import Stack

_CODED = (".jpg", ".jpeg", ".jpe")
_WORSE = 1.1
_PIXELS = 1000


def tone(stack: Stack) -> list[Finding]:
    """Compare the stack's tone curve with what its photographs say."""
    curve = stack.encoding.curve
    photographs = [name for name in stack.names if name.lower().endswith(_CODED)]
    estimate = _estimate(stack)
    numbers: dict[str, Any] = {"curve": curve}
    if estimate is not None:
        numbers |= {
            "best": estimate.best,
            "decided": estimate.decided,
            "errors": {name: round(error, 6) for name, error in estimate.errors},
        }
    return [_judged(curve, estimate, bool(photographs), numbers)]


def _judged(
    curve: str, estimate: ToneEstimate | None, coded: bool, numbers: dict[str, Any]
) -> Finding:
    errors = dict(estimate.errors) if estimate is not None else {}
    ratio = errors.get("linear", 0.0) / max(min(errors.values(), default=0.0), 1e-12)
    bent = ratio > _WORSE
    say = 'say encoding="srgb" (command line: --encoding srgb), or --encoding auto'
    if curve == "linear" and bent and estimate is not None:
        return Finding(
            "encoding",
            "warning",
            f"read as linear, but light does not add up: the curve {estimate.best!r} predicts "
            f"held-out photographs {ratio:.2f} times better",
            say,
            numbers=numbers,
        )
    if curve == "linear" and coded:
        return Finding(
            "encoding",
            "warning",
            "JPEG photographs read as linear: cameras apply a tone curve to them",
            say,
            numbers=numbers,
        )
    if estimate is None:
        return Finding(
            "encoding",
            "ok",
            f"cannot tell whether the tone curve {curve!r} is right: six photographs with usable "
            "samples are needed",
            numbers=numbers,
        )
    return Finding("encoding", "ok", f"the tone curve {curve!r} is plausible", numbers=numbers)


def _estimate(stack: Stack) -> ToneEstimate | None:
    """The curve estimated from the codes, which are made again where the files were decoded."""
    codes, white = _codes(stack)
    if white is None:
        return None
    try:
        return estimate_tone(
            codes,
            stack.rig.directions,
            white=white,
            mask=None,
            intensities=stack.rig.intensities,
        )
    except ArgumentError:
        return None


def _codes(stack: Stack) -> tuple[Any, float | None]:
    """``(obs, 1, 1, n)`` coded values of some pixels in the brightest band, full scale at 1."""
    height, width = stack.shape[2:]
    inside = np.arange(height * width) if stack.mask is None else np.flatnonzero(stack.mask.ravel())
    if len(inside) == 0:
        return None, None
    # A fixed-seed draw: an even step would walk down single columns where it divides the width.
    count = min(_PIXELS, len(inside))
    picked = np.sort(np.random.default_rng(0).choice(inside, count, replace=False))
    light = np.stack([linear(stack, row[:, *np.divmod(picked, width)]) for row in stack.samples])
    clipped, usable = np.isposinf(light), np.isfinite(light)
    if not usable.any():
        return None, None
    top = np.full(len(stack.bands), np.nan)
    if stack.saturation is not None:
        top = (stack.saturation - stack.black) * stack.scale
    full = np.where(np.isfinite(top), top, float(light[usable].max()))
    share = np.where(usable, light / full[:, None], np.where(clipped, 1.0, np.nan))
    band = int(np.argmax(np.nan_to_num(np.where(usable, share, 0.0)).mean(axis=(0, 2))))
    if not full[band] > 0:
        return None, None
    coded = Encoding(stack.encoding.curve, 1.0).encode(np.nan_to_num(share[:, band], nan=1.0))
    return coded[:, None, None], 1.0

"""A picture of a calibrated lens: what is left at every corner, and what the lens does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.lens_calibration import LensCalibration
from impasto.lens import Lens
from impasto.pictures import Panel, Picture, contact_sheet

_GREEN, _AMBER, _LINE = (120, 190, 110), (255, 190, 90), (88, 88, 92)
_SIZE = 720
_LONGEST = 40.0
"""Pixels of the picture that the longest arrow may have."""


def lens_picture(found: LensCalibration) -> Picture:
    """``(y, x, 3)``: residuals of all corners over the frame, enlarged, and the distortion.

    Arrows point from where the model expects a corner to where it was found. Parts of the frame
    without arrows are not calibrated.
    """
    lens = found.lens
    return contact_sheet(
        [_residuals(found), _distortion(lens)],
        title="Lens",
        subtitle=f"{lens.model} model, {lens.corners} corners in {lens.photographs} photographs, "
        f"residual {lens.residual_px:.3f} pixels",
        columns=2,
        width=_SIZE,
    )


def _frame(lens: Lens) -> tuple[Picture, float]:
    scale = _SIZE / max(lens.size)
    rows, columns = (max(1, round(side * scale)) for side in lens.size[::-1])
    return np.full((rows, columns, 3), 38, dtype=np.uint8), scale


def _residuals(found: LensCalibration) -> Panel:
    picture, scale = _frame(found.lens)
    places = np.concatenate([view.found for view in found.views])
    residuals = np.concatenate([view.residual for view in found.views])
    # The longest of 99 in 100 is as long as the picture allows; a round factor is easier to read.
    large = float(np.percentile(np.linalg.norm(residuals, axis=1), 99))
    factor = round_factor(_LONGEST / max(large * scale, 1e-9))
    draw_arrows(picture, (places + 0.5) * scale - 0.5, residuals * scale * factor)
    return Panel("Found minus predicted", picture, f"arrows enlarged {factor:g} times")


def round_factor(value: float) -> float:
    """1, 2 or 5 times a power of ten, the largest that is no more than the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(digit * power for digit in (1, 2, 5) if digit * power <= value))


def draw_arrows(picture: Picture, places: NDArray[np.float64], shifts: NDArray[np.float64]) -> None:
    """Draw arrows ``(n, 2)`` from places of the picture."""
    import cv2

    sub = 4  # bits of a pixel's fraction
    for start, end in zip(places, places + shifts, strict=True):
        a, b = (tuple(np.rint(one * (1 << sub)).astype(int).tolist()) for one in (start, end))
        cv2.line(picture, a, b, _AMBER, 1, cv2.LINE_AA, sub)
        cv2.circle(picture, a, 2 << sub >> 1, _GREEN, -1, cv2.LINE_AA, sub)


def _distortion(lens: Lens) -> Panel:
    """A grid of straight lines as the lens shows it."""
    import cv2

    picture, scale = _frame(lens)
    width, height = lens.size
    along = np.linspace(0.0, 1.0, 65)
    steps = np.linspace(0.0, 1.0, 13)
    for share in steps:
        for x, y in ((np.full(65, share), along), (along, np.full(65, share))):
            line = np.stack([x * (width - 1), y * (height - 1)], axis=1)
            for points, colour in ((line, _LINE), (lens.observed(line), _GREEN)):
                drawn = np.rint(16.0 * ((points + 0.5) * scale - 0.5)).astype(np.int32)
                cv2.polylines(picture, [drawn], False, colour, 1, cv2.LINE_AA, 4)
    corner = lens.observed(np.zeros((1, 2)))[0]
    move = f"grey: a pinhole camera; a corner moves by {np.hypot(*corner):.1f} pixels"
    return Panel("Distortion", picture, move)

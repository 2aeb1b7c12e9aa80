"""Shifts between photographs under different lamps: ECC maximisation [@evangelidis2008parametric].

Relief that is lit from opposite sides swaps bright and dark slopes. The magnitude of the gradient
of the logarithm of the light hardly changes with that: edges of colour stay, and a slope keeps its
outline. On it the enhanced correlation coefficient is maximised over shifts alone; transformations
with more unknowns follow the shading. Phase correlation [@kuglin1975phase] of the same pictures
starts the search, and a result that is far from it is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

FLOOR = 0.02
"""Added to light before the logarithm, relative to its median: noise of shadows counts little."""
BLUR = 1.0
"""Standard deviation in pixels of the Gaussian before gradients."""
SMOOTH = 5
"""Pixels of the Gaussian that ECC applies to both pictures."""
STEPS, EPSILON = 200, 1e-7
LARGEST = 1024
"""Rows and columns of the middle part that is compared at most."""
FARTHEST = 8.0
"""Largest shift in pixels: marks are better than that, unless one of them moved."""
APART = 1.0
"""Pixels by which ECC and phase correlation may differ."""
LEAST_SCORE = 0.3
"""Correlation from which pictures have structure in common: gradients of lamps that stand opposite
each other on simulated and real relief have 0.5 and more (``benches/results/alignment.json``)."""


@dataclass(frozen=True)
class Shift:
    """How far the content of a picture lies from that of the reference.

    Attributes
    ----------
    x, y
        Pixels to the right and below; 0 where it was refused.
    score
        Correlation of the two pictures' gradients at this shift, -1 to 1.
    phase_x, phase_y
        What phase correlation says.
    refused
        Why the shift is not applied; empty if it is.
    """

    x: float
    y: float
    score: float
    phase_x: float
    phase_y: float
    refused: str = ""


def gradient_picture(light: Image) -> Image:
    """``(y, x)``: magnitude of the gradient of the logarithm of the light, mean 1."""
    import cv2

    level = max(float(np.median(light)), 1e-6)
    tone = np.log(np.maximum(light, 0.0) / level + FLOOR).astype(np.float32)
    tone = np.asarray(cv2.GaussianBlur(tone, (0, 0), BLUR))
    across, down = (cv2.Sobel(tone, cv2.CV_32F, dx, 1 - dx, scale=0.125) for dx in (1, 0))
    size = np.hypot(across, down)
    return np.asarray(size / max(float(size.mean()), 1e-12), np.float32)


def middle(picture: Image) -> Image:
    """The part of a picture that is compared."""
    rows, columns = (min(side, LARGEST) for side in picture.shape)
    top, left = (
        (side - own) // 2 for side, own in zip(picture.shape, (rows, columns), strict=True)
    )
    return np.ascontiguousarray(picture[top : top + rows, left : left + columns])


def shift_between(reference: Image, moving: Image) -> Shift:
    """The shift of a picture against a reference, both linear light ``(y, x)`` of one size."""
    first, second = (gradient_picture(middle(one)) for one in (reference, moving))
    return ecc_shift(first, second)


def ecc_shift(first: Image, second: Image) -> Shift:
    """The shift between two pictures whose values go together.

    Parameters
    ----------
    first, second
        ``(y, x)`` of one size, such as :func:`gradient_picture` makes.
    """
    import cv2

    phase_x, phase_y = phase_shift(first, second)
    near = float(np.hypot(phase_x, phase_y)) <= FARTHEST
    start = (phase_x, phase_y) if near else (0.0, 0.0)
    warp = np.array([[1.0, 0.0, start[0]], [0.0, 1.0, start[1]]], dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, STEPS, EPSILON)
    try:
        score, warp = cv2.findTransformECC(
            first, second, warp, cv2.MOTION_TRANSLATION, stop, None, SMOOTH
        )
    except cv2.error:
        # OpenCV says so where the iteration does not converge, as without any structure.
        return Shift(0.0, 0.0, 0.0, phase_x, phase_y, "no structure in common with the reference")
    x, y = float(warp[0, 2]), float(warp[1, 2])
    refused = ""
    if not score >= LEAST_SCORE:
        refused = f"correlation {score:.2f} with the reference is below {LEAST_SCORE}"
    elif np.hypot(x, y) > FARTHEST:
        refused = f"a shift of {np.hypot(x, y):.1f} pixels is more than {FARTHEST:g}"
    elif np.hypot(x - phase_x, y - phase_y) > APART:
        refused = f"phase correlation says ({phase_x:.2f}, {phase_y:.2f}), ECC ({x:.2f}, {y:.2f})"
    if refused:
        return Shift(0.0, 0.0, float(score), phase_x, phase_y, refused)
    return Shift(x, y, float(score), phase_x, phase_y)


def phase_shift(first: Image, second: Image) -> tuple[float, float]:
    """By phase correlation with a Hann window.

    Borders are left out where OpenCV would pad the pictures to an odd size: it then is off by half
    a pixel.
    """
    import cv2

    rows, columns = (_even(side) for side in first.shape)
    one, other = (picture[:rows, :columns] for picture in (first, second))
    window = cv2.createHanningWindow((columns, rows), cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(one - one.mean(), other - other.mean(), window)
    return float(x), float(y)


def _even(side: int) -> int:
    """The largest even length, up to a side, that OpenCV's transform does not pad."""
    import cv2

    fitting = (n for n in range(side - side % 2, 1, -2) if cv2.getOptimalDFTSize(n) == n)
    return next(fitting, side)

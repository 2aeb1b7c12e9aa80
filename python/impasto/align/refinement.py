"""Shifts between photographs of pairs of lamps: Lucas and Kanade's method [@lucas1981registration].

Relief that is lit from opposite sides swaps bright and dark slopes. The magnitude of the gradient
of the logarithm of the light hardly changes with that: edges of colour stay, and a slope keeps its
outline. On it the flow of a grid of windows is found in pyramids; its median is the shift. That was
better than ECC maximisation and phase correlation where any of them was within half a pixel, but
for one case that is refused (``benches/results/alignment.json``). A shift that is far from that of
phase correlation [@kuglin1975phase] of the same pictures is refused.
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
BRIGHT = 99.5
"""Percentile of the gradient that becomes the largest code of what is compared."""
WINDOW = 31
"""Rows and columns of the windows whose flow is found."""
LEAST_WINDOWS = 16
LARGEST = 1024
"""Rows and columns of the middle part that is compared at most."""
FARTHEST = 8.0
"""Largest shift in pixels: marks are better than that, unless one of them moved."""
APART = 1.0
"""Pixels by which both methods may differ."""
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
    phase_x, phase_y = phase_shift(first, second)
    flow = lucas_kanade(first, second)
    if flow is None:
        none = "no structure in common with the reference"
        return Shift(0.0, 0.0, 0.0, phase_x, phase_y, none)
    x, y = flow
    score = _correlation(first, second, x, y)
    refused = ""
    if not score >= LEAST_SCORE:
        refused = f"correlation {score:.2f} with the reference is below {LEAST_SCORE}"
    elif np.hypot(x, y) > FARTHEST:
        refused = f"a shift of {np.hypot(x, y):.1f} pixels is more than {FARTHEST:g}"
    elif np.hypot(x - phase_x, y - phase_y) > APART:
        refused = (
            f"phase correlation says ({phase_x:.2f}, {phase_y:.2f}), Lucas and Kanade's method "
            f"({x:.2f}, {y:.2f})"
        )
    if refused:
        return Shift(0.0, 0.0, score, phase_x, phase_y, refused)
    return Shift(x, y, score, phase_x, phase_y)


def lucas_kanade(first: Image, second: Image) -> tuple[float, float] | None:
    """The median flow of a grid of windows in pyramids; None where no window has structure."""
    import cv2

    one, other = (
        np.rint(
            255.0 * np.clip(picture / max(float(np.percentile(picture, BRIGHT)), 1e-12), 0, 1)
        ).astype(np.uint8)
        for picture in (first, second)
    )
    places = [
        np.arange(WINDOW // 2, side - WINDOW // 2, WINDOW // 2, dtype=np.float32)
        for side in first.shape[::-1]
    ]
    points = np.stack(np.meshgrid(*places), axis=-1).reshape(-1, 1, 2)
    if not len(points):
        return None
    flow, seen, _ = cv2.calcOpticalFlowPyrLK(
        one, other, points, np.empty_like(points), winSize=(WINDOW, WINDOW)
    )
    found = (flow - points)[np.asarray(seen).ravel() == 1].reshape(-1, 2)
    if len(found) < LEAST_WINDOWS:
        return None
    x, y = np.median(found, axis=0).tolist()
    return float(x), float(y)


def _correlation(first: Image, second: Image, x: float, y: float) -> float:
    """Of two pictures, the second moved back by a shift, without their borders."""
    import cv2

    warp = np.array([[1.0, 0.0, x], [0.0, 1.0, y]], dtype=np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    moved = np.asarray(cv2.warpAffine(second, warp, second.shape[::-1], flags=flags))
    edge = round(FARTHEST)
    inner = np.s_[edge:-edge, edge:-edge]
    one, other = (picture[inner].astype(np.float64).ravel() for picture in (first, moved))
    if one.size < 2:
        return 0.0
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0


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

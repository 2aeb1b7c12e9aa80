"""Shifts of photographs against what photometric stereo [@woodham1980photometric] predicts of each.

Where the relief and the colours of a painting go together, as in brush strokes, shading moves edges
along the light: two photographs under opposite lamps are then shifted as far as any method sees. So
each photograph is compared with its own prediction, in which the same lamp shines: Lambert's law
fitted to all photographs by least squares, pixel by pixel. ECC [@evangelidis2008parametric] of
band-passed light gives the shift, the fit is repeated with the photographs moved, and so on.

Shifts that are a linear function of the lamp's slopes change nothing but the fitted surface (they
are a gauge): that part is set to zero, and so is the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from impasto.align.refinement import (
    FARTHEST,
    LEAST_SCORE,
    Image,
    Shift,
    phase_shift,
)

Floats = NDArray[np.float64]

LEAST_LIGHTS = 8
"""Three unknowns of the surface and three of the gauge leave 2 of 8 lights to compare."""
LARGEST_CONDITION = 10.0
"""Condition number of the lamps' directions from which they do not determine a surface."""
SMOOTH = 5
"""Pixels of the Gaussian that ECC applies to both pictures."""
STEPS, EPSILON = 200, 1e-7
ROUNDS = 4
REWEIGHTINGS, HUBER = 20, 1.345
LOWEST = 0.1
"""Least cosine of a lamp."""
CLIPPED = 98.0
"""Percentile of the light above which highlights are cut: Lambert's law knows none."""
FINE, ROUGH = 1.0, 3.0
"""Standard deviations in pixels of the two Gaussians whose difference is the band."""


def predictable(directions: Floats) -> bool:
    """Whether lamps ``(n, 3)`` are enough for :func:`relit_shifts`."""
    return len(directions) >= LEAST_LIGHTS and float(np.linalg.cond(directions)) < LARGEST_CONDITION


def relit_shifts(
    pictures: Sequence[Image],
    directions: Floats,
    advance: Callable[[int, int], None] | None = None,
) -> list[Shift]:
    """The shift of each photograph.

    Parameters
    ----------
    pictures
        ``(y, x)`` linear light of one part of the painting, all of one size, of any exposure.
    directions
        ``(n, 3)`` unit vectors to the lamps.
    advance
        Called with rounds done and all.

    Returns
    -------
    list
        With phase correlation of the photograph and its prediction beside each shift. A shift that
        ECC does not find stays 0.
    """
    import cv2

    count = len(pictures)
    shape = pictures[0].shape
    shifts, scores = np.zeros((count, 2)), np.zeros(count)
    fit = directions @ np.linalg.pinv(directions)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, STEPS, EPSILON)
    # A flat panel has the cosine of the lamp as its median, whatever lamp and exposure were.
    levels = [max(float(np.median(one)), 1e-6) for one in pictures]
    scaled = [
        one * np.float32(max(float(z), LOWEST) / level)
        for one, z, level in zip(pictures, directions[:, 2], levels, strict=True)
    ]
    limit = float(np.mean([np.percentile(one, CLIPPED) for one in scaled]))
    cut = [np.minimum(one, np.float32(limit)) for one in scaled]
    bands = [_band(one) for one in cut]
    first = np.zeros((count, 2))
    for turn in range(ROUNDS):
        moved = np.stack([_moved(one, shift) for one, shift in zip(cut, shifts, strict=True)])
        predicted = (fit @ moved.reshape(count, -1)).reshape(count, *shape).astype(np.float32)
        for index, band in enumerate(bands):
            own = _band(predicted[index])
            x, y = shifts[index].tolist()
            warp = np.array([[1.0, 0.0, x], [0.0, 1.0, y]], dtype=np.float32)
            try:
                scores[index], warp = cv2.findTransformECC(
                    own, band, warp, cv2.MOTION_TRANSLATION, stop, None, SMOOTH
                )
                shifts[index] = warp[0, 2], warp[1, 2]
            except cv2.error:  # no structure: OpenCV's iteration does not converge
                scores[index] = 0.0
            if turn == ROUNDS - 1:
                first[index] = phase_shift(own, band)
        shifts = without_gauge(shifts, directions)
        if advance is not None:
            advance(turn + 1, ROUNDS)
    return [
        _judged(shift, float(score), phase)
        for shift, score, phase in zip(shifts.tolist(), scores, first.tolist(), strict=True)
    ]


def without_gauge(shifts: Floats, directions: Floats) -> Floats:
    """Shifts ``(n, 2)`` less what the directions of the lamps explain.

    That is their mean, what is linear in x / z and y / z (the gauge), and what lies along the lamp
    in proportion to the sine of its angle from the front, as shadows and gloss do. Iteratively
    reweighted least squares with Huber's weights [@huber1964]: a few photographs that did move
    keep their shifts.
    """
    count = len(shifts)
    slopes = directions[:, :2] / np.maximum(directions[:, 2:], LOWEST)
    linear = np.column_stack([np.ones(count), slopes])
    none = np.zeros_like(linear)
    columns = np.block([
        [linear, none, directions[:, :1]],
        [none, linear, -directions[:, 1:2]],  # rows run down
    ])  # fmt: skip
    right = shifts.T.ravel()
    weight = np.ones(2 * count)
    left = right
    for _ in range(REWEIGHTINGS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(columns * root[:, None], right * root, rcond=None)[0]
        left = right - columns @ found
        off = np.linalg.norm(left.reshape(2, -1), axis=0)
        scale = max(float(np.median(off)) / 1.18, 1e-3)  # of a Rayleigh distribution
        weight = np.tile(np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-12)), 2)
    return np.asarray(left.reshape(2, -1).T)


def _judged(shift: list[float], score: float, phase: list[float]) -> Shift:
    x, y = shift
    refused = ""
    if not score >= LEAST_SCORE:
        refused = f"correlation {score:.2f} with its prediction is below {LEAST_SCORE}"
    elif np.hypot(x, y) > FARTHEST:
        refused = f"a shift of {np.hypot(x, y):.1f} pixels is more than {FARTHEST:g}"
    if refused:
        return Shift(0.0, 0.0, score, phase[0], phase[1], refused)
    return Shift(x, y, score, phase[0], phase[1])


def _moved(picture: Image, shift: Floats) -> Image:
    import cv2

    warp = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]], dtype=np.float32)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = picture.shape[::-1]
    return np.asarray(
        cv2.warpAffine(picture, warp, size, flags=flags, borderMode=cv2.BORDER_REFLECT), np.float32
    )


def _band(picture: Image) -> Image:
    """Difference of Gaussians [@marr1980edge] of the root, whose noise of photons is even."""
    import cv2

    root = np.sqrt(np.maximum(picture, 0.0))
    fine, rough = (cv2.GaussianBlur(root, (0, 0), sigma) for sigma in (FINE, ROUGH))
    return np.asarray(fine - rough, np.float32)

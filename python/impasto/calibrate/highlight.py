"""The highlight of a lamp on a mirror ball: where it is, how well that is known, or why not.

Pixels of at least ``LEVEL`` of the brightest one inside the outline, without what is as bright in
all photographs (windows, lamps of the room), form connected components; that with the largest sum
is the highlight. Its place is the weighted centroid of its pixels. The weight is the height above
the threshold times the squared distance from the edge of the component (distance transform
[@felzenszwalb2012distance]): the streaks and spikes that scratches and lenses draw through a
clipped highlight are thin, and count little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.geometry import Array, BallCamera
from impasto.errors import ArgumentError

Rule: TypeAlias = Literal["centroid", "median"]
"""``"centroid"``: as above. ``"median"``: the median column and row of all pixels from code 250 on
of 8-bit luma, the rule by which the directions of Xiong's data set were made [@xiong2014psbox]."""

LEVEL = 0.9
LEVELS = (0.8, 0.9, 0.97)
"""Thresholds whose centroids say how much the place depends on the threshold."""
RIM = 0.95
"""Highlights are looked for within this part of the radius: at the rim a mirror shows what is
behind it, squeezed into a few pixels."""
CONTRAST = 4.0
"""Least ratio of a highlight to the 90th percentile of the ball."""
SECOND = 0.4
"""A second component of that part of the largest one's sum is a second lamp."""
APART = 3.0
"""Components closer than that many widths of the largest one belong to it: a split highlight."""
TOO_LARGE = 0.08
"""Share of the ball that no highlight of a lamp covers."""
MEDIAN_CODE = 250


@dataclass(frozen=True, slots=True)
class Highlight:
    """Where a lamp is mirrored.

    Parameters
    ----------
    x, y
        Pixels.
    sigma
        Standard deviation of each, in pixels: that of the centroids at the thresholds of
        ``LEVELS``, and that of counting whole pixels, 1 / sqrt(12 n) with n pixels on the edge of
        the component, as independent errors.
    pixels
        Size of the component.
    clipped
        Share of its pixels at the largest code of the file.
    """

    x: float
    y: float
    sigma: float
    pixels: int
    clipped: float


def luma(codes: NDArray[Any]) -> Array:
    """``(y, x)`` from ``(band, y, x)``: Rec. 601 of three bands, else their mean."""
    planes = np.asarray(codes, dtype=np.float64)
    if len(planes) == 3:
        return np.asarray(0.299 * planes[0] + 0.587 * planes[1] + 0.114 * planes[2])
    return np.asarray(planes.mean(axis=0))


def median_highlight(picture: Array, where: str) -> Highlight:
    """The published rule of Xiong's data set: the median place of pixels from 250 on.

    Parameters
    ----------
    picture
        ``(y, x)``: 8-bit luma of the whole photograph.
    where
        The photograph, for messages.
    """
    y, x = np.nonzero(np.rint(picture) >= MEDIAN_CODE)
    if not len(x):
        raise ArgumentError(
            f"{where}: no pixel reaches code {MEDIAN_CODE} (the largest is {picture.max():.0f}), "
            'so there is no highlight for rule="median"; rule="centroid" needs no code'
        )
    # Half a pixel of the median of whole numbers, whatever their number.
    sigma = 0.5 / np.sqrt(3.0)
    return Highlight(float(np.median(x)), float(np.median(y)), sigma, len(x), 1.0)


def find_highlight(
    picture: Array,
    outline: Array,
    camera: BallCamera,
    where: str,
    *,
    still: Array | None = None,
    full: float | None = None,
) -> Highlight:
    """The highlight of one lamp in a photograph of a ball.

    Parameters
    ----------
    picture
        ``(y, x)``: brightness.
    outline
        ``(3,)``: of the ball, in pixels of ``picture``.
    camera
        With its principal point in pixels of ``picture``.
    where
        The photograph, for messages.
    still
        ``(y, x)``: what all photographs have in common, their minimum.
    full
        Brightness of a clipped pixel, if known.

    Raises
    ------
    ArgumentError
        No highlight, two of them, one at the rim, or so large a clipped area that no place is left.
    """
    import cv2

    rows, columns = np.indices(picture.shape)
    scaled = np.array([outline[0], outline[1], RIM * outline[2]])
    places = np.stack([columns, rows], axis=-1).astype(np.float64)
    inside = camera.off_outline(scaled, places) < 0.0
    if not inside.any():
        raise ArgumentError(f"{where}: the outline lies outside the photograph")
    values = np.where(inside, picture, 0.0)
    if not np.isfinite(values).all():
        count = int((~np.isfinite(values)).sum())
        raise ArgumentError(
            f"{where}: {count} pixels of the ball are NaN or infinite; write the file again"
        )
    if still is not None:
        values = np.where(still >= 0.5 * values.max(), 0.0, values)
    peak = float(values.max())
    common = float(np.quantile(picture[inside], 0.9))
    bright = int((values >= LEVEL * peak).sum())
    if full is not None and peak >= full and bright > TOO_LARGE * int(inside.sum()):
        raise ArgumentError(
            f"{where}: clipped pixels cover {100 * bright / int(inside.sum()):.0f} % of the ball: "
            "it is overexposed; expose less, so that the lamp alone is clipped"
        )
    if not peak > 0.0 or peak < CONTRAST * common:
        raise ArgumentError(_none(where, picture, outline, peak, common, camera))
    component, others = _components(values, LEVEL * peak)
    mask, flux = component
    size = int(mask.sum())
    if size > TOO_LARGE * int(inside.sum()):
        raise ArgumentError(
            f"{where}: the highlight covers {100 * size / int(inside.sum()):.0f} % of the ball: "
            "it is overexposed; expose less, so that the lamp alone is clipped"
        )
    x, y = _centroid(values, mask, LEVEL * peak)
    width = np.sqrt(size / np.pi)
    for other_x, other_y, other in others:
        if other > SECOND * flux and np.hypot(other_x - x, other_y - y) > APART * 2.0 * width:
            raise ArgumentError(
                f"{where}: two highlights, at ({x:.0f}, {y:.0f}) and ({other_x:.0f}, "
                f"{other_y:.0f}), the second with {100 * other / flux:.0f} % of the light of the "
                "first: two lamps were on; light one lamp at a time, or leave this photograph out"
            )
    if camera.off_outline(scaled, np.array([x, y])) > -2.0:
        raise ArgumentError(_at_the_rim(where, x, y))
    spread = []
    for level in LEVELS:
        (own, _), _ = _components(values, level * peak)
        spread.append(_centroid(values, own, level * peak))
    scatter = float(np.square(np.std(np.array(spread), axis=0, ddof=1)).mean())
    border = mask & ~np.asarray(
        cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)), dtype=bool
    )
    sigma = float(np.sqrt(scatter + 1.0 / (12.0 * int(border.sum()))))
    clipped = 0.0 if full is None else float((picture[mask] >= full).mean())
    return Highlight(x, y, sigma, size, clipped)


def _components(
    values: Array, level: float
) -> tuple[tuple[NDArray[np.bool_], float], list[tuple[float, float, float]]]:
    """The largest component as mask and sum; x, y and sum of the others."""
    import cv2

    above = (values >= level).astype(np.uint8)
    count, labels, _, centres = cv2.connectedComponentsWithStats(above, connectivity=8)
    sums = np.bincount(np.asarray(labels).ravel(), values.ravel(), minlength=count)
    sums[0] = 0.0
    best = int(sums.argmax())
    others = [
        (float(centres[each][0]), float(centres[each][1]), float(sums[each]))
        for each in range(1, count)
        if each != best
    ]
    return (np.asarray(labels == best), float(sums[best])), others


def _centroid(values: Array, mask: NDArray[np.bool_], level: float) -> tuple[float, float]:
    """On a grid finer than the pixels, so that the edge of a small component is exact, too."""
    import cv2

    rows, columns = np.nonzero(mask)
    top, left = max(rows.min() - 2, 0), max(columns.min() - 2, 0)
    window = (slice(top, rows.max() + 3), slice(left, columns.max() + 3))
    grown = cv2.dilate(mask[window].astype(np.uint8), np.ones((3, 3), np.uint8))
    # Between the pixels nothing is as bright as a single one: the finer grid may miss it.
    for finer in (8, 1) if len(rows) < 2000 else (1,):
        size = (grown.shape[1] * finer, grown.shape[0] * finer)
        near = cv2.resize(grown, size, interpolation=cv2.INTER_NEAREST)
        fine = cv2.resize(values[window], size, interpolation=cv2.INTER_LINEAR)
        own = ((np.asarray(fine) >= level) & (np.asarray(near) > 0)).astype(np.uint8)
        if own.any():
            break
    own = np.pad(own, 1)
    depth = np.asarray(cv2.distanceTransform(own, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))[1:-1, 1:-1]
    y, x = np.nonzero(own[1:-1, 1:-1])
    height = np.asarray(fine, dtype=np.float64)[y, x] - level
    # A component of one code has no height: every pixel is as high.
    height = height + max(float(height.max()), level) * 1e-3
    weight = height * np.square(depth[y, x].astype(np.float64))
    column, row = (float((at * weight).sum() / weight.sum()) for at in (x, y))
    return (column + 0.5) / finer - 0.5 + float(left), (row + 0.5) / finer - 0.5 + float(top)


def _none(
    where: str, picture: Array, outline: Array, peak: float, common: float, camera: BallCamera
) -> str:
    rows, columns = np.indices(picture.shape)
    places = np.stack([columns, rows], axis=-1).astype(np.float64)
    off = camera.off_outline(outline, places)
    rim = np.where(
        (off < -max(3.0, 0.015 * outline[2])) & (off > -(1.0 - RIM) * outline[2]), picture, 0.0
    )
    if float(rim.max()) > CONTRAST * common and rim.max() > peak:
        y, x = np.unravel_index(int(rim.argmax()), rim.shape)
        return _at_the_rim(where, float(x), float(y))
    ratio = f"{peak / common:.1f} times" if common > 0.0 else "not above"
    return (
        f"{where}: no highlight on the ball: its brightest pixel is {ratio} the 90th percentile "
        f"of the ball, at least {CONTRAST:g} times is needed; was the lamp on, and does the "
        "outline fit?"
    )


def _at_the_rim(where: str, x: float, y: float) -> str:
    return (
        f"{where}: the highlight at ({x:.0f}, {y:.0f}) is at the rim of the ball, where a "
        "mirror shows what is behind it: no lamp that lights the painting is seen there; look "
        "for a reflection or a wrong outline"
    )

"""Disparities of tiles between two rectified pictures: Lucas and Kanade [@lucas1981registration].

The flow of a window around each tile is found in pyramids, to and fro (OpenCV). Only its part along
the epipolar line can be relief; how exact a window tells that is in its structure tensor and in how
well both windows correlate: noise has structure, too, but none in common. The part across the line
is error alone, and says how large errors of a photograph are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.align.refinement import BRIGHT, gradient_picture

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

OVERLAP = 2.0
"""Width of a window in distances between tiles."""
LEVELS = 3
"""Halvings of the pictures: flows up to about a hundred pixels are found."""
ROUND_TRIP = 0.5
"""Pixels by which a flow to and fro may miss its start."""
LEAST_CORRELATION = 0.5
"""Of two windows; below, they show noise, or a highlight."""
PATCHES = 1 << 14
"""Rows of windows side by side that are resampled at a time: OpenCV takes less than 32768."""
CHI_SQUARE_MEDIAN = 0.4549
"""Median of the square of a normal deviate."""
LEAST_TILES = 12
"""Below, a photograph says nothing of its own errors."""


@dataclass(frozen=True, eq=False)
class Tiles:
    """The tiles of a rectified picture.

    Attributes
    ----------
    window
        Rows and columns of the windows whose flow is found.
    pixels
        ``(n, 2)`` columns and rows of the middles.
    structure
        ``(n, 2, 2)`` structure tensors of the reference: sums over the window of products of the
        slopes, in squared codes per squared pixel.
    variance
        ``(n,)`` of the codes in the window.
    codes
        ``(y, x)`` what is compared.
    seen
        ``(n,)``: whether the whole window is seen.
    """

    window: int
    pixels: NDArray[np.float32]
    structure: Floats
    variance: Floats
    codes: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def tiles_of(light: Image, seen: NDArray[np.bool_], window: int) -> Tiles:
    """The tiles of a reference.

    Parameters
    ----------
    light
        ``(y, x)`` rectified linear light.
    seen
        ``(y, x)``: where the photograph shows the painting.
    window
        Rows and columns of windows, odd; tiles are half as far apart.
    """
    import cv2

    middles = [_middles(side, window) for side in light.shape[::-1]]
    pixels = np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, 2).astype(np.float32)
    codes = compared(light)
    slopes = [
        cv2.Scharr(codes, cv2.CV_32F, dx, 1 - dx, scale=1.0 / 32.0).astype(np.float64)
        for dx in (1, 0)
    ]
    columns, rows = pixels.astype(int).T

    def sums(one: Floats, other: Floats) -> Floats:
        total = cv2.boxFilter(one * other, -1, (window, window), normalize=False)
        return np.asarray(total[rows, columns])

    across, down = slopes
    mixed = sums(across, down)
    structure = np.stack([sums(across, across), mixed, mixed, sums(down, down)], axis=-1)
    values, ones = codes.astype(np.float64), np.ones(codes.shape)
    mean, square = (sums(values, one) / window**2 for one in (ones, values))
    whole = cv2.erode(seen.astype(np.uint8), np.ones((window, window), np.uint8))
    return Tiles(
        window, pixels, structure.reshape(-1, 2, 2), np.maximum(square - mean**2, 0.0), codes,
        whole[rows, columns] > 0,
    )  # fmt: skip


def _middles(side: int, window: int) -> Floats:
    half = window // 2
    count = max(1, 1 + int((side - window) * OVERLAP / window))
    return np.rint(np.linspace(half, max(side - 1 - half, half), count))


def compared(light: Image) -> NDArray[np.uint8]:
    """``(y, x)`` codes of the gradient's magnitude, which hardly depends on the lamp."""
    size = gradient_picture(light)
    top = max(float(np.percentile(size, BRIGHT)), 1e-12)
    return np.asarray(np.rint(255.0 * np.clip(size / top, 0.0, 1.0)), np.uint8)


@dataclass(frozen=True, eq=False)
class Disparities:
    """What one photograph says of the heights of tiles.

    Attributes
    ----------
    along_px
        ``(n,)`` disparities along the epipolar lines, in pixels.
    height_mm
        ``(n,)`` heights that they mean, beyond those that the pictures were rectified with.
    weight
        ``(n,)`` inverse variances of these heights; 0 where nothing was found.
    across_px
        Root mean square of the part across the lines; NaN where it is not known.
    """

    along_px: Floats
    height_mm: Floats
    weight: Floats
    across_px: float


def disparities(tiles: Tiles, light: Image, seen: NDArray[np.bool_], slope: Floats) -> Disparities:
    """Heights of tiles from one photograph and the reference.

    Parameters
    ----------
    tiles
        Of the reference.
    light, seen
        ``(y, x)`` the photograph, rectified to the same pixels.
    slope
        ``(n, 2)``: by how many pixels (columns, rows) each tile moves for a mm of height, beyond
        what it moves in the reference.
    """
    flow, found, correlation = _flow(tiles, light, seen)
    found &= correlation >= LEAST_CORRELATION
    # Slopes over what differs between the windows: Gauss and Newton's information.
    g = tiles.structure / (tiles.variance * (1.0 - correlation**2) + 1e-3)[:, None, None]
    pull = np.einsum("nij,nj->ni", g, slope)
    information = np.einsum("ni,ni->n", pull, slope)
    found &= information > 0.0
    height = np.where(found, np.einsum("ni,ni->n", pull, flow), 0.0)
    height = height / np.where(found, information, 1.0)
    left = flow - height[:, None] * slope
    misfit = np.einsum("ni,nij,nj->n", left, g, left)
    length = np.linalg.norm(slope, axis=1)
    if found.sum() < LEAST_TILES:
        none = np.zeros(len(flow))
        return Disparities(none, none, none, float("nan"))
    variance = max(float(np.median(misfit[found])) / CHI_SQUARE_MEDIAN, 1e-9)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1) / np.maximum(length, 1e-12)[:, None]
    across = np.einsum("ni,ni->n", flow, normal)[found]
    return Disparities(
        height * length, height, np.where(found, information / variance, 0.0),
        float(np.sqrt(np.square(across).mean())),
    )  # fmt: skip


def _flow(
    tiles: Tiles, light: Image, seen: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Flows ``(n, 2)`` in pixels, where they agree there and back, and correlations of windows."""
    import cv2

    codes = compared(light)
    start = tiles.pixels.reshape(-1, 1, 2)
    window = tiles.window, tiles.window
    options: dict[str, Any] = {"winSize": window, "maxLevel": LEVELS}
    there, forth, _ = cv2.calcOpticalFlowPyrLK(
        tiles.codes, codes, start, np.empty_like(start), **options
    )
    back, again, _ = cv2.calcOpticalFlowPyrLK(
        codes, tiles.codes, there, np.empty_like(there), **options
    )
    flow = (there - start).reshape(-1, 2).astype(np.float64)
    missed = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    found = (forth.ravel() == 1) & (again.ravel() == 1) & (missed < ROUND_TRIP) & tiles.seen
    rows, columns = light.shape
    at = np.clip(np.rint(np.nan_to_num(there.reshape(-1, 2))), 0, (columns - 1, rows - 1))
    at = at.astype(int)
    whole = cv2.erode(seen.astype(np.uint8), np.ones(window, np.uint8))
    found &= np.isfinite(flow).all(axis=1) & (whole[at[:, 1], at[:, 0]] > 0)
    flow = np.where(found[:, None], flow, 0.0)
    places = tiles.pixels + flow.astype(np.float32)
    return flow, found, _correlations(tiles, codes, places)


def _correlations(tiles: Tiles, codes: NDArray[np.uint8], places: NDArray[np.float32]) -> Floats:
    """``(n,)``: of the windows of the reference and those about places ``(n, 2)`` of a picture."""
    found = np.empty(len(places))
    step = max(1, PATCHES // tiles.window)
    for start in range(0, len(places), step):
        part = slice(start, start + step)
        first = _windows(tiles.codes, tiles.pixels[part], tiles.window)
        other = _windows(codes, places[part], tiles.window)
        found[part] = np.einsum("ni,ni->n", first, other)
    return np.clip(found, -1.0, 1.0)


def _windows(codes: NDArray[np.uint8], middles: NDArray[np.float32], window: int) -> Floats:
    """``(n, pixels)``: windows about places, without their means, of length 1 (0 for even ones)."""
    import cv2

    offset = np.arange(window, dtype=np.float32) - window // 2
    x = np.broadcast_to(middles[:, 0, None, None] + offset, (len(middles), window, window))
    y = np.broadcast_to(middles[:, 1, None, None] + offset[:, None], x.shape)
    right, below = (np.ascontiguousarray(one).reshape(-1, window) for one in (x, y))
    cut = cv2.remap(codes, right, below, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    found = np.asarray(cut, np.float64).reshape(len(middles), -1)
    found -= found.mean(axis=1, keepdims=True)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))

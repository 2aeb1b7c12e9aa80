"""Where two frames show the same: patches of both on the pixels of the merged painting.

Shifts of a patch are found by the method of Lucas and Kanade [@lucas1981registration] in the
logarithm of the diffuse luminance and in both slopes, which no lamp changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto.merge.adjustment import Matches, Pair
from impasto.merge.frames import Frame
from impasto.merge.placement import Placement
from impasto.merge.resampling import REACH, Samples

Floats = NDArray[np.float64]

SIDES = (64, 48, 32, 24, 16)
"""Rows and columns of a patch: the largest of which the overlap holds enough."""
ENOUGH = 24
"""Patches of a pair at which larger ones are preferred to more of them."""
MOST_PATCHES = 100
"""Patches of a pair, evenly spread."""
BLOCK = 16
"""Rows and columns of a block of a patch, of which means are taken."""
PIXELS = 3
"""Of so many rows and columns of a patch one pixel is kept, for what single pixels say."""
ITERATIONS = 8
FARTHEST = 3.0
"""Pixels by which a patch may be shifted, times the smoothing."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of the merged painting in two frames.

    Attributes
    ----------
    left, top
        Its first column and row.
    diffuse, normal
        Of both frames: ``(2, band, n, n)`` and ``(2, 3, n, n)``, normals rotated with the frames.
        NaN where either frame knows nothing.
    """

    left: int
    top: int
    diffuse: Floats
    normal: Floats


@dataclass(frozen=True, eq=False)
class Overlap:
    """Samples of what two frames share; the first axis is the frame.

    Attributes
    ----------
    diffuse, normal
        ``(2, n, band)`` and ``(2, n, 3)``: means over blocks of 16 x 16 pixels of both frames.
    pixel_diffuse, pixel_normal
        The same of single pixels.
    pixels
        How many pixels of the merged painting both frames cover.
    """

    diffuse: Floats
    normal: Floats
    pixel_diffuse: Floats
    pixel_normal: Floats
    pixels: int


def overlapping(
    frames: Sequence[Frame], placements: Sequence[Placement]
) -> dict[Pair, tuple[int, list[tuple[int, int]], int]]:
    """Side of the patches, their first columns and rows, and the shared pixels, for every pair."""
    found = {}
    for i in range(len(frames)):
        for j in range(i + 1, len(frames)):
            area = _area(frames, placements, (i, j))
            if area is None:
                continue
            side, corners, pixels = area
            if corners:
                found[i, j] = side, corners, pixels
    return found


def patches(
    frames: Sequence[Frame],
    placements: Sequence[Placement],
    pair: Pair,
    side: int,
    corners: Sequence[tuple[int, int]],
) -> Iterator[Patch]:
    """Patches in both frames of a pair, each read alone."""
    for left, top in corners:
        x, y = (
            one.ravel().astype(np.float64)
            for one in np.meshgrid(np.arange(left, left + side), np.arange(top, top + side))
        )
        colours, normals = [], []
        for k in pair:
            diffuse, normal = _resampled(frames[k], placements[k], x, y)
            colours.append(diffuse)
            normals.append(normal)
        diffuse, normal = np.stack(colours), np.stack(normals)
        known = np.isfinite(normal).all(axis=(0, 1)) & np.isfinite(diffuse).all(axis=(0, 1))
        diffuse[..., ~known], normal[..., ~known] = np.nan, np.nan
        yield Patch(
            left,
            top,
            diffuse.reshape(2, -1, side, side),
            normal.reshape(2, 3, side, side),
        )


def matched(
    frames: Sequence[Frame],
    placements: Sequence[Placement],
    smoothing: float,
    *,
    most: int = MOST_PATCHES,
    precision: float = 0.002,
) -> dict[Pair, Matches]:
    """Where patches of all pairs lie in both frames.

    Parameters
    ----------
    frames, placements
        The frames, and where they lie as far as is known.
    smoothing
        Standard deviation in pixels; the farther a patch may be off, the more.
    most
        Patches of a pair at most.
    precision
        Pixels at which the search for a shift ends.
    """
    found = {}
    for pair, (side, corners, _) in overlapping(frames, placements).items():
        first, second, weights = [], [], []
        for patch in patches(frames, placements, pair, side, _spread(corners, most)):
            shift = _shift(patch, smoothing, precision)
            if shift is None:
                continue
            move, weight = shift
            middle = np.array([[patch.left + (side - 1) / 2, patch.top + (side - 1) / 2]])
            first.append(placements[pair[0]].inverse.to(middle)[0])
            second.append(placements[pair[1]].inverse.to(middle + move)[0])
            weights.append(weight)
        if first:
            found[pair] = Matches(np.array(first), np.array(second), np.array(weights))
    return found


def sampled(frames: Sequence[Frame], placements: Sequence[Placement]) -> dict[Pair, Overlap]:
    """Colours and normals of both frames of every pair, for gains, levels and what is left."""
    found = {}
    for pair, (side, corners, pixels) in overlapping(frames, placements).items():
        means, single = [], []
        for patch in patches(frames, placements, pair, side, corners):
            both = np.concatenate([patch.diffuse, patch.normal], axis=1)
            single.append(both[..., ::PIXELS, ::PIXELS].reshape(2, both.shape[1], -1))
            means.append(_block_means(both))
        blocks, points = (_known(np.concatenate(one, axis=-1)) for one in (means, single))
        bands = blocks.shape[-1] - 3
        if blocks.shape[1]:
            found[pair] = Overlap(
                blocks[..., :bands], blocks[..., bands:], points[..., :bands], points[..., bands:],
                pixels,
            )  # fmt: skip
    return found


def _known(values: Floats) -> Floats:
    """``(2, n, k)`` of ``(2, k, n)``: the columns without NaN."""
    return np.moveaxis(values[..., np.isfinite(values).all(axis=(0, 1))], 1, 2)


def _block_means(planes: Floats) -> Floats:
    side = planes.shape[-1] // BLOCK * BLOCK
    cut = planes[..., :side, :side]
    blocks = cut.reshape(*cut.shape[:2], side // BLOCK, BLOCK, -1, BLOCK)
    return np.asarray(blocks.mean(axis=(3, 5)).reshape(*cut.shape[:2], -1))


def _area(
    frames: Sequence[Frame], placements: Sequence[Placement], pair: Pair
) -> tuple[int, list[tuple[int, int]], int] | None:
    """Side of patches, their first columns and rows, and shared pixels; None: no overlap."""
    corners = [placements[k].corners(frames[k].shape) for k in pair]
    low = np.ceil(np.max([one.min(axis=0) for one in corners], axis=0)).astype(int)
    high = np.floor(np.min([one.max(axis=0) for one in corners], axis=0)).astype(int) + 1
    width, height = (high - low).tolist()
    if min(width, height) < SIDES[-1]:
        return None
    step = max(1, max(width, height) // 512)
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    shared = _inside(frames, placements, pair, x.ravel(), y.ravel(), 0.0)
    pixels = int(shared.sum()) * step * step
    best: tuple[int, NDArray[np.int_]] | None = None
    for side in SIDES:
        found = _corners(low, high, side)
        fine = np.ones(len(found), np.bool_)
        for right, down in ((0, 0), (side - 1, 0), (0, side - 1), (side - 1, side - 1)):
            places = found + np.array((right, down))
            fine &= _inside(frames, placements, pair, places[:, 0], places[:, 1], float(REACH))
        found = found[fine]
        if best is None or len(found) > len(best[1]):
            best = side, found
        if len(found) >= ENOUGH:
            break
    assert best is not None
    side, found = best
    return side, _spread([(int(a), int(b)) for a, b in found], MOST_PATCHES), pixels


def _spread(corners: Sequence[tuple[int, int]], most: int) -> list[tuple[int, int]]:
    """At most so many of them, evenly chosen."""
    count = min(len(corners), most)
    return [corners[at] for at in np.linspace(0, len(corners) - 1, count).round().astype(int)]


def _corners(low: NDArray[np.int_], high: NDArray[np.int_], side: int) -> NDArray[np.int_]:
    """First columns and rows of patches half a side apart, evenly spread."""
    axes = []
    for start, stop in zip(low, high, strict=True):
        last = max(stop - side, start)
        count = 2 * (last - start) // side + 1
        axes.append(np.linspace(start, last, max(count, 3)).round().astype(int))
    x, y = np.meshgrid(*axes)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _inside(
    frames: Sequence[Frame],
    placements: Sequence[Placement],
    pair: Pair,
    x: NDArray[np.int_],
    y: NDArray[np.int_],
    margin: float,
) -> NDArray[np.bool_]:
    fine = np.ones(len(x), np.bool_)
    for k in pair:
        height, width = frames[k].shape
        column, row = placements[k].back(x.astype(np.float64), y.astype(np.float64))
        fine &= (column >= margin) & (column <= width - 1 - margin)
        fine &= (row >= margin) & (row <= height - 1 - margin)
    return fine


def _resampled(frame: Frame, placement: Placement, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Diffuse colours and rotated normals of a frame at pixels of the merged painting."""
    column, row = placement.back(x, y)
    height, width = frame.shape
    rows = slice(max(int(row.min()) - REACH, 0), min(int(row.max()) + REACH + 2, height))
    columns = slice(max(int(column.min()) - REACH, 0), min(int(column.max()) + REACH + 2, width))
    window = rows.stop - rows.start, columns.stop - columns.start
    samples = Samples.at(column - columns.start, row - rows.start, window)
    diffuse = samples.interpolated(frame.map("diffuse", rows, columns))
    normal = placement.rotation @ samples.interpolated(frame.map("normal", rows, columns))
    return diffuse, normal


def _shift(patch: Patch, smoothing: float, precision: float) -> tuple[Floats, float] | None:
    """By how much the second frame lies right of and below the first, and 1 / variance.

    Lucas and Kanade's least squares with the mean gradient of both frames; planes are scaled by
    their noise, and a gain or a tilt of a frame, which is a constant in them, is taken off.
    """
    planes = _planes(patch)
    if planes is None:
        return None
    one, other = (_smoothed(plane, smoothing) for plane in planes)
    total = np.zeros(2)
    weight = 0.0
    margin = 2 + int(np.ceil(2 * smoothing))
    if one.shape[-1] - 2 * margin < BLOCK:
        margin = 2
    inner = (..., slice(margin, -margin), slice(margin, -margin))
    for _ in range(ITERATIONS):
        moved = _moved(other, total)
        difference = np.asarray((moved - one)[inner])
        difference -= difference.mean(axis=(1, 2), keepdims=True)
        noise = np.maximum(difference.std(axis=(1, 2), keepdims=True), 1e-9)
        middle = 0.5 * (one + moved)
        down, across = (np.asarray(slope) for slope in np.gradient(middle, axis=(1, 2)))
        slopes = np.stack([across[inner], down[inner]])
        slopes -= slopes.mean(axis=(2, 3), keepdims=True)
        slopes /= noise
        difference /= noise
        normal = np.einsum("ikyx,jkyx->ij", slopes, slopes)
        # The second frame shows at p what the first shows at p - shift.
        right = -np.einsum("ikyx,kyx->i", slopes, difference)
        smallest = float(np.linalg.eigvalsh(normal)[0])
        if smallest < 1.0:
            return None
        move = np.linalg.solve(normal, right)
        total = total + move
        if np.abs(total).max() > FARTHEST * (1.0 + smoothing):
            return None
        weight = smallest
        if np.abs(move).max() < precision:
            break
    return total, weight


def _planes(patch: Patch) -> Floats | None:
    """``(2, 3, n, n)``: log luminance and two slopes; gaps have the mean."""
    luminance = patch.diffuse.mean(axis=1)
    known = np.isfinite(luminance).all(axis=0)
    if known.mean() < 0.5:
        return None
    middle = max(float(np.median(luminance[:, known])), 1e-6)
    with np.errstate(invalid="ignore"):
        tone = np.log(np.maximum(luminance, 0.0) + 0.05 * middle)
    planes = np.concatenate([tone[:, None], patch.normal[:, :2]], axis=1)
    planes -= planes[..., known].mean(axis=-1)[..., None, None]
    return np.where(known, planes, 0.0)


def _smoothed(planes: Floats, sigma: float) -> Floats:
    if sigma == 0.0:
        return planes
    import cv2

    return np.stack([cv2.GaussianBlur(plane, (0, 0), sigma) for plane in planes])


def _moved(planes: Floats, shift: Floats) -> Floats:
    """Planes whose value at p is that at p + shift."""
    count, height, width = planes.shape
    x, y = np.meshgrid(np.arange(width) + shift[0], np.arange(height) + shift[1])
    x, y = np.clip(x, 0, width - 1).ravel(), np.clip(y, 0, height - 1).ravel()
    samples = Samples.at(x, y, (height, width))
    found = samples.interpolated(planes.astype(np.float32))
    return found.reshape(count, height, width)


def with_gains(overlap: Overlap, gains: Floats) -> Overlap:
    """Both frames times their gains ``(2, band)``."""
    return replace(
        overlap,
        diffuse=overlap.diffuse * gains[:, None],
        pixel_diffuse=overlap.pixel_diffuse * gains[:, None],
    )


def with_rotations(overlap: Overlap, rotations: Floats) -> Overlap:
    """Both frames' normals after their rotations ``(2, 3, 3)``."""
    turn = np.swapaxes(rotations, 1, 2)
    return replace(overlap, normal=overlap.normal @ turn, pixel_normal=overlap.pixel_normal @ turn)

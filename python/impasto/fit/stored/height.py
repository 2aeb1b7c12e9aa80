"""Height of a painting of any size: a coarse grid of the whole, and overlapping tiles on it.

A tile integrated alone (:func:`impasto.integrate_normals`) has the fine relief of the whole; what
it lacks solves Laplace's equation within the tile, and is smooth away from its borders: an offset,
a tilt, a slow bending. A coarse grid of means over blocks of pixels has what is slow. Two grids as
in domain decomposition with a coarse space [@smith1996domain]: the coarse problem is solved for the
whole by the cosine transform [@simchony1990poisson], every tile for itself, and the difference of
their means over blocks, interpolated, is added to the tile. Neighbouring tiles are blended.

The difference between the means of two blocks is a weighted sum of the slopes between them, the
same that the tiles take. So where slopes are those of a surface, coarse grid and tiles are exact,
and so is the result, up to rounding; where they are not, it differs from the least squares over the
whole by a part of what no surface explains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.height import integrate_normals

Floats = NDArray[np.float64]
Normals = Callable[[slice, slice], NDArray[np.float32]]
"""Reads a window ``(3, rows, columns)`` of a painting's normals."""

CELLS = 2**20
"""Most blocks of a coarse grid, about: 8 MB of a map in double precision."""
FINEST = 16
"""Fewest rows and columns of a block: a sixteenth of the normals' memory."""
HALO = 12
"""Blocks around a tile that are integrated with it. What its borders do to the relief fades within
the outer half, and tiles are blended within the inner half."""
TILE = 768
"""Fewest rows and columns of a tile without these."""
TILE_BLOCKS = 32
"""Fewest blocks along a tile."""
STEEPEST = math.tan(math.radians(80.0))
"""Steepest slope that is used, as in the numerics."""


@dataclass(frozen=True)
class Blocks:
    """Rows and columns of a painting in blocks; the last ones may be smaller.

    Attributes
    ----------
    shape
        ``(y, x)`` of the painting.
    side
        Rows and columns of a block.
    """

    shape: tuple[int, int]
    side: int

    @classmethod
    def of(cls, shape: tuple[int, int]) -> Blocks:
        """Blocks as small as a coarse grid allows."""
        rows, columns = shape
        return cls(shape, max(FINEST, math.isqrt(rows * columns // CELLS) + 1))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of blocks."""
        rows, columns = self.shape
        return -(-rows // self.side), -(-columns // self.side)

    def means(self, values: NDArray[Any], axis: int) -> Floats:
        """Means over the blocks of an axis whose first entry begins one."""
        starts = np.arange(0, values.shape[axis], self.side)
        sums = np.add.reduceat(values, starts, axis=axis, dtype=np.float64)
        counts = np.diff(np.append(starts, values.shape[axis]))
        return np.asarray(np.moveaxis(np.moveaxis(sums, axis, -1) / counts, -1, axis))


def coarse_height(normals: Normals, blocks: Blocks, pitch_mm: float) -> Floats:
    """Means ``(y, x)`` of the height over blocks, mm; their mean is 0.

    The normals are read once, some rows of blocks at a time.
    """
    rows, columns = blocks.shape
    down, across = blocks.grid
    right = np.zeros((down, max(across - 1, 0)))
    below = np.zeros((max(down - 1, 0), across))
    # Height of every row over the first, mean over the columns of each block, and of it the mean
    # over the last rows of blocks.
    walked = np.zeros(across)
    last = np.zeros(across)
    for index in range(down):
        top = index * blocks.side
        bottom = min(top + blocks.side, rows)
        along_x, along_y, usable = _slopes(
            normals(slice(top, min(bottom + 1, rows)), slice(0, columns))
        )
        own = slice(0, bottom - top)
        steps = _edges(along_x[own], usable[own], 1).mean(axis=0)
        heights = np.concatenate([[0.0], np.cumsum(steps)])
        right[index] = np.diff(blocks.means(heights, 0))
        steps = blocks.means(_edges(along_y, usable, 0), 1)
        heights = walked + np.concatenate([np.zeros((1, across)), np.cumsum(steps, axis=0)])
        mean = heights[own].mean(axis=0)
        if index > 0:
            below[index - 1] = mean - last
        last, walked = mean, heights[-1]
    return _poisson(right, below) * pitch_mm


def height_rows(
    normals: Normals,
    shape: tuple[int, int],
    pitch_mm: float,
    *,
    rows: int = 256,
    tile: int | None = None,
    threads: int | None = None,
    done: Callable[[int], object] = lambda pixels: None,
) -> Iterator[NDArray[np.float32]]:
    """Height in mm as bands ``(1, rows, x)``, from the top; mean about 0, a number everywhere.

    Parameters
    ----------
    normals
        Reads a window of the normals.
    shape
        ``(y, x)`` of the painting.
    pitch_mm
        Width of a pixel in mm.
    rows
        Of a band; the last one has what is left.
    tile
        Rows and columns that are integrated at a time, about, without the border around them;
        default: 768, or 32 blocks of the coarse grid.
    threads
        None means every allowed core.
    done
        Called with the number of pixels of every tile.
    """
    blocks = Blocks.of(shape)
    coarse = coarse_height(normals, blocks, pitch_mm)
    counts = [np.diff(np.append(np.arange(0, s, blocks.side), s)) for s in shape]
    coarse = coarse - np.average(coarse, weights=np.outer(*counts))
    tile = max(TILE, TILE_BLOCKS * blocks.side) if tile is None else tile
    # Not narrower than its border, within which it meets its neighbours alone.
    side = max(HALO, tile // blocks.side) * blocks.side
    halo = HALO * blocks.side
    height, width = shape
    kept = np.zeros((0, width), np.float32)
    flushed = 0
    for top in range(0, height, side):
        around = slice(max(top - halo, 0), min(top + side + halo, height))
        # What an earlier row of tiles has begun, and room for more.
        sums = np.zeros((around.stop - flushed, width), np.float32)
        sums[: len(kept)] = kept
        fade_y = _fade(around, top, top + side, height, halo)
        for left in range(0, width, side):
            beside = slice(max(left - halo, 0), min(left + side + halo, width))
            part = _tile(normals, coarse, blocks, (around, beside), pitch_mm, threads)
            fade_x = _fade(beside, left, left + side, width, halo)
            part *= fade_y[:, None] * fade_x
            # Rows that are flushed do not count in this tile any more.
            part = part[max(flushed - around.start, 0) :]
            sums[len(sums) - len(part) :, beside] += part.astype(np.float32)
            done((min(top + side, height) - top) * (min(left + side, width) - left))
        # The next row of tiles begins to count half a border above its first row.
        final = height if top + side >= height else top + side - halo // 2
        whole = height if final == height else flushed + (final - flushed) // rows * rows
        for start in range(flushed, whole, rows):
            stop = min(start + rows, whole)
            yield sums[None, start - flushed : stop - flushed]
        kept, flushed = sums[whole - flushed :], whole


def _tile(
    normals: Normals,
    coarse: Floats,
    blocks: Blocks,
    window: tuple[slice, slice],
    pitch_mm: float,
    threads: int | None,
) -> Floats:
    """Height of a window that begins with a block, on the coarse grid."""
    own = integrate_normals(normals(*window), pitch_mm, threads=threads).astype(np.float64)
    if own.shape == blocks.shape:
        return own
    means = blocks.means(blocks.means(own, 0), 1)
    first = [part.start // blocks.side for part in window]
    meant = coarse[tuple(slice(f, f + n) for f, n in zip(first, means.shape, strict=True))]
    return own + _between(_smoothed(meant - means), own.shape, blocks.side)


def _smoothed(cells: Floats) -> Floats:
    """Weighted means over neighbours (Hann's window), mirrored at the borders.

    What a tile lacks is harmonic, and a harmonic function is the mean of its surroundings: it stays
    as it is. What is as short as a few blocks, the tile knows better than the coarse grid.
    """
    reach = HALO // 2
    weights = np.hanning(2 * reach + 3)[1:-1]
    weights /= weights.sum()
    found = cells
    for axis, size in enumerate(cells.shape):
        places = np.arange(-reach, size + reach) % (2 * size)
        mirrored = np.take(found, np.minimum(places, 2 * size - 1 - places), axis)
        found = sum(
            weight * np.take(mirrored, np.arange(start, start + size), axis)
            for start, weight in enumerate(weights.tolist())
        )
    return np.asarray(found)


def _between(cells: Floats, shape: tuple[int, ...], side: int) -> Floats:
    """Cells at pixels, linear between their middles and constant beyond the outermost."""
    found = cells
    for axis, size in enumerate(shape):
        starts = np.arange(0, size, side)
        middles = 0.5 * (starts + np.minimum(starts + side, size) - 1)
        places = np.interp(np.arange(size), middles, np.arange(len(middles)))
        low = np.minimum(places.astype(np.intp), len(middles) - 1)
        high = np.minimum(low + 1, len(middles) - 1)
        share = np.moveaxis((places - low).reshape(-1, 1), 0, axis)
        found = np.take(found, low, axis) * (1.0 - share) + np.take(found, high, axis) * share
    return found


def _fade(part: slice, start: int, stop: int, size: int, halo: int) -> Floats:
    """How much a tile counts along an axis; over neighbouring tiles the sum is 1."""
    place = np.arange(part.start, part.stop) + 0.5

    def rises(border: float) -> Floats:
        share = np.clip((place - border) / halo + 0.5, 0.0, 1.0)
        return np.asarray(share * share * (3.0 - 2.0 * share))

    weight = np.ones(len(place))
    if start > 0:
        weight = weight * rises(start)
    if stop < size:
        weight = weight * (1.0 - rises(stop))
    return weight


def _slopes(normal: NDArray[np.float32]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Slopes to the right and down, and where there are any; as in the numerics."""
    x, y, z = normal.astype(np.float64)
    usable = np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (z > 0.0)
    front = np.where(usable, z, 1.0)
    along_x, along_y = (
        np.clip(np.where(usable, one, 0.0) / front, -STEEPEST, STEEPEST) for one in (-x, y)
    )
    return along_x, along_y, usable


def _edges(slope: Floats, usable: NDArray[np.bool_], axis: int) -> Floats:
    """Slopes of the edges between neighbours: the mean of both, or that of the one that has one."""
    size = slope.shape[axis]
    first, second = (np.take(slope, np.arange(n, size - 1 + n), axis) for n in (0, 1))
    one, two = (np.take(usable, np.arange(n, size - 1 + n), axis) for n in (0, 1))
    # Slopes that are not usable are 0.
    return np.asarray((first + second) / np.maximum(one.astype(np.float64) + two, 1.0))


def _poisson(right: Floats, below: Floats) -> Floats:
    """Numbers ``(y, x)`` of mean 0 whose differences to the right and down are closest to these."""
    rows, columns = right.shape[0], below.shape[1]
    flows = np.zeros((rows, columns))
    flows[:, :-1] += right
    flows[:, 1:] -= right
    flows[:-1] += below
    flows[1:] -= below
    found = _cosines(_cosines(flows, 0), 1)
    values = [2.0 * np.cos(np.pi * np.arange(n) / n) - 2.0 for n in (rows, columns)]
    divisor = values[0][:, None] + values[1]
    divisor[0, 0] = 1.0
    found = found / divisor
    found[0, 0] = 0.0
    return _from_cosines(_from_cosines(found, 0), 1)


def _cosines(values: Floats, axis: int) -> Floats:
    """The cosine transform (DCT-II), by the Fourier transform of the values and their mirror."""
    size = values.shape[axis]
    mirrored = np.concatenate([values, np.flip(values, axis)], axis)
    spectrum = np.take(np.fft.rfft(mirrored, axis=axis), np.arange(size), axis)
    return np.asarray((spectrum * _phase(size, values.ndim, axis)).real)


def _from_cosines(values: Floats, axis: int) -> Floats:
    """The values that :func:`_cosines` made these of."""
    size = values.shape[axis]
    spectrum = values / _phase(size, values.ndim, axis)
    ends = [np.zeros_like(np.take(values, [0], axis))]
    whole = np.fft.irfft(np.concatenate([spectrum, *ends], axis), n=2 * size, axis=axis)
    return np.asarray(np.take(whole, np.arange(size), axis))


def _phase(size: int, dims: int, axis: int) -> NDArray[np.complex128]:
    shape = [1] * dims
    shape[axis] = size
    phase = np.exp(-0.5j * np.pi * np.arange(size) / size)
    return np.asarray(phase.reshape(shape))

"""Crops and quarter turns of pictures, for stacks and results."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError

Window: TypeAlias = tuple[slice, slice]
"""Rows and columns, with a start and an end."""


def window(key: Any, shape: tuple[int, int]) -> Window:
    """The rows and columns of ``[y0:y1, x0:x1]``; a slice left out means all.

    Raises
    ------
    ArgumentError
        Anything but slices of step 1 with at least one pixel.
    """
    parts = key if isinstance(key, tuple) else (key,)
    if not 1 <= len(parts) <= 2 or not all(isinstance(part, slice) for part in parts):
        raise ArgumentError(
            f"[y0:y1, x0:x1]: expected one or two slices, found {key!r}; one pixel is "
            ".pixel(y, x) of a result, one photograph .take([index]) of a stack"
        )
    rows, columns = (*parts, slice(None))[:2]
    return _bounds(rows, shape[0], "y"), _bounds(columns, shape[1], "x")


def _bounds(part: slice, size: int, axis: str) -> slice:
    for value in (part.start, part.stop, part.step):
        if value is not None and not is_whole(value):
            raise ArgumentError(f"{axis}: expected whole numbers in a slice, found {value!r}")
    if part.step not in (None, 1):
        raise ArgumentError(f"{axis}: expected a slice of step 1, found {part.step}")
    start, stop, _ = part.indices(size)
    if stop <= start:
        raise ArgumentError(f"{axis}: the slice holds none of {size} pixels")
    return slice(start, stop)


def squares(shape: tuple[int, int], side: int) -> Iterator[Window]:
    """Windows of ``side`` rows and columns that cover a picture, the last ones smaller, by rows."""
    height, width = shape
    for top in range(0, height, side):
        for left in range(0, width, side):
            yield slice(top, min(top + side, height)), slice(left, min(left + side, width))


def offset(part: Window, shape: tuple[int, int]) -> tuple[float, float]:
    """Offset in pixels, right and up, from the centre of a picture to the centre of its part."""
    rows, columns = part
    height, width = shape
    right = (columns.start + columns.stop - width) / 2
    up = (height - rows.start - rows.stop) / 2
    return right, up


def widened(tile: Window, size: tuple[int, int], halo: int) -> Window:
    """A tile with a border of so many pixels around it, as far as the picture reaches."""
    rows, columns = (
        slice(max(part.start - halo, 0), min(part.stop + halo, length))
        for part, length in zip(tile, size, strict=True)
    )
    return rows, columns


def within(tile: Window, wide: Window) -> Window:
    """Where a tile lies in the part that was cut around it."""
    rows, columns = (
        slice(part.start - around.start, part.stop - around.start)
        for part, around in zip(tile, wide, strict=True)
    )
    return rows, columns


def overlap(one: Window, other: Window) -> Window:
    """What two windows of a picture share."""
    rows, columns = (
        slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(one, other, strict=True)
    )
    return rows, columns


def rotated_map(plane: NDArray[Any], turns: int, axis: int | None = None) -> NDArray[Any]:
    """A map ``(..., y, x)`` after quarter turns counterclockwise.

    ``axis`` is the axis of x, y, z for maps of vectors, which rotate too. The result is exact: x
    and y only swap and change sign.
    """
    found = np.rot90(plane, turns, axes=(-2, -1))
    if axis is None or turns == 0:
        return found
    x, y, z = np.moveaxis(found, axis, 0)
    for _ in range(turns):
        x, y = -y, x
    return np.stack([x, y, z], axis=axis)


def place(y: Any, x: Any, shape: tuple[int, int]) -> tuple[int, int]:
    """Row and column counted from 0; negative ones count from the end.

    Raises
    ------
    ArgumentError
        Not whole numbers, or a pixel outside.
    """
    for name, value, size in (("y", y, shape[0]), ("x", x, shape[1])):
        if not is_whole(value):
            raise ArgumentError(f"{name}: expected a whole number, found {value!r}")
        if not -size <= value < size:
            raise ArgumentError(f"{name}: {value} is outside a painting of {size}")
    return int(y) % shape[0], int(x) % shape[1]

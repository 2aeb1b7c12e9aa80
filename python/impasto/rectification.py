"""Photographs resampled to the frontal view of a painting, once: lens, perspective, depth, shift.

Every pixel of the frontal picture is looked up in the photograph (inverse mapping) by Lanczos
interpolation [@duchon1979lanczos].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto.depth_mesh import Parallax
from impasto.errors import ArgumentError
from impasto.frontal_view import FrontalView

Floats = NDArray[np.float64]
Interpolation = Literal["lanczos", "cubic", "linear"]

BLOCK = 256
"""Rows that are resampled at a time."""
ACROSS = 2048
"""Columns that are resampled at a time: OpenCV's ``remap`` takes sources below 32768 pixels."""
REACH = 5
"""Pixels around a place that Lanczos interpolation reads, and one more."""
COARSE = 1.5
"""Pixels of the photograph in one of the frontal picture from which on several are averaged."""


@dataclass(frozen=True)
class Grid:
    """The pixels of the frontal picture.

    Attributes
    ----------
    size_mm
        Width and height.
    pixel_mm
        Width of a pixel.
    """

    size_mm: tuple[float, float]
    pixel_mm: float

    @property
    def columns(self) -> int:
        """Pixels of a row."""
        return max(1, round(self.size_mm[0] / self.pixel_mm))

    @property
    def rows(self) -> int:
        """Pixels of a column."""
        return max(1, round(self.size_mm[1] / self.pixel_mm))

    def mm(self, columns: Floats, rows: Floats) -> Floats:
        """``(..., 2)``: the places of pixels; the middle of the picture is the origin."""
        x = (columns - (self.columns - 1) / 2) * self.pixel_mm
        y = ((self.rows - 1) / 2 - rows) * self.pixel_mm
        return np.stack(np.broadcast_arrays(x, y), axis=-1)


def middle_of(grid: Grid, side: int) -> Grid:
    """The same pixels, ``side`` x ``side`` of them or fewer, about the middle."""
    columns = min(grid.columns, side - (side - grid.columns) % 2)
    rows = min(grid.rows, side - (side - grid.rows) % 2)
    return Grid((columns * grid.pixel_mm, rows * grid.pixel_mm), grid.pixel_mm)


@dataclass(frozen=True, eq=False)
class Rectified:
    """Rows of a frontal picture.

    Attributes
    ----------
    planes
        ``(band, y, x)`` of the photograph's type.
    seen
        ``(y, x)``: whether the photograph shows the pixel.
    """

    planes: NDArray[Any]
    seen: NDArray[np.bool_]


def rectified_rows(
    photograph: NDArray[Any],
    view: FrontalView,
    grid: Grid,
    *,
    shift: tuple[float, float] = (0.0, 0.0),
    parallax: Parallax | None = None,
    full: float | None = None,
    interpolation: Interpolation = "lanczos",
) -> Iterator[Rectified]:
    """The frontal picture, 256 rows at a time.

    Parameters
    ----------
    photograph
        ``(band, y, x)``, uint16 or float32, linear.
    view
        How it shows the plane.
    grid
        The pixels of the frontal picture.
    shift
        Pixels of the frontal picture by which the photograph's content lies to the right and below.
    parallax
        The relief as the camera of this photograph sees it; None: the painting is flat.
    full
        The code from which samples are clipped: what is interpolated less than 2 pixels from one
        becomes this code, so that no mean with unclipped neighbours passes for a measurement. What
        the 8 x 8 pixels hold farther away counts little. None: none are.
    interpolation
        ``"lanczos"`` (8 x 8 pixels), ``"cubic"`` (4 x 4) or ``"linear"``.
    """
    clipped = None if full is None else _clipped(photograph, full)
    for top in range(0, grid.rows, BLOCK):
        rows = slice(top, min(top + BLOCK, grid.rows))
        yield _window(
            photograph, view, grid, rows, slice(0, grid.columns), shift, parallax, full,
            clipped, interpolation,
        )  # fmt: skip


def rectified_window(
    photograph: NDArray[Any],
    view: FrontalView,
    grid: Grid,
    rows: slice,
    columns: slice,
    *,
    shift: tuple[float, float] = (0.0, 0.0),
    parallax: Parallax | None = None,
    full: float | None = None,
    interpolation: Interpolation = "lanczos",
) -> Rectified:
    """Some rows and columns of the frontal picture, bit for bit those of the whole.

    Whole blocks are resampled, for places are rounded to single precision within each.
    """
    clipped = None if full is None else _clipped(photograph, full)
    return _window(
        photograph, view, grid, rows, columns, shift, parallax, full, clipped, interpolation
    )


def _window(
    photograph: NDArray[Any],
    view: FrontalView,
    grid: Grid,
    rows: slice,
    columns: slice,
    shift: tuple[float, float],
    parallax: Parallax | None,
    full: float | None,
    clipped: NDArray[np.float32] | None,
    interpolation: Interpolation,
) -> Rectified:
    times = _oversampling(view, grid, max(photograph.shape[1:]))
    shape = rows.stop - rows.start, columns.stop - columns.start
    planes = np.empty((len(photograph), *shape), photograph.dtype)
    seen = np.empty(shape, dtype=bool)
    for down in _blocks(rows, grid.rows, BLOCK):
        for across in _blocks(columns, grid.columns, ACROSS):
            places = _places(view, grid, down, across, shift, parallax, times)
            found, whole = _looked_up(photograph, places, times, full, clipped, interpolation)
            (out_y, in_y), (out_x, in_x) = _shared(rows, down), _shared(columns, across)
            planes[:, out_y, out_x] = found[:, in_y, in_x]
            seen[out_y, out_x] = whole[in_y, in_x]
    return Rectified(planes, seen)


def _blocks(wanted: slice, size: int, step: int) -> Iterator[slice]:
    """The blocks of an axis that a window touches."""
    for start in range(wanted.start // step * step, wanted.stop, step):
        yield slice(start, min(start + step, size))


def _shared(window: slice, block: slice) -> tuple[slice, slice]:
    """What both have: its places in the window, and in the block."""
    first, end = max(window.start, block.start), min(window.stop, block.stop)
    return (
        slice(first - window.start, end - window.start),
        slice(first - block.start, end - block.start),
    )


def rectified(photograph: NDArray[Any], view: FrontalView, grid: Grid, **options: Any) -> Rectified:
    """The whole frontal picture; see :func:`rectified_rows`."""
    parts = list(rectified_rows(photograph, view, grid, **options))
    return Rectified(
        np.concatenate([part.planes for part in parts], axis=1),
        np.concatenate([part.seen for part in parts]),
    )


def _clipped(photograph: NDArray[Any], full: float) -> NDArray[np.float32] | None:
    """1 where a pixel or one beside it is clipped in any band; None if none is."""
    import cv2

    clipped = (photograph >= full).any(axis=0)
    if not clipped.any():
        return None
    return np.asarray(cv2.dilate(clipped.astype(np.float32), np.ones((3, 3), np.uint8)))


def _oversampling(view: FrontalView, grid: Grid, most: int) -> int:
    """Places along the side of a pixel that are averaged.

    More than one where it is larger than those of the photograph: fine structure would alias.

    Raises
    ------
    ArgumentError
        A pixel is larger than the photograph, or the view is no view of a plane.
    """
    ratio = grid.pixel_mm / view.pixel_mm()
    if not ratio <= most:
        raise ArgumentError(
            f"pixel_mm: a pixel of {grid.pixel_mm:g} mm is as wide as {ratio:.3g} pixels of the "
            f"photograph, which has {most}; choose smaller pixels, or check lens and alignment"
        )
    return 1 if ratio < COARSE else ceil(ratio)


def _places(
    view: FrontalView,
    grid: Grid,
    rows: slice,
    columns: slice,
    shift: tuple[float, float],
    parallax: Parallax | None,
    times: int,
) -> Floats:
    """``(rows * times, columns * times, 2)``: pixels of the photograph."""
    inner = (np.arange(times) + 0.5) / times - 0.5
    across = (np.arange(columns.start, columns.stop)[:, None] + inner).ravel()
    down = (np.arange(rows.start, rows.stop)[:, None] + inner).ravel()
    if parallax is None:
        return view.pixels(grid.mm(across[None] + shift[0], down[:, None] + shift[1]))
    x = (across - (grid.columns - 1) / 2) * grid.pixel_mm
    y = ((grid.rows - 1) / 2 - down) * grid.pixel_mm
    # The heights belong to the pixels of the result, the shift to the photograph.
    moved = np.array([shift[0], -shift[1]]) * grid.pixel_mm
    return view.pixels(parallax.on_grid(x, y) + moved)


def _looked_up(
    photograph: NDArray[Any],
    places: Floats,
    times: int,
    full: float | None,
    clipped: NDArray[np.float32] | None,
    interpolation: Interpolation,
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    import cv2

    height, width = photograph.shape[1:]
    limit = np.array([width - 0.5, height - 0.5])
    seen = ((places > -0.5) & (places < limit)).all(axis=-1)
    shape = places.shape[0] // times, places.shape[1] // times

    def averaged(values: NDArray[Any]) -> NDArray[Any]:
        if times == 1:
            return values
        return np.asarray(values.reshape(shape[0], times, shape[1], times).mean(axis=(1, 3)))

    whole = np.asarray(averaged(np.asarray(seen)) == 1.0)
    planes = np.zeros((len(photograph), *shape), dtype=photograph.dtype)
    if not seen.any():
        return planes, whole
    # A window of the photograph: single precision then has 0.0002 pixels left for places.
    corner = np.maximum(np.floor(places[seen].min(axis=0)).astype(int) - REACH, 0)
    stop = np.ceil(places[seen].max(axis=0)).astype(int) + REACH + 1
    window = slice(corner[1], stop[1]), slice(corner[0], stop[0])
    x, y = ((places[..., axis] - corner[axis]).astype(np.float32) for axis in (0, 1))
    how = {
        "lanczos": cv2.INTER_LANCZOS4, "cubic": cv2.INTER_CUBIC, "linear": cv2.INTER_LINEAR,
    }[interpolation]  # fmt: skip
    for band, plane in enumerate(photograph):
        source = np.ascontiguousarray(plane[window])
        found = np.asarray(cv2.remap(source, x, y, how, borderMode=cv2.BORDER_REPLICATE))
        mean = averaged(found)
        planes[band] = np.rint(mean) if planes.dtype.kind == "u" else mean
    if clipped is not None and full is not None:
        source = np.ascontiguousarray(clipped[window])
        near = averaged(np.asarray(cv2.remap(source, x, y, cv2.INTER_LINEAR))) > 0.0
        planes[:, near] = full
    planes[:, ~whole] = 0
    return planes, whole

"""A painting at all its scales, tile by tile: from maps in memory, or from a store of any size.

At each scale pixels are means of 2 x 2 of the one before, with lobes that the scatter of the
normals has widened (:func:`impasto.lighting.reduced`), as in the stores of jobs.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, squares
from impasto.errors import ArgumentError
from impasto.fit.reflectance import ReflectanceEstimator
from impasto.fit.stored import StoredSbrdf
from impasto.height import integrate_normals
from impasto.lighting import coloured, metallic, reduced
from impasto.rig import PointView
from impasto.surface import Surface, with_each_map
from impasto.viewer.layout import QUALITY, middle_of

SIDE = 256
"""Rows and columns of a tile."""
READ = 8
"""Largest factor at which the status of a store is read: each tile of it reads so many squared."""
TOGETHER = 4
"""Tiles along a side that are made at a time where all are: chunks of a store hold several, and are
decoded once for those."""
LOADED = 2**24
"""Most pixels of a store without smaller scales."""
RELIEF = 2**18
"""Most pixels of the scale of a store whose normals are integrated: a fifth of a second."""
FEWEST = 100
"""Normals of which heights are made: a plane through fewer is none."""


@dataclass(frozen=True)
class Scale:
    """The painting at one scale.

    Attributes
    ----------
    factor
        How many pixels of the painting, along a side, are one.
    shape
        ``(y, x)``.
    """

    factor: int
    shape: tuple[int, int]

    @property
    def tiles(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        return -(-self.shape[0] // SIDE), -(-self.shape[1] // SIDE)

    def blocks(self) -> Iterator[list[tuple[int, int]]]:
        """Rows and columns of all tiles, those together that are made at a time.

        The status is read of all pixels up to :data:`READ`: no block covers more of them than the
        largest tile does.
        """
        side = max(1, TOGETHER // self.factor) if self.factor <= READ else TOGETHER
        for rows, columns in squares(self.tiles, side):
            yield list(product(range(rows.start, rows.stop), range(columns.start, columns.stop)))

    def window(self, row: int, column: int) -> Window:
        """Rows and columns of a tile.

        Raises
        ------
        IndexError
            There is no such tile.
        """
        rows, columns = self.tiles
        if not (0 <= row < rows and 0 <= column < columns):
            raise IndexError(f"no tile {row}, {column} of {rows} x {columns}")
        height, width = self.shape
        return (
            slice(row * SIDE, min((row + 1) * SIDE, height)),
            slice(column * SIDE, min((column + 1) * SIDE, width)),
        )


@dataclass(frozen=True, eq=False)
class Part:
    """The maps of a part of a painting at one scale.

    Attributes
    ----------
    surface
        Normals, colours and lobes.
    status
        ``(y, x)`` :class:`~impasto.Status`, where it was read.
    beneath
        ``(y, x)`` share of the gloss that a varnish leaves as it is, where that matters.
    quality
        Maps ``(y, x)`` by their names in :data:`~impasto.viewer.layout.QUALITY`.
    """

    surface: Surface
    status: NDArray[np.uint8] | None = None
    beneath: NDArray[np.float32] | None = None
    quality: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)

    def cut(self, window: Window) -> Part:
        """A part of it."""
        return Part(
            cut(self.surface, window),
            None if self.status is None else self.status[window],
            None if self.beneath is None else self.beneath[window],
            {name: plane[window] for name, plane in self.quality.items()},
        )


class Scales(Protocol):
    """Parts of a painting at any of its scales."""

    @property
    def scales(self) -> tuple[Scale, ...]:
        """From the painting itself to the smallest."""

    @property
    def template(self) -> Surface:
        """A part, for what is no map."""

    def part(self, scale: Scale, window: Window) -> Part:
        """Its maps."""


class ScalesInMemory:
    """Of a surface that is loaded.

    Parameters
    ----------
    surface
        With the colours that the page shows.
    status
        ``(y, x)`` :class:`~impasto.Status`; None where there is none.
    beneath
        As in :class:`Part`: a map ``(y, x)``.
    quality
        As in :class:`Part`; at a smaller scale the numbers of the pixel in the middle.
    """

    def __init__(
        self,
        surface: Surface,
        status: NDArray[np.uint8] | None = None,
        beneath: NDArray[np.float32] | None = None,
        quality: Mapping[str, NDArray[np.float32]] | None = None,
    ) -> None:
        self._quality = quality or {}
        self._template = surface
        self._status = status
        self._levels = [surface]
        self._beneath = [beneath]
        while max(self._levels[-1].shape) > SIDE and min(self._levels[-1].shape) > 1:
            above = self._levels[-1]
            smaller, height = reduced(above, above.height, 2)
            self._levels.append(replace(smaller, height=height))
            share = self._beneath[-1]
            self._beneath.append(None if share is None else _halved(share))
        self._scales = tuple(Scale(2**n, one.shape) for n, one in enumerate(self._levels))

    @property
    def scales(self) -> tuple[Scale, ...]:
        """See :class:`Scales`."""
        return self._scales

    @property
    def template(self) -> Surface:
        """The surface."""
        return self._template

    def part(self, scale: Scale, window: Window) -> Part:
        """See :class:`Scales`."""
        number = scale.factor.bit_length() - 1
        whole, beneath = self._levels[number], self._beneath[number]
        rows, columns = whole.shape

        def sampled(plane: NDArray[Any]) -> NDArray[Any]:
            found: NDArray[Any] = middle_of(plane, scale.factor)[:rows, :columns][window]
            return found

        return Part(
            cut(whole, window),
            None if self._status is None else sampled(self._status),
            None if beneath is None else beneath[window],
            {name: sampled(plane) for name, plane in self._quality.items()},
        )


class ScalesOfStore:
    """Of a result in a store, read by windows.

    Scales that are smaller than the smallest of the store are made of that when one of them is
    asked for first, until a tile holds the whole painting. Heights are those of one scale, whose
    normals are integrated; between its pixels they are interpolated.

    Parameters
    ----------
    stored
        What :func:`impasto.open_sbrdf` returns.
    bands
        Numbers of the bands that are shown; None: all.
    spectra
        Makes spectra of the bands; None: bands are shown.
    pitch_mm
        Width of a pixel, for heights; None: that of the store.

    Raises
    ------
    ArgumentError
        A large store without smaller scales.
    """

    def __init__(
        self,
        stored: StoredSbrdf,
        bands: list[int] | None,
        spectra: ReflectanceEstimator | None = None,
        pitch_mm: float | None = None,
    ) -> None:
        rows, columns = stored.shape
        if not stored.factors and rows * columns > LOADED:
            raise ArgumentError(
                f"result: {stored.path} holds {columns} x {rows} pixels and no smaller scales; "
                "impasto job run makes stores that do"
            )
        self._stored, self._bands, self._spectra = stored, bands, spectra
        self._pitch = pitch_mm or stored.pitch_mm or 1.0
        self.quality = tuple(name for name in QUALITY if name in stored.map_names)
        shapes = {1: stored.shape} | {one: stored.level_shape(one) for one in stored.factors}
        self._last = factor = max(shapes)
        while max(shapes[factor]) > SIDE and min(shapes[factor]) > 1:
            rows, columns = shapes[factor]
            factor *= 2
            shapes[factor] = rows // 2, columns // 2
        self._scales = tuple(Scale(factor, shape) for factor, shape in shapes.items())
        self._lock = threading.RLock()
        small = [one for one in self._scales if one.shape[0] * one.shape[1] <= RELIEF]
        self.relieved = small[0] if small else self._scales[-1]

    @property
    def scales(self) -> tuple[Scale, ...]:
        """See :class:`Scales`."""
        return self._scales

    @cached_property
    def template(self) -> Surface:
        """The first pixel; its height is not known yet."""
        surface = self._read(self.scales[0], (slice(0, 1), slice(0, 1))).surface
        return replace(surface, height=np.zeros(surface.shape, np.float32))

    def part(self, scale: Scale, window: Window) -> Part:
        """See :class:`Scales`."""
        found = self._without_height(scale, window)
        with self._lock:
            heights = self._heights
        share = scale.factor / self.relieved.factor
        height = resampled(heights, window, share)
        return replace(found, surface=replace(found.surface, height=height))

    def _without_height(self, scale: Scale, window: Window) -> Part:
        if scale.factor <= self._last:
            return self._read(scale, window)
        with self._lock:
            smaller = self._smallest
        return smaller.part(Scale(scale.factor // self._last, scale.shape), window)

    @cached_property
    def _heights(self) -> NDArray[np.float32]:
        """Of one scale in mm, about the plane of the panel; in pixels without their width."""
        scale = self.relieved
        whole = _all(scale.shape)
        if scale.factor == 1:
            normal = self._stored.map("normal", *whole)
        elif scale.factor <= self._last:
            normal = self._stored.level_part(scale.factor, *whole).normal
        else:
            normal = self._without_height(scale, whole).surface.normal
        if int((normal[2] > 0).sum()) < FEWEST:
            return np.zeros(scale.shape, np.float32)
        return integrate_normals(normal, self._pitch * scale.factor, level=True)

    def _read(self, scale: Scale, window: Window) -> Part:
        one: Any
        if scale.factor == 1:
            one = self._stored.visible(*window)
            status = one.status
        else:
            one = self._stored.level_part(scale.factor, *window)
            if scale.factor > READ:
                surface, beneath = self._shown(one)
                return Part(surface, None, beneath, self._unknown(window))
            status = self._sampled("status", scale.factor, window)
        quality = {name: self._sampled(name, scale.factor, window) for name in self.quality}
        surface, beneath = self._shown(one)
        return Part(surface, status, beneath, quality)

    def _sampled(self, name: str, factor: int, window: Window) -> NDArray[Any]:
        """Of every group of pixels the one in its middle."""
        rows, columns = (slice(factor * one.start, factor * one.stop) for one in window)
        return middle_of(self._stored.map(name, rows, columns), factor)

    def _unknown(self, window: Window) -> dict[str, NDArray[np.float32]]:
        """In place of what is not read at a small scale."""
        size = tuple(one.stop - one.start for one in window)
        return {name: np.full(size, np.nan, np.float32) for name in self.quality}

    @cached_property
    def _smallest(self) -> ScalesInMemory:
        """The smallest scale of the store, and those that are made of it."""
        one = self._read(self._scales[self._number], _all(self._scales[self._number].shape))
        return ScalesInMemory(one.surface, one.status, one.beneath, one.quality)

    @property
    def _number(self) -> int:
        return next(n for n, scale in enumerate(self._scales) if scale.factor == self._last)

    def _shown(self, one: Any) -> tuple[Surface, NDArray[np.float32] | None]:
        """A part as it is lit, and what lies beneath a varnish."""
        if self._spectra is None:
            bands = one if self._bands is None else one.with_bands(self._bands)
            return replace(bands.surface(), height=None), None
        lit = one.surface()
        share = metallic(lit)
        found = coloured(lit, "store", self._spectra.apply(one.diffuse, threads=1), None)
        return replace(found, height=None), np.broadcast_to(np.float32(share), lit.shape)


def resampled(plane: NDArray[np.float32], window: Window, share: float) -> NDArray[np.float32]:
    """A window of a scale whose pixels are so many of a plane wide, linear between its pixels."""
    found = plane
    for axis, part in enumerate(window):
        places = (np.arange(part.start, part.stop) + 0.5) * share - 0.5
        places = np.clip(places, 0.0, found.shape[axis] - 1.0)
        low = places.astype(np.intp)
        high = np.minimum(low + 1, found.shape[axis] - 1)
        weight = np.moveaxis((places - low).astype(np.float32).reshape(-1, 1), 0, axis)
        found = (1 - weight) * np.take(found, low, axis) + weight * np.take(found, high, axis)
    return np.asarray(found, np.float32)


def _all(shape: tuple[int, int]) -> Window:
    return slice(0, shape[0]), slice(0, shape[1])


def _halved(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2 x 2 numbers; NaN counts as 0."""
    rows, columns = (size // 2 for size in plane.shape)
    known = np.nan_to_num(plane[: 2 * rows, : 2 * columns], nan=0.0)
    means = known.reshape(rows, 2, columns, 2).mean(axis=(1, 3), dtype=np.float32)
    return np.asarray(means)


def cut(surface: Surface, window: Window) -> Surface:
    """A part of a surface; where it lies is not kept."""
    return with_each_map(surface, lambda plane: plane[(..., *window)])


def eye_of(view: Any) -> dict[str, Any]:
    """From where pictures show a painting, for the page: a direction, or a place in mm."""
    if isinstance(view, PointView):
        return {"position": [float(value) for value in view.position]}
    return {"direction": [float(value) for value in view]}

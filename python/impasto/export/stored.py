"""A painting in a store as a source of exports: parts of it, at all scales, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto._internal.windows import Window
from impasto.errors import ArgumentError
from impasto.export.source import Source
from impasto.fit.stored import StoredLevel, StoredSbrdf
from impasto.lighting import reduced
from impasto.surface import Surface, with_each_map

Plane = NDArray[np.float32]

LOADED = 2**24
"""Most pixels of a painting that are exported at once: some 2 GB of maps."""
OVERVIEW = 2**20
"""Most pixels of a scale from which numbers of the whole are taken."""
SAMPLED = 9
"""Parts in which losses are measured."""


@dataclass(frozen=True, eq=False)
class StoredSource:
    """A painting that is not loaded.

    Parameters
    ----------
    stored
        What :func:`impasto.open_sbrdf` returns.
    pitch_mm
        Width of a pixel on the painting; default: that of the result.
    name
        Of the painting.

    Raises
    ------
    ArgumentError
        A wrong pitch.
    """

    stored: StoredSbrdf
    pitch_mm: float | None = None
    name: str = "painting"

    def __post_init__(self) -> None:
        pitch = self.pitch_mm
        known = self.stored.known_pitch_mm if pitch is None else length_mm(pitch, "pitch_mm")
        object.__setattr__(self, "pitch_mm", known)

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.stored.shape

    def part(self, window: Window) -> Source:
        """A part of the painting."""
        return self._source(self.stored.visible(*window), 1)

    def scaled(self, factor: int, window: Window) -> Source:
        """A part of a smaller scale, whose sizes are rounded up, as those of tiled formats are.

        Stores leave out what fills no group of pixels; the last row and column stand in for it.
        """
        if factor == 1:
            return self.part(window)
        own = self.scale_shape(factor)
        inside = [
            slice(min(part.start, size - 1), min(part.stop, size))
            for part, size in zip(window, own, strict=True)
        ]
        if factor in self.stored.factors:
            found: Any = self.stored.level_part(factor, *inside)
        else:
            found = replace(self._smallest, maps=_cut(self._smaller(factor), inside))
        missing = [
            (part.stop - part.start) - (one.stop - one.start)
            for part, one in zip(window, inside, strict=True)
        ]
        if any(missing):
            found = replace(found, maps=_padded(found.maps, missing))
        return self._source(found, factor)

    def scale_shape(self, factor: int) -> tuple[int, int]:
        """``(y, x)`` of the maps of a scale, rounded down."""
        if factor == 1:
            return self.shape
        if factor in self.stored.factors:
            return self.stored.level_shape(factor)
        return self._smaller(factor).shape

    def check_scales(self) -> None:
        """Refuse a store without smaller scales, or whose smallest is large.

        Raises
        ------
        ArgumentError
            There is none that can be loaded.
        """
        shapes = [self.stored.level_shape(one) for one in self.stored.factors]
        if not any(rows * columns <= LOADED for rows, columns in shapes):
            rows, columns = self.shape
            raise ArgumentError(
                f"result: {self.stored.path} holds {columns} x {rows} pixels and no smaller "
                "scales, of which this export is made; impasto job run makes stores that have them"
            )

    def known(self) -> bool:
        """Whether any pixel has a normal and colours."""
        if self.stored.factors:
            return bool(np.isfinite(self._smallest.normal[2]).any())
        parts = (self.stored.map("normal", *part) for part in self.stored.windows())
        return any(np.isfinite(part[2]).any() for part in parts)

    def sampled(self, side: int) -> Iterator[tuple[int, int, Window]]:
        """Row and column of some tiles with known pixels, spread evenly, and their windows.

        ``side`` is a power of two that is not less than the factor of the smallest scale.
        """
        factor = max(self.stored.factors)
        places = np.argwhere(np.isfinite(self._smallest.normal[2]))
        chosen = places[np.linspace(0, len(places) - 1, min(SAMPLED, len(places))).astype(int)]
        for row, column in np.unique(chosen * factor // side, axis=0).tolist():
            yield row, column, tile_window(self.shape, side, row, column)

    def overview(self) -> Source:
        """The painting at the largest scale of a million pixels at most, loaded."""
        fine = [one for one in self.stored.factors
                if np.prod(self.stored.level_shape(one)) <= OVERVIEW]  # fmt: skip
        factor = min(fine) if fine else max(self.stored.factors)
        return self._source(self.stored.level(factor), factor)

    @cached_property
    def _smallest(self) -> StoredLevel:
        return self.stored.level(max(self.stored.factors))

    @cached_property
    def _more(self) -> dict[int, Surface]:
        return {}

    def _smaller(self, factor: int) -> Surface:
        """A scale beyond the smallest one that is stored."""
        if factor not in self._more:
            own = max(self.stored.factors)
            above = self._smallest.maps if factor == 2 * own else self._smaller(factor // 2)
            if min(above.shape) > 1:
                self._more[factor] = reduced(above, None, 2)[0]
            else:  # of a line every second pixel, as its rows cannot be halved
                steps = [slice(None, None, 2) for _ in range(2)]
                self._more[factor] = _cut(above, steps)
        return self._more[factor]

    def _source(self, result: Any, factor: int) -> Source:
        pitch = None if self.pitch_mm is None else self.pitch_mm * factor
        return Source(result, None, pitch, self.name)


def tile_window(shape: tuple[int, int], side: int, row: int, column: int) -> Window:
    """Rows and columns of a tile; those at the borders are smaller."""
    height, width = shape
    return (
        slice(row * side, min((row + 1) * side, height)),
        slice(column * side, min((column + 1) * side, width)),
    )


def _cut(surface: Surface, window: Sequence[slice]) -> Surface:
    return with_each_map(surface, lambda plane: plane[..., window[0], window[1]])


def _padded(surface: Surface, more: Sequence[int]) -> Surface:
    """With so many more rows and columns, as the last ones."""

    def padded(plane: Plane) -> Plane:
        around = [(0, 0)] * (plane.ndim - 2) + [(0, count) for count in more]
        return np.pad(plane, around, "edge")

    return with_each_map(surface, padded)

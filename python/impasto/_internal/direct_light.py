"""Photographs without the light that places of a relief send each other.

It is taken off the samples as they are read: a corrected copy of all photographs would need several
times their memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.stack import Stack

Map = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Places:
    """Where the pixels along an axis lie between the middles of cells.

    Attributes
    ----------
    first
        ``(pixel,)`` the cell before it; the other is the next, or the same at the end.
    share
        ``(pixel,)`` share of the next cell, 0 to 1.
    """

    first: NDArray[np.uint32]
    share: Map

    @classmethod
    def of(cls, pixels: int, cells: int, step: int, shift: float) -> Places:
        """Places whose middle is ``shift`` pixels behind that of the cells of ``step`` pixels.

        Beyond the middles of the outermost cells is their value.
        """
        # Half pixels are exact, and so a part gets the bits of the whole.
        place = (np.arange(pixels) - (pixels - 1) / 2 + shift) / step + (cells - 1) / 2
        place = np.clip(place, 0.0, cells - 1.0)
        first = np.minimum(place.astype(np.uint32), max(cells - 2, 0)).astype(np.uint32)
        return cls(first, (place - first).astype(np.float32))

    def __getitem__(self, part: slice) -> Places:
        """Those of some pixels."""
        return Places(self.first[part], self.share[part])

    def between(self, cells: Map, axis: int) -> Map:
        """Maps of cells at these places along an axis, by linear interpolation."""
        second = np.minimum(self.first + 1, cells.shape[axis] - 1)
        share = np.expand_dims(self.share, tuple(range(1, -axis)))
        one, other = (np.take(cells, index, axis) for index in (self.first, second))
        return np.asarray((1.0 - share) * one + share * other, np.float32)


@dataclass(frozen=True, slots=True)
class InterreflectionArguments:
    """Light that pixels get from others, as plain arrays.

    Attributes
    ----------
    irradiance
        ``(obs, band, cell_y, cell_x)``: what each cell gets.
    albedo
        ``(band, y, x)``: the share of it that a pixel reflects.
    rows, columns
        Where the pixels lie between cells.
    black, scale, saturation
        ``(band,)``: how the numbers that are stored become linear light.
    """

    irradiance: Map
    albedo: Map
    rows: Places
    columns: Places
    black: Map
    scale: Map
    saturation: Map


@dataclass(frozen=True, init=False, eq=False, repr=False)
class DirectStack(Stack):
    """Photographs of which fits read what the lamps alone light, in linear light.

    ``samples`` are the stored ones. Whatever is made of it, such as a part, is a plain stack of
    float32.
    """

    photographs: Stack
    interreflections: InterreflectionArguments

    def __init__(
        self, photographs: Stack, irradiance: Map, albedo: Map, rows: Places, columns: Places
    ) -> None:
        """Of photographs and what :class:`InterreflectionArguments` holds."""
        set_ = object.__setattr__
        for one in fields(photographs):
            set_(self, one.name, getattr(photographs, one.name))
        none = np.zeros(photographs.shape[1])
        full = none + np.inf if self.saturation is None else self.saturation
        numbers = (one.astype(np.float32) for one in (self.black, self.scale, full))
        taken_off = InterreflectionArguments(irradiance, albedo, rows, columns, *numbers)
        set_(self, "photographs", photographs)
        set_(self, "interreflections", taken_off)
        # What is left is linear.
        set_(self, "black", none)
        set_(self, "scale", none + 1.0)
        set_(self, "saturation", None)

    def linear(self, index: int) -> Map:
        """One observation as linear light ``(band, y, x)``; clipped samples are +inf."""
        return self._direct(index, slice(None), slice(None))

    def _samples_at(self, rows: Any, columns: Any) -> Map:
        if isinstance(rows, slice):
            each = [self._direct(index, rows, columns) for index in range(len(self.rig))]
        else:
            each = [self.linear(index)[:, rows, columns] for index in range(len(self.rig))]
        return np.stack(each)

    def _direct(self, index: int, rows: slice, columns: slice) -> Map:
        light, part = self.interreflections, np.s_[:, rows, columns]
        around = light.rows[rows].between(light.irradiance[index], -2)
        around = light.albedo[part] * light.columns[columns].between(around, -1)
        linear = self.photographs._linear(self.samples[index][part])
        # Noise around black stays.
        return np.asarray(np.maximum(linear - around, np.minimum(linear, 0.0)), np.float32)

    def take(self, indices: Iterable[int]) -> Stack:
        """The plain stack of some observations."""
        return self[:, :].take(indices)

    def rotated(self, quarter_turns: int = 1) -> Stack:
        """The plain stack after quarter turns."""
        return self[:, :].rotated(quarter_turns)

    def _replace(self, **changes: Any) -> Stack:
        if "samples" not in changes:
            return self[:, :]._replace(**changes)
        return super()._replace(**changes)

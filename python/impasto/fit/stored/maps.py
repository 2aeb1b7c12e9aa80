"""The maps of a result in a store, read by windows; what is no map is read once."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, offset, squares
from impasto.errors import ArgumentError, CorruptInputError
from impasto.fit.relief import Relief
from impasto.fit.result import Sbrdf
from impasto.fit.saved import map_names
from impasto.fit.sbrdf import RESULTS
from impasto.io.results import checked_maps, other_kind
from impasto.io.results.zarr_arrays import ZarrArray
from impasto.io.results.zarr_store import read_array, read_window

UNSEEN = re.compile(r"normals\..*|residual|sigma|misfit|\w+_sigma")
"""Maps that no picture shows."""
LARGEST_PART = 1024
"""Most rows and columns that are read at a time."""


class StoredMaps:
    """What a store holds of a result.

    Attributes
    ----------
    path
        The store.
    kind
        The class of the result.
    shape
        ``(y, x)``.
    tile
        Rows and columns of the tiles of its maps.

    Raises
    ------
    CorruptInputError
        It holds something else, or maps of other sizes.
    """

    def __init__(self, path: Path, text: dict[str, NDArray[Any]], arrays: list[ZarrArray]) -> None:
        self.path = path
        kind = str(text.get("kind", "something else"))
        if kind not in RESULTS:
            raise CorruptInputError(path, other_kind(kind, RESULTS))
        self.kind: type[Sbrdf] = RESULTS[kind]
        self._text = text
        names = set(map_names(self.kind))
        self._maps = {one.name: one for one in arrays if one.name in names}
        self._others = [one for one in arrays if one.name not in names]
        self._relief: Relief | None = None
        status = self._maps.get("status")
        if status is None or len(status.shape) != 2 or 0 in status.shape:
            raise CorruptInputError(path, "has no array 'status' over rows and columns")
        self.shape = status.shape[0], status.shape[1]
        self.tile = status.tile or max(self.shape)
        for one in self._maps.values():
            if one.shape[-2:] != self.shape:
                raise CorruptInputError(path, f"array {one.name!r} has the wrong shape {one.shape}")

    @property
    def names(self) -> tuple[str, ...]:
        """The maps that there are."""
        return tuple(sorted(self._maps))

    def named(self, name: str) -> ZarrArray:
        """The map of that name.

        Raises
        ------
        ArgumentError
            There is none.
        """
        if name not in self._maps:
            known = ", ".join(sorted(self._maps))
            raise ArgumentError(f"name: expected one of {known}, found {name!r}")
        return self._maps[name]

    def read(self, name: str, part: Window) -> NDArray[Any]:
        """A window of one map."""
        one = self.named(name)
        if one.tile is None:
            return read_array(self.path, one)[(..., *part)]
        return read_window(self.path, one, *part)

    def part(self, part: Window, *, visible: bool = False) -> Sbrdf:
        """A part of the result; of what is ``visible`` in pictures, with 0 in other maps."""
        own = {
            name: np.zeros((*one.shape[:-2], *(p.stop - p.start for p in part)), one.dtype)
            if visible and UNSEEN.fullmatch(name)
            else self.read(name, part)
            for name, one in self._maps.items()
            if not one.same_as
        }
        same = {name: own[one.same_as] for name, one in self._maps.items() if one.same_as}
        found = self._result(own | same)
        if found.relief is not None:
            # One for all parts: it remembers the shadows of its lights.
            self._relief = self._relief or found.relief
            found = replace(found, relief=self._relief)
        return found.placed(*offset(part, self.shape))

    def every(self, step: int) -> Sbrdf:
        """Every so many rows and columns of all maps."""
        return self._result({name: self.sample(name, step) for name in self._maps})

    def sample(self, name: str, step: int) -> NDArray[Any]:
        """Every so many rows and columns of one map."""
        one = self.named(name)
        height, width = self.shape
        size = -(-height // step), -(-width // step)
        found: NDArray[Any] | None = None
        for rows, columns in self.windows():
            first = [-(-part.start // step) for part in (rows, columns)]
            starts = [
                at * step - part.start for at, part in zip(first, (rows, columns), strict=True)
            ]
            picked = self.read(name, (rows, columns))[..., starts[0] :: step, starts[1] :: step]
            down, across = picked.shape[-2:]
            if found is None:
                found = np.empty((*one.shape[:-2], *size), picked.dtype)
            found[..., first[0] : first[0] + down, first[1] : first[1] + across] = picked
        assert found is not None
        return found

    def windows(self, side: int | None = None) -> Iterator[Window]:
        """Square parts that cover the painting, row by row; default: as large as tiles."""
        return squares(self.shape, min(self.tile, LARGEST_PART) if side is None else side)

    def _result(self, arrays: dict[str, NDArray[Any]]) -> Sbrdf:
        with checked_maps(self.path, self._numbers | arrays, *RESULTS) as maps:
            return self.kind.from_maps(maps)

    @cached_property
    def _numbers(self) -> dict[str, NDArray[Any]]:
        return self._text | {one.name: read_array(self.path, one) for one in self._others}

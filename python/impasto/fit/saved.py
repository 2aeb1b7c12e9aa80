"""Dataclasses of maps in a file and back: no array is believed before its type and size are seen.

A field says by its metadata (:func:`over`) what its array runs over. Fields that are dataclasses
themselves stand in the file under their own name: ``normals.albedo``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from impasto.io.results import SavedMaps, rig_arrays
from impasto.rig import Rig

SIZES = {"axis": 3, "reason": 4, "row": 2, "column": 2, "measured": 3, "parameter": 2}
"""Dimensions of a size that is always the same."""


def over(*dims: str, dtype: type[np.generic] = np.float32, unit: str = "") -> dict[str, Any]:
    """Metadata of a field: the dimensions of its array, the kind of number and its unit."""
    return {"dims": dims, "dtype": dtype, "unit": unit}


def arrays_of(
    result: Any, prefix: str = "", *, leave_out: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """The arrays of a dataclass and of the dataclasses in its fields."""
    arrays: dict[str, NDArray[Any]] = {}
    for field in fields(result):
        name, value = prefix + field.name, getattr(result, field.name)
        if field.name in leave_out:
            continue
        if isinstance(value, Rig):
            arrays |= rig_arrays(value)
        elif is_dataclass(value):
            arrays |= arrays_of(value, f"{name}.")
        elif "dims" in field.metadata:
            arrays[name] = np.asarray(value)
    return arrays


def maps_of(result: Any, prefix: str = "") -> set[str]:
    """The names that :func:`arrays_of` gives to arrays over the pixels ``(..., y, x)``."""
    names: set[str] = set()
    for field in fields(result):
        name, value = prefix + field.name, getattr(result, field.name)
        if is_dataclass(value) and not isinstance(value, Rig):
            names |= maps_of(value, f"{name}.")
        elif tuple(field.metadata.get("dims", ())[-2:]) == ("y", "x"):
            names.add(name)
    return names


def map_names(kind: type[Any], prefix: str = "") -> Iterator[str]:
    """The names that :func:`maps_of` gives to the maps of every result of a class."""
    types = get_type_hints(kind)
    for field in fields(kind):
        name, type_ = prefix + field.name, types[field.name]
        if tuple(field.metadata.get("dims", ())[-2:]) == ("y", "x"):
            yield name
        for one in (type_, *get_args(type_)):
            if isinstance(one, type) and is_dataclass(one) and one is not Rig:
                yield from map_names(one, f"{name}.")


def columns_of(rows: Sequence[Any], kind: type[Any], prefix: str) -> dict[str, NDArray[Any]]:
    """Dataclasses of numbers as one array per field, a row for each."""
    return {
        prefix + field.name: np.array(
            [getattr(row, field.name) for row in rows], dtype=field.metadata["dtype"]
        ).reshape(len(rows), *(SIZES[dim] for dim in field.metadata["dims"]))
        for field in fields(kind)
    }


class Reader:
    """Reads fields whose arrays agree in their sizes.

    Parameters
    ----------
    maps
        An open file; it has ``status (y, x)`` and ``bands (band,)``, which all others are held
        against.
    """

    def __init__(self, maps: SavedMaps) -> None:
        self.maps = maps
        self.sizes: dict[str, int] = dict(SIZES)
        self._array("status", {"dims": ("y", "x"), "dtype": np.uint8})
        self._array("bands", {"dims": ("band",), "dtype": np.str_})

    def fields(self, kind: type[Any], prefix: str = "") -> dict[str, Any]:
        """What the file holds for the fields of a dataclass that say what they run over."""
        return {
            field.name: self._value(prefix + field.name, field.metadata)
            for field in fields(kind)
            if "dims" in field.metadata
        }

    def rows(self, kind: type[Any], prefix: str) -> tuple[Any, ...]:
        """The dataclasses that :func:`columns_of` took apart."""
        columns = [
            self._array(
                prefix + field.name,
                {**field.metadata, "dims": (prefix, *field.metadata["dims"])},
            )
            for field in fields(kind)
        ]
        return tuple(
            kind(*(entry.item() if entry.ndim == 0 else entry for entry in map(np.asarray, row)))
            for row in zip(*columns, strict=True)
        )

    def _value(self, name: str, metadata: Any) -> Any:
        array = self._array(name, metadata)
        if array.ndim == 0:
            return array.item()
        return tuple(array.tolist()) if array.dtype.kind == "U" else array

    def _array(self, name: str, metadata: Any) -> NDArray[Any]:
        """An array of the sizes known so far; what is new of them is known from here on."""
        wanted = tuple(self.sizes.get(dim) for dim in metadata["dims"])
        array: NDArray[Any] = self.maps.array(name, metadata["dtype"], wanted)
        self.sizes |= dict(zip(metadata["dims"], array.shape, strict=True))
        return array

"""Result files: named arrays, checked while they are read."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.casts import contiguous
from impasto._internal.damage import DAMAGE, damage_of
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.folders import recover
from impasto.io.results.store import STORES, store_of
from impasto.io.rig_arrays import arrays_of_rig, rig_of_arrays
from impasto.io.temporary import PARTIAL
from impasto.rig import Rig

STACK = "impasto.Stack"
"""Says that a store holds a stack."""
STORE = ".zarr"
MERGE = "merge"
"""The group of a store that says how it was merged of others."""
RESULT = "sbrdf.npz"
"""The file of a result folder that holds the whole fit."""


def result_file(path: str | os.PathLike[str]) -> Path:
    """The file or store that holds a result: the path itself, or what a result folder has of it.

    Raises
    ------
    ArgumentError
        A store whose job has not finished it.
    """
    target = Path(path)
    if target.suffix.lower() in STORES:
        recover(target)
    _refuse_unfinished(target)
    stored = target.suffix.lower() in STORES and not (target / RESULT).is_file()
    return target / RESULT if target.is_dir() and not stored else target


def _refuse_unfinished(target: Path) -> None:
    """A store that a job has begun lies under another name until its last tile is written."""
    whole = target.with_name(target.name.removesuffix(PARTIAL)) if target.name else target
    if whole.suffix.lower() != STORE or whole.exists():
        return
    partial = whole.with_name(whole.name + PARTIAL)
    if partial.is_dir():
        merged = (partial / MERGE).is_dir()
        how = (
            "the same call of impasto.merge or impasto job merge goes on"
            if merged
            else f"impasto job status {whole} says how many, impasto job resume {whole} goes on"
        )
        raise ArgumentError(
            f"{whole} is not finished: {partial.name} has the tiles that are written so far; {how}"
        )


def other_kind(found: str, wanted: Collection[str]) -> str:
    """What is wrong with a file of this kind where one of others is expected."""
    if found == STACK:
        return (
            f"holds {found}: photographs, not the result of a fit; make one of them by impasto job "
            "run, or impasto fit"
        )
    if len(wanted) > 1:
        return (
            f"holds {found}, not the result of a fit: expected the folder of impasto fit, its "
            f"{RESULT}, or the .zarr of impasto job run"
        )
    return f"holds {_called(found)}, not {next(iter(wanted))}"


def no_photographs(found: str) -> str:
    """What is wrong with a file of this kind where a stack is expected."""
    instead = "; impasto render, view and export take this one" if _is_result(found) else ""
    return (
        f"holds {_called(found)}, not photographs: expected what impasto ingest or "
        f"impasto.io.write_stack made of them, or their light file or folder{instead}"
    )


def _called(kind: str) -> str:
    return f"the result of a fit ({kind})" if _is_result(kind) else kind


def _is_result(kind: str) -> bool:
    return kind.startswith("impasto.") and kind.endswith("Sbrdf")


class SavedMaps:
    """The arrays of an open file, by name."""

    def __init__(self, path: Path, kind: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.path = path
        self.kind = kind
        self.arrays = arrays

    def take(self, name: str) -> Any:
        """One array; an error if it is missing."""
        if name not in self.arrays:
            raise CorruptInputError(self.path, f"has no array {name!r}")
        return self.arrays[name]

    def array(self, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> Any:
        """One array of a type and a shape (None: any size); otherwise an error."""
        found = np.asarray(self.take(name))
        fits = len(found.shape) == len(shape) and all(
            wanted in (None, length) for wanted, length in zip(shape, found.shape, strict=True)
        )
        if not fits:
            raise CorruptInputError(self.path, f"array {name!r} has the wrong shape {found.shape}")
        wanted_type = np.dtype(dtype)
        self.demand(
            name, found.dtype.kind == wanted_type.kind, f"holds {found.dtype}, not {dtype.__name__}"
        )
        if wanted_type.kind == "U":
            return found
        array = contiguous(found, wanted_type).reshape(found.shape)
        if wanted_type.kind == "u" and found.dtype != wanted_type:
            self.demand(name, np.array_equal(array, found), f"holds more than {dtype.__name__} can")
        return array

    def demand(self, name: str, holds: bool, problem: str) -> None:
        """Raise an error for the contents of an array."""
        if not holds:
            raise CorruptInputError(self.path, f"array {name!r} {problem}")


def write_maps(path: str | os.PathLike[str], kind: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a result atomically.

    Raises
    ------
    ArgumentError
        A suffix of no format.
    """
    target = Path(path)
    if target.suffix.lower() not in STORES:
        hint = f"; name it {target.stem}.npz" if target.name else ""
        raise ArgumentError(
            f"path: expected a name ending in {' or '.join(STORES)}, found {target.name!r}{hint}"
        )
    store_of(target).write(target, {"kind": np.array(kind), **arrays})


@contextmanager
def read_maps(path: str | os.PathLike[str], *kinds: str) -> Iterator[SavedMaps]:
    """The arrays of a result; errors while they are read mean a damaged file."""
    target = Path(path)
    with checked_maps(target, store_of(target).read(target), *kinds) as maps:
        yield maps


@contextmanager
def checked_maps(
    target: Path, arrays: Mapping[str, NDArray[Any]], *kinds: str
) -> Iterator[SavedMaps]:
    """Arrays that were read from a file; errors while they are used mean a damaged file."""
    with damage_of(target, "a result"):
        bare = STACK if {"samples", "lights"} <= arrays.keys() else "something else"
        found = str(arrays.get("kind", bare))
    if found not in kinds:
        raise CorruptInputError(target, other_kind(found, kinds))
    try:
        yield SavedMaps(target, found, arrays)
    except CorruptInputError:
        raise
    except (*DAMAGE, ImpastoError) as error:
        raise CorruptInputError(target, f"is damaged ({error})") from error


def rig_arrays(rig: Rig) -> dict[str, NDArray[Any]]:
    """A rig among other arrays: ``rig.lights``, and so on."""
    return {f"rig.{name}": array for name, array in arrays_of_rig(rig).items()}


def rig_from_arrays(maps: SavedMaps) -> Rig:
    """The rig of the arrays of :func:`rig_arrays`."""
    names = ("lights", "near", "falloff", "intensities", "views")
    arrays = {name: maps.take(f"rig.{name}") for name in names}
    for name in ("radii", "view_positions", "pitch_mm", "origin", "refinement"):
        if f"rig.{name}" in maps.arrays:
            arrays[name] = maps.take(f"rig.{name}")
    return rig_of_arrays(arrays)

"""Results as Zarr v3 groups: a folder with one array for each map."""

from __future__ import annotations

import json
import math
import os
import re
import stat
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import DAMAGE
from impasto._internal.recycling import empty
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_together
from impasto.io.folders import new_folder, recover
from impasto.io.results.precision import from_store
from impasto.io.results.zarr_arrays import METADATA, ZarrArray, need_zarr, snapped

FORMAT = 1
"""Version of the format; increased when an entry changes its meaning."""
OWN = "impasto"
"""The attribute of the group that says what it holds."""
LONGEST_METADATA = 1 << 24
"""Most bytes of a ``zarr.json``: those of a result have some thousands."""
NAME = re.compile(r"(levels/[0-9]+/)?[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")
"""Names of arrays: they are names of folders, too."""
OME = "ome"
"""The attribute of the group in which readers of OME-NGFF look."""
EMPTY_GROUP = b'{\n  "attributes": {},\n  "node_type": "group",\n  "zarr_format": 3\n}\n'
"""The ``zarr.json`` of a group that says nothing of itself."""
STATISTICS = "statistics"
"""The array of what is known of pieces of the maps, for plans of pictures."""
Levels: TypeAlias = dict[int, list[ZarrArray]]
"""Smaller maps by how many pixels of the painting, along a side, are one of theirs."""


class ZarrStore:
    """A folder in Zarr v3: crc32c of every chunk, no compression, shards of whole tiles."""

    def write(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See :class:`~impasto.io.results.MapStore`; an older store stays until this is whole.

        Raises
        ------
        ArgumentError
            There is something else of that name, which is not replaced.
        MissingExtraError
            zarr is not installed.
        """
        need_zarr()
        path = Path(os.path.realpath(path))
        if path.exists() and not _is_store(path):
            raise ArgumentError(
                f"path: {path} exists and is no result of impasto; give another name"
            )
        if foreign := _foreign(path):
            raise ArgumentError(
                f"path: {path} holds {foreign}, which saving would remove; give another name"
            )
        size = np.shape(arrays.get("status", 0))
        tile = snapped(max(size)) if len(size) == 2 else None
        stored = zarr_arrays(arrays, size, tile)
        with new_folder(path) as folder:
            for array in stored:
                if array.same_as:
                    continue
                files = dict(array.files(np.asarray(arrays[array.name])))
                atomic_together({folder / name: data for name, data in files.items()})
            atomic_together({folder / METADATA: group_metadata(arrays, stored)})

    def read(self, path: Path) -> Mapping[str, NDArray[Any]]:
        """See :class:`~impasto.io.results.MapStore`.

        Raises
        ------
        FileNotFoundError
            There is none.
        CorruptInputError
            A checksum that does not agree, a file that is missing or truncated, or a store of
            something else; the file is named where one is at fault.
        MissingExtraError
            zarr is not installed.
        """
        recover(path)
        text, stored = contents(path)
        need_zarr()
        own = {one.name: read_array(path, one) for one in stored if not one.same_as}
        return {**text, **own, **{one.name: own[one.same_as] for one in stored if one.same_as}}


def zarr_arrays(
    arrays: Mapping[str, NDArray[Any]], size: tuple[int, ...], tile: int | None
) -> list[ZarrArray]:
    """How arrays that are no text are stored: those ``(..., *size)`` in tiles, if there are any."""
    found = []
    same = same_arrays(arrays)
    for name, array in sorted(arrays.items()):
        if array.dtype.kind not in "U":
            whole = tile is not None and array.ndim >= 2 and array.shape[-2:] == size
            one = ZarrArray(name, array.shape, array.dtype, tile if whole else None)
            found.append(replace(one, same_as=same.get(name, "")) if whole else one)
    return found


def same_arrays(arrays: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """Names of arrays that are another one, not only its like, with the name of that.

    Photometric stereo alone gives its normals as those of the result: they are stored once.
    """
    names: dict[Any, str] = {}
    found = {}
    for name in sorted(arrays, key=lambda name: ("." in name, name)):
        array = arrays[name]
        place = array.__array_interface__["data"][0], array.shape, array.strides, array.dtype.str
        if array.size and names.setdefault(place, name) != name:
            found[name] = names[place]
    return found


def group_metadata(
    arrays: Mapping[str, NDArray[Any]],
    stored: list[ZarrArray],
    levels: Levels | None = None,
    multiscales: Mapping[str, Any] | None = None,
    statistics: ZarrArray | None = None,
) -> bytes:
    """The ``zarr.json`` of a store: its arrays, and the values of those that are text.

    ``levels``: smaller maps of the same painting; ``multiscales``: what other readers know of them;
    ``statistics``: the array of that name.
    """
    content: dict[str, Any] = {
        "format": FORMAT,
        "arrays": _entries(stored),
        "text": {name: array.tolist() for name, array in arrays.items() if array.dtype.kind == "U"},
    }
    if levels:
        content["levels"] = {str(factor): _entries(maps) for factor, maps in levels.items()}
    if statistics is not None:
        content[STATISTICS] = _entries([statistics])
    content["crc32"] = _checksum(content)
    attributes = {OWN: content} | ({OME: dict(multiscales)} if multiscales else {})
    group = {"zarr_format": 3, "node_type": "group", "attributes": attributes}
    return (json.dumps(group, indent=2, sort_keys=True) + "\n").encode()


def _entries(arrays: list[ZarrArray]) -> dict[str, Any]:
    return {
        one.name: {"dtype": one.dtype.name, "shape": list(one.shape), "tile": one.tile}
        | ({"same_as": one.same_as} if one.same_as else {})
        for one in arrays
    }


def contents(path: Path) -> tuple[dict[str, NDArray[Any]], list[ZarrArray]]:
    """The texts of a store, and its arrays; no other file has been read.

    Raises
    ------
    FileNotFoundError
        There is none.
    CorruptInputError
        No store of impasto, or one whose list of arrays is damaged.
    """
    own = _checked(path)
    try:
        text = {str(name): np.array(value, np.str_) for name, value in own["text"].items()}
        stored = [_stored(name, entry) for name, entry in own["arrays"].items()]
        by_name = {one.name: one for one in stored}
        for one in stored:
            if one.same_as and by_name[one.same_as] != replace(one, name=one.same_as, same_as=""):
                raise ValueError(f"{one.name} is not like {one.same_as}")
    except DAMAGE as error:
        raise CorruptInputError(path / METADATA, f"is damaged ({error})") from error
    return text, stored


def levels_of(path: Path) -> Levels:
    """The smaller maps of a store, by how many pixels of the painting are one of theirs.

    Raises
    ------
    FileNotFoundError, CorruptInputError
        As :func:`contents`.
    """
    own = _checked(path)
    try:
        found = {
            int(factor): [_stored(name, entry) for name, entry in maps.items()]
            for factor, maps in own.get("levels", {}).items()
        }
    except DAMAGE as error:
        raise CorruptInputError(path / METADATA, f"is damaged ({error})") from error
    return dict(sorted(found.items()))


def statistics_of(path: Path) -> ZarrArray | None:
    """The array of what is known of pieces of the maps; None of a store without it.

    Raises
    ------
    FileNotFoundError, CorruptInputError
        As :func:`contents`.
    """
    own = _checked(path)
    try:
        found = [_stored(name, entry) for name, entry in own.get(STATISTICS, {}).items()]
    except DAMAGE as error:
        raise CorruptInputError(path / METADATA, f"is damaged ({error})") from error
    return found[0] if found else None


def _checked(path: Path) -> dict[str, Any]:
    """What a store says of itself, unchanged since it was written."""
    if not path.exists():
        raise FileNotFoundError(2, "No such file or directory", str(path))
    own = _own(path)
    if own is None:
        raise CorruptInputError(path, f"is no result of impasto: see {METADATA} of the folder")
    if own.pop("crc32", None) != _checksum(own):
        raise CorruptInputError(path / METADATA, "is damaged: its checksum does not agree")
    if own.get("format") != FORMAT:
        raise CorruptInputError(
            path,
            f"has the format {own.get('format')}, this version of impasto reads {FORMAT}: use the "
            "version that made it, or fit the painting anew",
        )
    return own


def check_files(path: Path, array: ZarrArray) -> None:
    """Every file of an array is there, and every shard holds all its chunks.

    Raises
    ------
    CorruptInputError
        It names the file.
    """
    _check_metadata(path, array)
    for name, _ in array.paths():
        _check_file(path / name)
    if array.tile is None:
        # Not to ask for more memory than there are numbers.
        wanted = math.prod(array.shape) * array.dtype.itemsize
        size = sum((path / name).stat().st_size for name, _ in array.paths())
        if wanted > size:
            raise CorruptInputError(path / array.path(), "is truncated")
        return
    for name, (row, column) in array.paths():
        if lost := array.missing_chunks(path / name, row, column):
            raise CorruptInputError(path / name, f"is truncated: it lacks {lost} of its chunks")


def check_window(path: Path, array: ZarrArray, rows: slice, columns: slice) -> None:
    """The same of the shards and chunks alone that a window of a map touches."""
    for row, column in array.tiles(rows, columns):
        file = path / array.path(row, column)
        _check_file(file)
        if lost := array.missing_chunks(file, row, column, (rows, columns)):
            raise CorruptInputError(file, f"is truncated: it lacks {lost} of its chunks")


def _check_file(file: Path) -> None:
    try:
        mode = file.lstat().st_mode
    except OSError as error:
        raise CorruptInputError(file, "is missing") from error
    if not stat.S_ISREG(mode):
        raise CorruptInputError(file, "is no file")


def _check_metadata(path: Path, array: ZarrArray) -> None:
    file = path / array.metadata_path
    _check_file(file)
    if file.stat().st_size > LONGEST_METADATA:
        raise CorruptInputError(file, "is too long to describe an array")


def read_array(path: Path, array: ZarrArray) -> NDArray[Any]:
    """One array of a store, all of whose checksums agree; a map in single precision.

    Raises
    ------
    CorruptInputError
        It names the file or the array.
    """
    check_files(path, array)
    if is_usual(path, array):
        height, width = array.shape[-2:]
        return from_store(array.name, _filled(path, array, slice(0, height), slice(0, width)))
    with _damage_of(path / array.folder):
        found = np.asarray(_opened(path, array)[...], dtype=array.dtype)
    return from_store(array.name, found)


def read_window(
    path: Path, array: ZarrArray, rows: slice, columns: slice, stride: int = 1
) -> NDArray[Any]:
    """A window ``(..., rows, columns)`` of a map; no other chunks are read.

    ``stride``: every so many of its rows and columns, from the first on.

    Raises
    ------
    CorruptInputError
        A chunk of the window whose checksum does not agree or that is missing; other chunks are not
        looked at.
    """
    _check_metadata(path, array)
    check_window(path, array, rows, columns)
    if is_usual(path, array):
        return from_store(array.name, _filled(path, array, rows, columns, stride))
    with _damage_of(path / array.folder):
        found = np.asarray(_opened(path, array)[..., rows, columns], dtype=array.dtype)
    return from_store(array.name, found[..., ::stride, ::stride])


def _filled(
    path: Path, array: ZarrArray, rows: slice, columns: slice, stride: int = 1
) -> NDArray[Any]:
    """A window of a map, whose files are as this version writes them."""
    size = (-(-(side.stop - side.start) // stride) for side in (rows, columns))
    found = empty((*array.shape[:-2], *size), array.dtype)
    array.filled(path, (rows, columns), found, stride)
    return found


def is_usual(path: Path, array: ZarrArray) -> bool:
    """Whether a map is described as this version describes it; zarr reads what else there is."""
    if array.tile is None or 0 in array.shape:
        return False
    try:
        found = json.loads((path / array.metadata_path).read_bytes())
        own = json.loads(array.metadata)
        for one in (found, own):
            one.pop("dimension_names", None)
            one.pop("attributes", None)
    except (*DAMAGE, OSError):
        return False
    return bool(found == own)


def _opened(path: Path, array: ZarrArray) -> Any:
    import zarr

    found = zarr.open_array(str(path / array.folder), mode="r", zarr_format=3)
    if (found.shape, found.dtype, found.shards) != _layout(array):
        raise ValueError(f"{found.dtype} {found.shape} in shards {found.shards}")
    return found


@contextmanager
def _damage_of(folder: Path) -> Iterator[None]:
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:  # zarr and its codecs raise whatever they stumble over
        raise CorruptInputError(folder, f"is damaged ({error})") from error


def _layout(array: ZarrArray) -> tuple[Any, ...]:
    tile = array.tile
    shards = None if tile is None else (*array.shape[:-2], tile, tile)
    return array.shape, array.dtype, shards


def _stored(name: str, entry: Mapping[str, Any]) -> ZarrArray:
    shape, tile, dtype = entry["shape"], entry["tile"], np.dtype(entry["dtype"])
    same_as = entry.get("same_as", "")
    fine = (
        NAME.fullmatch(name) is not None
        and isinstance(same_as, str)
        and dtype.kind in "biuf"
        and all(isinstance(size, int) and size >= 0 for size in shape)
        and (tile is None or (isinstance(tile, int) and tile > 0 and len(shape) >= 2))
    )
    if not fine:
        raise ValueError(f"an array {name!r} of {entry!r}")
    return ZarrArray(name, tuple(shape), dtype, tile, same_as=same_as)


def _own(path: Path) -> dict[str, Any] | None:
    """What a folder says of itself; None if it is no store of impasto."""
    file = path / METADATA
    try:
        mode = file.lstat()
        if not stat.S_ISREG(mode.st_mode) or mode.st_size > LONGEST_METADATA:
            return None
        group = json.loads(file.read_bytes())
        own = group["attributes"][OWN]
    except (*DAMAGE, OSError):
        return None
    return dict(own) if isinstance(own, dict) else None


def _foreign(path: Path) -> str | None:
    """Something in a store that is none of its arrays: notes of a job, or what people put there."""
    if not path.exists():
        return None
    own = {METADATA, *((_own(path) or {}).get("arrays") or ())}
    return next((one.name for one in sorted(path.iterdir()) if one.name not in own), None)


def _is_store(path: Path) -> bool:
    return _own(path) is not None


def _checksum(content: Mapping[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(content, sort_keys=True).encode()):08x}"

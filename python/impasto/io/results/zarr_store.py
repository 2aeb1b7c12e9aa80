"""Results as Zarr v3 groups: a folder with one array for each map."""

from __future__ import annotations

import json
import math
import os
import re
import stat
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import DAMAGE
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_together
from impasto.io.folders import new_folder, recover
from impasto.io.results.zarr_arrays import METADATA, ZarrArray, need_zarr, snapped

FORMAT = 1
"""Version of the format; increased when an entry changes its meaning."""
OWN = "impasto"
"""The attribute of the group that says what it holds."""
LONGEST_METADATA = 1 << 24
"""Most bytes of a ``zarr.json``: those of a result have some thousands."""
NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")
"""Names of arrays: they are names of folders, too."""


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
        return {**text, **{array.name: _read(path, array) for array in stored}}


def zarr_arrays(
    arrays: Mapping[str, NDArray[Any]], size: tuple[int, ...], tile: int | None
) -> list[ZarrArray]:
    """How arrays that are no text are stored: those ``(..., *size)`` in tiles, if there are any."""
    found = []
    for name, array in sorted(arrays.items()):
        if array.dtype.kind not in "U":
            whole = tile is not None and array.ndim >= 2 and array.shape[-2:] == size
            found.append(ZarrArray(name, array.shape, array.dtype, tile if whole else None))
    return found


def group_metadata(arrays: Mapping[str, NDArray[Any]], stored: list[ZarrArray]) -> bytes:
    """The ``zarr.json`` of a store: its arrays, and the values of those that are text."""
    content: dict[str, Any] = {
        "format": FORMAT,
        "arrays": {
            one.name: {"dtype": one.dtype.name, "shape": list(one.shape), "tile": one.tile}
            for one in stored
        },
        "text": {name: array.tolist() for name, array in arrays.items() if array.dtype.kind == "U"},
    }
    content["crc32"] = _checksum(content)
    group = {"zarr_format": 3, "node_type": "group", "attributes": {OWN: content}}
    return (json.dumps(group, indent=2, sort_keys=True) + "\n").encode()


def contents(path: Path) -> tuple[dict[str, NDArray[Any]], list[ZarrArray]]:
    """The texts of a store, and its arrays; no other file has been read.

    Raises
    ------
    FileNotFoundError
        There is none.
    CorruptInputError
        No store of impasto, or one whose list of arrays is damaged.
    """
    if not path.exists():
        raise FileNotFoundError(2, "No such file or directory", str(path))
    own = _own(path)
    if own is None:
        raise CorruptInputError(path, f"is no result of impasto: see {METADATA} of the folder")
    if own.pop("crc32", None) != _checksum(own):
        raise CorruptInputError(path / METADATA, "is damaged: its checksum does not agree")
    if own.get("format") != FORMAT:
        raise CorruptInputError(
            path, f"has the format {own.get('format')}; this version of impasto reads {FORMAT}"
        )
    try:
        text = {str(name): np.array(value, np.str_) for name, value in own["text"].items()}
        stored = [_stored(name, entry) for name, entry in own["arrays"].items()]
    except DAMAGE as error:
        raise CorruptInputError(path / METADATA, f"is damaged ({error})") from error
    return text, stored


def check_files(path: Path, array: ZarrArray) -> None:
    """Every file of an array is there, and every shard holds all its chunks.

    Raises
    ------
    CorruptInputError
        It names the file.
    """
    for name in (array.metadata_path, *(name for name, _ in array.paths())):
        file = path / name
        try:
            mode = file.lstat().st_mode
        except OSError as error:
            raise CorruptInputError(file, "is missing") from error
        if not stat.S_ISREG(mode):
            raise CorruptInputError(file, "is no file")
    if (path / array.metadata_path).stat().st_size > LONGEST_METADATA:
        raise CorruptInputError(path / array.metadata_path, "is too long to describe an array")
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


def _read(path: Path, array: ZarrArray) -> NDArray[Any]:
    """One array, all of whose checksums agree."""
    import zarr

    check_files(path, array)
    folder = path / array.name
    try:
        found = zarr.open_array(str(folder), mode="r", zarr_format=3)
        if (found.shape, found.dtype, found.shards) != _layout(array):
            raise ValueError(f"{found.dtype} {found.shape} in shards {found.shards}")
        return np.asarray(found[...], dtype=array.dtype)
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
    fine = (
        NAME.fullmatch(name) is not None
        and dtype.kind in "biuf"
        and all(isinstance(size, int) and size >= 0 for size in shape)
        and (tile is None or (isinstance(tile, int) and tile > 0 and len(shape) >= 2))
    )
    if not fine:
        raise ValueError(f"an array {name!r} of {entry!r}")
    return ZarrArray(name, tuple(shape), dtype, tile)


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

"""Arrays in files as sources: ``.npy``, and members of ``.npz`` that are not compressed."""

from __future__ import annotations

import ast
import io
import math
import struct
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import DAMAGE, damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.sources import Source

MAGIC = b"\x93NUMPY"
LONGEST_HEADER = 1 << 16
"""Bytes in which the header of an array must end."""
_LOCAL_HEADER = 30
"""Bytes of the fixed part of a member's header in a zip archive."""


@dataclass(frozen=True, slots=True)
class StoredArray:
    """Where the values of an array in ``.npy`` format lie in a file."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    by_columns: bool

    @property
    def nbytes(self) -> int:
        """Bytes of all values."""
        return math.prod(self.shape) * self.dtype.itemsize


class ArraySource(Source):
    """An array ``(band, y, x)`` or ``(y, x)`` of a file, of which rows are read where they lie.

    Parameters
    ----------
    file
        The file, which the source closes.
    stored
        Where the array lies: the last three axes of a C-contiguous one.
    """

    def __init__(self, file: RegularFile, stored: StoredArray) -> None:
        path, dtype = file.path, stored.dtype
        shape = stored.shape if len(stored.shape) == 3 else (1, *stored.shape)
        if len(shape) != 3 or 0 in shape:
            raise ArgumentError(
                f"{path}: holds an array of shape {stored.shape}; expected (band, y, x) or (y, x)"
            )
        if dtype.kind not in "uif" or dtype.itemsize > 8:
            raise ArgumentError(f"{path}: holds {dtype}; expected numbers of at most 64 bits")
        if stored.by_columns:
            raise ArgumentError(
                f"{path}: its array is stored column by column; save numpy.ascontiguousarray(array)"
            )
        self._file = file
        self._stored = stored
        self._shape = (shape[0], shape[1], shape[2])

    @property
    def name(self) -> str:
        """See :class:`Source`."""
        return str(self._file.path)

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`Source`."""
        return self._shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """See :class:`Source`."""
        return self._stored.dtype.newbyteorder("=")

    @property
    def grid(self) -> tuple[int, int]:
        """One pixel: rows are read in parts."""
        return 1, 1

    def close(self) -> None:
        """See :class:`Source`."""
        self._file.close()

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        bands, height, width = self._shape
        item = self._stored.dtype.itemsize
        out = np.empty((bands, bottom - top, right - left), self.dtype)
        for band in range(bands):
            start = self._stored.offset + ((band * height + top) * width + left) * item
            found = self._file.rows(start, width * item, bottom - top, (right - left) * item)
            out[band] = found.view(self._stored.dtype)
        return out


def open_array(file: RegularFile) -> ArraySource:
    """The array of a ``.npy`` file."""
    head = file.at(0, min(LONGEST_HEADER, file.size))
    return ArraySource(file, array_in(file.path, head, 0, file.size))


def open_member(file: RegularFile, name: str, index: int | None = None) -> ArraySource:
    """One array of an ``.npz`` archive as :func:`numpy.savez` writes it: not compressed.

    Parameters
    ----------
    name
        Of the array.
    index
        Of one observation of an array ``(obs, band, y, x)``; None: an array ``(band, y, x)`` or
        ``(y, x)``.

    Raises
    ------
    ArgumentError
        No such array, a compressed one, or one of another kind.
    CorruptInputError
        A damaged archive.
    """
    stored = member(file, name)
    if index is not None:
        stored = observation(file.path, stored, index)
    return ArraySource(file, stored)


def observation(path: Path, stored: StoredArray, index: int) -> StoredArray:
    """One of an array ``(obs, band, y, x)``."""
    if len(stored.shape) != 4 or not 0 <= index < stored.shape[0]:
        raise ArgumentError(
            f"index: {index}, where {path} has an array {stored.shape}, not (obs, band, y, x) with "
            "more observations"
        )
    size = stored.nbytes // stored.shape[0]
    return replace(stored, offset=stored.offset + index * size, shape=stored.shape[1:])


def member(file: RegularFile, name: str) -> StoredArray:
    """Where an array of an archive lies; see :func:`open_member`."""
    with damage_of(file.path, ".npz"), zipfile.ZipFile(file.handle) as archive:
        members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
    if name not in members:
        raise ArgumentError(f"{file.path}: has no array {name!r}, only {sorted(members)}")
    found = members[name]
    if found.compress_type != zipfile.ZIP_STORED:
        raise ArgumentError(
            f"{file.path}: its array {name!r} is compressed, so that no window can be read alone; "
            "write it with numpy.savez"
        )
    local = file.at(found.header_offset, _LOCAL_HEADER)
    if local[:4] != b"PK\3\4":
        raise CorruptInputError(file.path, f"is damaged: no array {name!r} where it is listed")
    names, extra = struct.unpack_from("<HH", local, 26)
    start = found.header_offset + _LOCAL_HEADER + names + extra
    head = file.at(start, min(LONGEST_HEADER, found.file_size))
    return array_in(file.path, head, start, found.file_size)


def _check_header(head: bytes, at: int, version: tuple[int, int]) -> None:
    """Refuse what numpy reads with a warning: headers of Python 2, and the name ``a`` of a type.

    Raises
    ------
    SyntaxError
        Something else than one literal of Python 3.
    ValueError
        A type that is no number or text.
    """
    wide = 2 if version == (1, 0) else 4
    length = int.from_bytes(head[at : at + wide], "little")
    header = ast.literal_eval(head[at + wide : at + wide + length].decode("latin1"))
    kind = header.get("descr") if isinstance(header, dict) else None
    if not isinstance(kind, str) or "a" in kind:
        raise ValueError(f"of type {kind!r}")


def array_in(path: Path, head: bytes, start: int, size: int) -> StoredArray:
    """The array in ``.npy`` format whose ``size`` bytes begin with ``head`` at ``start``.

    Raises
    ------
    CorruptInputError
        No array, or one that does not fit in.
    """
    opened = io.BytesIO(head)
    try:
        version = np.lib.format.read_magic(opened)
        _check_header(head, opened.tell(), version)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, by_columns, dtype = read(opened)
        stored = StoredArray(
            start + opened.tell(),
            tuple(int(n) for n in shape),
            dtype,
            by_columns and len(shape) > 1,
        )
    except DAMAGE as error:
        raise CorruptInputError(path, f"has a damaged header of an array ({error})") from error
    left = size - opened.tell()
    if min(stored.shape, default=0) < 0 or (not dtype.hasobject and stored.nbytes > left):
        raise CorruptInputError(
            path,
            f"is truncated: it claims an array {stored.shape} of {dtype}, {stored.nbytes} bytes, "
            f"and has {left}",
        )
    return stored

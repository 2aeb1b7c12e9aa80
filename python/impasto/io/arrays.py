"""Arrays in files as sources: ``.npy``, and members of ``.npz`` that are not compressed."""

from __future__ import annotations

import io
import math
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.regular import RegularFile
from impasto.io.sources import Source

MAGIC = b"\x93NUMPY"
_LONGEST_HEADER = 1 << 16
_LOCAL_HEADER = 30
"""Bytes of the fixed part of a member's header in a zip archive."""


@dataclass(frozen=True, slots=True)
class StoredArray:
    """Where the values of an array in ``.npy`` format lie in a file."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

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
        shape = stored.shape if len(stored.shape) == 3 else (1, *stored.shape)
        if len(shape) != 3 or 0 in shape:
            raise ArgumentError(
                f"{file.path}: holds an array of shape {stored.shape}; expected (band, y, x) or "
                "(y, x)"
            )
        if stored.dtype.kind not in "uif" or stored.dtype.itemsize > 8:
            raise ArgumentError(f"{file.path}: holds {stored.dtype}; expected numbers")
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


def open_npy(file: RegularFile) -> ArraySource:
    """The array of a ``.npy`` file."""
    return ArraySource(file, stored_array(file, 0, file.size))


def open_member(path: str | Path, name: str) -> ArraySource:
    """One array ``(band, y, x)`` or ``(y, x)`` of an ``.npz`` archive, without reading the others.

    Parameters
    ----------
    path
        The archive, as :func:`numpy.savez` writes it: its arrays are not compressed.
    name
        Of the array.

    Raises
    ------
    ArgumentError
        No such array, a compressed one, or one of another kind.
    CorruptInputError
        A damaged archive.
    """
    path = Path(path)
    file = RegularFile(path)
    try:
        return ArraySource(file, _member(file, name))
    except BaseException:
        file.close()
        raise


def _member(file: RegularFile, name: str) -> StoredArray:
    try:
        with zipfile.ZipFile(file.handle) as archive:
            members = {
                member.filename.removesuffix(".npy"): member for member in archive.infolist()
            }
    except (zipfile.BadZipFile, OSError, ValueError, struct.error) as error:
        raise CorruptInputError(file.path, f"cannot be read as .npz ({error})") from error
    if name not in members:
        raise ArgumentError(f"{file.path}: has no array {name!r}, only {sorted(members)}")
    member = members[name]
    if member.compress_type != zipfile.ZIP_STORED:
        raise ArgumentError(
            f"{file.path}: its array {name!r} is compressed, so that no window can be read alone; "
            "write it with numpy.savez"
        )
    local = file.at(member.header_offset, _LOCAL_HEADER)
    if local[:4] != b"PK\3\4":
        raise CorruptInputError(file.path, f"is damaged: no array {name!r} where it is listed")
    names, extra = struct.unpack_from("<HH", local, 26)
    return stored_array(
        file, member.header_offset + _LOCAL_HEADER + names + extra, member.file_size
    )


def stored_array(file: RegularFile, start: int, size: int) -> StoredArray:
    """The array in ``.npy`` format in ``size`` bytes from ``start`` on.

    Raises
    ------
    CorruptInputError
        No array, or one that does not fit in.
    ArgumentError
        An array of Python objects, or in Fortran's order.
    """
    head = io.BytesIO(file.at(start, min(size, _LONGEST_HEADER, file.size - start)))
    try:
        version = np.lib.format.read_magic(head)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, in_fortran_order, dtype = read(head)
    except (ValueError, KeyError, EOFError, SyntaxError, RecursionError) as error:
        raise CorruptInputError(file.path, f"has a damaged header of an array ({error})") from error
    if dtype.hasobject:
        raise ArgumentError(f"{file.path}: holds Python objects, not numbers")
    if in_fortran_order and len(shape) > 1:
        raise ArgumentError(
            f"{file.path}: its array is stored column by column; save "
            "numpy.ascontiguousarray(array)"
        )
    stored = StoredArray(start + head.tell(), tuple(int(n) for n in shape), dtype)
    if min(stored.shape, default=0) < 0 or head.tell() + stored.nbytes > size:
        raise CorruptInputError(
            file.path,
            f"is truncated: it claims an array {stored.shape} of {dtype}, {stored.nbytes} bytes, "
            f"and has {size - head.tell()}",
        )
    return stored

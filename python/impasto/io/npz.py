"""Arrays by name in one ``.npz`` file; no pickles."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Mapping
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import DAMAGE, damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.arrays import LONGEST_HEADER, MAGIC, array_in
from impasto.io.budget import check_claim
from impasto.io.files import atomic_path


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays atomically.

    Raises
    ------
    ArgumentError
        Another suffix.
    """
    if path.suffix.lower() != ".npz":
        hint = f"; name it {path.stem}.npz" if path.name else ""
        raise ArgumentError(f"path: expected a name ending in .npz, found {path.name!r}{hint}")
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **dict(arrays))


def npz_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The file that :func:`write_npz` writes; the same for the same arrays."""
    file = BytesIO()
    np.savez(file, allow_pickle=False, **dict(arrays))
    return file.getvalue()


def npz_names(path: Path) -> tuple[str, ...]:
    """The names of the arrays of a file; none where it cannot be read as one."""
    try:
        with zipfile.ZipFile(path) as archive:
            return tuple(name.removesuffix(".npy") for name in archive.namelist())
    except (OSError, *DAMAGE):
        return ()


def read_npz(path: Path, *, without: str = "") -> dict[str, NDArray[Any]]:
    """All arrays of a file, but the one ``without``.

    Raises
    ------
    FileNotFoundError
        There is none.
    ArgumentError
        A folder, a pipe or a device.
    CorruptInputError
        It is truncated, damaged or something else, or claims more than such a file can hold.
    """
    try:
        opened = RegularFile(path)
    except ArgumentError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise error.__cause__ from None
        raise
    with closing(opened):
        if opened.size < 2 or opened.at(0, 2) != b"PK":  # numpy takes any other for a pickle
            raise CorruptInputError(path, "is no .npz file")
        opened.handle.seek(0)
        # Opened here: numpy leaves its own handle open if the archive is damaged.
        with damage_of(path, ".npz"), np.load(opened.handle, allow_pickle=False) as file:
            _check_claims(path, file.zip)
            return {key: _numbers(path, key, file[key]) for key in file.files if key != without}


def _numbers(path: Path, name: str, array: Any) -> NDArray[Any]:
    """An array of real numbers, truth values or text; numpy gives other members as bytes."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biufU":
        what = array.dtype if isinstance(array, np.ndarray) else "no array"
        raise CorruptInputError(path, f"has an array {name!r} that holds {what}")
    if array.dtype.kind == "U":
        # numpy makes texts of any numbers, and Python stumbles over them later.
        kind = np.dtype(np.uint32).newbyteorder(array.dtype.byteorder)
        if np.frombuffer(array.tobytes(), kind).max(initial=0) > sys.maxunicode:
            raise CorruptInputError(path, f"has an array {name!r} of characters that do not exist")
    return array


def _check_claims(path: Path, archive: zipfile.ZipFile) -> None:
    """No array is longer than its member, and no member longer than its bytes can become."""
    for member in archive.infolist():
        check_claim(path, member.file_size, member.compress_size, f"an array {member.filename!r}")
        with archive.open(member) as file:
            head = file.read(min(LONGEST_HEADER, member.file_size))
        if head.startswith(MAGIC):
            array_in(path, head, 0, member.file_size)

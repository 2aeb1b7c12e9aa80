"""Arrays by name in one ``.npz`` file; no pickles."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_path

DAMAGE = (
    *(OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error),
    RuntimeError,  # A flipped bit can mean: encrypted, or unknown compression.
)
"""Exceptions of numpy and zipfile for a damaged archive."""


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


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file.

    Raises
    ------
    FileNotFoundError
        There is none.
    CorruptInputError
        It is truncated, damaged or something else.
    """
    if path.is_file() and not _has_content_of_zip(path):
        raise CorruptInputError(path, "is no .npz file")
    try:
        # Opened here: numpy leaves its own handle open if the archive is damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {key: file[key] for key in file.files}
    except FileNotFoundError:
        raise
    except DAMAGE as error:
        raise CorruptInputError(path, f"cannot be read as .npz ({error})") from error


def _has_content_of_zip(path: Path) -> bool:
    """Whether a file begins like an archive; numpy takes any other for a pickle."""
    with path.open("rb") as file:
        return file.read(2) == b"PK"

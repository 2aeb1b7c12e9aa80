"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from impasto.io.files import as_problem_of, sync_folder

PARTIAL = ".partial"
"""Ends the names of folders that are not whole yet."""


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder beside ``path`` that replaces it if the block ends without an error.

    All files in it must have been written by :func:`atomic_together`. An older folder of that name
    stays until the new one is whole on the disk; it is then moved aside, and removed when the new
    one has its name. After an error the new one is gone and the older untouched.
    """
    with as_problem_of(path):
        made = tempfile.mkdtemp(dir=path.parent, prefix=f".{path.stem}-", suffix=PARTIAL)
    folder = Path(made)
    try:
        yield folder
        folder.chmod(0o777 & ~_umask())
        sync_folders(folder)
        put_in_place(folder, path)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def put_in_place(folder: Path, path: Path) -> None:
    """Give a folder that is whole on the disk its name; an older one is removed afterwards."""
    older = None
    if path.exists():
        older = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.stem}-", suffix=".old"))
        path.rename(older / path.name)
    try:
        folder.rename(path)
    except BaseException:
        if older is not None:
            (older / path.name).rename(path)
            older.rmdir()
        raise
    sync_folder(path.parent)
    if older is not None:
        shutil.rmtree(older, ignore_errors=True)


def sync_folders(folder: Path) -> None:
    """The names of all files below a folder reach the disk, those of subfolders first."""
    for inner, _, _ in os.walk(folder, topdown=False):
        sync_folder(Path(inner))


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

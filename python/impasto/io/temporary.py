"""Files and folders that are being written, under names of their own beside the final one.

Their writer holds a lock on each, which ends with the process, however that ends. So the next
writer of the same name knows those that a killed one left, and removes them.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PARTIAL = ".partial"
"""Ends the names of files and folders that are not whole yet."""
OLD = ".old"
"""Ends the names of folders that hold what is being replaced."""
_RANDOM = 8
"""Characters that ``tempfile`` adds to a name."""
_LONGEST = 60
"""Characters of the final name that are kept: systems allow 255 bytes in all."""
_TOGETHER = ".tmp"
"""Ends the names of files that are written together."""


@contextmanager
def temporary_beside(
    path: Path, suffix: str = "", *, folder: bool = False, ending: str = PARTIAL
) -> Iterator[Path]:
    """A new file or folder beside ``path``, locked while the block runs.

    What killed writers of the same name left is removed first. The block moves or removes the new
    one.

    Parameters
    ----------
    suffix
        Ends the name of a file, behind ``ending``: writers of pictures look at it.
    folder
        Whether to make a folder.
    """
    for left in leftovers(path, suffix, ending=ending):
        _remove(left)
    prefix, ending = _names(path, suffix, ending)
    while True:
        if folder:
            made = tempfile.mkdtemp(dir=path.parent, prefix=prefix, suffix=ending)
            handle = os.open(made, os.O_RDONLY) if os.name == "posix" else -1
        else:
            handle, made = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=ending)
        if os.name != "posix":  # no locks; an open file could not be moved
            os.close(handle) if handle >= 0 else None
            yield Path(made)
            return
        try:
            # Between the two steps another writer may take it for one that was left.
            if _locked(handle, Path(made)) is not False:
                yield Path(made)
                return
        finally:
            os.close(handle)


def temporaries_of(paths: Iterable[Path]) -> dict[Path, Path]:
    """A temporary file beside each path, of names that no other call has."""
    own = secrets.token_hex(6)
    return {path: path.with_name(f".{path.name}-{own}{_TOGETHER}") for path in paths}


def is_temporary(name: str) -> bool:
    """Whether a name is one of a file that is being written, or that a killed writer left."""
    ours = rf"[0-9a-f]+{re.escape(_TOGETHER)}|[a-z0-9_]{{{_RANDOM}}}{re.escape(PARTIAL)}(\..+)?"
    return re.fullmatch(rf"\..+-({ours})", name) is not None


def leftovers(path: Path, suffix: str = "", *, ending: str = PARTIAL) -> Iterator[Path]:
    """What killed writers of ``path`` left beside it; each is locked until the next is asked for.

    Nothing where the system has no locks, or the folder cannot be read.
    """
    if os.name != "posix":
        return
    start, end = _names(path, suffix, ending)
    try:
        names = [
            name
            for name in (one.name for one in path.parent.iterdir())
            if name.startswith(start)
            and name.endswith(end)
            and len(name) == len(start) + _RANDOM + len(end)
        ]
    except OSError:
        return
    for name in sorted(names):
        left = path.parent / name
        try:
            handle = os.open(left, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            continue
        try:
            if _locked(handle, left):
                yield left
        finally:
            os.close(handle)


def _names(path: Path, suffix: str, ending: str) -> tuple[str, str]:
    return f".{path.stem[:_LONGEST]}-", ending + suffix


def _locked(handle: int, path: Path) -> bool | None:
    """Whether a lock could be had of what still has this name; None where there are no locks."""
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except FileNotFoundError:
        return False


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()

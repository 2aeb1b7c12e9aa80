"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from impasto._internal.umask import umask
from impasto.io.files import as_problem_of, sync_folder
from impasto.io.temporary import OLD, leftovers, temporary_beside


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder beside ``path`` that replaces it if the block ends without an error.

    All files in it must have been written by :func:`atomic_together`. An older folder of that name
    stays until the new one is whole on the disk; it is then moved aside, and removed when the new
    one has its name. After an error the new one is gone and the older untouched; an error of the
    system names what was asked for, not the temporary folder. What a killed process left goes with
    the next write of that name (:func:`recover`).
    """
    recover(path)
    with ExitStack() as held:
        with as_problem_of(path):
            folder = held.enter_context(temporary_beside(path, folder=True))
        try:
            yield folder
            folder.chmod(0o777 & ~umask())
            sync_folders(folder)
            put_in_place(folder, path)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise_by_name(error, folder, path)
            raise
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise


@contextmanager
def new_files(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Files of one folder that belong together and get their names if the block ends well.

    They are made in a hidden folder beside the first, under their own names, by functions like
    :func:`atomic_bytes`. The first gets its name first, after those that belong to an older one are
    gone: a file never stands beside what is said of another. After an error of the block nothing
    has changed.
    """
    first = paths[0]
    with ExitStack() as held:
        with as_problem_of(first):
            folder = held.enter_context(temporary_beside(first, folder=True))
        made = tuple(folder / path.name for path in paths)
        try:
            yield made
            for path in paths[1:]:
                path.unlink(missing_ok=True)
            for source, path in zip(made, paths, strict=True):
                source.replace(path)
            sync_folder(first.parent)
        except OSError as error:
            raise_by_name(error, folder, first.parent)
            raise
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def raise_by_name(error: OSError, folder: Path, path: Path) -> None:
    """Raise an error in the temporary folder of ``path`` once more, by the name that was asked for.

    An error about something else, or not of the system, is left to the caller.
    """
    named = _requested(error.filename, folder, path) if error.errno else None
    if named is not None:
        raise OSError(error.errno, error.strerror, str(named)) from error


def _requested(name: object, folder: Path, path: Path) -> Path | None:
    """The file of ``path`` that an error in its temporary folder is about; None: it is not."""
    if name is None:  # flushes and full disks name no file at all
        return path
    with suppress(TypeError, ValueError):
        return path / Path(os.fsdecode(name)).relative_to(folder)  # type: ignore[arg-type]
    return None


def put_in_place(folder: Path, path: Path) -> None:
    """Give a folder that is whole on the disk its name; an older one is removed afterwards."""
    if not path.exists():
        folder.rename(path)
        sync_folder(path.parent)
        return
    with temporary_beside(path, folder=True, ending=OLD) as replaced:
        older = replaced / path.name
        try:
            path.rename(older)
            folder.rename(path)
        except BaseException:
            if older.exists():
                older.rename(path)
            replaced.rmdir()
            raise
        try:
            sync_folder(path.parent)
        finally:
            shutil.rmtree(replaced, ignore_errors=True)


def recover(path: Path) -> None:
    """Give a folder its name back whose replacement was killed between its two renames.

    Leftovers of replacements are removed; what cannot be moved or removed stays.
    """
    for replaced in leftovers(path, ending=OLD):
        older = replaced / path.name
        with suppress(OSError):
            if older.exists() and not path.exists():
                older.rename(path)
                sync_folder(path.parent)
        if path.exists():
            shutil.rmtree(replaced, ignore_errors=True)


def sync_folders(folder: Path) -> None:
    """The names of all files below a folder reach the disk, those of subfolders first."""
    for inner, _, _ in os.walk(folder, topdown=False):
        sync_folder(Path(inner))

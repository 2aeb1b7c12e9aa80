"""Atomic writing of files; reading text of any encoding."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from impasto._internal.pools import Pool
from impasto._internal.regular import check_regular
from impasto._internal.umask import umask
from impasto._internal.waiting import wait_for
from impasto.errors import ArgumentError
from impasto.io.temporary import temporaries_of, temporary_beside

FLUSHED = 8
"""Files whose data are on their way to the disk at a time."""


@contextmanager
def as_problem_of(path: Path) -> Iterator[None]:
    """Errors of the system name the requested file instead of the temporary one."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that replaces it if the block ends without an error.

    The data reaches the disk before the name does: flush, fsync, rename, fsync of the folder.
    After an error the temporary file is gone and an older file of that name is untouched. What a
    killed process left goes with the next write of that name.
    """
    path = Path(path)
    with ExitStack() as held:
        with as_problem_of(path):
            temporary = held.enter_context(temporary_beside(path, path.suffix or ".tmp"))
        try:
            yield temporary
            _sync(temporary, os.O_RDWR)
            # Temporary files are private; results get the default mode.
            temporary.chmod(0o666 & ~umask())
            temporary.replace(path)
        except BaseException as error:
            temporary.unlink(missing_ok=True)
            names = {None, str(temporary)}
            if isinstance(error, OSError) and error.errno and error.filename in names:
                # A full disk names no file at all.
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise
    with as_problem_of(path):
        sync_folder(path.parent)


def atomic_bytes(path: str | Path, data: bytes) -> None:
    """Write ``data`` atomically: readers see the old file or the complete new one."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def atomic_together(files: Mapping[Path, bytes | memoryview | Iterable[memoryview]]) -> None:
    """Write files, whole or given in pieces; each appears complete or not at all.

    The data of all reach the disk before any name does. Disks flush many files in little more time
    than one. Temporary names are the call's own: others may write the same files. Folders that are
    missing are made; when the call returns, their names are on the disk, too.
    """
    temporary = temporaries_of(files)
    folders = {path.parent for path in files}
    made = _make(folders)
    with Pool(FLUSHED) as pool:

        def write(path: Path) -> None:
            data = files[path]
            with as_problem_of(path), temporary[path].open("wb") as file:
                for piece in (data,) if isinstance(data, bytes | memoryview) else data:
                    file.write(piece)
                file.flush()
                os.fsync(file.fileno())

        def sync(folder: Path) -> None:
            with as_problem_of(folder):
                sync_folder(folder)

        try:
            list(pool.map(write, files))
            for path in files:
                with as_problem_of(path):
                    temporary[path].replace(path)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            for path in temporary.values():
                path.unlink(missing_ok=True)
            raise
        # The name of a folder lies in the one above it.
        list(pool.map(sync, sorted(folders | {folder.parent for folder in made})))


def _make(folders: Iterable[Path]) -> set[Path]:
    """Make folders, and those above them; which of all these the call has made itself.

    One that another call has just made is flushed by that: a tile that a power failure takes in
    between is found to be missing, and made again.
    """
    missing: set[Path] = set()
    for folder in folders:
        while folder not in missing and not folder.is_dir():
            missing.add(folder)
            folder = folder.parent
    made: set[Path] = set()
    for folder in sorted(missing):
        try:
            folder.mkdir()
        except FileExistsError:
            if not folder.is_dir():
                raise
        else:
            made.add(folder)
    return made


def sync_folder(path: Path) -> None:
    """The names of the files in a folder reach the disk, where the system can say so."""
    if os.name == "posix":
        _sync(path, os.O_RDONLY)


def sync_handle(handle: int) -> None:
    """What was written to an open file reaches the disk; Ctrl-C does not wait for that.

    The caller may close the file at once after Ctrl-C: the flush goes on with a handle of its own.
    """

    def fsync(own: int) -> None:
        try:
            os.fsync(own)
        finally:
            os.close(own)

    wait_for(fsync, os.dup(handle))


def _sync(path: Path, flags: int) -> None:
    handle = os.open(path, flags)
    try:
        sync_handle(handle)
    finally:
        os.close(handle)


def read_text(path: Path) -> str:
    """A text file of unknown origin: UTF-8 with or without BOM, UTF-16 with BOM, else Latin-1."""
    check_regular(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ArgumentError(f"{path}: cannot be read ({error.strerror})") from error
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")

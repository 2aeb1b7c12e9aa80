"""``report.json``: inputs, options, versions, and results.

Enough to say years later which files, options and versions a map was made from. The keys are
sorted and there is no date in it, so two runs differ only where the work differed (and in timings).
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from io import FileIO
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.pools import Pool
from impasto.errors import ArgumentError
from impasto.status import Status

SCHEMA = 1
"""Version of the format; increased when a key changes its meaning."""


LIBRARIES = ("colour-science", "opencv-python-headless", "OpenEXR", "tifffile")
"""Libraries for files and spectra."""
HASHED = 2
"""Files that are hashed at a time: other threads run while Python hashes."""
BLOCK = 1 << 20
"""Bytes that are hashed at a time."""


class Timings:
    """Seconds of wall clock per stage, in the order in which the stages ended."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body; repeated stages are added."""
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + elapsed


def file_entry(
    path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None
) -> dict[str, Any]:
    """Name (within ``folder``, if given), size in bytes and SHA-256 of a file.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    return _entry(Path(path), folder, lambda count: None)


def file_entries(
    paths: Sequence[Path],
    report: Callable[[int, int], object],
    found: Callable[[Path, dict[str, Any]], object] = lambda path, entry: None,
) -> list[dict[str, Any]]:
    """:func:`file_entry` of many files, some at a time.

    Parameters
    ----------
    paths
        The files.
    report
        Called with (bytes read, bytes in all), by one thread at a time; an error of it ends all.
    found
        Called with each file and its entry as soon as that is known, by any thread.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    total = sum(path.stat().st_size for path in paths)
    lock = Lock()
    done = 0

    def add(count: int) -> None:
        nonlocal done
        with lock:
            done += count
            report(done, total)

    def entry_of(path: Path) -> dict[str, Any]:
        entry = _entry(path, None, add)
        found(path, entry)
        return entry

    add(0)
    with Pool(HASHED) as pool:
        entries = [pool.submit(entry_of, path) for path in paths]
        try:
            return [one.result() for one in entries]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _entry(
    path: Path, folder: str | os.PathLike[str] | None, add: Callable[[int], object]
) -> dict[str, Any]:
    digest, size = hashlib.sha256(), 0
    block = memoryview(bytearray(BLOCK))
    with path.open("rb", buffering=0) as file:
        while count := _filled(block, file, path):
            digest.update(block[:count])
            size += count
            add(count)
    name = path if folder is None else path.relative_to(folder)
    return {"file": name.as_posix(), "bytes": size, "sha256": digest.hexdigest()}


def _filled(block: memoryview, file: FileIO, path: Path) -> int:
    """Bytes that were read; an error of a disk that fails names no file by itself."""
    try:
        return file.readinto(block)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def status_counts(status: ArrayLike) -> dict[str, int]:
    """Pixels per status, by name; statuses that do not occur are left out.

    Parameters
    ----------
    status
        ``(y, x)`` uint8 codes of :class:`~impasto.Status`.
    """
    counts = np.bincount(np.asarray(status, dtype=np.uint8).ravel(), minlength=256)
    return {
        Status(code).name.lower(): int(counts[code]) for code in np.flatnonzero(counts).tolist()
    }


def versions() -> dict[str, Any]:
    """Versions of impasto and its libraries, machine and SIMD level."""
    from impasto import _core

    build = _core.build_info()
    return {
        "impasto": build["version"],
        "simd": build["simd"],
        "optimised": not build["debug"],
        "python": platform.python_version(),
        "numpy": np.__version__,
        **{name: _installed(name) for name in LIBRARIES},
        "machine": platform.machine(),
        "system": platform.system(),
    }


def _installed(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def report(
    command: str,
    *,
    inputs: Iterable[str | os.PathLike[str]] = (),
    options: Mapping[str, Any] | None = None,
    results: Mapping[str, Any] | None = None,
    timings: Timings | None = None,
    notes: Iterable[Any] = (),
    folder: str | os.PathLike[str] | None = None,
) -> dict[str, Any]:
    """Collect a report; :func:`write_report` saves it.

    Parameters
    ----------
    command
        The command: ``"fit"``, ``"demo"`` ...
    inputs
        Files read; each is hashed.
    options
        Options in force, defaults included.
    results
        Numbers: status counts, pooled beta and gamma ...
    timings
        Seconds per stage.
    notes
        What was repaired, left out or assumed while the input was read; ``str`` of each is a
        sentence.
    folder
        Folder of the results; every file in it is hashed.
    """
    made = [] if folder is None else sorted(p for p in Path(folder).rglob("*") if p.is_file())
    seconds = {} if timings is None else timings.seconds
    return {
        "schema": SCHEMA,
        "command": command,
        "inputs": [file_entry(path) for path in inputs],
        "outputs": [file_entry(path, folder) for path in made],
        "notes": [str(note) for note in notes],
        "options": _plain(options or {}),
        "results": _plain(results or {}),
        "timings_s": {name: round(value, 4) for name, value in seconds.items()},
        "versions": versions(),
    }


def write_report(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Save a report as JSON, atomically.

    Parameters
    ----------
    path
        The file to write; an older one is replaced.
    content
        Result of :func:`report`.
    """
    from impasto.io import atomic_bytes

    text = json.dumps(_plain(content), indent=2, sort_keys=True, allow_nan=False)
    atomic_bytes(Path(path), (text + "\n").encode("utf-8"))


def _plain(value: Any) -> Any:
    """The value in types of JSON; NaN and infinities become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(entry) for entry in value]
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, np.bool_ | np.integer):
        return value.item()
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, os.PathLike):
        return Path(value).as_posix()
    raise ArgumentError(f"report: a {type(value).__name__} cannot be written as JSON")

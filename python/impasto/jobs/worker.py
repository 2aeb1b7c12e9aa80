"""What a worker of a Dask cluster does for a job: one tile from its photographs to its files."""

from __future__ import annotations

import gc
import os
import socket
import threading
from collections import deque
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from impasto._internal.build import build_name
from impasto.errors import ArgumentError, ClusterError, ImpastoError
from impasto.fit.learning import LearnedModel, load_learned
from impasto.jobs.folder import NOTES, RECORD
from impasto.jobs.grid import Tile
from impasto.jobs.learning import LEARNED, digest_of
from impasto.jobs.photographs import Photographs, open_photographs
from impasto.jobs.record import JobRecord
from impasto.jobs.tiles import EncodedTile, WrittenTile, fitted

HELD = 3
"""Tiles in the memory of a worker: one is read, one is fitted, one is written."""


@dataclass(frozen=True)
class SharedJob:
    """A job as workers know it: everything else is in its folder.

    Attributes
    ----------
    folder
        The store, which is not whole yet, by the same absolute path for all.
    record, learned
        SHA-256 of the files of the record and of the learned model.
    memory
        Bytes for the samples and maps of a worker.
    run
        Tells this call from an earlier one that the same job was interrupted in.
    """

    folder: Path
    record: str
    learned: str
    memory: int
    run: str = ""


@dataclass(frozen=True)
class _Opened:
    """What a worker keeps from tile to tile."""

    record: JobRecord
    photographs: Photographs
    model: LearnedModel


@dataclass(frozen=True)
class _Slots:
    """What a worker has for tiles, whatever the number of its threads."""

    held: threading.BoundedSemaphore = field(
        default_factory=lambda: threading.BoundedSemaphore(HELD)
    )
    fitting: threading.Lock = field(default_factory=threading.Lock)


_OPENING = threading.Lock()
_KEEPING = threading.Lock()
"""Not the same: a worker that releases a job, on the thread that talks to its scheduler, does not
wait for photographs that are being opened."""
_KEPT: dict[SharedJob, _Opened] = {}
"""The job whose photographs are open: one at most."""
_RELEASED: deque[SharedJob] = deque(maxlen=64)
"""The last jobs that have ended; cancelled tiles of theirs may still come to their turn."""


def fit_tile(job: SharedJob, tile: Tile, numbers: bool) -> WrittenTile:
    """Read the photographs of a tile, fit them, and write the files of its maps.

    A worker fits one tile at a time, with as many threads as it has; its other threads read the
    next tile and write the last one.

    Parameters
    ----------
    numbers
        Whether what is not a map is returned, too.

    Raises
    ------
    ArgumentError
        The worker does not see the folder of the job or its photographs as the calling process
        does.
    ClusterError
        The job has ended meanwhile; nobody waits for the tile.
    """
    from distributed import get_worker

    worker = get_worker()
    slots = _slots(worker.address)
    with slots.held:
        _check_folder(job)
        with _OPENING:
            opened = _opened(job)
        grid = opened.record.grid
        stack = opened.photographs.window(*grid.window(tile, opened.model.halo))
        with slots.fitting:
            result = fitted(opened.model, stack, grid, tile, worker.state.nthreads)
        del stack
        # One thread: meanwhile the next tile has all others.
        encoded = EncodedTile.of(grid, tile, result, opened.record.precision, threads=1)
        # A worker that was given up for lost may come to this after all.
        _check_folder(job)
        return encoded.write(job.folder, numbers=numbers)


@lru_cache(maxsize=64)
def _slots(address: str) -> _Slots:
    """Of one worker: there may be several in a process."""
    return _Slots()


def release(job: SharedJob) -> None:
    """Close the photographs of a job that has ended.

    A tile that has them keeps them until it is done; one that has not is refused.
    """
    with _KEEPING:
        _RELEASED.append(job)
        kept = _KEPT.pop(job, None)
    if kept is not None:
        del kept
        gc.collect()


def _opened(job: SharedJob) -> _Opened:
    with _KEEPING:
        found = _KEPT.get(job)
        if found is None:
            _refuse_released(job)
            _KEPT.clear()
    if found is None:
        found = _open(job)
        with _KEEPING:
            _refuse_released(job)  # while they were opened
            _KEPT[job] = found
    return found


def _refuse_released(job: SharedJob) -> None:
    if job in _RELEASED:
        raise ClusterError(f"client: the job of {job.folder} has ended, of which this is a tile")


def _open(job: SharedJob) -> _Opened:
    record = JobRecord.read(job.folder / NOTES / RECORD)
    version = build_name()
    if record.version != version:
        raise ImpastoError(
            f"client: {_here()} has impasto {version}, the job {record.version}; install the same "
            "version everywhere"
        )
    _check_inputs(record)
    photographs = open_photographs(record.source, record.reading, 0, record.curve)
    if photographs.source_grid[1] >= photographs.size[1]:
        # What is decoded in whole rows is read once for as many as there is room for.
        photographs = open_photographs(record.source, record.reading, job.memory // 2, record.curve)
    return _Opened(record, photographs, load_learned(job.folder / NOTES / LEARNED))


def _check_folder(job: SharedJob) -> None:
    notes = job.folder / NOTES
    for name, digest in ((RECORD, job.record), (LEARNED, job.learned)):
        try:
            found = digest_of(notes / name)
        except OSError as error:
            raise ArgumentError(
                f"out: {notes / name} cannot be read by {_here()} ({error.strerror}): all workers "
                "write into the store; put it on a file system that they share, under one path"
            ) from error
        if found != digest:
            raise ArgumentError(
                f"out: {_here()} finds another job in {job.folder} than the one that is running; "
                "put the store on a file system that all workers share"
            )


def _check_inputs(record: JobRecord) -> None:
    """Photographs that a worker sees have the size of those that the calling process hashed."""
    for entry in record.inputs:
        path, size = Path(entry["file"]), entry["bytes"]
        try:
            found: Any = f"has {path.stat().st_size} bytes"
        except OSError as error:
            found = f"cannot be read ({error.strerror})"
        if found != f"has {size} bytes":
            raise ArgumentError(
                f"source: {path} {found} on {_here()}, where the job expects {size} bytes: workers "
                "read the photographs themselves; put them on a file system that all share, under "
                "one path"
            )


def _here() -> str:
    return f"the worker {os.getpid()} on {socket.gethostname()}"

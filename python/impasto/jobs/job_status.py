"""How far a job is, and how fast, from its files alone."""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from impasto._internal.damage import DAMAGE
from impasto._internal.regular import content_of
from impasto.jobs.beginning import bytes_read
from impasto.jobs.folder import (
    NOTES,
    READING,
    RECORD,
    check_journal,
    check_notes,
    partial_of,
    store_name,
)
from impasto.jobs.grid import Grid
from impasto.jobs.journal import Entries
from impasto.jobs.lock import Holder, holder
from impasto.jobs.lookup import in_folder_of, journal_in
from impasto.jobs.memory import kept_memory
from impasto.jobs.record import JobRecord
from impasto.jobs.tiles import PACE

RECENT = 20
"""Last tiles from which the pace of a job is taken."""
Phase: TypeAlias = Literal["reading", "learning", "tiles", "scales"]


@dataclass(frozen=True)
class JobStatus:
    """How far a job is.

    Attributes
    ----------
    folder
        The store, or while tiles are missing the folder that becomes it.
    state
        ``"running"``; ``"interrupted"``: no process works on it, it can be resumed;
        ``"finished"``.
    process
        The process that works on it.
    machine
        The name of its machine, where that is another one.
    phase
        What that does: ``"reading"`` and hashing the photographs, while the model may already be
        learned, ``"learning"`` the model of the whole painting, ``"tiles"``, or ``"scales"`` when
        all tiles are there; None where nobody works on it.
    tiles_done, tiles
        Tiles on the disk, and all; both 0 while the photographs of a new job are read.
    pixels_done, pixels
        The same in pixels.
    bytes_read, bytes_to_read
        Of the photographs, while they are hashed; else None.
    pixels_per_second
        Of the last tiles; None where none is known.
    seconds_left
        For the other pixels at this pace; None where it is not known, 0 of a finished job.
    memory
        Bytes that it may take, or could when it was interrupted, and takes again if it is resumed;
        None where it is not known, and of a finished job.
    sample
        The model is learned from every so many rows and columns, more where memory is less; None
        while the photographs of a new job are read.
    notes
        What was repaired, left out or assumed while the photographs were read: kind and text.
    reads_files
        Whether the photographs are files, which :func:`verify` compares; False for those that were
        in the memory of the process.
    """

    folder: Path
    state: Literal["running", "interrupted", "finished"]
    process: int | None
    machine: str | None
    phase: Phase | None
    tiles_done: int
    tiles: int
    pixels_done: int
    pixels: int
    bytes_read: int | None
    bytes_to_read: int | None
    pixels_per_second: float | None
    seconds_left: float | None
    memory: int | None
    sample: int | None
    notes: tuple[tuple[str, str], ...]
    reads_files: bool


def status(out: str | os.PathLike[str]) -> JobStatus:
    """How far a job is, from its files alone; it is not disturbed.

    Parameters
    ----------
    out
        The ``out`` of :func:`impasto.run`.

    Raises
    ------
    ArgumentError
        There is no job of that name.
    CorruptInputError
        A damaged record or journal, or the journal of another job.
    """
    partial = partial_of(store_name(out))
    if not (partial / NOTES / RECORD).exists() and (by := holder(partial / NOTES)) is not None:
        return _of_beginning(partial, by)
    return in_folder_of(out, _status_of)


def _of_beginning(partial: Path, by: Holder) -> JobStatus:
    """Of a job that has no record yet."""
    read, to_read = bytes_read(partial / NOTES) or (None, None)
    return JobStatus(
        folder=partial,
        state="running",
        process=by.process,
        machine=by.machine,
        phase="reading",
        tiles_done=0,
        tiles=0,
        pixels_done=0,
        pixels=0,
        bytes_read=read,
        bytes_to_read=to_read,
        pixels_per_second=None,
        seconds_left=None,
        memory=None,
        sample=None,
        notes=(),
        reads_files=True,
    )


def _status_of(folder: Path, whole: bool) -> JobStatus:
    """Of a job that has one, under the name of a finished store or not."""
    notes = folder / NOTES
    check_notes(notes)
    record = JobRecord.read(notes / RECORD)
    grid = record.grid
    entries = journal_in(notes)
    if entries is not None:
        check_journal(notes, entries)
    pixels = grid.rows * grid.columns
    done = 0 if entries is None else sum(map(grid.pixels, entries.tiles))
    by = None if whole else holder(notes)
    read, to_read = (by and bytes_read(notes)) or (None, None)
    pace = None if whole else _pace(notes / PACE)
    left = None if pace is None else (pixels - done) / pace
    finished = whole and entries is not None and entries.files is not None
    return JobStatus(
        folder=folder,
        state="finished" if finished else "interrupted" if by is None else "running",
        process=None if by is None else by.process,
        machine=None if by is None else by.machine,
        phase=None if by is None else _phase(notes, entries, grid),
        tiles_done=0 if entries is None else len(entries.tiles),
        tiles=len(grid),
        pixels_done=done,
        pixels=pixels,
        bytes_read=read,
        bytes_to_read=to_read,
        pixels_per_second=pace,
        seconds_left=0.0 if finished else left,
        memory=None if finished else kept_memory(notes),
        sample=record.sample,
        notes=tuple((str(kind), str(text)) for kind, text in record.notes),
        reads_files=record.source is not None,
    )


def _phase(notes: Path, entries: Entries | None, grid: Grid) -> Phase:
    if (notes / READING).exists():
        return "reading"
    if entries is None:
        return "learning"
    return "tiles" if len(entries.tiles) < len(grid) else "scales"


def _pace(path: Path) -> float | None:
    """Pixels per second of the last tiles."""
    try:
        lines = content_of(path).splitlines()[-RECENT:]
    except OSError:
        return None
    pixels = seconds = 0.0
    for line in lines:
        with suppress(*DAMAGE):  # it is being written
            entry = json.loads(line)
            more, longer = float(entry["pixels"]), float(entry["seconds"])
            pixels, seconds = pixels + more, seconds + longer
    pace = pixels / seconds if seconds > 0 else 0.0
    return pace if 0.0 < pace < math.inf else None

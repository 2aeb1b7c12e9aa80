"""Whether the files of a job, a merged store or a store of photographs are as they were written."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from impasto._internal.calls import ProgressCallback, reporting
from impasto.errors import CorruptInputError
from impasto.io.results.zarr_arrays import ZarrArray
from impasto.io.results.zarr_store import contents, levels_of, statistics_of
from impasto.io.session.stored import StoredStack
from impasto.jobs.checksums import CHECKSUMS, read_checksums
from impasto.jobs.folder import NOTES, READING, RECORD, numbers_problem, store_name, strange_notes
from impasto.jobs.grid import Grid
from impasto.jobs.journal import JOURNAL, Entries, problem_of, read_journal
from impasto.jobs.learning import LEARNED, digest_of
from impasto.jobs.lock import LOCK, holder
from impasto.jobs.lookup import holds_photographs, in_folder_of, journal_in
from impasto.jobs.memory import MEMORY
from impasto.jobs.meter import Meter
from impasto.jobs.record import JobRecord
from impasto.jobs.tiles import NUMBERS, PACE
from impasto.report import file_entry

SHARD = r"(levels/2/)?[^/]+/c(/0)*/(?P<row>0|[1-9]\d{0,8})/(?P<column>0|[1-9]\d{0,8})"
"""Names of the files of a tile in a store: its maps, also at half their scale, and statistics."""
UNFINISHED = (RECORD, READING, LEARNED, NUMBERS, LOCK, PACE, MEMORY)
"""Files of the notes of a job that is not finished."""


@dataclass(frozen=True)
class Finding:
    """A file that is not as a job wrote or read it.

    Attributes
    ----------
    file
        Its path.
    problem
        What is wrong.
    foreign
        Whether it is a file that no job wrote or read.
    """

    file: str
    problem: str
    foreign: bool = False

    def __str__(self) -> str:
        return f"{self.file}: {self.problem}"


def verify(
    out: str | os.PathLike[str],
    *,
    inputs: bool = True,
    progress: bool | ProgressCallback = False,
) -> tuple[Finding, ...]:
    """Compare every file of a job with its journal, and the photographs with its record.

    Every file of a store of :func:`impasto.merge` is compared with the checksums in it, and every
    number of a store of :func:`impasto.ingest` with those of its chunks.

    Parameters
    ----------
    out
        The ``out`` of :func:`impasto.run`, finished or not, of :func:`impasto.merge` or of
        :func:`impasto.ingest`.
    inputs
        Whether to read the photographs, too. A stack in memory is not compared.
    progress
        True: a bar on stderr; or a callable ``(done, total)`` in bytes. It begins again where a
        job ends meanwhile.

    Returns
    -------
    tuple
        A :class:`Finding` for every file that has changed, is missing, or does not belong to the
        store; empty if all is well. A tile that is not done yet is none.

    Raises
    ------
    ArgumentError
        There is none of these of that name.
    """
    target = store_name(out)
    with reporting(progress, "comparing files", whole=True) as callback:
        meter = Meter(callback)
        if (target / CHECKSUMS).is_file() and not (target / NOTES / RECORD).exists():
            return tuple(sorted(set(_merged_findings(target / CHECKSUMS, meter)), key=str))
        if holds_photographs(target):
            return tuple(sorted(set(_photographs_findings(target, meter)), key=str))

        def look(folder: Path, whole: bool) -> set[Finding]:
            return set(_findings(folder, whole, inputs, meter))

        return tuple(sorted(in_folder_of(out, look), key=str))


def _findings(folder: Path, whole: bool, inputs: bool, meter: Meter) -> Iterator[Finding]:
    notes = folder / NOTES
    if strange := list(strange_notes(notes)):
        yield from map(_finding_of, strange)
        return
    named: set[str] = set()
    try:
        record = JobRecord.read(notes / RECORD)
    except CorruptInputError as error:
        yield (finding := _finding_of(error))
        record = None
        named.add(finding.file)
    read = _inputs_of(record, notes) if record is not None and inputs else ()
    meter.begin(chain((Path(one["file"]) for one in read), _written_so_far(folder)))
    if record is not None and read:
        yield from _changed_inputs(record, meter)
    try:
        entries = journal_in(notes)
    except CorruptInputError as error:
        yield _finding_of(error)
        return
    if entries is None:
        if whole:
            yield Finding(str(notes / JOURNAL), "is missing")
        return
    for name, digest in ((RECORD, entries.job), (LEARNED, entries.learned)):
        foreign = _foreign(notes / name, digest)
        if foreign is not None and foreign.file not in named:
            named.add(foreign.file)
            yield foreign
    known = known_files(entries)
    yield from (one for one in changed_files(folder, known, meter) if one.file not in named)
    # A record of another job says nothing of the tiles of this one.
    grid = None if record is None or str(notes / RECORD) in named else record.grid
    own = {*known, f"{NOTES}/{JOURNAL}"}
    if whole:
        if grid is not None:
            yield from _lacking(folder, grid, entries, known)
        if holder(notes) is not None:
            own.add(f"{NOTES}/{LOCK}")  # in a moment the process takes it away
    else:
        # Of a job that runs the journal may know a version by now that it did not know before.
        if numbers_problem(notes, entries) and entries.tiles:
            problem = numbers_problem(notes, read_journal(notes / JOURNAL))
            if problem is not None:
                yield Finding(str(notes / NUMBERS), problem)
        complete = grid is not None and all(tile in entries.tiles for tile in grid)
        if complete or holder(notes) is not None:
            return  # the files beside the tiles are being written, or will be in a moment
        own |= {f"{NOTES}/{name}" for name in UNFINISHED}
    for finding in others(folder, own):
        name = Path(finding.file).relative_to(folder).as_posix()
        if whole or not _of_an_open_tile(name, grid, entries):
            yield finding


def _finding_of(error: CorruptInputError) -> Finding:
    return Finding(str(error.path), error.problem)


def _inputs_of(record: JobRecord, notes: Path) -> Sequence[Mapping[str, Any]]:
    """The files that the job of the journal has read; of another's record none."""
    if record.source is None:
        return ()
    with suppress(CorruptInputError):  # found when the journal is read for its tiles
        entries = journal_in(notes)
        if entries is not None and _foreign(notes / RECORD, entries.job) is not None:
            return ()
    return record.inputs


def _written_so_far(folder: Path) -> Iterator[Path]:
    """Files of a job; while photographs are compared, one that runs writes more."""
    with suppress(CorruptInputError):
        if (entries := journal_in(folder / NOTES)) is not None:
            yield from (folder / name for name in known_files(entries))


def known_files(entries: Entries) -> dict[str, str]:
    """The checksums of a journal by the names of the files in the store."""
    known = dict(entries.files or {})
    for entry in entries.tiles.values():
        known |= entry.shards
    return known


def _merged_findings(checksums: Path, meter: Meter) -> Iterator[Finding]:
    """The same of a store that has no journal, but a list of checksums."""
    try:
        known = read_checksums(checksums)
    except CorruptInputError as error:
        yield _finding_of(error)
        return
    folder = checksums.parent
    meter.begin(folder / name for name in known)
    yield from changed_files(folder, known, meter, f"in {CHECKSUMS}")
    yield from others(folder, {*known, CHECKSUMS})


def _photographs_findings(store: Path, meter: Meter) -> Iterator[Finding]:
    """The same of a store of photographs, in which every chunk has its checksum."""
    try:
        stored = StoredStack(store)
    except CorruptInputError as error:
        yield _finding_of(error)
        return
    yield from map(_finding_of, stored.damage())
    files = stored.files()
    meter.begin(files)
    for path in files:
        try:
            if not path.is_file():
                yield Finding(str(path), "is missing")
            else:
                stored.tile_entry(path, compare=True)
        except CorruptInputError as error:
            yield _finding_of(error)
        meter.read(path)
    yield from others(store, {path.relative_to(store).as_posix() for path in files})


def changed_files(
    folder: Path, known: Mapping[str, str], meter: Meter, where: str = "in the journal"
) -> Iterator[Finding]:
    """Files that are not as their checksums say."""
    for path, crc in ((folder / name, crc) for name, crc in known.items()):
        if (problem := problem_of(path, crc, where)) is not None:
            yield Finding(str(path), problem)
        meter.read(path)


def others(folder: Path, own: Set[str]) -> Iterator[Finding]:
    """Files that have none of these names, and links in the place of folders."""
    for path in folder.rglob("*"):
        if path.is_symlink() and path.is_dir():
            yield Finding(str(path), "is a link, not the folder that was made")
        elif not path.is_dir() and path.relative_to(folder).as_posix() not in own:
            yield Finding(str(path), "does not belong to the store", foreign=True)


def _of_an_open_tile(name: str, grid: Grid | None, entries: Entries) -> bool:
    """Whether a file may be of a tile that is not in the journal yet, or is being written."""
    if name.rpartition("/")[2].startswith("."):
        return True
    if (found := re.fullmatch(SHARD, name)) is None:
        return False
    row, column = tile = int(found["row"]), int(found["column"])
    inside = grid is None or (row < grid.shape[0] and column < grid.shape[1])
    return inside and tile not in entries.tiles


def _lacking(
    folder: Path, grid: Grid, entries: Entries, known: dict[str, str]
) -> Iterator[Finding]:
    """What the journal of a finished job does not have."""
    journal = str(folder / NOTES / JOURNAL)
    if entries.files is not None and not entries.ended:
        yield Finding(journal, "has more than the lines of a finished job")
    for row, column in entries.tiles:
        if not (0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]):
            yield Finding(journal, f"has a tile {row}, {column} beyond the painting")
    for tile in grid:
        if tile not in entries.tiles:
            yield Finding(journal, f"has no tile {tile[0]}, {tile[1]}")
    try:
        _, arrays = contents(folder)
        for smaller in levels_of(folder).values():
            arrays += smaller
        statistics = statistics_of(folder)
        arrays += [] if statistics is None else [statistics]
    except CorruptInputError as error:
        yield _finding_of(error)
        return
    for name in _all_files(arrays):
        if name not in known:
            yield Finding(journal, f"has no checksum of {name}")


def _all_files(arrays: list[ZarrArray]) -> Iterator[str]:
    for array in arrays:
        yield array.metadata_path
        yield from (name for name, _ in array.paths())
    yield from (f"{NOTES}/{name}" for name in (RECORD, LEARNED, NUMBERS))


def _foreign(path: Path, digest: str) -> Finding | None:
    """What is wrong with a record or a learned model, of which the journal has the SHA-256."""
    if not path.is_file():
        return Finding(str(path), "is missing")
    if digest_of(path) != digest:
        return Finding(str(path), f"is not what {JOURNAL} beside it belongs to")
    return None


def _changed_inputs(record: JobRecord, meter: Meter) -> Iterator[Finding]:
    entry_of = _entries_of(record)
    for entry in record.inputs:
        path = Path(entry["file"])
        if (finding := _changed_input(path, entry, entry_of)) is not None:
            yield finding
        meter.read(path)


def _changed_input(
    path: Path, entry: Mapping[str, Any], entry_of: Callable[[Path], Mapping[str, Any]]
) -> Finding | None:
    if not path.is_file():
        return Finding(str(path), "is missing: a photograph or another input of the job")
    try:
        found = entry_of(path)
    except CorruptInputError as error:
        return _finding_of(error)
    if any(found.get(key) != entry[key] for key in ("sha256", "crc32c") if key in entry):
        return Finding(str(path), "has changed since the job read it")
    return None


def _entries_of(record: JobRecord) -> Callable[[Path], Mapping[str, Any]]:
    """What tells what an input is now; tiles of a store are read, and their checksums compared."""
    if record.source is None or all("crc32c" not in one for one in record.inputs):
        return file_entry
    try:
        stored = StoredStack(Path(record.source))
    except (CorruptInputError, FileNotFoundError):
        return file_entry  # which are not those of tiles
    return lambda path: stored.tile_entry(path, compare=True) or file_entry(path)

"""The folder of a job: its names, what an earlier run left in it, and how it becomes a store."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from logging import NullHandler, getLogger
from pathlib import Path

from impasto._internal.regular import kind_of
from impasto.errors import ArgumentError, CorruptInputError, ResumeMismatchError
from impasto.io.files import as_problem_of, atomic_bytes
from impasto.io.folders import sync_folders
from impasto.io.npz import read_npz
from impasto.io.results.maps import MERGE
from impasto.io.results.precision import Precision
from impasto.io.results.zarr_arrays import METADATA
from impasto.io.results.zarr_store import EMPTY_GROUP
from impasto.io.temporary import OLD, PARTIAL, is_temporary, temporary_beside
from impasto.jobs.assembly import complete, is_name
from impasto.jobs.grid import Grid
from impasto.jobs.journal import JOURNAL, Entries, checksum, problem_of, read_journal
from impasto.jobs.learning import LEARNED, digest_of
from impasto.jobs.lock import LOCK
from impasto.jobs.memory import MEMORY
from impasto.jobs.meter import Meter
from impasto.jobs.record import JobRecord
from impasto.jobs.tiles import NUMBERS, PACE

LOG = getLogger("impasto.jobs")
LOG.addHandler(NullHandler())
NOTES = "job"
"""The group of a store that holds what the job needs: record, learned model and journal."""
RECORD = "job.json"
READING = "reading.jsonl"
"""How far photographs are read and hashed; there while that lasts."""
NOTE_FILES = (RECORD, LEARNED, JOURNAL, NUMBERS, READING, LOCK, PACE, MEMORY, METADATA)
"""All that a job puts among its notes."""
SUFFIX = ".zarr"


def checked_target(out: str | os.PathLike[str]) -> Path:
    """The name of a store that a job makes, also where it is given as that of its running job.

    Raises
    ------
    ArgumentError
        As of :func:`checked_store`.
    """
    return checked_store(store_name(out))


def checked_store(out: str | os.PathLike[str], kind: str = ".impasto") -> Path:
    """The name of a store that can be made.

    Parameters
    ----------
    kind
        What the names of such stores have before their suffix.

    Raises
    ------
    ArgumentError
        No name of a file, another suffix, a folder that does not exist, or one in a store, a link
        to nothing.
    """
    target = _file_name(out)
    if target.suffix.lower() != SUFFIX:
        raise ArgumentError(
            f"out: expected a name ending in {SUFFIX}, found {target.name!r}; "
            f"name it {target.stem or 'painting'}{kind}{SUFFIX}"
        )
    if not target.absolute().parent.is_dir():
        raise ArgumentError(f"out: the folder {target.absolute().parent} does not exist")
    for folder in target.absolute().parents:
        stored = folder.name.lower().endswith((SUFFIX, SUFFIX + PARTIAL))
        if stored and any((folder / notes).is_dir() for notes in (NOTES, MERGE)):
            raise ArgumentError(
                f"out: {target} would lie in the store {folder}, to which it does not belong; give "
                "a name outside of it"
            )
    if target.is_symlink() and not target.exists():
        raise ArgumentError(f"out: {target} is a link to nothing; remove it or give another name")
    return target


def store_name(out: str | os.PathLike[str]) -> Path:
    """The name of a store, also of one that is given by its name while its job runs.

    Raises
    ------
    ArgumentError
        No name of a file.
    """
    target = _file_name(out)
    if target.name.lower().endswith(SUFFIX + PARTIAL):
        target = target.with_name(target.name.removesuffix(PARTIAL))
    return target


def _file_name(out: str | os.PathLike[str]) -> Path:
    target = Path(out)
    if "\0" in str(target):
        raise ArgumentError(f"out: {str(target)!r} is no name of a file")
    return target


def partial_of(target: Path) -> Path:
    """The name of a store while its job runs."""
    return target.with_name(target.name + PARTIAL)


def refuse_differences(
    job: JobRecord, call: JobRecord, target: Path, argument: str = "out"
) -> None:
    """A job goes on with the same photographs, options and version only."""
    if found := _shown_differences(job, call):
        anew = argument == "out" and not target.exists()
        what = "belongs to another job" + (", which is finished" if target.exists() else "")
        how = "begin anew (resume=False, --no-resume)" if anew else "remove it"
        raise ResumeMismatchError(
            f"{argument}: {target} {what} ({found}); give another name, or {how}"
        )


def refuse_changes(job: JobRecord, now: JobRecord, store: Path) -> None:
    """A job can be made as it was of the same photographs, by the same version only."""
    if found := _shown_differences(job, now):
        raise ResumeMismatchError(
            f"out: {store} cannot be made as it was begun ({found}); bring back what has changed, "
            "or fit it anew by impasto.run or impasto job run, under another name"
        )


def _shown_differences(job: JobRecord, call: JobRecord) -> str:
    found = job.differences(call)
    more = f"; and {len(found) - 3} more" if len(found) > 3 else ""
    return "; ".join(found[:3]) + more


def earlier_record(target: Path, partial: Path, *, resume: bool) -> JobRecord | None:
    """The record of a job of this name, if it is to go on."""
    for folder in (target, partial):
        if not folder.exists():
            continue
        file = folder / NOTES / RECORD
        if not file.exists():
            if folder == partial and not _used(folder):
                continue  # killed before it began
            raise ArgumentError(f"out: {folder} exists and is no job of impasto; give another name")
        if resume:
            return JobRecord.read(file)
        if folder == target:
            raise ArgumentError(
                f"out: {target} is a finished job, which resume=False (--no-resume) does not "
                "replace; give another name, or remove it"
            )
    return None


def remove_unfinished(partial: Path) -> None:
    """Remove a job that is not to go on, at once by its name; the caller holds its lock."""
    real = partial.resolve()
    with temporary_beside(real, folder=True, ending=OLD) as removed:
        try:
            real.rename(removed / real.name)
            if partial.is_symlink():
                partial.unlink()
        finally:
            shutil.rmtree(removed)


def check_finished(target: Path, grid: Grid) -> Entries:
    """Refuse a store whose journal is not closed; what the journal says of others.

    Raises
    ------
    CorruptInputError
        An unfinished job under the name of a finished one, a journal that is damaged, missing or
        that of another job, or a note that is no file.
    """
    check_notes(target / NOTES)
    try:
        entries = read_journal(target / NOTES / JOURNAL)
    except FileNotFoundError as error:
        raise CorruptInputError(target / NOTES / JOURNAL, "is missing") from error
    check_journal(target / NOTES, entries)
    if not entries.ended or len(entries.tiles) != len(grid):
        raise CorruptInputError(
            target, f"is not finished; rename it to {partial_of(target).name} and resume the job"
        )
    return entries


def check_journal(notes: Path, entries: Entries) -> None:
    """Refuse a journal that is not that of the record beside it.

    Raises
    ------
    CorruptInputError
        It is that of another job, or the record has changed.
    """
    if entries.job != digest_of(notes / RECORD):
        raise CorruptInputError(
            notes / JOURNAL,
            f"is the journal of another job than {RECORD}; bring back the file that is not of this "
            "store (impasto job verify names all that have changed)",
        )


def _used(folder: Path) -> bool:
    """Whether a folder holds more than a job leaves that was killed before it began."""
    early = {LOCK, READING}
    return any(
        p.is_file() and p.name not in early and not p.name.startswith(".")
        for p in folder.rglob("*")
    )


def check_own(partial: Path, notes: str = NOTES) -> None:
    """Refuse a job that would write somewhere else, through a link in its folder.

    Parameters
    ----------
    notes
        Name of the folder in it for what is no map.

    Raises
    ------
    ArgumentError
        A folder in it, or a file of its notes, is a link. The folder itself may be one.
    CorruptInputError
        One of its notes is no file.
    """
    for path in partial.rglob("*"):
        if path.is_symlink() and (path.is_dir() or notes in path.relative_to(partial).parts[:-1]):
            raise ArgumentError(
                f"out: {path} is a link; a job writes only into its own folder: put what it leads "
                "to in its place, or begin anew (resume=False, --no-resume)"
            )
    check_notes(partial / notes)


def check_notes(notes: Path) -> None:
    """Refuse notes of which one is no file: who opens a pipe waits for its other end for ever.

    Raises
    ------
    CorruptInputError
        It is a pipe, a folder, a device or a socket.
    """
    for problem in strange_notes(notes):
        raise problem


def strange_notes(notes: Path) -> Iterator[CorruptInputError]:
    """What :func:`check_notes` raises, for each of them."""
    for path in (notes / name for name in NOTE_FILES):
        if (kind := kind_of(path)) is not None:
            yield CorruptInputError(path, f"is {kind}, not a file; remove it")


def clear(partial: Path) -> None:
    """Remove what a killed run was writing; other hidden files are somebody else's."""
    for path in partial.rglob(".*"):
        if is_temporary(path.name) and path.is_file():
            path.unlink()


def entries_of(partial: Path, grid: Grid, meter: Meter) -> Entries:
    """The journal of a job, without tiles whose files are not those that it wrote."""
    notes = partial / NOTES
    own = Entries(digest_of(notes / RECORD), digest_of(notes / LEARNED))
    if not has_begun(notes):
        (notes / NUMBERS).unlink(missing_ok=True)
        return own
    found = read_journal(notes / JOURNAL)
    check_journal(notes, found)
    if found.learned != own.learned:
        raise CorruptInputError(
            notes / LEARNED,
            f"is not the learned model that {JOURNAL} beside it belongs to; bring back the file, "
            "or begin anew (resume=False, --no-resume)",
        )
    return undamaged(found, partial, notes, grid, meter)


def undamaged(found: Entries, partial: Path, notes: Path, grid: Grid, meter: Meter) -> Entries:
    """What a journal says, without tiles whose files are not those that were written."""
    if problem := numbers_problem(notes, found):
        (notes / NUMBERS).unlink(missing_ok=True)
        if found.tiles:
            # They are the same for every tile with an estimated pixel.
            again = max(found.tiles, key=lambda tile: found.tiles[tile].estimated)
            LOG.warning("tile %s is fitted again: %s %s", again, notes / NUMBERS, problem)
            del found.tiles[again]
    places = set(grid)
    if found.tiles:
        meter.begin(partial / name for entry in found.tiles.values() for name in entry.shards)
    for tile, entry in list(found.tiles.items()):
        lost = []
        for name, crc in entry.shards.items():
            if problem_of(partial / name, crc) is not None:
                lost.append(name)
            meter.read(partial / name)
        if tile not in places or lost:
            LOG.warning("tile %s is fitted again: not as it was written: %s", tile, lost)
            del found.tiles[tile]
    return found


def has_begun(notes: Path) -> bool:
    """Whether the journal of a job has its first line, without which nothing beside it counts."""
    path = notes / JOURNAL
    return path.is_file() and b"\n" in path.read_bytes()


def has_tiles(notes: Path) -> bool:
    """Whether a tile of a job is on the disk."""
    return has_begun(notes) and bool(read_journal(notes / JOURNAL).tiles)


def numbers_problem(notes: Path, entries: Entries) -> str | None:
    """What is wrong with the numbers of a job that is not finished; None: nothing."""
    path = notes / NUMBERS
    known = [*entries.numbers, (entries.files or {}).get(f"{notes.name}/{NUMBERS}")]
    if not path.is_file():
        return "is missing"
    if path.is_symlink() or checksum(path) not in known:
        return "is not as it was written"
    return None


def finish(
    partial: Path, grid: Grid, entries: Entries, precision: Precision, threads: int | None
) -> None:
    """Describe all arrays, write those that are no maps, and close the journal.

    Every step leaves a folder that can be resumed; the same steps then write the same bytes.
    """
    notes = partial / NOTES
    left = read_npz(notes / NUMBERS)
    for name in left:
        if not is_name(name):
            raise CorruptInputError(notes / NUMBERS, f"has an array {name!r}, which no job writes")
    more = {f"{NOTES}/{METADATA}": EMPTY_GROUP}
    crcs = complete(partial, left, grid, precision, more, threads)
    own = (f"{NOTES}/{name}" for name in (RECORD, LEARNED, NUMBERS))
    entries.files = crcs | {name: checksum(partial / name) for name in own}
    atomic_bytes(notes / JOURNAL, entries.to_bytes(grid))
    for name in (PACE, MEMORY):
        (notes / name).unlink(missing_ok=True)
    with as_problem_of(partial):
        sync_folders(partial)

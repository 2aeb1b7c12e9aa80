"""The merged painting in a store, tile by tile, resumable after anything."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.build import build_name
from impasto.errors import ArgumentError, CorruptInputError, ResumeMismatchError
from impasto.fit.stored import StoredSbrdf
from impasto.io.files import as_problem_of, atomic_bytes, sync_folder
from impasto.io.folders import sync_folders
from impasto.io.npz import read_npz
from impasto.io.results.maps import MERGE
from impasto.io.results.zarr_arrays import METADATA
from impasto.jobs.assembly import complete, files_of_tile
from impasto.jobs.checksums import CHECKSUMS, checksums_file, read_checksums
from impasto.jobs.folder import NOTES as OF_A_JOB
from impasto.jobs.folder import check_own, clear, has_begun, partial_of, undamaged
from impasto.jobs.grid import Grid
from impasto.jobs.journal import JOURNAL, Entries, Journal, problem_of, read_journal
from impasto.jobs.lock import LOCK, locked, release
from impasto.jobs.meter import Meter
from impasto.jobs.tiles import NUMBERS, PACE, EncodedTile, TileLog
from impasto.merge.blend import Mosaic
from impasto.merge.frames import Frame
from impasto.merge.report import MergeReport
from impasto.report import file_entry

NOTES = MERGE
REPORT = f"{NOTES}/report.json"
"""What :class:`MergeReport` says, in the store."""
LISTS = (f"{OF_A_JOB}/{JOURNAL}", CHECKSUMS)
"""Files of a store that have the checksum of every other one."""


def write_store(
    target: Path,
    mosaic: Mosaic,
    grid: Grid,
    report: MergeReport,
    done: Callable[[int], None],
) -> None:
    """Make a store, or go on with one that was interrupted; ``done`` is called after every tile.

    Until it is whole it has the name of an unfinished job, and a journal as that has. It then has
    the checksums of all of its files, from which the last steps go on without the journal, and the
    bytes of one that was made in one go.

    Raises
    ------
    ArgumentError
        Another process is at it, or has just finished it; its folder leads elsewhere by a link.
    ResumeMismatchError
        What was interrupted is a merge of other frames or with other options.
    """
    partial = partial_of(target)
    notes = partial / NOTES
    merge = _digest(mosaic, grid, report)
    check_own(partial, NOTES)
    with as_problem_of(partial):
        notes.mkdir(parents=True, exist_ok=True)
    with locked(notes):
        try:
            # While the frames were registered, another process may have come to its end.
            refuse_finished(target)
        except ArgumentError:
            _leave(partial)
            raise
        clear(partial)
        if _is_whole(partial, merge):
            done(len(grid))
        else:
            _write(partial, mosaic, grid, report, merge, done)
        with as_problem_of(target):
            # Before the journal goes: what it says is on the disk must be there without it.
            sync_folders(partial)
            for name in (NUMBERS, PACE, JOURNAL):
                (notes / name).unlink(missing_ok=True)
            sync_folder(notes)
            partial.rename(target)
            # Not before: another process could take a lock of its own.
            release(target / NOTES)
            sync_folder(target / NOTES)
            sync_folder(target.parent)


def _write(
    partial: Path,
    mosaic: Mosaic,
    grid: Grid,
    report: MergeReport,
    merge: str,
    done: Callable[[int], None],
) -> None:
    """Write all files of a store, but those that its journal has; last the checksums of all."""
    notes = partial / NOTES
    with (
        closing(Journal(notes / JOURNAL, _entries(partial, grid, merge))) as journal,
        as_problem_of(partial),
    ):
        sync_folder(partial.parent)
        left = _write_tiles(partial, mosaic, grid, journal, done)
        shards = {name: crc for one in left.tiles.values() for name, crc in one.shards.items()}
    more = {f"{NOTES}/{METADATA}": _group(merge), REPORT: report.to_json().encode()}
    crcs = shards | complete(partial, read_npz(notes / NUMBERS), grid, "single", more)
    atomic_bytes(partial / CHECKSUMS, checksums_file(crcs))


def _write_tiles(
    partial: Path, mosaic: Mosaic, grid: Grid, journal: Journal, done: Callable[[int], None]
) -> Entries:
    """Blend and write the tiles that the journal has not; what it has then."""
    log = TileLog(partial / NOTES, grid, journal, done)
    done(len(journal.entries.tiles))
    for tile in grid:
        if tile in journal.entries.tiles:
            continue
        part = mosaic.part(*grid.window(tile))
        files, numbers = files_of_tile(grid, tile, part, "single", mosaic.rig)
        encoded = EncodedTile(int(part.estimated.sum()), files, numbers)
        log.add(tile, encoded.write(partial, numbers=log.wants_numbers))
        log.report()
    return journal.entries


def _entries(partial: Path, grid: Grid, merge: str) -> Entries:
    """The journal of an interrupted merge, without tiles whose files are not as it wrote them."""
    notes = partial / NOTES
    own = Entries(merge, "")
    if not has_begun(notes):
        (notes / NUMBERS).unlink(missing_ok=True)
        return own
    found = read_journal(notes / JOURNAL)
    if found.job != merge:
        raise _another(partial)
    return undamaged(found, partial, notes, grid, Meter(None))


def _is_whole(partial: Path, merge: str) -> bool:
    """Whether an interrupted merge has all of its files, and lacks nothing but its name.

    Its journal may be gone then. A file that has changed meanwhile is told by the journal; without
    one everything is made anew.

    Raises
    ------
    ResumeMismatchError
        It is a merge of other frames or with other options, and has no journal that says so.
    """
    try:
        crcs = read_checksums(partial / CHECKSUMS)
    except (FileNotFoundError, CorruptInputError):
        return False
    group = partial / NOTES / METADATA
    if not group.is_file() or group.read_bytes() != _group(merge):
        if not has_begun(partial / NOTES):
            raise _another(partial)
        return False
    return all(problem_of(partial / name, crc) is None for name, crc in crcs.items())


def _group(merge: str) -> bytes:
    """The ``zarr.json`` of the notes: what the bytes of the store follow from, for who goes on."""
    content = {"attributes": {"sha256": merge}, "node_type": "group", "zarr_format": 3}
    return (json.dumps(content, indent=2, sort_keys=True) + "\n").encode()


def _another(partial: Path) -> ResumeMismatchError:
    return ResumeMismatchError(
        f"out: {partial} is an unfinished merge of other frames, with other options or by "
        "another version; remove that folder, or give another name"
    )


def refuse_finished(target: Path) -> None:
    """Refuse a name that is taken; the lock that a merge left there in its last step goes.

    Raises
    ------
    ArgumentError
        There is something of this name.
    """
    if target.exists() or target.is_symlink():
        if (target / REPORT).is_file():
            release(target / NOTES)
        raise ArgumentError(f"out: {target} exists; remove it or give another name")


def _leave(partial: Path) -> None:
    """Remove the folder that was made and locked for nothing; one with anything in it stays."""
    notes = partial / NOTES
    with suppress(OSError):
        if not has_begun(notes):
            (notes / LOCK).unlink(missing_ok=True)
        notes.rmdir()
        partial.rmdir()


def check_begun(target: Path) -> None:
    """Refuse an unfinished store of this name that was not begun by a merge.

    An empty folder is what a merge leaves whose second step failed.
    """
    partial = partial_of(target)
    empty = partial.is_dir() and not any(partial.iterdir())
    if partial.exists() and not empty and not (partial / NOTES).is_dir():
        raise ResumeMismatchError(
            f"out: {partial} is there and is no merge, but perhaps an unfinished job; remove that "
            "folder, or give another name"
        )


def _digest(mosaic: Mosaic, grid: Grid, report: MergeReport) -> str:
    """SHA-256 of all that the bytes of the store follow from."""
    found = hashlib.sha256(json.dumps([build_name(), grid.tile]).encode())
    found.update(report.to_json().encode())
    for place in mosaic.placements:
        found.update(np.concatenate([place.linear.ravel(), place.offset]).tobytes())
    for numbers in (mosaic.gains, mosaic.rotations):
        found.update(np.ascontiguousarray(numbers).tobytes())
    found.update("".join(_digests_of(mosaic.frames)).encode())
    return found.hexdigest()


def _digests_of(frames: Sequence[Frame]) -> list[str]:
    """SHA-256 of what every frame holds, of a store by its list of checksums if it has one."""
    return [
        _digest_of_store(frame.result.path)
        if isinstance(frame.result, StoredSbrdf)
        else _digest_of_arrays(frame.result.arrays())
        for frame in frames
    ]


def _digest_of_store(store: Path) -> str:
    lists = [store / name for name in LISTS if (store / name).is_file()]
    files = lists or sorted(path for path in store.rglob("*") if path.is_file())
    entries = [file_entry(path, store) for path in files]
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def _digest_of_arrays(arrays: dict[str, Any]) -> str:
    found = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        array = np.ascontiguousarray(values)
        found.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        found.update(array.tobytes() if array.dtype.kind == "U" else array.data)
    return found.hexdigest()

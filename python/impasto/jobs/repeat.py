"""Jobs that are known from their records: to be resumed, or made once more."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from impasto._internal.build import build_name
from impasto._internal.calls import ProgressCallback
from impasto._internal.memory import DEFAULT_MEMORY
from impasto.errors import ArgumentError, ImpastoWarning
from impasto.io.results.zarr_arrays import need_zarr
from impasto.jobs.beginning import held
from impasto.jobs.cluster import checked_client
from impasto.jobs.folder import (
    NOTES,
    RECORD,
    check_finished,
    check_notes,
    checked_target,
    earlier_record,
    partial_of,
    refuse_changes,
    refuse_differences,
)
from impasto.jobs.grid import bytes_of, in_words
from impasto.jobs.job import Means, carry_out
from impasto.jobs.kept_options import check_options
from impasto.jobs.learning import border_of
from impasto.jobs.lookup import in_folder_of
from impasto.jobs.memory import kept_memory
from impasto.jobs.photographs import Photographs, open_photographs
from impasto.jobs.record import JobRecord
from impasto.stack import Stack

if TYPE_CHECKING:
    from distributed import Client


def resume(
    out: str | os.PathLike[str],
    *,
    source: Stack | Photographs | None = None,
    memory: str | int | None = None,
    client: Client | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Path:
    """Go on with a job that was interrupted; nothing else need be known of it.

    Parameters
    ----------
    out
        The ``out`` of :func:`impasto.run`.
    source
        The stack, if the job is one of a stack in memory.
    memory
        As in :func:`impasto.run`; default: what the job had. The tiles keep their size.
    client, threads, progress
        As in :func:`impasto.run`, whether the job began with a client or not.

    Returns
    -------
    Path
        The store; at once if the job is finished.

    Raises
    ------
    ArgumentError
        There is no job of that name, or it is running; a stack is needed or one too many.
    GeometryError
        Lights that cannot determine normals, of a job that was interrupted before it had learned.
    ResumeMismatchError
        The photographs have changed, or this is another version of impasto.
    CorruptInputError
        A damaged photograph, or a damaged file of the job.
    MissingExtraError
        zarr is not installed.
    ClusterError
        As in :func:`impasto.run`.
    """
    folder, whole, record = in_folder_of(out, _found)
    if whole:
        check_finished(folder, record.grid)
        return folder
    target = checked_target(out)
    if memory is None:
        memory = kept_memory(folder / NOTES) or DEFAULT_MEMORY
    means = Means(bytes_of(memory), checked_client(client, source), threads, progress)
    return _repeated(record, target, source, target, means)


def rerun(
    out: str | os.PathLike[str],
    into: str | os.PathLike[str],
    *,
    source: Stack | Photographs | None = None,
    memory: str | int = DEFAULT_MEMORY,
    client: Client | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> tuple[str, ...]:
    """Make a finished store once more from its photographs, and compare the two byte by byte.

    Parameters
    ----------
    out
        The finished store.
    into
        The new one, which does not exist yet, or was begun by an earlier call.
    source, client, threads, progress
        As in :func:`resume`.
    memory
        As in :func:`impasto.run`.

    Returns
    -------
    tuple
        The files that differ, or that only one of the two has; empty: the same bytes.

    Raises
    ------
    ArgumentError
        ``out`` is no finished job, or ``into`` is something else than its repetition.
    ResumeMismatchError
        The photographs have changed, or this is another version of impasto.
    CorruptInputError
        A damaged photograph, or a damaged file of either job.
    MissingExtraError
        zarr is not installed.
    ClusterError
        As in :func:`impasto.run`.
    """
    folder, whole, record = in_folder_of(out, _found)
    target = checked_target(into)
    if not whole:
        raise ArgumentError(f"out: {out} is not finished: resume it first")
    if target.exists() and target.samefile(folder):
        raise ArgumentError(f"into: {target} is the store itself; give another name")
    # One that was interrupted goes on.
    earlier = earlier_record(target, partial_of(target), resume=True)
    if earlier is not None:
        refuse_differences(earlier, record, target, "into")
    means = Means(bytes_of(memory), checked_client(client, source), threads, progress)
    made = _repeated(record, folder, source, target, means)
    names = {
        path.relative_to(store).as_posix()
        for store in (folder, made)
        for path in store.rglob("*")
        if not path.is_dir()
    }
    return tuple(sorted(name for name in names if _differ(folder / name, made / name)))


def _found(folder: Path, whole: bool) -> tuple[Path, bool, JobRecord]:
    """The folder of a job, whether it is finished, and its record."""
    check_notes(folder / NOTES)
    return folder, whole, JobRecord.read(folder / NOTES / RECORD)


def _repeated(
    record: JobRecord,
    store: Path,
    source: Stack | Photographs | None,
    target: Path,
    means: Means,
) -> Path:
    """The job of the record of a store, with the photographs as they are now."""
    need_zarr()
    # At once: another version may not know these options, and hashing takes long.
    refuse_changes(record, replace(record, version=build_name()), store)
    check_options(record, store / NOTES / RECORD)
    if record.source is None and source is None:
        raise ArgumentError(
            "source: this job is one of a stack in memory, which its folder does not hold; give "
            "the stack"
        )
    if record.source is not None and source is not None:
        raise ArgumentError(f"source: this job reads {record.source}; leave source out")
    with held(target) as own:
        photographs = open_photographs(
            record.source if source is None else source,
            record.reading,
            means.memory // 2,
            record.curve,
        )
        # Not before there is room for it.
        own.keep_memory(means.memory)
        if store == target:
            _warn_of_memory(means.memory // 2, photographs, record)
        curve = photographs.encoding
        found = replace(
            record,
            version=build_name(),
            encoding=(curve.curve, float(curve.white)),
            inputs=own.hashes(photographs),
            shape=photographs.shape,
            notes=photographs.notes,
        )
        refuse_changes(record, found, store)
        return carry_out(found, photographs, target, own, means)


def _warn_of_memory(memory: int, photographs: Photographs, record: JobRecord) -> None:
    """The tiles of a job keep their size: with less memory they take more than they may."""
    sides = min(record.tile, record.shape[2]), min(record.tile, record.shape[3])
    border = border_of(record.fit)
    # As far as the painting reaches.
    rows, columns = (min(s + 2 * border, n) for s, n in zip(sides, record.shape[2:], strict=True))
    needed = photographs.pixel.of_tile(sides, (rows, columns))
    if needed > memory:
        warnings.warn(
            f"memory: the tiles of this job keep their {sides[0]} x {sides[1]} pixels, for which "
            f"it takes {in_words(2 * needed)}, not {in_words(2 * memory)}; if this machine has "
            "less, begin anew with smaller tiles: impasto.run(resume=False, tile=), impasto job "
            "run --no-resume --tile",
            ImpastoWarning,
            stacklevel=4,
        )


def _differ(one: Path, two: Path) -> bool:
    return not (one.is_file() and two.is_file() and one.read_bytes() == two.read_bytes())

"""Fits of any size: tile by tile into a Zarr store, resumable after anything."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from impasto._internal.build import build_name
from impasto._internal.calls import ProgressCallback, check_progress, reporting, thread_count
from impasto._internal.checks import truth
from impasto._internal.memory import DEFAULT_MEMORY
from impasto._internal.windows import Window
from impasto.errors import ArgumentError, GeometryError, ResumeMismatchError
from impasto.fit.learning import LearnedModel, load_learned
from impasto.fit.subsample import Sample, checked_stride
from impasto.io.files import as_problem_of, atomic_bytes, sync_folder
from impasto.io.results.precision import Precision, checked_precision
from impasto.io.results.zarr_arrays import need_zarr
from impasto.jobs.beginning import Beginning, held
from impasto.jobs.cluster import checked_client, fit_tiles_on
from impasto.jobs.folder import (
    NOTES,
    RECORD,
    check_finished,
    checked_target,
    clear,
    earlier_record,
    entries_of,
    finish,
    has_begun,
    has_tiles,
    partial_of,
    refuse_differences,
)
from impasto.jobs.grid import (
    STEP,
    bytes_of,
    checked_tile,
    stride_for,
    tile_for,
)
from impasto.jobs.journal import JOURNAL, Journal
from impasto.jobs.learning import LEARNED, FitOptions, border_of, checked_fit, learned_from
from impasto.jobs.lock import release
from impasto.jobs.memory import keep_memory
from impasto.jobs.meter import Meter
from impasto.jobs.photographs import (
    Photographs,
    check_source,
    checked_reading,
    open_photographs,
)
from impasto.jobs.record import JobRecord, plain
from impasto.jobs.tiles import TileLog, fit_tiles
from impasto.jobs.worker import SharedJob
from impasto.stack import Stack

if TYPE_CHECKING:
    from distributed import Client


def run(
    source: str | os.PathLike[str] | Stack | Photographs,
    out: str | os.PathLike[str],
    *,
    memory: str | int = DEFAULT_MEMORY,
    resume: bool = True,
    tile: int | None = None,
    sample: int | None = None,
    precision: Precision = "single",
    reading: Mapping[str, Any] | None = None,
    client: Client | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
    **fit: Unpack[FitOptions],
) -> Path:
    """Fit a painting tile by tile into a Zarr store, in a given memory, resumable after anything.

    Two passes. *Learn*: what the fit must know of the whole painting is learned and saved
    (:func:`impasto.learn_sbrdf`). *Apply*: tile after tile is read, fitted and written; a line in a
    journal says so when all its files are on the disk. Until all tiles are done, the store is
    called ``out`` and ``.partial``. After an interruption, also by SIGKILL or a full disk, the same
    call goes on with the tiles that the journal does not have; at most the one being fitted and
    those being written are lost, after Ctrl-C only the one being fitted. The files of the store are
    the same, byte for byte, whether a job was interrupted or not, and for any number of threads.
    The numbers in it do not depend on the size of the tiles.

    **The result is that of** ``fit_sbrdf``, **bit for bit**, if the sample of pixels that
    :func:`impasto.learn_sbrdf` learns from, two million at most, fits into half of ``memory``. Else
    the sample is smaller: every so many rows and columns as fit. The tone curve, if it must be
    estimated and not all photographs fit into memory, is that of 1024 x 1024 pixels in the middle.

    Parameters
    ----------
    source
        What :func:`impasto.read_stack` takes, a :class:`Stack`, whose samples may be a memory
        map, or a :class:`impasto.jobs.Photographs`. Of TIFF, OpenEXR and uncompressed ``.npz``
        every tile reads its window alone; of JPEG and PNG as many rows as fit into the memory are
        decoded at once.
    out
        The store to make: a name that ends in ``.zarr``, which does not exist yet.
    memory
        Bytes, or a text such as ``"4GiB"``, for samples and maps; the program and its libraries
        come on top. It decides the size of tiles and from how many pixels the model is learned. A
        stack of arrays in memory is not counted.
    resume
        Whether to go on with a job of this name; False: an unfinished one is removed.
    tile
        Rows and columns of a tile, an even number, no more than the painting needs; default: as
        ``memory`` allows, at most 1024. A job that is resumed keeps its own.
    sample
        The model is learned from every so many rows and columns, an odd number; 1: from all pixels,
        whatever memory that takes. Default: that of :func:`impasto.learn_sbrdf`, or a larger one if
        ``memory`` asks for it.
    precision
        ``"half"``: normals, colours, strengths and widths of lobes, residuals and predicted errors
        are stored in half precision. Colours then differ by 0.05 % at most, normals by
        0.024 degrees; :func:`impasto.load_sbrdf` gives them in single precision. Default
        ``"single"``: bit for bit.
    reading
        Options of :func:`impasto.read_stack` for a path: ``{"encoding": "srgb"}``. Arrays are
        refused; give files. There is no ``region``.
    client
        A ``dask.distributed.Client``: tiles are read, fitted and written by the workers of its
        cluster, and a tile whose worker dies is given to another one (:doc:`clusters`). The bytes
        of the store are the same. Workers read ``source`` and write ``out`` under the paths that
        they have here, on a file system that all share; ``memory`` is that of each worker. A stack
        is refused: give its file.
    threads
        None means every allowed core. While a tile is fitted, one more thread reads the next. With
        a ``client`` that counts for this process, which learns and makes the smaller scales; a
        worker has the threads that it was started with.
    progress
        True: a bar on stderr, also while finished tiles of a job that goes on are compared with
        their checksums; or a callable ``(done, total)`` in tiles.
    **fit
        Options of :func:`impasto.learn_sbrdf`: model, pooling, lobes, ambient, coated, extraction,
        peak, joint, index, normals, refine, residuals, relief and effort.

    Returns
    -------
    Path
        The store, for :func:`impasto.load_sbrdf`, which loads all of it.

    Raises
    ------
    ArgumentError
        A value that cannot be used, ``out`` that is something else or in use by another job,
        memory for less than a tile of 64 x 64 pixels, or files that a worker cannot see.
    GeometryError
        Lights that cannot determine normals, or views from behind alone; nothing is left of a job
        that began with them.
    ResumeMismatchError
        There is a job of this name with other photographs or options; the differences are named.
    CorruptInputError
        A damaged photograph, or a damaged file of the job that is resumed.
    MissingExtraError
        zarr is not installed.
    ClusterError
        A tile ended every worker that it was given to, or the scheduler was lost; the job can be
        resumed.
    """
    target = checked_target(out)
    need_zarr()
    client = checked_client(client, source)
    check_source(source, "a job")
    budget = bytes_of(memory)
    thread_count(threads)
    check_progress(progress)
    given = checked_reading(reading)
    options = {name: plain(_as_path(name, value), name) for name, value in given.items()}
    path = None if isinstance(source, Stack | Photographs) else plain(Path(source), "source")
    chosen = checked_fit(fit)
    sample = None if sample is None else checked_stride(sample)
    tile = None if tile is None else checked_tile(tile)
    partial = partial_of(target)
    go_on = truth(resume, "resume")
    # What is no folder of a job is refused before anything is put into it.
    earlier_record(target, partial, resume=go_on)
    with held(target) as own:
        earlier = earlier_record(target, partial, resume=go_on)
        photographs = open_photographs(
            source if path is None else path,
            options,
            budget // 2,
            None if earlier is None else earlier.curve,
        )
        if photographs.inside(Sample(1, photographs.size)) == 0:
            raise ArgumentError("mask: is empty, no pixel belongs to the painting")
        if earlier is not None:
            tile = earlier.tile if tile is None else tile
            sample = earlier.sample if sample is None else sample
        if tile is None:
            tile = tile_for(
                budget // 2, photographs.pixel, photographs.source_grid, border_of(chosen)
            )
        tile = min(tile, -(-max(photographs.size) // STEP) * STEP)
        if sample is None:
            observations, bands, *_ = photographs.shape
            least = Sample.to_learn(photographs.size, observations * bands, photographs.inside)
            sample = stride_for(budget // 2, photographs.pixel, photographs.size, least.stride)
        curve = photographs.encoding
        record = JobRecord(
            version=build_name(),
            source=path,
            reading=options,
            encoding=(curve.curve, float(curve.white)),
            inputs=() if earlier is None else own.hashes(photographs),
            fit=chosen,
            shape=photographs.shape,
            tile=tile,
            sample=sample,
            precision=checked_precision(precision),
            notes=photographs.notes,
        )
        if earlier is not None:
            refuse_differences(earlier, record, target)
            own.keep_memory(budget)
        if not go_on:
            own.anew()
        means = Means(budget, client, threads, progress)
        return carry_out(record, photographs, target, own, means)


@dataclass(frozen=True)
class Means:
    """With what a job is done, as :func:`run` takes it; its result depends on none of it."""

    memory: int
    client: Client | None
    threads: int | None
    progress: bool | ProgressCallback


def carry_out(
    record: JobRecord, photographs: Photographs, target: Path, own: Beginning, means: Means
) -> Path:
    """Bring a job to its end, from wherever it is; see :func:`run`.

    The record of a job that has not begun may lack the hashes of its inputs: photographs are then
    hashed while the model is learned from them.
    """
    if target.exists():
        check_finished(target, record.grid)
        release(target / NOTES)
        return target
    partial = partial_of(target)
    is_new = not (partial / NOTES / RECORD).exists()
    try:
        return _carried_out(record, photographs, target, own, means)
    except GeometryError:
        # No job can come of these lights; one of others would be refused for the sake of this.
        if is_new and not has_tiles(partial / NOTES):
            own.discard()
        raise


def _carried_out(
    record: JobRecord, photographs: Photographs, target: Path, own: Beginning, means: Means
) -> Path:
    partial = partial_of(target)
    notes = partial / NOTES
    clear(partial)
    if not has_begun(notes):
        (notes / LEARNED).unlink(missing_ok=True)  # no checksum vouches for it

    def learn(check: Callable[[], object] = lambda: None) -> LearnedModel:
        return learned_from(
            photographs,
            record.fit,
            record.sample,
            max(record.tile, record.sample),
            threads=means.threads,
            progress=means.progress,
            check=check,
        )

    def write_record() -> None:
        # A source without files has none of these either, and says so at once.
        inputs = record.inputs or own.hashes(photographs)
        _refuse_changed(photographs)
        atomic_bytes(notes / RECORD, replace(record, inputs=inputs).to_bytes())
        keep_memory(notes, means.memory)
        with as_problem_of(partial):
            sync_folder(partial)
            sync_folder(partial.parent)

    if not (notes / RECORD).exists():
        with own.beside(write_record) as written:

            def check() -> None:
                # Without the hashes or their record nothing can come of what is learned.
                if written.done():
                    written.result()

            model = learn(check)
            written.result()
        model.save(notes / LEARNED)
    elif not (notes / LEARNED).exists():
        learn().save(notes / LEARNED)
    model = load_learned(notes / LEARNED)
    grid = record.grid
    with reporting(
        _of_comparing(means.progress), "comparing finished tiles", whole=True
    ) as callback:
        entries = entries_of(partial, grid, Meter(callback))
    with (
        closing(Journal(notes / JOURNAL, entries)) as journal,
        reporting(means.progress, "tiles") as callback,
    ):
        done = journal.entries.tiles

        def report(count: int) -> None:
            if callback is not None:
                callback(count, len(grid))

        report(len(done))
        # A photograph that is exchanged, and put back before the job ends, is in the tiles between.
        log = TileLog(
            notes, grid, journal, report,
            lambda tile: _refuse_changed(photographs, grid.window(tile, model.halo)),
        )  # fmt: skip
        missing = [tile for tile in grid if tile not in done]
        if means.client is None:
            fit_tiles(
                photographs, model, partial, grid, missing, log,
                precision=record.precision, threads=means.threads,
            )  # fmt: skip
        else:
            job = SharedJob(partial.absolute(), entries.job, entries.learned, means.memory)
            fit_tiles_on(means.client, job, missing, log)
            clear(partial)  # of workers that died
    _refuse_changed(photographs)
    finish(partial, grid, entries, record.precision, means.threads)
    with as_problem_of(target):
        partial.rename(target)
        # Not before: another process could take a lock of its own.
        release(target / NOTES)
        sync_folder(target / NOTES)
        sync_folder(target.parent)
    return target


def _of_comparing(progress: bool | ProgressCallback) -> bool | ProgressCallback:
    """Who is told how many bytes of finished tiles are compared: a callable counts tiles.

    One that counts these, too, has a method for it.
    """
    return getattr(progress, "comparing", False) if callable(progress) else progress


def _refuse_changed(photographs: Photographs, window: Window | None = None) -> None:
    """What was learned, and every tile, must be of the photographs of the record."""
    if changed := photographs.changed(window):
        raise ResumeMismatchError(
            f"source: {changed[0]} has changed while the job ran; restore it and resume, or "
            "begin anew (resume=False, --no-resume)"
        )


def _as_path(name: str, value: Any) -> Any:
    """Texts that name files, as paths: a job may go on in another folder."""
    named = name in {"lights", "images", "mask", "white", "dark", "intensities"}
    return Path(value) if named and isinstance(value, str) else value

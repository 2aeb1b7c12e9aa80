"""``merge``: overlapping frames of one painting become one result."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole
from impasto._internal.waiting import wait_for
from impasto.errors import ArgumentError
from impasto.fit.result import Sbrdf
from impasto.fit.stored import StoredSbrdf, open_sbrdf
from impasto.io.results.zarr_arrays import need_zarr
from impasto.jobs.folder import checked_target
from impasto.jobs.grid import STEP, Grid, checked_tile
from impasto.merge.blend import Mosaic
from impasto.merge.frames import Frame, frames_of
from impasto.merge.levels import tilt_of
from impasto.merge.models import model_of
from impasto.merge.report import FrameReport, MergeReport
from impasto.merge.solution import Solution, solved
from impasto.merge.store import check_begun, refuse_finished, write_store

TILE = 512
"""Rows and columns of a tile, if nobody says otherwise."""


@dataclass(frozen=True)
class Merged:
    """What :func:`impasto.merge` returns.

    Attributes
    ----------
    sbrdf
        The merged painting: in memory, or the opened store.
    report
        Where frames lie, what was done to them, and what is left at the seams.
    """

    sbrdf: Sbrdf | StoredSbrdf
    report: MergeReport


def merge(
    frames: Sequence[Sbrdf | StoredSbrdf | str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    *,
    reference: int = 0,
    white: int | None = None,
    tile: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Merged:
    """Merge overlapping frames of one painting into one result of one scale, colour and level.

    Between the frames camera or painting were shifted, so that each shows another part. Nothing
    needs to be known of that. Frames may be rotated in their plane by any angle, taken from a
    slightly other distance (scales of 2/3 to 3/2), with another exposure and white balance, and of
    a panel that leans a little.

    Frames are *registered* by features of their diffuse colours (SIFT, RANSAC) and by patches of
    colours and slopes (Lucas and Kanade's method), all at once by robust least squares: shift,
    scale and rotation, or an affine map where BIC prefers it strongly. Then each has a *gain* per
    band and one *rotation* of its normals, also found for all frames at once from what they share.
    Pixels are *blended* from all frames that see them, with weights that fall to zero at the edges
    of a frame (:doc:`merge`).

    Parameters
    ----------
    frames
        Two or more results of :func:`impasto.fit_sbrdf`, results that :func:`impasto.open_sbrdf`
        opened, or names of their files. All have the same bands and the same kind of lobes:
        Torrance-Sparrow lobes (of the painting or per pixel) or Lafortune lobes.
    out
        A name that ends in ``.zarr`` and does not exist: the result is written there tile by tile,
        in the memory of a tile, with its smaller scales and ``merge/report.json``. Frames that are
        ``.zarr`` are read by windows. Until it is whole it is called ``out`` and ``.partial``; the
        same call goes on with that after an interruption. Default: the result is in memory.
    reference
        Number of the frame whose scale, direction, plane and lamps are those of the result;
        default: the first.
    white
        Number of the frame whose colours are kept; default: none, but the geometric mean of the
        gains is 1 in every band.
    tile
        Rows and columns of the tiles of ``out``; default: 512. The numbers in the store do not
        depend on it.
    progress
        True for a bar on stderr, or a callable ``(done, total)`` in tiles.

    Returns
    -------
    Merged
        The result and a report. The result is a :class:`PooledSbrdf` if the lobes of pooled frames
        agree within three standard deviations, otherwise a :class:`LobeSbrdf` with the lobes of
        the frames blended, or a :class:`LafortuneSbrdf`. It has neither ``residuals`` nor
        ``relief``. Its ``rig`` is that of the reference frame. Every frame had lamps of its own, so
        that only ``predict`` and ``render`` under given lights show the whole painting as one would
        see it.

    Raises
    ------
    ArgumentError
        Frames that nothing connects with the others, by name; fewer than two; other bands, lobes or
        interfaces; an ``out`` that exists, whose folder does not, or that another process is
        making.
    ResumeMismatchError
        An interrupted merge of this name had other frames or options.
    CorruptInputError
        A damaged frame.
    MissingExtraError
        zarr is not installed.

    Examples
    --------
    >>> merged = impasto.merge(["left.npz", "right.npz"])  # doctest: +SKIP
    >>> print(merged.report)  # doctest: +SKIP
    """
    given = frames_of(frames)
    numbered(reference, len(given), "reference")
    if white is not None:
        numbered(white, len(given), "white")
    target = None if out is None else _checked_out(out)
    side = TILE if tile is None else checked_tile(tile)
    solution = wait_for(solved, given, reference, white)
    mosaic, report = _described(given, solution, reference)
    side = min(side, -(-max(solution.shape) // STEP) * STEP)
    grid = Grid(*solution.shape, side)
    with reporting(progress, "merging") as callback:

        def done(count: int) -> None:
            if callback is not None:
                callback(count, len(grid))

        done(0)
        if target is None:
            whole = mosaic.part(*(slice(0, size) for size in solution.shape))
            done(len(grid))
            return Merged(whole, report)
        write_store(target, mosaic, grid, report, done)
    return Merged(open_sbrdf(target), report)


def numbered(value: Any, count: int, name: str) -> None:
    """Refuse what is no number of a frame."""
    if not is_whole(value) or not 0 <= value < count:
        raise ArgumentError(
            f"{name}: expected the number of a frame, 0 to {count - 1}, found {value!r}"
        )


def _described(
    frames: Sequence[Frame], solution: Solution, reference: int
) -> tuple[Mosaic, MergeReport]:
    model = model_of(frames, solution.gains)
    height, width = solution.shape
    rows, columns = frames[reference].shape
    left, top = solution.placements[reference].offset.tolist()
    # From the middle of the reference frame to that of the merged painting.
    right, up = (width - columns) / 2 - left, top - (height - rows) / 2
    methods = [frame.window(slice(0, 1), slice(0, 1)).normals.method for frame in frames]
    mosaic = Mosaic(
        frames=frames,
        placements=solution.placements,
        gains=solution.gains,
        rotations=solution.rotations,
        model=model,
        shape=solution.shape,
        rig=frames[reference].rig.part(right, up),
        method=methods[reference],
    )
    entries = []
    for frame, place, gain, rotation in zip(
        frames, solution.placements, solution.gains, solution.rotations, strict=True
    ):
        x, y = place.to(np.zeros((1, 2)))[0].tolist()
        entries.append(
            FrameReport(
                name=frame.name,
                left=x,
                top=y,
                scale=place.scale,
                angle=place.angle,
                gain=tuple(gain.tolist()),
                tilt=tilt_of(rotation),
            )
        )
    report = MergeReport(
        shape=solution.shape,
        reference=reference,
        affine=solution.affine,
        lobes=model.words,
        frames=tuple(entries),
        seams=solution.seams,
    )
    return mosaic, report


def _checked_out(out: str | os.PathLike[str]) -> Path:
    target = checked_target(out)
    refuse_finished(target)
    need_zarr()
    check_begun(target)
    return target

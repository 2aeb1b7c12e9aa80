"""What a scene calls for, of a painting whose maps are not in memory.

Jobs keep statistics of every tile beside its maps; they are enough for a picture of the whole as
it is stored. For a detail, some bands, a varnish or a levelled panel, and of other stores, the maps
are read part by part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.windows import Window, offset, squares
from impasto.effects import Decisions
from impasto.fit.stored.picture import Parts, check_local
from impasto.level import Level
from impasto.lighting import prepare
from impasto.picture import Fidelity
from impasto.plan import decided, shows_photographs
from impasto.scene import Scene

READ = 4 * _core.SurfaceStatistics.SIDE
"""Rows and columns that are read at a time."""


def plan_parts(
    painting: Parts,
    scene: Scene,
    *,
    region: Window | None = None,
    bands: Sequence[int] | None = None,
    tolerance: str | float = 0,
    fidelity: Fidelity = "photographs",
    level: bool | Level = False,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
    **options: Any,
) -> Decisions:
    """Decide what a scene calls for; see :meth:`StoredSbrdf.plan`."""
    check_local(scene)
    rows, columns = region or tuple(slice(0, size) for size in painting.shape)
    size = rows.stop - rows.start, columns.stop - columns.start
    prepared: dict[str, Any] = {"level": level, "threads": threads, **options}

    def surface(down: slice, across: slice) -> Any:
        part = painting.visible(down, across)
        return part if bands is None else part.with_bands(list(bands))

    # A pixel, put into the middle of what is shown, has all that is no map.
    first = slice(rows.start, rows.start + 1), slice(columns.start, columns.start + 1)
    here, there = offset((rows, columns), painting.shape), offset(first, painting.shape)
    pixel = surface(*first).placed(here[0] - there[0], here[1] - there[1])
    standing = prepare(pixel, scene, **prepared)
    as_stored = bands is None and region is None and scene.varnish is None
    as_stored = as_stored and not isinstance(level, Level)
    kept = painting.statistics() if as_stored else None
    if kept is None:
        kept = READ, _read(surface, scene, (rows, columns), prepared, progress)
    tile, table = kept
    workers = thread_count(threads)
    statistics = _core.SurfaceStatistics.from_table(table.reshape(-1), standing.surface, size, tile)
    _, decisions = decided(
        standing,
        scene,
        statistics,
        tolerance=tolerance,
        more_light=shows_photographs(pixel, standing, fidelity),
        workers=workers,
        shape=size,
    )
    return decisions


def _read(
    surface: Any,
    scene: Scene,
    window: Window,
    prepared: dict[str, Any],
    progress: bool | ProgressCallback,
) -> NDArray[np.float64]:
    """Numbers ``(number, y, x)`` of the pieces of a part of the painting, which is read."""
    rows, columns = window
    size = rows.stop - rows.start, columns.stop - columns.start
    side = _core.SurfaceStatistics.SIDE
    down, across = (-(-one // side) for one in size)
    table: NDArray[np.float64] | None = None
    done, total = 0, size[0] * size[1]
    with reporting(progress, "reading maps") as callback:
        for part in squares(size, READ):
            top, left = (one.start // side for one in part)
            own = (
                slice(part[0].start + rows.start, part[0].stop + rows.start),
                slice(part[1].start + columns.start, part[1].stop + columns.start),
            )
            lit = prepare(surface(*own), scene, **prepared).surface
            numbers = _core.SurfaceStatistics(lit, None, thread_count(prepared["threads"])).table()
            height, width = (-(-one // side) for one in lit.shape)
            if table is None:
                table = np.empty((numbers.size // (height * width), down, across))
            table[:, top : top + height, left : left + width] = numbers.reshape(-1, height, width)
            done += lit.shape[0] * lit.shape[1]
            if callback is not None:
                callback(done, total)
    assert table is not None
    return table

"""A store of a gigapixel on little disk: every tile of it is one of four.

A painting of 2 x 2 tiles is fitted by a job; the store of the large one has a name for each of its
tiles and no bytes of its own for them (hard links). Its smaller scales are made as jobs make them,
of one period. What reads it opens and checks as many files as in any other store of the size.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

import impasto
from impasto.fit.stored import maps_of_level
from impasto.io.results.multiscales import multiscales_of
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import (
    EMPTY_GROUP,
    Levels,
    contents,
    group_metadata,
    levels_of,
    read_array,
    statistics_of,
)
from impasto.lighting import reduced
from impasto.rig import Rig

TILE = 1024
PERIOD = 2 * TILE


def fitted(folder: Path) -> Path:
    """The store of 2 x 2 tiles: a varnished relief under eight lamps in three bands."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:PERIOD, :PERIOD] * (2.0 * np.pi / PERIOD)
    normal = np.stack([0.2 * np.sin(9 * x), 0.2 * np.cos(7 * y + x), np.ones((PERIOD, PERIOD))])
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    azimuth, elevation = np.arange(8) * np.pi / 4, np.radians(40.0 + 15.0 * (np.arange(8) % 2))
    lights = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
         np.sin(elevation)], axis=1,
    )  # fmt: skip
    waves = 1.0 + 0.5 * np.sin(11 * x + 4 * y) * np.cos(13 * y - 3 * x)
    diffuse = (rng.uniform(0.2, 0.5, (3, 1, 1)) * waves).astype(np.float32)
    surface = impasto.Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2)
    samples = surface.predict(lights)
    samples += rng.normal(0.0, 1e-3, samples.shape).astype(np.float32)
    stack = impasto.Stack(samples, lights=Rig(lights, pitch_mm=0.02))
    out = folder / "period.impasto.zarr"
    impasto.run(stack, out, tile=TILE, pooling="none", memory="2GiB")
    return out


def repeated(source: Path, out: Path, side: int) -> Path:
    """A store of ``side`` x ``side`` pixels whose tiles are those of ``source``."""
    if side % PERIOD:
        raise ValueError(f"side: expected a multiple of {PERIOD}, found {side}")
    text, arrays = contents(source)
    stored = impasto.open_sbrdf(source)
    times = side // PERIOD
    out.mkdir()
    maps: list[ZarrArray] = []
    for one in arrays:
        if one.tile is None:
            _linked(source, out, one, one)
            maps.append(one)
            continue
        large = replace(one, shape=(*one.shape[:-2], side, side))
        if not one.same_as:
            _linked(source, out, one, large)
        maps.append(large)
    half = levels_of(source)[2]
    levels: Levels = {2: [replace(o, shape=(*o.shape[:-2], side // 2, side // 2)) for o in half]}
    for one, large in zip(half, levels[2], strict=True):
        _linked(source, out, one, large)
    period = stored.level(2).surface()
    factor = 2
    while side // factor > TILE:
        factor *= 2
        period, _ = reduced(period, None, 2)
        levels[factor] = _level(out, period, factor, side // factor, half)
    for name in ("levels", *(f"levels/{one}" for one in levels)):
        (out / name / METADATA).write_bytes(EMPTY_GROUP)
    statistics = statistics_of(source)
    assert statistics is not None
    rows, columns = (times * size for size in statistics.shape[-2:])
    large = replace(statistics, shape=(*statistics.shape[:-2], rows, columns))
    _linked(source, out, statistics, large)
    numbers = text | {o.name: read_array(source, o) for o in arrays if o.tile is None}
    group = group_metadata(
        numbers, maps, levels, multiscales_of(maps, levels, stored.pitch_mm), large
    )
    (out / METADATA).write_bytes(group)
    return out


def _level(
    out: Path, period: impasto.Surface, factor: int, side: int, like: list[ZarrArray]
) -> list[ZarrArray]:
    """All maps at one scale: its tiles are all the same, the period as often as it fits in one."""
    dims = {one.name.rsplit("/", 1)[1]: one.dims for one in like}
    found = []
    for name, plane in maps_of_level(period).items():
        tile = min(TILE, side)
        times = tile // plane.shape[-1]
        part = np.tile(plane, (*(1 for _ in plane.shape[:-2]), times, times))
        shape = (*plane.shape[:-2], side, side)
        one = ZarrArray(f"levels/{factor}/{name}", shape, plane.dtype, TILE, dims=dims[name])
        files = iter(one.paths())
        first, (row, column) = next(files)
        (out / first).parent.mkdir(parents=True)
        (out / first).write_bytes(one.encoded(part, row, column))
        (out / one.metadata_path).write_bytes(one.metadata)
        for path, _ in files:
            _link(out / first, out / path)
        found.append(one)
    return sorted(found, key=lambda one: one.name)


def _linked(source: Path, out: Path, one: ZarrArray, large: ZarrArray) -> None:
    (out / large.metadata_path).parent.mkdir(parents=True)
    (out / large.metadata_path).write_bytes(large.metadata)
    rows, columns = one.grid
    for path, (row, column) in large.paths():
        name = one.path() if one.tile is None else one.path(row % rows, column % columns)
        _link(source / name, out / path)


def _link(source: Path, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    os.link(source, path)

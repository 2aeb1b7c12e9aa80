"""How a store is put together from tiles: the files of each, and what describes them all.

Beside its files a tile leaves what is no map, the same for every tile that has an estimated pixel,
and its maps without pixels, which say how they are stored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto.fit.result import Sbrdf
from impasto.fit.saved import maps_of
from impasto.fit.stored import StoredMaps, StoredSbrdf
from impasto.io.files import atomic_together
from impasto.io.json_lines import crc_of
from impasto.io.results import SavedMaps
from impasto.io.results.multiscales import multiscales_of, with_dims
from impasto.io.results.precision import Precision, from_store, to_store
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import (
    NAME,
    STATISTICS,
    group_metadata,
    same_arrays,
    zarr_arrays,
)
from impasto.jobs.grid import PIECE, Grid, Tile
from impasto.jobs.levels import HALF_SCALE, half_scale, write_levels
from impasto.rig import Rig

MAP = "map:"
"""Begins the names of maps, of which no pixels are left."""
SAME = "same:"
"""Begins the names of maps that are others, whose names these are."""
STEREO = "normals."
"""Begins the names of the maps of photometric stereo, which a result with lobes holds, too."""
ERRORS = ("residual", "sigma")
"""What a fit has left and predicts of its error; pictures show neither."""
KNOWN = "estimated"
"""Whether the tile that the numbers are from has an estimated pixel."""


def files_of_tile(
    grid: Grid,
    tile: Tile,
    result: Sbrdf,
    precision: Precision,
    rig: Rig | None = None,
    threads: int | None = None,
) -> tuple[dict[str, bytes | memoryview], dict[str, NDArray[Any]]]:
    """Every map of a tile as a file, by its name in the store, and what the tile leaves beside.

    The maps of half the scale are made, too, while those of the tile are in memory, and the
    statistics on which plans of pictures rest.

    Parameters
    ----------
    rig
        That of the whole painting; default: the tile's, with its origin in the middle of it.
    threads
        None means every allowed core.
    """
    maps, others = _split(result, Rig(result.rig, origin=(0.0, 0.0)) if rig is None else rig)
    same = same_arrays(maps)
    stored = {
        name: to_store(name, plane, precision)
        for name, plane in sorted((maps | half_scale(result, grid, threads)).items())
        if name not in same
    }
    files = {}
    stored[STATISTICS] = _statistics(_as_stored(result, maps, others, stored, same))
    for name, plane in stored.items():
        array = _array(name, plane, grid)
        if 0 not in plane.shape:
            files[array.path(*tile)] = array.encoded(plane, *tile)
    none = {f"{MAP}{name}": plane[..., :0, :0] for name, plane in stored.items()}
    shared = {f"{SAME}{name}": np.array(other) for name, other in same.items()}
    return files, {**others, **none, **shared, KNOWN: np.asarray(result.estimated.any())}


def is_name(name: str) -> bool:
    """Whether a tile may leave an array of this name: it becomes that of a folder."""
    return NAME.fullmatch(name.removeprefix(MAP).removeprefix(SAME)) is not None


def complete(
    folder: Path,
    left: Mapping[str, NDArray[Any]],
    grid: Grid,
    precision: Precision,
    more: Mapping[str, bytes],
    threads: int | None = None,
) -> dict[str, str]:
    """Write all that a store has beside the files of its tiles.

    What describes the arrays, those that are no maps, the smaller scales and, last, the list of
    what there is. The same steps write the same bytes.

    Parameters
    ----------
    folder
        The store, with the files of all tiles.
    left
        What a tile has left beside its files, if possible one that has an estimated pixel.
    more
        Other files by name.
    threads
        Of the smaller scales; None means every allowed core.

    Returns
    -------
    dict
        CRC-32 in hexadecimal digits of every file that was written, by its name.
    """
    numbers = {
        name: array
        for name, array in left.items()
        if not name.startswith((MAP, SAME)) and name != KNOWN
    }
    tiles = _arrays(left, grid)
    statistics = next((one for one in tiles if one.name == STATISTICS), None)
    maps = [one for one in tiles if not one.name.startswith((HALF_SCALE, STATISTICS))]
    half = [one for one in tiles if one.name.startswith(HALF_SCALE)]
    others = zarr_arrays(numbers, (), None)
    files: dict[str, bytes | memoryview] = {**more}
    for array in others:
        files |= array.files(numbers[array.name])
    files |= {array.metadata_path: array.metadata for array in tiles}
    described = sorted([*others, *maps], key=lambda array: array.name)
    atomic_together({folder / name: data for name, data in files.items()})
    text = {name: array for name, array in numbers.items() if array.dtype.kind == "U"}
    painting = StoredSbrdf(StoredMaps(folder, text, described), {})
    levels, crcs = write_levels(folder, painting, half, precision, threads)
    multiscales = multiscales_of(described, levels, painting.known_pitch_mm)
    group = group_metadata(numbers, described, levels, multiscales, statistics)
    last = {METADATA: group}
    atomic_together({folder / name: data for name, data in last.items()})
    return crcs | {name: crc_of(data) for name, data in {**files, **last}.items()}


def _arrays(left: Mapping[str, NDArray[Any]], grid: Grid) -> list[ZarrArray]:
    """How all maps are stored, those of half the scale too."""
    own = {
        name.removeprefix(MAP): _array(name.removeprefix(MAP), plane, grid)
        for name, plane in left.items()
        if name.startswith(MAP)
    }
    same = [
        replace(own[str(other)], name=name.removeprefix(SAME), same_as=str(other))
        for name, other in left.items()
        if name.startswith(SAME)
    ]
    return [*own.values(), *same]


def _array(name: str, plane: NDArray[Any], grid: Grid) -> ZarrArray:
    """How a map is stored, from its part ``(..., y, x)`` in any tile."""
    place = grid.pieces if name == STATISTICS else grid
    place = grid.half if name.startswith(HALF_SCALE) else place
    shape = (*plane.shape[:-2], place.rows, place.columns)
    return with_dims(ZarrArray(name, shape, plane.dtype, place.tile))


def _as_stored(
    result: Sbrdf,
    maps: Mapping[str, NDArray[Any]],
    others: Mapping[str, NDArray[Any]],
    stored: Mapping[str, NDArray[Any]],
    same: Mapping[str, str],
) -> Sbrdf:
    """The result as pictures of the store will show it: of maps in half precision, what these say.

    What no picture shows stays as it is: to convert it takes time.
    """
    shown = {
        name: from_store(name, plane)
        for name, plane in stored.items()
        if name in maps and not name.startswith(STEREO) and name not in ERRORS
    }
    if all(shown[name] is stored[name] for name in shown):
        return result
    again = {name: shown[other] for name, other in same.items() if other in shown}
    arrays = {**others, **maps, **shown, **again}
    return type(result).from_maps(SavedMaps(Path(), result.kind(), arrays))


def _statistics(result: Sbrdf) -> NDArray[np.float64]:
    """Numbers ``(number, y, x)`` of every piece of a tile."""
    surface = result.surface()
    down, across = (-(-size // PIECE) for size in surface.shape)
    return _core.SurfaceStatistics(surface, None, 1).table().reshape(-1, down, across)


def _split(result: Sbrdf, rig: Rig) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """The maps of a tile, and all else, which is that of the whole painting."""
    whole = replace(result, rig=rig)
    names = maps_of(whole)
    arrays = whole.arrays()
    maps = {name: np.asarray(array) for name, array in arrays.items() if name in names}
    numbers = {name: np.asarray(array) for name, array in arrays.items() if name not in names}
    return maps, {"kind": np.array(result.kind()), **numbers}

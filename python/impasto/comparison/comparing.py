"""``compare``: what changed between two states of a painting."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, number, one_of, truth
from impasto._internal.damage import DAMAGE
from impasto.bands import Camera
from impasto.colour.illuminants import Illuminant
from impasto.comparison.clusters import ClusterSums
from impasto.comparison.colours import Spectra, colours_of
from impasto.comparison.entries import ComparisonMaps, GlossChange
from impasto.comparison.overview import Overview, OverviewSums
from impasto.comparison.quantities import words_of
from impasto.comparison.registration import Align, Exposure, aligned
from impasto.comparison.result import KIND, Comparison, from_dict
from impasto.comparison.store import write_store
from impasto.comparison.summary import Summary
from impasto.comparison.tiles import STEPS, Comparer
from impasto.errors import ArgumentError, CorruptInputError
from impasto.fit.pooled import PooledSbrdf
from impasto.fit.reflectance import Reflectance
from impasto.fit.result import Sbrdf
from impasto.fit.sbrdf import fit_sbrdf
from impasto.fit.stored import StoredSbrdf
from impasto.height import integrate_normals
from impasto.io.results import read_maps
from impasto.io.results.zarr_arrays import need_zarr
from impasto.jobs.folder import checked_store
from impasto.jobs.grid import Grid, Tile
from impasto.merge.frames import Frame, frame_of
from impasto.stack import Stack

Painting = Sbrdf | StoredSbrdf | Stack | str | os.PathLike[str]

TILE = 256
"""Rows and columns of a tile: what photographs show of lobes is predicted for all of its pixels."""
STORED_TILE = 1024
"""The same of a store, in multiples of :data:`TILE`."""
SAMPLE = 512
"""Rows or columns of the sample of a stored result, from which the painting's gloss is taken."""


def compare(
    before: Painting,
    after: Painting,
    out: str | os.PathLike[str] | None = None,
    *,
    align: Align = "found",
    exposure: Exposure = "measured",
    illuminant: Illuminant = "D65",
    camera: Camera | tuple[Camera | None, Camera | None] | None = None,
    reflectance: tuple[Reflectance | None, Reflectance | None] | None = None,
    alpha: float = 0.001,
    exposure_sigma: float = 0.01,
    cells: int = 8,
    regions: ArrayLike | None = None,
    height: bool = False,
    progress: bool | ProgressCallback = False,
) -> Comparison:
    """Compare two states of a painting, as before and after cleaning.

    The painting after is *registered* on the pixels of the one before, also where it is cropped,
    shifted by parts of a pixel, scaled (2/3 to 3/2), rotated or sheared a little, as in
    :func:`impasto.merge`, and its normals are rotated onto the same plane. Then normals, diffuse
    colours and gloss are compared pixel by pixel, and each difference is held against the predicted
    errors of both (Hotelling's T squared, :doc:`compare`).

    Parameters
    ----------
    before, after
        Results of :func:`impasto.fit_sbrdf`, opened stores, names of their files or folders, or
        stacks, which are fitted with default options. Both stand on white boards; sizes, rigs and
        bands may differ.
    out
        A name that ends in ``.zarr`` and does not exist: maps are written there tile by tile, in
        the memory of a tile, and :func:`load_comparison` reads them. Default: they are in memory.
    align
        ``"found"``: the registration is found; ``"same"``: pixels are the same already.
    exposure
        ``"measured"``: colours as the white boards have them; ``"matched"``: one gain per band
        takes off what most of the painting has in common.
    illuminant
        The light of the colour differences; without spectra D65, under which three bands are
        linear sRGB.
    camera
        The camera of both, or a pair, for spectra (Wiener) and so for any bands and illuminant.
        Bands without either that are neither three nor one have no colours: only normals and
        gloss are compared, and ``illuminant`` of the result says so.
    reflectance
        Instead, a pair of what :func:`impasto.fit_reflectance` found of results in memory.
    alpha
        The probability that a quantity of an unchanged pixel is marked: 0.001 of all pixels are.
    exposure_sigma
        Relative standard deviation of the exposure of each band between the two sessions; part of
        the predicted error of colours.
    cells
        Cells of the grid along the longer side, for ``areas`` of the result.
    regions
        ``(y, x)`` whole numbers over the pixels before, for ``areas`` by region instead of the
        grid; below 0: none.
    height
        Whether both are integrated to heights and compared, in memory; without an error.
    progress
        True for a bar on stderr, or a callable ``(done, total)`` in steps, of which every tile has
        three.

    Returns
    -------
    Comparison
        Maps, table and areas; ``save``, ``picture``, ``to_json`` and ``str`` of it.

    Raises
    ------
    ArgumentError
        Paintings that cannot be placed on each other; wrong options.
    CorruptInputError
        A damaged file.
    MissingExtraError
        A store, and zarr is not installed.

    Examples
    --------
    >>> found = impasto.compare("before.npz", "after.npz")  # doctest: +SKIP
    >>> print(found)  # doctest: +SKIP
    """
    one_of(align, get_args(Align), "align")
    one_of(exposure, get_args(Exposure), "exposure")
    truth(height, "height")
    level = _within(alpha, "alpha", "a probability above 0 and below 1", 0.0, 1.0, open_=True)
    spread = _within(exposure_sigma, "exposure_sigma", "a share from 0 to 1", 0.0, 1.0)
    if not is_whole(cells) or not 1 <= cells <= 256:
        raise ArgumentError(f"cells: expected a whole number from 1 to 256, found {cells!r}")
    target = None if out is None else _checked_out(out, height)
    frames = (_frame(before, "before"), _frame(after, "after"))
    labels = None if regions is None else _labels(regions, frames[0].shape)
    cameras = _cameras(camera)
    spectra = _spectra(reflectance, frames)
    colours = colours_of((frames[0].bands, frames[1].bands), cameras, illuminant, spectra)
    placed = aligned(frames, align, exposure)
    comparer = Comparer(*frames, placed, colours, level, spread)
    shape = frames[0].shape
    side = TILE if target is None else min(STORED_TILE, -(-max(shape) // TILE) * TILE)
    sums, summary = OverviewSums(shape), Summary(shape, int(cells), labels)
    connected = ClusterSums(shape[1])
    # Blocks of an overview do not cross tiles.
    side = max(side // sums.step * sums.step, sums.step)
    grid = Grid(*shape, side)
    normals = np.full((2, 3, *shape), np.nan, np.float32) if height else None

    def tiles() -> Iterator[tuple[Tile, dict[str, NDArray[Any]]]]:
        with reporting(progress, "comparing") as callback:
            for count, tile in enumerate(grid):
                part = grid.window(tile)

                def step(done: int, before: int = STEPS * count) -> None:
                    if callback is not None:
                        callback(before + done, STEPS * len(grid))

                found = comparer.tile(part, step)
                sums.add(part, found.overview)
                summary.add(part, found)
                connected.add(part, found.maps)
                if normals is not None:
                    normals[(slice(None), slice(None), *part)] = found.normals
                yield tile, found.maps
                step(STEPS)

    def result(maps: ComparisonMaps | None, path: Path | None) -> Comparison:
        extent, clusters = connected.clusters(
            summary.comparable,
            resampled=placed.report.sigma > 0.0,
            pitch_mm=frames[0].result.known_pitch_mm,
        )
        return Comparison(
            shape=shape,
            names=(frames[0].name, frames[1].name),
            fits=(words_of(frames[0].kind), words_of(frames[1].kind)),
            registration=placed.report,
            alpha=level,
            illuminant=colours.words,
            quantities=summary.quantities(),
            gloss=_gloss(frames),
            compared=summary.compared,
            areas=summary.areas(),
            extent=extent,
            clusters=clusters,
            overview=sums.overview(),
            maps=maps,
            path=path,
        )

    if target is not None:
        write_store(target, grid, tiles(), lambda: result(None, target).numbers(), KIND)
        return result(None, target)
    whole: dict[str, NDArray[Any]] = {}
    for tile, maps in tiles():
        for name, plane in maps.items():
            whole.setdefault(name, np.empty(shape, plane.dtype))[grid.window(tile)] = plane
    if normals is not None:
        whole["height"] = _heights(normals, frames[0].result.known_pitch_mm)
    return result(ComparisonMaps(**whole), None)


def load_comparison(path: str | os.PathLike[str]) -> Comparison:
    """Read what ``save`` of a comparison or ``out`` of :func:`impasto.compare` wrote, whole.

    Raises
    ------
    CorruptInputError
        A file that is damaged or holds something else.
    FileNotFoundError
        There is none.
    """
    with read_maps(path, KIND) as maps:
        found = ComparisonMaps.of(maps)
        overview = Overview.of(maps)
        text = str(maps.array("report", np.str_, ()))
    try:
        result = from_dict(json.loads(text), overview, found, Path(path))
    except DAMAGE as error:
        raise CorruptInputError(Path(path), f"has a damaged report ({error})") from error
    if result.shape != found.status.shape:
        raise CorruptInputError(Path(path), "has maps of another size than its report says")
    return result


def _frame(one: Any, name: str) -> Frame:
    if isinstance(one, Stack):
        return Frame(name, fit_sbrdf(one))
    if isinstance(one, Sbrdf | StoredSbrdf | str | os.PathLike):
        return frame_of(one, name)
    raise ArgumentError(
        f"{name}: expected a result of impasto.fit_sbrdf or impasto.open_sbrdf, the name of its "
        f"file, or a stack; found {type(one).__name__}"
    )


def _cameras(camera: Any) -> tuple[Camera | None, Camera | None]:
    pair = camera if isinstance(camera, tuple) else (camera, camera)
    if len(pair) != 2 or not all(one is None or isinstance(one, Camera) for one in pair):
        raise ArgumentError(
            f"camera: expected an impasto.Camera, a pair of them or None, found {camera!r}"
        )
    return pair[0], pair[1]


def _spectra(
    reflectance: Any, frames: tuple[Frame, Frame]
) -> tuple[Spectra | None, Spectra | None]:
    pair = (None, None) if reflectance is None else reflectance
    fine = isinstance(pair, tuple) and len(pair) == 2
    if not fine or not all(one is None or isinstance(one, Reflectance) for one in pair):
        raise ArgumentError(
            "reflectance: expected a pair of what impasto.fit_reflectance returns or None, found "
            f"{reflectance!r}"
        )
    found: list[Spectra | None] = []
    for one, frame in zip(pair, frames, strict=True):
        if one is not None and isinstance(frame.result, StoredSbrdf):
            raise ArgumentError(
                f"reflectance: {frame.name} is a store, whose colours come from camera="
            )
        found.append(None if one is None else (frame.result.diffuse, one))  # type: ignore[union-attr]
    return found[0], found[1]


def _labels(regions: ArrayLike, shape: tuple[int, int]) -> NDArray[np.int64]:
    found = np.asarray(regions)
    if found.dtype.kind not in "iub" or found.shape != shape:
        raise ArgumentError(
            f"regions: expected whole numbers {shape} over the pixels before, found "
            f"{found.dtype} {found.shape}"
        )
    return found.astype(np.int64)


def _within(
    value: Any, name: str, expected: str, low: float, high: float, *, open_: bool = False
) -> float:
    found = number(value, name, expected)
    if not (low < found < high if open_ else low <= found <= high):
        raise ArgumentError(f"{name}: expected {expected}, found {value!r}")
    return found


def _checked_out(out: str | os.PathLike[str], height: bool) -> Path:
    target = checked_store(out, kind="")
    if target.exists():
        raise ArgumentError(f"out: {target} exists; remove it or give another name")
    if height:
        raise ArgumentError("height: heights are compared in memory; leave one of both out")
    need_zarr()
    return target


def _gloss(frames: tuple[Frame, Frame]) -> GlossChange:
    """That of the paintings; of a store, of a sample of its pixels."""
    ones: list[Sbrdf] = []
    for frame in frames:
        result = frame.result
        if isinstance(result, StoredSbrdf):
            result = result.every(max(1, min(min(result.shape), max(result.shape) // SAMPLE)))
        ones.append(result)
    one, other = ones
    first, second = one.gloss, other.gloss
    beta_z = gamma_z = math.nan
    highlights = first.beta > 0.0 and second.beta > 0.0
    if highlights and isinstance(one, PooledSbrdf) and isinstance(other, PooledSbrdf):
        spread = np.sqrt(np.diag(one.covariance) + np.diag(other.covariance))
        beta_z = math.log(second.beta / first.beta) / float(spread[0])
        gamma_z = math.log(second.gamma / first.gamma) / float(spread[1])
    return GlossChange((first.beta, second.beta), (first.gamma, second.gamma), beta_z, gamma_z)


def _heights(normals: NDArray[np.float32], pitch: float | None) -> NDArray[np.float32]:
    """Height after less height before, median 0; NaN where either is unknown."""
    known = np.isfinite(normals).all(axis=(0, 1))
    before, after = (
        integrate_normals(np.where(known, own, np.nan), pitch or 1.0) for own in normals
    )
    off = np.where(known, after - before, np.nan)
    return np.asarray(off - (np.nanmedian(off) if known.any() else 0.0), np.float32)

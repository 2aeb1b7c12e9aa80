"""A result in a store as a user has it: parts, pictures, height and smaller scales."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, length_mm
from impasto._internal.viewing import view
from impasto._internal.windows import Window, offset, window
from impasto.effects import Decisions
from impasto.errors import ArgumentError
from impasto.fit.choice import Choice
from impasto.fit.result import Sbrdf
from impasto.fit.stored.height import height_rows
from impasto.fit.stored.level import StoredLevel, place_of_level, surface_of_level
from impasto.fit.stored.maps import StoredMaps
from impasto.fit.stored.picture import PictureFile, render_parts
from impasto.fit.stored.planning import plan_parts
from impasto.io.images.bands_of_rows import TIFF_TILE, check_suffix, write_tiff_rows
from impasto.io.results import checked_maps, result_file
from impasto.io.results.zarr_arrays import ZarrArray, need_zarr
from impasto.io.results.zarr_store import (
    Levels,
    contents,
    levels_of,
    read_array,
    read_window,
    statistics_of,
)
from impasto.level import Level, level_of_sample, sample_step
from impasto.picture import Backend, Fidelity
from impasto.rig import Rig
from impasto.scene import Scene


def open_sbrdf(path: str | os.PathLike[str]) -> StoredSbrdf:
    """Open a ``.zarr`` result of any size without loading its maps.

    Parameters
    ----------
    path
        What :func:`impasto.run` made, or ``save`` of a result with a name that ends in ``.zarr``.

    Raises
    ------
    ArgumentError
        An ``.npz``, which :func:`impasto.load_sbrdf` loads whole.
    CorruptInputError
        A store that is damaged or holds something else.
    FileNotFoundError
        There is none.
    MissingExtraError
        zarr is not installed.
    """
    target = result_file(path)
    if target.suffix.lower() != ".zarr":
        raise ArgumentError(
            f"path: expected a name ending in .zarr, found {target.name!r}; impasto.load_sbrdf "
            "loads other results"
        )
    text, arrays = contents(target)
    need_zarr()
    maps = StoredMaps(target, text, arrays)
    return StoredSbrdf(maps, levels_of(target), statistics_of(target))


class StoredSbrdf:
    """A result in a store, made by :func:`impasto.open_sbrdf`; its maps are read by windows.

    ``stored[y0:y1, x0:x1]`` is that part of the painting as :func:`impasto.load_sbrdf` would give
    it: a result of the same class, whose rig knows where the part lies. Only the chunks of the
    store that it touches are read, and their checksums compared.

    Attributes
    ----------
    path
        The store.
    """

    def __init__(
        self, maps: StoredMaps, levels: Levels, statistics: ZarrArray | None = None
    ) -> None:
        self.path = maps.path
        self._maps = maps
        self._levels = levels
        self._statistics = statistics

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self._maps.shape

    @property
    def kind(self) -> type[Sbrdf]:
        """The class of what is read, such as :class:`impasto.PooledSbrdf`."""
        return self._maps.kind

    @property
    def map_names(self) -> tuple[str, ...]:
        """What :meth:`map` reads."""
        return self._maps.names

    @property
    def has_statistics(self) -> bool:
        """Whether :meth:`statistics` are kept; they are not read."""
        return self._statistics is not None

    @property
    def tile(self) -> int:
        """Rows and columns of the tiles in which the maps are stored."""
        return self._maps.tile

    @property
    def bands(self) -> tuple[str, ...]:
        """One name per band."""
        return self._pixel.bands

    @property
    def rig(self) -> Rig:
        """Who lit and who looked."""
        rows, columns = self._first
        right, up = offset((rows, columns), self.shape)
        return self._pixel.rig.part(-right, -up)

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel in the unit of the rig: mm, or pixels as in ``known_pitch_mm``."""
        return self._pixel.rig.pitch_mm

    @property
    def known_pitch_mm(self) -> float | None:
        """Width of a pixel in mm; None where nobody has said it, also where the rig is refined."""
        return self._pixel.rig.known_pitch_mm

    @property
    def chosen(self) -> Choice | None:
        """What ``pooling="auto"`` chose, and against what."""
        return self._pixel.chosen

    @property
    def factors(self) -> tuple[int, ...]:
        """How many pixels, along a side, are one in the smaller maps of :meth:`level`: 2, 4 ..."""
        return tuple(self._levels)

    def __repr__(self) -> str:
        height, width = self.shape
        return (
            f"<StoredSbrdf {width} x {height} pixels, {len(self.bands)} bands, "
            f"{self.kind.__name__} in tiles of {self.tile}>"
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: size, tiles, and pictures of the smallest stored scale."""
        from impasto.notebook import stored_view

        return stored_view(self)

    def view(self, **options: Any) -> Any:
        """Show it in a notebook, in any light; only tiles that are seen are read.

        As :meth:`impasto.Sbrdf.view`, but without ``reflectance`` and ``height``.
        """
        return view(self, options)

    def __getitem__(self, key: Any) -> Sbrdf:
        """``[y0:y1, x0:x1]``: a part of the painting, loaded.

        Raises
        ------
        ArgumentError
            Anything but slices of step 1 with at least one pixel.
        CorruptInputError
            A chunk of the part is missing or damaged.
        """
        return self._maps.part(window(key, self.shape))

    def visible(self, rows: slice, columns: slice) -> Sbrdf:
        """A part as pictures need it: errors and photometric stereo are not read, but 0."""
        return self._maps.part(window((rows, columns), self.shape), visible=True)

    def windows(self, side: int | None = None) -> Iterator[Window]:
        """Rows and columns of square parts that cover the painting, row by row.

        Parameters
        ----------
        side
            Rows and columns of a part; default: those of the store's tiles, at most 1024.
        """
        return self._maps.windows(side)

    def map(self, name: str, rows: slice, columns: slice) -> NDArray[Any]:
        """A window of one map alone, such as ``"normal"`` or ``"status"``.

        Raises
        ------
        ArgumentError
            No map of this result, or no window.
        CorruptInputError
            A chunk of it is missing or damaged.
        """
        return self._maps.read(name, window((rows, columns), self.shape))

    def every(self, step: int) -> Sbrdf:
        """Every so many rows and columns, for statistics.

        Parameters
        ----------
        step
            Of so many rows and columns one; 1 loads the whole.

        Returns
        -------
        Sbrdf
            Its ``rig`` and position are not those of the painting.

        Raises
        ------
        ArgumentError
            No whole number from 1 to the smaller side.
        CorruptInputError
            A chunk is missing or damaged.
        """
        if not is_whole(step) or not 1 <= step <= min(self.shape):
            raise ArgumentError(
                f"step: expected a whole number from 1 to {min(self.shape)}, found {step!r}"
            )
        return self._maps.every(int(step))

    def render(
        self,
        scene: Scene,
        path: str | os.PathLike[str],
        *,
        region: Any = None,
        bands: Sequence[int] | None = None,
        pitch_mm: float | None = None,
        index: float | None = None,
        fidelity: Fidelity = "photographs",
        level: bool | Level = False,
        tolerance: str | float | None = None,
        backend: Backend = "cpu",
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> PictureFile:
        """Render the painting part by part into a tiled 16-bit TIFF, in the memory of some rows.

        The picture has the bits of :func:`impasto.render` of the whole, also under near lamps and
        with a near eye.

        Parameters
        ----------
        scene
            Without shadows, parallax, perspective and a view from the side. ``exposure="maximum"``
            lights the painting twice.
        path
            A name that ends in ``.tif``; a BigTIFF where it may exceed 4 GiB.
        region
            A detail as ``np.s_[y0:y1, x0:x1]``; default: all.
        bands
            Numbers of the three bands (or the one) that are shown, of a painting with others.
        pitch_mm, index, fidelity, tolerance, backend, threads
            As in :func:`impasto.render`. With a ``tolerance`` every part has a plan of its own.
        level
            True: the plane is found in all normals, as :meth:`find_level` does; or that plane.
        progress
            True for a bar on stderr, or a callable ``(done, total)`` in pixels.

        Returns
        -------
        PictureFile
            Where it is and what it is like.

        Raises
        ------
        ArgumentError
            A scene with effects of neighbours, another suffix, or what :func:`impasto.render`
            refuses.
        CorruptInputError
            A part of the store is missing or damaged; no picture is written.
        """
        check_suffix(Path(path))
        return render_parts(
            self,
            scene,
            path,
            region=None if region is None else window(region, self.shape),
            bands=bands,
            pitch_mm=pitch_mm,
            index=index,
            fidelity=fidelity,
            level=self.find_level() if level is True else level,
            tolerance=tolerance,
            backend=backend,
            threads=threads,
            progress=progress,
        )

    def plan(
        self,
        scene: Scene,
        *,
        tolerance: str | float = 0,
        region: Any = None,
        bands: Sequence[int] | None = None,
        pitch_mm: float | None = None,
        index: float | None = None,
        fidelity: Fidelity = "photographs",
        level: bool | Level = False,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> Decisions:
        """Decide what a scene calls for, as :func:`impasto.plan` does with the whole in memory.

        Jobs keep statistics of their tiles: no map is read for a picture of the whole, in all its
        bands, without a varnish and not levelled. Otherwise the maps are read once, part by part.
        Where the tiles are no multiples of 256 pixels, bounds of the kept statistics are wider.

        Parameters
        ----------
        scene
            As in :meth:`render`.
        tolerance
            What may be left out, as in :func:`impasto.plan`.
        region, bands, pitch_mm, index, fidelity, level, threads
            As in :meth:`render`.
        progress
            True for a bar on stderr, or a callable ``(done, total)`` in pixels that are read.

        Returns
        -------
        Decisions
            With ``explain()`` and ``to_json()``; :meth:`render` makes the picture.

        Raises
        ------
        ArgumentError
            A scene with effects of neighbours, or what :func:`impasto.plan` refuses.
        CorruptInputError
            A part of the store that is read is missing or damaged.
        """
        return plan_parts(
            self,
            scene,
            region=None if region is None else window(region, self.shape),
            bands=bands,
            tolerance=tolerance,
            pitch_mm=pitch_mm,
            index=index,
            fidelity=fidelity,
            level=self.find_level() if level is True else level,
            threads=threads,
            progress=progress,
        )

    def statistics(self) -> tuple[int, NDArray[np.float64]] | None:
        """Statistics of the maps, as plans need them, where a job has kept them.

        Returns
        -------
        tuple
            Rows and columns of the tiles, and numbers ``(number, y, x)`` of pieces of 256 x 256
            pixels, into which each tile is cut; None if nothing is kept.

        Raises
        ------
        CorruptInputError
            A file is missing or damaged.
        """
        if self._statistics is None:
            return None
        return self.tile, read_array(self.path, self._statistics)

    def height(
        self,
        path: str | os.PathLike[str],
        *,
        pitch_mm: float | None = None,
        level: bool | Level = False,
        threads: int | None = None,
        progress: bool | ProgressCallback = False,
    ) -> Path:
        """Integrate the normals tile by tile into a tiled 32-bit TIFF of heights in mm.

        What :func:`impasto.integrate_normals` does with the whole: a coarse height of the whole
        painting, and overlapping tiles on it. Where the normals are those of a surface, both give
        the same up to rounding; noise of one degree makes them differ by a twentieth of what it
        does to either.

        Parameters
        ----------
        path
            A name that ends in ``.tif``; a BigTIFF where it may exceed 4 GiB.
        pitch_mm
            Width of a pixel in mm; default: that of the result, otherwise 1.
        level
            True: heights about the plane of the panel, as :meth:`find_level` finds it; or that
            plane, without its bending. Default: with the lean of the panel.
        threads
            None means every allowed core.
        progress
            True for a bar on stderr, or a callable ``(done, total)`` in pixels.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ArgumentError
            Another suffix, a wrong pitch, or a plane that bends.
        CorruptInputError
            Normals are missing or damaged; nothing is written.
        """
        pitch = self.pitch_mm if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
        plane = self.find_level() if level is True else level
        if not isinstance(plane, bool) and any(plane.bend):
            raise ArgumentError("level: the bending of a plane is not taken out tile by tile")

        def normals(rows: slice, columns: slice) -> NDArray[np.float32]:
            found = self._maps.read("normal", (rows, columns))
            return found if isinstance(plane, bool) else plane.rotated(found)

        with reporting(progress, "integrating normals") as callback:
            total, pixels = self.shape[0] * self.shape[1], 0

            def done(count: int) -> None:
                nonlocal pixels
                pixels += count
                if callback is not None:
                    callback(pixels, total)

            rows = height_rows(
                normals, self.shape, pitch or 1.0, rows=TIFF_TILE, threads=threads, done=done
            )
            write_tiff_rows(Path(path), rows, self.shape, planes=1, dtype=np.float32)
        return Path(path)

    def find_level(self) -> Level:
        """The plane of the panel, as :func:`impasto.find_level` finds it in all normals."""
        step = sample_step(self.shape)
        return level_of_sample(self._maps.sample("normal", step), self.shape, step)

    def level(self, factor: int) -> StoredLevel:
        """The painting at a smaller scale, as pictures need it; :attr:`factors` are there.

        Parameters
        ----------
        factor
            How many pixels of the painting, along a side, are one: 2, 4, 8 ...

        Raises
        ------
        ArgumentError
            A factor that the store does not have.
        CorruptInputError
            A file is missing or damaged.
        """
        maps = self._of_level(factor)
        arrays = {name: read_array(self.path, one) for name, one in maps.items()}
        return self._level_of(arrays, factor, place_of_level(self.shape, self.rig.origin, factor))

    def level_part(self, factor: int, rows: slice, columns: slice) -> StoredLevel:
        """A window of :meth:`level`; no other chunks of the smaller maps are read.

        Parameters
        ----------
        factor
            As in :meth:`level`.
        rows, columns
            Of the smaller maps, slices of step 1.

        Raises
        ------
        ArgumentError
            A factor that the store does not have, or no window of its maps.
        CorruptInputError
            A chunk of the window is missing or damaged.
        """
        maps = self._of_level(factor)
        height, width = maps["normal"].shape[-2:]
        part = window((rows, columns), (height, width))
        arrays = {name: read_window(self.path, one, *part) for name, one in maps.items()}
        right, up = place_of_level(self.shape, self.rig.origin, factor)
        along, above = offset(part, (height, width))
        return self._level_of(arrays, factor, (right + along, up + above))

    def level_shape(self, factor: int) -> tuple[int, int]:
        """``(y, x)`` of the smaller maps of :meth:`level`."""
        height, width = self._of_level(factor)["normal"].shape[-2:]
        return height, width

    def _of_level(self, factor: int) -> dict[str, ZarrArray]:
        if factor not in self._levels:
            there = ", ".join(map(str, self._levels)) or "none"
            raise ArgumentError(f"factor: the store has {there}, found {factor!r}")
        return {one.name.rsplit("/", 1)[1]: one for one in self._levels[factor]}

    def _level_of(
        self, arrays: dict[str, NDArray[Any]], factor: int, origin: tuple[float, float]
    ) -> StoredLevel:
        pitch = None if self.pitch_mm is None else self.pitch_mm * factor
        with checked_maps(self.path, {"kind": np.array("level"), **arrays}, "level"):
            surface = surface_of_level(arrays, self._pixel.surface())
        lit = replace(surface, pitch_mm=pitch, origin=origin)
        in_mm = self.pitch_mm is None or self.known_pitch_mm is not None
        return StoredLevel(lit, self._pixel.eye(), in_mm)

    @property
    def _first(self) -> Window:
        return slice(0, 1), slice(0, 1)

    @cached_property
    def _pixel(self) -> Sbrdf:
        """The first pixel, with all that is not a map."""
        return self[self._first]

"""Results in a store, read by windows."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, length_mm
from impasto._internal.windows import Window, offset, window
from impasto.errors import ArgumentError, CorruptInputError
from impasto.fit.choice import Choice
from impasto.fit.relief import Relief
from impasto.fit.result import Sbrdf
from impasto.fit.saved import map_names
from impasto.fit.sbrdf import RESULTS
from impasto.io.images.bands_of_rows import TIFF_TILE, check_suffix, write_tiff_rows
from impasto.io.results import checked_maps, result_file
from impasto.io.results.zarr_arrays import ZarrArray, need_zarr
from impasto.io.results.zarr_store import Levels, contents, levels_of, read_array, read_window
from impasto.large_height import height_rows
from impasto.large_picture import PictureFile, render_parts
from impasto.level import Level, level_of_sample, sample_step
from impasto.picture import Backend, Fidelity
from impasto.rig import PointView, Rig
from impasto.scene import Scene
from impasto.surface import SHAPES, Lobe, Relightable, Surface

UNSEEN = re.compile(r"normals\..*|residual|sigma|misfit|\w+_sigma")
"""Maps that no picture shows."""


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
    return StoredSbrdf(target, text, arrays, levels_of(target))


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
        self,
        path: Path,
        text: dict[str, NDArray[Any]],
        arrays: list[ZarrArray],
        levels: Levels,
    ) -> None:
        self.path = path
        kind = str(text.get("kind", "something else"))
        if kind not in RESULTS:
            raise CorruptInputError(path, f"holds {kind}, not {' or '.join(RESULTS)}")
        self._class = RESULTS[kind]
        self._text = text
        names = set(map_names(self._class))
        self._maps = {one.name: one for one in arrays if one.name in names}
        self._others = [one for one in arrays if one.name not in names]
        self._levels = levels
        self._relief: Relief | None = None
        status = self._maps.get("status")
        if status is None or len(status.shape) != 2 or 0 in status.shape:
            raise CorruptInputError(path, "has no array 'status' over rows and columns")
        self._shape = status.shape[0], status.shape[1]
        self._tile = status.tile or max(self._shape)
        for one in self._maps.values():
            if one.shape[-2:] != self._shape:
                raise CorruptInputError(path, f"array {one.name!r} has the wrong shape {one.shape}")

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self._shape

    @property
    def kind(self) -> type[Sbrdf]:
        """The class of what is read, such as :class:`impasto.PooledSbrdf`."""
        return self._class

    @property
    def tile(self) -> int:
        """Rows and columns of the tiles in which the maps are stored."""
        return self._tile

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
        """Width of a pixel on the painting in mm, if known."""
        return self._pixel.rig.pitch_mm

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
            f"{self._class.__name__} in tiles of {self.tile}>"
        )

    def __getitem__(self, key: Any) -> Sbrdf:
        """``[y0:y1, x0:x1]``: a part of the painting, loaded.

        Raises
        ------
        ArgumentError
            Anything but slices of step 1 with at least one pixel.
        CorruptInputError
            A chunk of the part is missing or damaged.
        """
        part = window(key, self.shape)
        return self._part(part, {name: self._read(one, part) for name, one in self._maps.items()})

    def visible(self, rows: slice, columns: slice) -> Sbrdf:
        """A part as pictures need it: errors and photometric stereo are not read, but 0."""
        part = window((rows, columns), self.shape)
        arrays = {
            name: np.zeros((*one.shape[:-2], *(p.stop - p.start for p in part)), one.dtype)
            if UNSEEN.fullmatch(name)
            else self._read(one, part)
            for name, one in self._maps.items()
        }
        return self._part(part, arrays)

    def _part(self, part: Window, arrays: dict[str, NDArray[Any]]) -> Sbrdf:
        with checked_maps(self.path, self._numbers | arrays, *RESULTS) as maps:
            found = self._class.from_maps(maps)
        if found.relief is not None:
            # One for all parts: it remembers the shadows of its lights.
            self._relief = self._relief or found.relief
            found = replace(found, relief=self._relief)
        return found.placed(*offset(part, self.shape))

    def windows(self, side: int | None = None) -> Iterator[Window]:
        """Rows and columns of square parts that cover the painting, row by row.

        Parameters
        ----------
        side
            Rows and columns of a part; default: those of the store's tiles, at most 1024.
        """
        side = min(self.tile, 1024) if side is None else side
        height, width = self.shape
        for top in range(0, height, side):
            for left in range(0, width, side):
                yield (
                    slice(top, min(top + side, height)),
                    slice(left, min(left + side, width)),
                )

    def map(self, name: str, rows: slice, columns: slice) -> NDArray[Any]:
        """A window of one map alone, such as ``"normal"`` or ``"status"``.

        Raises
        ------
        ArgumentError
            No map of this result, or no window.
        CorruptInputError
            A chunk of it is missing or damaged.
        """
        if name not in self._maps:
            known = ", ".join(sorted(self._maps))
            raise ArgumentError(f"name: expected one of {known}, found {name!r}")
        return self._read(self._maps[name], window((rows, columns), self.shape))

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
        arrays = {name: self._every(one, int(step)) for name, one in self._maps.items()}
        with checked_maps(self.path, self._numbers | arrays, *RESULTS) as maps:
            return self._class.from_maps(maps)

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
            found = self._read(self._maps["normal"], (rows, columns))
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
        return level_of_sample(self._every(self._maps["normal"], step), self.shape, step)

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
        if factor not in self._levels:
            there = ", ".join(map(str, self._levels)) or "none"
            raise ArgumentError(f"factor: the store has {there}, found {factor!r}")
        template = self._pixel.surface()
        maps = {one.name.rsplit("/", 1)[1]: one for one in self._levels[factor]}
        height, width = self.shape
        # Rows and columns that fill no group are left out on the right and below, at every level.
        origin, size = self.rig.origin, np.array([width, height])
        for _ in range(int(factor).bit_length() - 1):
            right, up = (0.5 * (size % 2)).tolist()
            origin = (origin[0] - right) / 2, (origin[1] + up) / 2
            size //= 2
        pitch = None if self.pitch_mm is None else self.pitch_mm * factor
        arrays = {name: read_array(self.path, one) for name, one in maps.items()}
        with checked_maps(self.path, {"kind": np.array("level"), **arrays}, "level"):
            surface = surface_of_level(arrays, template)
        lit = replace(surface, pitch_mm=pitch, origin=origin)
        return StoredLevel(lit, self._pixel.eye())

    def _read(self, one: ZarrArray, part: Window) -> NDArray[Any]:
        if one.tile is None:
            return read_array(self.path, one)[(..., *part)]
        return read_window(self.path, one, *part)

    def _every(self, one: ZarrArray, step: int) -> NDArray[Any]:
        height, width = self.shape
        size = -(-height // step), -(-width // step)
        found = np.empty((*one.shape[:-2], *size), one.dtype)
        for rows, columns in self.windows():
            first = [-(-part.start // step) for part in (rows, columns)]
            starts = [
                at * step - part.start for at, part in zip(first, (rows, columns), strict=True)
            ]
            picked = self._read(one, (rows, columns))[..., starts[0] :: step, starts[1] :: step]
            down, across = picked.shape[-2:]
            found[..., first[0] : first[0] + down, first[1] : first[1] + across] = picked
        return found

    @cached_property
    def _numbers(self) -> dict[str, NDArray[Any]]:
        return self._text | {one.name: read_array(self.path, one) for one in self._others}

    @property
    def _first(self) -> Window:
        return slice(0, 1), slice(0, 1)

    @cached_property
    def _pixel(self) -> Sbrdf:
        """The first pixel, with all that is not a map."""
        return self[self._first]


@dataclass(frozen=True, eq=False)
class StoredLevel(Relightable):
    """A painting at a smaller scale, for :func:`impasto.render`.

    Attributes
    ----------
    maps
        The surface.
    view
        From where pictures show it.
    """

    maps: Surface
    view: tuple[float, float, float] | PointView

    def surface(self) -> Surface:
        """The maps, ready to be lit."""
        return self.maps

    def eye(self) -> tuple[float, float, float] | PointView:
        """From where pictures show it unless a scene says so."""
        return self.view

    @property
    def diffuse(self) -> NDArray[np.float32]:
        """``(band, y, x)``."""
        return self.maps.diffuse

    @property
    def normal(self) -> NDArray[np.float32]:
        """``(3, y, x)``."""
        return self.maps.normal

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.maps.shape

    def with_bands(self, chosen: list[int]) -> StoredLevel:
        """The surface in some of its bands, by number."""

        def some(planes: Any) -> Any:
            return np.take(planes, chosen, axis=0) if np.ndim(planes) == 3 else planes

        lobes = tuple(Lobe(some(lobe.strength), lobe.shape) for lobe in self.maps.lobes)
        ambient, diffuse = some(self.maps.ambient), some(self.maps.diffuse)
        maps = replace(self.maps, diffuse=diffuse, ambient=ambient, lobes=lobes)
        return replace(self, maps=maps)


def maps_of_level(surface: Surface) -> dict[str, NDArray[np.float32]]:
    """The maps of a surface whose lobes are all maps, by their names in a store."""
    maps: dict[str, Any] = {"normal": surface.normal, "diffuse": surface.diffuse}
    if surface.ambient is not None:
        maps["ambient"] = surface.ambient
    for number, lobe in enumerate(surface.lobes, start=1):
        maps[f"lobe{number}.strength"] = lobe.strength
        names = SHAPES[surface.model]
        maps |= {
            f"lobe{number}.{name}": plane for name, plane in zip(names, lobe.shape, strict=True)
        }
    return maps


def surface_of_level(maps: dict[str, NDArray[Any]], template: Surface) -> Surface:
    """The surface of these maps; what is no map is that of a template of the same model."""
    names = SHAPES[template.model]
    lobes = tuple(
        Lobe(maps[f"lobe{number}.strength"], tuple(maps[f"lobe{number}.{n}"] for n in names))
        for number in range(1, len(template.lobes) + 1)
    )
    return replace(
        template,
        normal=maps["normal"],
        diffuse=maps["diffuse"],
        ambient=maps.get("ambient"),
        lobes=lobes,
        height=None,
    )

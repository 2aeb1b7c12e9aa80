"""Cast shadows and interreflections of a painting's own relief.

The normals of a fit are integrated to heights. From those follow the lamps that each place sees,
and the light that it gets from its surroundings, by one bounce of radiosity [@goral1984radiosity].
What came from the surroundings is taken off the samples, and the fit is repeated, as in shape from
interreflections [@nayar1991interreflections]. Heights are kept on a grid of cells over the whole
painting: a part of it has the light of the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.direct_light import DirectStack, Places
from impasto._internal.rotation import rotated_vector
from impasto._internal.windows import rotated_map
from impasto.fit.normals import fit_normals
from impasto.fit.saved import over
from impasto.height import integrate_normals
from impasto.io.results import SavedMaps
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.surface import Surface

Map = NDArray[np.float32]

SOFT = (-1.5, 0.0, 1.5)
"""Visibility is the mean over these changes of a light's elevation, in degrees: heights have
errors, and so have edges of shadows."""
GATHERED = 48
"""Most cells a side among which light is exchanged. It varies slowly: 24 cells gave normals of a
deep relief 0.35 degrees of error, 48 and 96 cells 0.32, none 0.97."""
REMEMBERED = 128
"""Lights whose shadows are kept in memory: 34 MB for the largest relief in three bands, 8 MB more
for each other band."""
TOGETHER = 16
"""Lights whose shadows are made at a time. For 64 lights over 64 cells a side 1, 4, 16 or all at a
time took 0.21, 0.11, 0.08 and 0.07 s and 5, 6, 10 and 22 MB at most."""
LOWEST = 0.01
"""Lowest elevation of a light that casts shadows, in radians. Lower ones have its shadows: along
the painting everything is in shadow, and a lamp that sinks must not make the picture jump."""


@dataclass(frozen=True, eq=False)
class Relief:
    """The relief of a painting, for the light that it keeps from itself and sends to itself.

    Attributes
    ----------
    height
        ``(cell_y, cell_x)`` float32, in pixels of the picture; NaN, where there is no surface,
        throws no shadow and receives none.
    normal
        ``(3, cell_y, cell_x)`` float32 unit vectors.
    diffuse
        ``(band, cell_y, cell_x)`` float32; 0 where there is no surface.
    step
        Pixels of the picture along a side of a cell.
    origin
        ``(2,)``: how far right and up of the painting's middle that of the cells lies, in pixels.
    interreflection
        Whether light from other cells counts, besides shadows.
    white
        What a white matte surface has as its ``diffuse``. The reflectance of a cell, of which its
        interreflections are made, is ``diffuse / white``; not every stack has a white board at 1.
    gain
        dB by which held-out photographs are predicted better than without.
    """

    height: Map = field(metadata=over("cell_y", "cell_x"))
    normal: Map = field(metadata=over("axis", "cell_y", "cell_x"))
    diffuse: Map = field(metadata=over("band", "cell_y", "cell_x"))
    step: int = field(metadata=over(dtype=np.int64))
    origin: NDArray[np.float64] = field(metadata=over("place", dtype=np.float64))
    interreflection: bool = field(metadata=over(dtype=np.bool_))
    white: float = field(default=1.0, metadata=over(dtype=np.float64))
    gain: float = field(default=0.0, metadata=over(dtype=np.float64))

    @classmethod
    def of(cls, result: Any, step: int, white: float | None) -> Relief:
        """The relief of a fit whose pixels are the cells; without ``white``, of shadows alone."""
        known = np.isfinite(result.normal).all(axis=0)
        upright = np.array([0.0, 0.0, 1.0], np.float32)[:, None, None]
        height = integrate_normals(result.normal) * np.float32(step)
        # Whole half pixels, in which positions are exact.
        origin = np.rint(2.0 * step * np.array(result.rig.origin)) / 2.0
        return cls(
            np.where(known, height, np.float32(np.nan)),
            np.where(known, result.normal, upright),
            np.where(known, np.nan_to_num(result.diffuse), np.float32(0.0)),
            step,
            origin,
            white is not None,
            1.0 if white is None else white,
        )

    def __str__(self) -> str:
        what = "cast shadows" + " and interreflections" * self.interreflection
        return f"{what} predict new lights {self.gain:.1f} dB better"

    def __repr__(self) -> str:
        height, width = self.height.shape
        return f"<Relief of {width} x {height} cells, {self}>"

    def report(self) -> dict[str, Any]:
        """Plain numbers for a report file."""
        return {
            "interreflection": self.interreflection,
            "white": self.white,
            "gain_decibels": self.gain,
        }

    def with_bands(self, chosen: list[int]) -> Relief:
        """The relief in some of its bands, by number."""
        return replace(self, diffuse=np.take(self.diffuse, chosen, axis=0))

    def magnified(self, factor: int) -> Relief:
        """The relief of the same painting in pixels of which ``factor`` make one of today's."""
        return replace(
            self,
            height=self.height * np.float32(factor),
            step=self.step * factor,
            origin=self.origin * factor,
        )

    def rotated(self, turns: int) -> Relief:
        """The relief after quarter turns counterclockwise."""
        return replace(
            self,
            height=rotated_map(self.height, turns),
            normal=rotated_map(self.normal, turns, 0),
            diffuse=rotated_map(self.diffuse, turns),
            origin=np.array(rotated_vector((*self.origin.tolist(), 0.0), turns)[:2]),
        )

    def visibility(self, rig: Rig) -> Map:
        """``(obs, cell_y, cell_x)``, 0 to 1: the share of each light that shadows leave."""
        pitch = rig.pitch_mm or 1.0
        height = np.ascontiguousarray(self.height * np.float32(pitch))
        found = np.ones((len(rig), *self.height.shape), np.float32)
        middle = np.append(self.origin, 0.0) * pitch
        for visible, lamp, near in zip(found, rig.vectors, rig.near.tolist(), strict=True):
            place = lamp - middle if near else lamp
            # One thread: so few cells take less time than starting others.
            seen = [
                _core.cast_shadows(height, pitch * self.step, light, near, 1)
                for light in (_raised(place, np.radians(angle)) for angle in SOFT)
            ]
            visible[:] = np.mean(seen, axis=0)
        return found

    def irradiance(self, rig: Rig, visibility: Map) -> Map:
        """``(obs, band, cell_y, cell_x)``: light from other cells, in that of the lamp in front."""
        pitch = (rig.pitch_mm or 1.0) * self.step
        right, up = (self.origin / self.step).tolist()
        lit = Surface(self.normal, self.diffuse, pitch_mm=pitch, origin=(right, up))
        radiosity = lit.predict(Rig(rig, pitch_mm=pitch), threads=1)
        side, factors = self._exchange
        sent = blocks(radiosity * visibility[:, None], side)
        received = factors.gather(sent.reshape(-1, len(factors.first) - 1)) / self.white
        maps = received.astype(np.float32).reshape(sent.shape)
        return finer(maps, side, self.height.shape, (0.0, 0.0))

    def add_to(self, shown: Map, diffuse: Map, ambient: Map | None, rig: Rig) -> None:
        """Shadow what a model shows and add its interreflections, in place.

        Parameters
        ----------
        shown
            ``(obs, band, y, x)`` of the painting, or of the part of it where ``rig.origin`` is.
        diffuse, ambient
            ``(band, y, x)`` of the same pixels. Ambient light is in shadows, too.
        rig
            The lights.
        """
        most = np.finfo(np.float32).max
        places = places_of(self.height.shape, self.step, shown.shape[-2:], self._origin(rig))
        for index, light, visible, around in self._each(rig):
            picture = shown[index]
            everywhere = 0.0 if ambient is None else np.float32(light) * ambient
            lit = between(visible, *places) * (picture - everywhere) + everywhere
            if around is not None:
                lit += diffuse * between(around, *places)
            picture[:] = np.minimum(lit, most)

    def seen(self, shape: tuple[int, int], rig: Rig) -> Map:
        """``(obs, y, x)``, 0 to 1: the share of each light that shadows leave.

        ``shape``: of the painting, or of the part of it where ``rig.origin`` is.
        """
        places = places_of(self.height.shape, self.step, shape, self._origin(rig))
        return np.stack([between(visible, *places) for *_, visible, _ in self._each(rig)])

    def removed(self, stack: Stack, *, threads: int | None = None) -> Stack:
        """The photographs without the light that pixels get from others.

        The reflectance of a pixel is that of photometric stereo by ranks, which highlights and
        shadows bias little and which depends on the pixel alone. No samples are copied: their light
        is taken off as they are read. Without interreflections it is the stack itself.
        """
        if not self.interreflection:
            return stack
        albedo = fit_normals(stack, method="rank", threads=threads).albedo
        albedo = np.maximum(np.nan_to_num(albedo), 0.0)
        irradiance = np.array([around for *_, around in self._each(stack.rig)], np.float32)
        origin = self._origin(stack.rig)
        places = places_of(irradiance.shape[2:], self.step, albedo.shape[1:], origin)
        return DirectStack(stack, irradiance, albedo, *places)

    def _each(self, rig: Rig) -> Iterator[tuple[int, float, Map, Map | None]]:
        """Number, intensity, visibility and irradiance by other cells of each light."""
        intensities = rig.intensities.tolist()
        for first in range(0, len(rig), TOGETHER):
            some = range(first, min(first + TOGETHER, len(rig)))
            for index, found in zip(some, self._under(rig.take(some)), strict=True):
                yield index, intensities[index], *found

    def _under(self, lights: Rig) -> list[tuple[Map, Map | None]]:
        """Visibility and irradiance under each; fits that are compared ask for them again."""
        numbers = (lights.vectors, lights.near, lights.falloff, lights.intensities)
        keys = [
            (lights.pitch_mm, *(number.tobytes() for number in each))
            for each in zip(*numbers, strict=True)
        ]
        found = {key: self._known[key] for key in keys if key in self._known}
        new = {key: index for index, key in enumerate(keys) if key not in found}
        if new:
            rig = lights.take(new.values())
            visible = self.visibility(rig)
            around = self.irradiance(rig, visible) if self.interreflection else len(new) * [None]
            for key, seen, received in zip(new, visible, around, strict=True):
                found[key] = seen, received
                if len(self._known) < REMEMBERED:
                    # Not views, each of which would keep the maps of all that were made together.
                    self._known[key] = seen.copy(), None if received is None else received.copy()
        return [found[key] for key in keys]

    @cached_property
    def _known(self) -> dict[Any, tuple[Map, Map | None]]:
        return {}

    def _origin(self, rig: Rig) -> tuple[float, float]:
        """How far right and up of the middle of the cells that of a picture lies, in pixels."""
        right, up = (np.array(rig.origin) - self.origin).tolist()
        return right, up

    @cached_property
    def _exchange(self) -> tuple[int, FormFactors]:
        """Side of the blocks of cells that exchange light, and their form factors."""
        side = -(-max(self.height.shape) // GATHERED)
        height = blocks(self.height, side) / (side * self.step)
        return side, FormFactors.of(height, blocks(self.normal, side))


class FormFactors(NamedTuple):
    """The share of its radiosity by which each cell lights another, as compressed sparse rows.

    Most pairs of cells do not see each other. The numerics find them by horizon mapping
    [@max1988horizon].
    """

    first: NDArray[np.uint64]
    """``(n + 1,)``: where the entries of each lit cell begin, and where the last ones end."""
    cell: NDArray[np.uint32]
    """Per entry the cell that lights it."""
    share: NDArray[np.float64]
    """Per entry the share."""

    @classmethod
    def of(cls, height: Map, normal: Map) -> FormFactors:
        """Those of heights ``(y, x)``, in sides of a cell, and normals ``(3, y, x)`` of any length.

        Heights that are NaN neither light others nor are lit.
        """
        return cls(*_core.form_factors(np.ascontiguousarray(height), np.ascontiguousarray(normal)))

    def gather(self, sent: Map) -> NDArray[np.float64]:
        """``(k, n)``: the light that cells get from each other when they send ``(k, n)``."""
        return _core.gather(*self, np.ascontiguousarray(sent))


def blocks(maps: NDArray[Any], side: int) -> Map:
    """Means ``(..., cells, cells)`` of what is known in blocks of pixels; NaN where nothing is.

    Blocks hang over the border alike at opposite edges, up to one pixel.
    """
    if side == 1:
        return np.asarray(maps, np.float32)
    short = [-size % side for size in maps.shape[-2:]]
    wide = [(0, 0)] * (maps.ndim - 2) + [(one // 2, one - one // 2) for one in short]
    padded = np.pad(maps, wide, constant_values=np.nan)
    rows, columns = (size // side for size in padded.shape[-2:])
    parts = padded.reshape(*maps.shape[:-2], rows, side, columns, side)
    known = ~np.isnan(parts)
    # Rows first: long rows are added at once, which leaves little for the few columns of a block.
    count = known.sum(axis=-3).sum(axis=-1)
    total = np.where(known, parts, 0.0).sum(axis=-3, dtype=np.float64).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(np.float32)


def finer(cells: Map, step: int, size: tuple[int, ...], origin: tuple[float, float]) -> Map:
    """Maps of cells at the pixels of a picture, or of a part of it, by bilinear interpolation.

    Beyond the middles of the outermost cells there is their value. ``origin``: how far right and up
    of the middle of the cells that of the pixels lies, in pixels.
    """
    return between(cells, *places_of(cells.shape[-2:], step, size, origin))


def between(cells: Map, rows: Places, columns: Places) -> Map:
    """Maps of cells at rows and columns of pixels, by bilinear interpolation."""
    return columns.between(rows.between(cells, -2), -1)


def places_of(
    cells: tuple[int, ...], step: int, size: tuple[int, ...], origin: tuple[float, float]
) -> tuple[Places, Places]:
    """Where the rows and columns of a picture lie between cells."""
    right, up = origin
    rows = Places.of(size[0], cells[0], step, -up)
    return rows, Places.of(size[1], cells[1], step, right)


def relief_of(maps: SavedMaps, fields: dict[str, Any]) -> Relief:
    """The relief of a file, from its fields; errors name the array."""
    found = Relief(**fields)
    maps.demand("relief.step", found.step > 0, f"is {found.step}, not positive")
    white = np.isfinite(found.white) and found.white > 0.0
    maps.demand("relief.white", bool(white), f"is {found.white}, not positive and finite")
    return found


def _raised(light: NDArray[np.float64], angle: float) -> tuple[float, float, float]:
    """A direction or position turned up about the painting's middle, not over the zenith."""
    across, length = float(np.hypot(light[0], light[1])), float(np.linalg.norm(light))
    elevation = float(np.arctan2(light[2], across)) + angle
    elevation = float(np.clip(elevation, LOWEST, 0.5 * np.pi))
    scale = length * np.cos(elevation) / across if across > 0.0 else 0.0
    return float(light[0] * scale), float(light[1] * scale), float(length * np.sin(elevation))

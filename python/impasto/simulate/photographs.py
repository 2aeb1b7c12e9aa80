"""The light of simulated photographs, each with what its lamp calls for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import thread_count
from impasto.height import cast_shadows
from impasto.lighting import SceneArguments
from impasto.lights import PointLight
from impasto.rig import Rig
from impasto.simulate.fields import Field
from impasto.simulate.lobes import Lobes
from impasto.simulate.paintings import Painting
from impasto.surface import Surface

Forward: TypeAlias = Callable[[Field, Field, Field, Field, Rig], NDArray[np.floating]]
"""Radiance ``(obs, band, y, x)`` from normal ``(3, y, x)``, diffuse ``(band, y, x)``, beta and
gamma ``(coat, y, x)``, and a rig; white board 1.0."""

Limit: TypeAlias = Callable[[list[int]], Any]
"""What may be left out of the light of some bands, as the core takes it; None for nothing."""

Mode = Literal["planned", "forced"]


def _exactly(bands: list[int]) -> None:
    """No light of any band may be left out."""


SIDE = 256
"""Pixels along a side of a plan's tile."""

_CHANNELS = 3
"""Bands that the renderer shows at once."""


@dataclass(frozen=True, eq=False)
class Photographs:
    """Noiseless photographs of a painting through ideal optics, one at a time.

    Attributes
    ----------
    painting, rig
        What is photographed, from where, under which lamps.
    diffuse
        ``(band, y, x)``: its diffuse reflectance.
    lobes
        Lafortune lobes; None for the painting's Torrance-Sparrow coats.
    shadows
        Whether the relief casts shadows.
    limit
        What a plan may leave out; default: nothing that changes a bit.
    gain
        ``(band,)``: what a sensor makes of light at most, as shares of full scale; None for no
        sensor.
    """

    painting: Painting
    rig: Rig
    diffuse: Field
    lobes: Lobes | None
    shadows: bool
    limit: Limit = _exactly
    gain: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.rig)

    def light(self, observation: int, mode: Mode) -> Field:
        """Radiance ``(band, y, x)`` of one observation, white board 1.0."""
        light = np.empty_like(self.diffuse)
        for bands in self._groups:
            arguments = self._scene(observation, bands)
            plan = self._plan(arguments, bands, mode)
            shown, coverage = _core.render(
                self._surface, self._relief, arguments, plan, thread_count(None), None
            )
            light[bands] = np.where(coverage > 0.0, shown[: len(bands)], np.float32(np.nan))
        return light

    def plans(self, observation: int, mode: Mode) -> list[_core.Plan]:
        """The plans of one observation, one per group of bands."""
        return [self._plan(self._scene(observation, bands), bands, mode) for bands in self._groups]

    @cached_property
    def _surface(self) -> Surface:
        # Lamps are placed from the middle of these pixels, as for heights.
        p = self.painting
        if self.lobes is None:
            return Surface.torrance_sparrow(p.normal, self.diffuse, p.beta, p.gamma)
        return Surface.lafortune(p.normal, self.diffuse, **vars(self.lobes))

    @property
    def _relief(self) -> Field | None:
        return self.painting.height if self.shadows else None

    @cached_property
    def _statistics(self) -> _core.SurfaceStatistics:
        return _core.SurfaceStatistics(self._surface, self._relief, thread_count(None))

    @cached_property
    def _groups(self) -> list[list[int]]:
        bands = list(range(len(self.diffuse)))
        return [bands[first : first + _CHANNELS] for first in range(0, len(bands), _CHANNELS)]

    def _scene(self, observation: int, bands: list[int]) -> SceneArguments:
        """One lamp whose colours are some of the bands."""
        rig = self.rig.take([observation]).here
        matrix = np.zeros((1, len(self.diffuse), _CHANNELS))
        matrix[0, bands, range(len(bands))] = 1.0
        interface = np.zeros((1, _CHANNELS))
        interface[0, : len(bands)] = 1.0
        return SceneArguments(
            rig=RigArguments.of(rig),
            intensity=rig.intensities,
            radius=rig.radii,
            colour=np.zeros(1, np.uint32),
            diffuse=matrix,
            interface=interface,
            background=(0.0, 0.0, 0.0),
            rectified=True,
            shadows=self.shadows,
        )

    def _plan(self, arguments: SceneArguments, bands: list[int], mode: Mode) -> _core.Plan:
        if mode == "forced":
            return _core.Plan.forced(self._surface, arguments)
        return _core.Plan(
            self._surface,
            self._statistics,
            arguments,
            tolerance=self.limit(bands),
            display=self._display(bands),
            more_light=False,
            threads=thread_count(None),
        )

    def _display(self, bands: list[int]) -> list[list[float]] | None:
        """A sensor as a display of some bands: columns to shares of full scale."""
        if self.gain is None:
            return None
        columns: list[list[float]] = np.diag(
            [*self.gain[bands], *np.zeros(_CHANNELS - len(bands))]
        ).tolist()
        return columns


@dataclass(frozen=True, eq=False)
class OtherPhotographs:
    """The same by a forward model of the caller, of which nothing can be left out."""

    painting: Painting
    rig: Rig
    diffuse: Field
    shadows: bool
    forward: Forward

    def __len__(self) -> int:
        return len(self.rig)

    def light(self, observation: int, mode: Mode) -> Field:
        """Radiance ``(band, y, x)`` of one observation, white board 1.0."""
        p, one = self.painting, self.rig.take([observation])
        image = self.forward(p.normal, self.diffuse, p.beta, p.gamma, one)[0]
        if self.shadows:
            # Relative to the middle of these pixels, as the height is.
            (lamp,) = one.here.lights
            near = isinstance(lamp, PointLight)
            towards = lamp.position if isinstance(lamp, PointLight) else lamp.direction
            image = image * cast_shadows(
                p.height, p.pitch_mm, towards, point=near, radius=lamp.radius
            )
        return np.asarray(image, dtype=np.float32)

    def plans(self, observation: int, mode: Mode) -> list[_core.Plan]:
        """None."""
        return []

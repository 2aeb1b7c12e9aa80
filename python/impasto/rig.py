"""Rigs: one light and one view for each observation.

World frame: origin in the middle of the painting, x right, y up, z towards the viewer,
millimetres. Directions have unit length and point away from the surface.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.casts import quiet_cast
from impasto._internal.checks import length_mm, numbers, picked, three_numbers
from impasto._internal.rotation import quarter_turns_of, rotated_rows, rotated_vector
from impasto._internal.thin_plate import over_directions
from impasto.errors import ArgumentError, GeometryError
from impasto.lights import ROUNDED, DistantLight, Light, PointLight, near_lamp
from impasto.refinement import RigRefinement

FRONTAL = (0.0, 0.0, 1.0)
"""The view of a camera far in front of the painting."""
_KNOWN = "_arrays"
"""Where a rig keeps its lights as arrays."""


@dataclass(frozen=True)
class PointView:
    """A camera so near that pixels see it in different directions.

    Photographs of it are rectified: each pixel of a stack is still one pixel of the painting.

    Parameters
    ----------
    position
        mm from the middle of the painting: x right, y up, z towards the viewer.
    """

    position: tuple[float, float, float]

    def __post_init__(self) -> None:
        vector = three_numbers(self.position, "position")
        if math.hypot(*vector) < 1e-6:
            raise GeometryError(
                f"position: a camera cannot stand on the painting, found {self.position}"
            )
        object.__setattr__(self, "position", tuple(vector))


Views: TypeAlias = "ArrayLike | PointView | Sequence[PointView | tuple[float, float, float]]"


class _Lamps(NamedTuple):
    """Lights as arrays ``(obs, ...)``."""

    vectors: NDArray[np.float64]
    intensities: NDArray[np.float64]
    near: NDArray[np.bool_]
    falloff: NDArray[np.bool_]

    @classmethod
    def of(cls, lights: Sequence[Light]) -> _Lamps:
        place = [x.position if isinstance(x, PointLight) else x.direction for x in lights]
        return cls(
            np.array(place, np.float64),
            np.array([light.intensity for light in lights], np.float64),
            np.array([isinstance(light, PointLight) for light in lights], np.bool_),
            np.array([isinstance(x, PointLight) and x.falloff for x in lights], np.bool_),
        )

    def take(self, chosen: list[int]) -> _Lamps:
        few = self.vectors[chosen], self.intensities[chosen], self.near[chosen]
        return _Lamps(*few, self.falloff[chosen])


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Rig:
    """One light and one view per observation.

    Parameters
    ----------
    lights
        ``(obs, 3)`` directions, or a sequence of :class:`DistantLight` / :class:`PointLight`.
    views
        ``(obs, 3)`` or ``(3,)`` directions to the eye, a :class:`PointView`, or a sequence of
        directions and :class:`PointView`; default: frontal.
    pitch_mm
        Width of a pixel on the painting in mm; needed by point lights and point views only.
    origin
        (x, y) of the middle of the picture in pixels from the middle of the painting, x right, y
        up: where a part of a painting (:class:`Stack`, :class:`Sbrdf`) lies in it. Positions of
        lights stay those of the whole painting. Default: (0, 0), the whole.
    refinement
        What :func:`impasto.refine_rig` found; None for a rig as it was given.
    """

    lights: tuple[Light, ...]
    views: NDArray[np.float64]
    """``(obs, 3)`` unit directions to the eye, from the middle of the painting."""
    view_positions: NDArray[np.float64]
    """``(obs, 3)`` mm where the view is a :class:`PointView`, else NaN."""
    pitch_mm: float | None
    origin: tuple[float, float]
    refinement: RigRefinement | None

    def __init__(
        self,
        lights: ArrayLike | Sequence[Light] | Rig,
        *,
        views: Views | None = None,
        pitch_mm: float | None = None,
        origin: tuple[float, float] | None = None,
        refinement: RigRefinement | None = None,
    ) -> None:
        if isinstance(lights, Rig):
            refinement = lights.refinement if refinement is None else refinement
            pitch_mm = lights.pitch_mm if pitch_mm is None else pitch_mm
            origin = lights.origin if origin is None else origin
            # Checked when that rig was made: searches make rigs of rigs by the thousand.
            parsed, seen = lights.lights, (lights.views, lights.view_positions)
            directions, positions = seen if views is None else _views(views, len(parsed))
        else:
            parsed = _lights(lights)
            directions, positions = _views(views, len(parsed))
        set_ = object.__setattr__
        set_(self, "lights", parsed)
        set_(self, "views", directions)
        set_(self, "view_positions", positions)
        set_(self, "pitch_mm", pitch_mm)
        set_(self, "origin", _origin(origin))
        set_(self, "refinement", refinement)
        if pitch_mm is not None:
            length_mm(pitch_mm, "pitch_mm")
        if pitch_mm is None and any(isinstance(light, PointLight) for light in parsed):
            raise GeometryError(
                "pitch_mm: point lights need the width of a pixel on the painting in mm"
            )
        if pitch_mm is None and self.near_views.any():
            raise GeometryError(
                "pitch_mm: point views need the width of a pixel on the painting in mm"
            )

    def __len__(self) -> int:
        return len(self.lights)

    def __repr__(self) -> str:
        near = int(self.near.sum())
        lights = f"{len(self)} light{'s' * (len(self) != 1)}"
        close = f", {near} of them near" if near else ""
        known = self.known_pitch_mm
        pitch = "" if known is None else f", pixels of {known:g} mm"
        refined = "" if self.refinement is None else ", refined"
        return f"<Rig {lights}{close}{pitch}{refined}>"

    @property
    def known_pitch_mm(self) -> float | None:
        """Width of a pixel in mm; None where nobody has said it.

        :func:`impasto.refine_rig` then counts lengths in pixels, and ``pitch_mm`` is 1.
        """
        in_pixels = self.refinement is not None and not self.refinement.in_mm
        return None if in_pixels else self.pitch_mm

    @property
    def _lamps(self) -> _Lamps:
        # Searches ask for them four times a fit. No lock, which a forked process would inherit: two
        # threads may both make them.
        known = vars(self).get(_KNOWN)
        if known is None:
            known = vars(self)[_KNOWN] = _Lamps.of(self.lights)
        return cast("_Lamps", known)

    def __getstate__(self) -> dict[str, Any]:
        """What a pickle and a copy hold: the rig, not what was made of it."""
        return {name: value for name, value in vars(self).items() if name != _KNOWN}

    @property
    def directions(self) -> NDArray[np.float64]:
        """``(obs, 3)`` unit directions to the lights, from the middle of the painting."""
        return np.array([light.direction for light in self.lights], dtype=np.float64)

    @property
    def intensities(self) -> NDArray[np.float64]:
        """``(obs,)`` light intensities."""
        return self._lamps.intensities.copy()

    @property
    def radii(self) -> NDArray[np.float64]:
        """``(obs,)`` sizes of the lamps: radians of distant lights, mm of near ones."""
        return np.array([light.radius for light in self.lights], dtype=np.float64)

    @property
    def vectors(self) -> NDArray[np.float64]:
        """``(obs, 3)`` positions of near lights in mm, directions of distant ones."""
        return self._lamps.vectors.copy()

    @property
    def near(self) -> NDArray[np.bool_]:
        """``(obs,)`` whether a light is a :class:`PointLight`."""
        return self._lamps.near.copy()

    @property
    def falloff(self) -> NDArray[np.bool_]:
        """``(obs,)`` whether a light falls off with the square of its distance."""
        return self._lamps.falloff.copy()

    @property
    def near_views(self) -> NDArray[np.bool_]:
        """``(obs,)`` whether a view is a :class:`PointView`."""
        return np.isfinite(self.view_positions[:, 0])

    @property
    def viewpoints(self) -> Views:
        """The views as :class:`Rig` takes them."""
        return viewpoints(self.views, self.view_positions)

    @property
    def here(self) -> Rig:
        """The same rig with its origin in the middle of the picture."""
        return self.seen_from(0.0, 0.0)

    def seen_from(self, x: float, y: float) -> Rig:
        """The rig with its origin at ``(x, y, 0)`` of the picture, in mm."""
        pitch = 0.0 if self.pitch_mm is None else self.pitch_mm
        x, y = x + self.origin[0] * pitch, y + self.origin[1] * pitch
        if (x, y) == (0.0, 0.0) and self.origin == (0.0, 0.0):
            return self
        lights = self.lights
        if (x, y) != (0.0, 0.0):
            lights = tuple(a.seen_from(x, y) if isinstance(a, PointLight) else a for a in lights)
        views = viewpoints(self.views, self.view_positions - (x, y, 0.0))
        return Rig(lights, views=views, pitch_mm=self.pitch_mm, refinement=self.refinement)

    def with_lights(self, lights: Sequence[Light]) -> Rig:
        """The same views and origin with other lights, one per observation."""
        return Rig(
            lights,
            views=self.viewpoints,
            pitch_mm=self.pitch_mm,
            origin=self.origin,
            refinement=self.refinement,
        )

    def at(self, lights: ArrayLike | Sequence[Light] | Rig) -> Rig:
        """Other lamps of the same rig: what lamps in their directions would be.

        Strengths are interpolated by a thin-plate spline over the stereographic coordinates
        ``(x, y) / (1 + z)`` of the directions, clipped to the range of this rig's; so are distances
        if all lamps of this rig are near; whether their light falls off is as of the nearest lamp.
        This predicts what depends on the place of a lamp, not lamps that flicker.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, or lights, whose intensities multiply the interpolated ones;
            they keep their angular radius, in front of near lamps up to that of a disc half as
            large as it is far.

        Returns
        -------
        Rig
            The lamps, seen as the photographs of this rig were.

        Raises
        ------
        ArgumentError
            The photographs of this rig have different views.
        """
        others = Rig(lights, pitch_mm=self.pitch_mm)
        towards = others.directions
        sizes = _angular_radii(others)
        strengths = np.exp(over_directions(self.directions, np.log(self.intensities), towards))
        strengths = (strengths * others.intensities).tolist()
        lamps: list[Light]
        if self.near.all():
            log = np.log(np.linalg.norm(self.vectors, axis=1))
            places = towards * np.exp(over_directions(self.directions, log, towards))[:, None]
            nearest = (towards @ self.directions.T).argmax(axis=1)
            each = (places.tolist(), strengths, self.falloff[nearest].tolist(), sizes.tolist())
            lamps = [near_lamp((x, y, z), *lamp) for (x, y, z), *lamp in zip(*each, strict=True)]
        else:
            lamps = [
                DistantLight((x, y, z), strength, radius)
                for (x, y, z), strength, radius in zip(
                    towards.tolist(), strengths, sizes.tolist(), strict=True
                )
            ]
        return Rig(
            lamps,
            views=self._common_view(),
            pitch_mm=self.pitch_mm,
            origin=self.origin,
            refinement=self.refinement,
        )

    def _common_view(self) -> Views:
        """The one view of all observations, for any number of lights."""
        same = np.array_equal(self.view_positions, self.view_positions[[0] * len(self)], True)
        if not same or not (self.views == self.views[0]).all():
            raise ArgumentError("lights: photographs with different views have no common view")
        if self.near_views.any():
            return PointView((*self.view_positions[0].tolist(),))
        return np.asarray(self.views[0])

    def part(self, right: float, up: float) -> Rig:
        """The rig of a part whose middle lies so many pixels from that of the picture."""
        origin = (self.origin[0] + right, self.origin[1] + up)
        return Rig(self, origin=origin)

    def rotated(self, quarter_turns: int = 1) -> Rig:
        """The rig after the painting and its lights rotated counterclockwise together.

        Coordinates only change places and signs: four quarter turns change no bit.
        """
        turns = quarter_turns_of(quarter_turns)
        lights = [_rotated_light(light, turns) for light in self.lights]
        x, y, _ = rotated_vector((*self.origin, 0.0), turns)
        views = viewpoints(
            rotated_rows(self.views, turns), rotated_rows(self.view_positions, turns)
        )
        return Rig(
            lights,
            views=views,
            pitch_mm=self.pitch_mm,
            origin=(x, y),
            refinement=self.refinement,
        )

    def take(self, indices: Iterable[int]) -> Rig:
        """The rig of some observations, in the order given; negative ones count from the end."""
        chosen = picked(indices, len(self), "indices", "observation")
        few = copy(self)
        # A part of what was checked needs no check.
        set_ = object.__setattr__
        if _KNOWN in vars(self):
            vars(few)[_KNOWN] = self._lamps.take(chosen)
        set_(few, "lights", tuple(self.lights[i] for i in chosen))
        set_(few, "views", _shared(self.views[chosen]))
        set_(few, "view_positions", _shared(self.view_positions[chosen]))
        return few


def seen_from_front(rig: Rig) -> None:
    """Refuse a rig none of whose views shows the front of the painting: a fit needs one.

    Raises
    ------
    GeometryError
        All views lie behind the painting or in its plane.
    """
    highest = float(rig.views[:, 2].max())
    if highest <= 0.0:
        raise GeometryError(
            f"views: all {len(rig)} views lie behind the painting (z <= 0, highest {highest:.3g}), "
            "where no front is seen; z points to the viewer: check the sign of z"
        )


def _rotated_light(light: Light, turns: int) -> Light:
    if isinstance(light, PointLight):
        return replace(light, position=rotated_vector(light.position, turns))
    return replace(light, direction=rotated_vector(light.direction, turns))


def _origin(origin: Any) -> tuple[float, float]:
    if origin is None:
        return (0.0, 0.0)
    place = numbers(origin, "origin", "two numbers (x, y)")
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ArgumentError(f"origin: expected two finite numbers (x, y), found {origin!r}")
    x, y = place.tolist()
    return x, y


def _lights(lights: Any) -> tuple[Light, ...]:
    if isinstance(lights, Sequence) and all(
        isinstance(light, DistantLight | PointLight) for light in lights
    ):
        if not lights:
            raise GeometryError("lights: expected at least one light, found none")
        return tuple(lights)
    try:
        with quiet_cast():
            array = np.asarray(lights, dtype=np.float64)
        if array.ndim == 0:
            raise TypeError
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            "lights: expected (obs, 3) directions or a sequence of DistantLight / PointLight, "
            f"found {type(lights).__name__}"
        ) from error
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise ArgumentError(f"lights: expected shape (obs, 3), found {array.shape}")
    for index, row in enumerate(array):
        if not np.isfinite(row).all() or float(np.linalg.norm(row)) < 1e-6:
            raise GeometryError(
                f"lights: row {index} is {row.tolist()}, not a direction with finite length"
            )
    return tuple(DistantLight((x, y, z)) for x, y, z in array.tolist())


def viewpoints(directions: NDArray[np.float64], positions: NDArray[np.float64]) -> Views:
    """Views as :class:`Rig` takes them, from directions and, unless NaN, positions ``(obs, 3)``."""
    near = np.isfinite(positions[:, 0])
    if not near.any():
        return directions
    if (positions == positions[0]).all():
        return PointView((*positions[0].tolist(),))
    return [
        PointView((*positions[i].tolist(),)) if near[i] else (*directions[i].tolist(),)
        for i in range(len(directions))
    ]


def _views(views: Views | None, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit directions from the middle of the painting, and positions, NaN where distant."""
    positions = np.full((count, 3), np.nan)
    if isinstance(views, PointView):
        positions[:] = views.position
        views = views.position
    elif isinstance(views, Sequence) and any(isinstance(view, PointView) for view in views):
        if len(views) != count:
            raise ArgumentError(f"views: expected one or {count}, found {len(views)}")
        for index, view in enumerate(views):
            if isinstance(view, PointView):
                positions[index] = view.position
        views = [view.position if isinstance(view, PointView) else view for view in views]
    array = numbers(FRONTAL if views is None else views, "views", f"(3,) or ({count}, 3)")
    if array.shape not in {(3,), (count, 3)}:
        raise ArgumentError(f"views: expected shape (3,) or ({count}, 3), found {array.shape}")
    array = np.broadcast_to(array, (count, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(array, axis=1, keepdims=True)
    if not np.isfinite(lengths).all() or bool((lengths < 1e-6).any()):
        raise GeometryError("views: every view needs a finite direction")
    lengths = np.where(np.abs(lengths - 1.0) < ROUNDED, 1.0, lengths)
    return _shared(np.ascontiguousarray(array / lengths)), _shared(positions)


def _shared(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array for rigs that are made of each other: nobody can change it."""
    array.setflags(write=False)
    return array


def _angular_radii(rig: Rig) -> NDArray[np.float64]:
    """``(obs,)``: radii of lamps in radians, as the middle of the painting sees them."""
    far = np.where(rig.near, np.linalg.norm(rig.vectors, axis=1), 1.0)
    return np.where(rig.near, np.arctan(rig.radii / far), rig.radii)

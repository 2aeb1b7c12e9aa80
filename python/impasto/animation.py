"""Series of scenes: raking light that goes round, a painting that turns, an eye that adapts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import instance, is_whole, length_mm, number, numbers
from impasto.errors import ArgumentError
from impasto.height import integrate_normals
from impasto.level import Level, as_level
from impasto.lighting import prepare
from impasto.lights import DistantLight, Light
from impasto.rig import FRONTAL, PointView
from impasto.scene import Scene
from impasto.surface import Relightable


def raking(scene: Scene, frames: int, *, elevation: float = math.radians(15.0)) -> list[Scene]:
    """One distant lamp that goes round the painting once, from the right over the top.

    Parameters
    ----------
    scene
        Everything but the lights; its first illuminant is the lamp's, the sum of its lights the
        lamp's strength, 1 without any, the largest of its distant lights the lamp's size.
    frames
        How many scenes.
    elevation
        Angle above the plane of the painting in radians.
    """
    _checked(scene)
    count = _count(frames)
    if not 0.0 < number(elevation, "elevation", "radians up to pi / 2") <= math.pi / 2:
        raise ArgumentError(f"elevation: expected 0 to pi / 2 radians, found {elevation:g}")
    # A scene of an environment alone has no lamp to take them from.
    strength = float(sum(light.intensity for light in scene.lights)) or 1.0
    sizes = [light.radius for light in scene.lights if isinstance(light, DistantLight)]
    lamp = (strength, max(sizes, default=0.0))
    room = [] if scene.environment is None else [scene.illuminants[-1]]
    across, z = math.cos(elevation), math.sin(elevation)
    turns = [2.0 * math.pi * step / count for step in range(count)]
    return [
        scene.changed(
            lights=[DistantLight((across * math.cos(turn), across * math.sin(turn), z), *lamp)],
            illuminant=[scene.illuminants[0], *room],
        )
        for turn in turns
    ]


def turntable(scene: Scene, frames: int, *, angle: float = math.radians(30.0)) -> list[Scene]:
    """The painting turns to the right, to the left and back about its vertical axis.

    Lights and eye stay where they are; the scenes tell them as the painting sees them.

    Parameters
    ----------
    scene
        Lights as they are when the painting faces the eye.
    frames
        How many scenes.
    angle
        The largest angle in radians.

    Raises
    ------
    ArgumentError
        A scene with a near eye or an environment, an angle of a quarter turn or more.
    GeometryError
        A light that comes to stand behind the painting.
    """
    _checked(scene)
    count = _count(frames)
    if not 0.0 < number(angle, "angle", "radians below pi / 2") < math.pi / 2:
        raise ArgumentError(f"angle: expected 0 to pi / 2 radians, found {angle:g}")
    if isinstance(scene.view, PointView):
        raise ArgumentError("view: a painting on a turntable is seen from a direction")
    if scene.environment is not None:
        raise ArgumentError(
            "environment: it would have to turn against the painting; give lights alone"
        )
    eye = FRONTAL if scene.view is None else scene.view
    made = []
    for step in range(count):
        rotated = angle * math.sin(2.0 * math.pi * step / count)
        made.append(
            scene.changed(
                lights=[_rotated_light(light, -rotated) for light in scene.lights],
                view=_rotated(eye, -rotated),
            )
        )
    return made


def adapting(scene: Scene, frames: int, *, first: float = 0.0, last: float = 1.0) -> list[Scene]:
    """An eye that adapts to the scene's light: degrees d from ``first`` to ``last``."""
    _checked(scene)
    count = _count(frames)
    for name, degree in (("first", first), ("last", last)):
        if not 0.0 <= number(degree, name, "a degree from 0 to 1") <= 1.0:
            raise ArgumentError(f"{name}: expected a degree from 0 to 1, found {degree!r}")
    return [scene.changed(adaptation=float(d)) for d in np.linspace(first, last, count)]


def same_exposure(surface: Relightable, scenes: Iterable[Scene], **options: Any) -> list[Scene]:
    """The scenes with one exposure, the least that one of them has by itself.

    A film whose frames had their own would flicker. ``options`` are those of
    :func:`impasto.render`.

    Raises
    ------
    ArgumentError
        No scene; ``exposure="maximum"``, which follows from each picture.
    """
    listed = list(scenes) if isinstance(scenes, Iterable) else [scenes]
    if not listed or not all(isinstance(scene, Scene) for scene in listed):
        kinds = ", ".join(dict.fromkeys(type(scene).__name__ for scene in listed)) or "none"
        raise ArgumentError(f"scenes: expected a list of impasto.Scene, found {kinds}")
    if any(isinstance(scene.exposure, str) for scene in listed):
        raise ArgumentError(
            'exposure: "maximum" differs from frame to frame, and the film would flicker; give '
            "a factor"
        )
    # Without heights, which an exposure does not need.
    bare = (scene.changed(shadows=False, parallax=False) for scene in listed)
    options = {**options, "level": False}
    least = min(prepare(surface, scene, **options).exposure for scene in bare)
    return [scene.changed(exposure=least) for scene in listed]


def centred(
    pictures: Iterable[NDArray[np.uint8]], size: tuple[int, int], fill: Sequence[float]
) -> Iterator[NDArray[np.uint8]]:
    """Pictures of different sizes in the middle of frames ``(y, x)``, display codes around them.

    Raises
    ------
    ArgumentError
        No pictures, no such size, no three codes.
    """
    if not isinstance(pictures, Iterable) or isinstance(pictures, str):
        raise ArgumentError(
            f"pictures: expected arrays (y, x, 3) of display codes, found {pictures!r}"
        )
    sides = numbers(size, "size", "whole numbers (y, x) from 1 on")
    if sides.shape != (2,) or not ((sides >= 1) & (sides == np.floor(sides))).all():
        raise ArgumentError(f"size: expected whole numbers (y, x) from 1 on, found {size!r}")
    codes = numbers(fill, "fill", "three display codes, 0 to 255")
    if codes.shape != (3,) or not ((codes >= 0) & (codes <= 255)).all():
        raise ArgumentError(f"fill: expected three display codes, 0 to 255, found {fill!r}")
    return _centred(pictures, (int(sides[0]), int(sides[1])), codes.astype(np.uint8))


def _centred(
    pictures: Iterable[NDArray[np.uint8]], size: tuple[int, int], fill: NDArray[np.uint8]
) -> Iterator[NDArray[np.uint8]]:
    for codes in pictures:
        shape = np.shape(codes)
        if len(shape) != 3 or shape[2] != 3:
            raise ArgumentError(f"pictures: expected arrays (y, x, 3), found shape {shape}")
        frame = np.empty((*size, 3), np.uint8)
        frame[:] = fill
        height, width = (min(a, b) for a, b in zip(shape[:2], size, strict=True))
        top, left = (size[0] - height) // 2, (size[1] - width) // 2
        frame[top : top + height, left : left + width] = codes[:height, :width]
        yield frame


def _checked(scene: Any) -> None:
    instance(scene, Scene, "scene", "an impasto.Scene, as in Scene([DistantLight((0, 1, 1))])")


def _count(frames: int) -> int:
    if not is_whole(frames) or frames < 1:
        raise ArgumentError(f"frames: expected a whole number from 1 on, found {frames!r}")
    return int(frames)


def _rotated(vector: tuple[float, float, float], angle: float) -> tuple[float, float, float]:
    """Rotated about the painting's vertical axis: z towards x for positive angles."""
    x, y, z = vector
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos * x + sin * z, y, cos * z - sin * x)


def _rotated_light(light: Light, angle: float) -> Light:
    if isinstance(light, DistantLight):
        return replace(light, direction=_rotated(light.direction, angle))
    return replace(light, position=_rotated(light.position, angle))


def relief(
    surface: Relightable, plane: bool | Level, pitch_mm: float | None, *, threads: int | None = None
) -> NDArray[np.float32]:
    """The height in mm that all frames share: the surface's own, or of its normals on a plane.

    Raises
    ------
    ArgumentError
        No surface, plane or width.
    """
    made_by = "what impasto.fit_sbrdf or impasto.load_sbrdf returns, or an impasto.Surface"
    instance(surface, Relightable, "surface", made_by)
    if pitch_mm is not None:
        length_mm(pitch_mm, "pitch_mm")
    lit = surface.surface()
    if lit.height is not None:
        return lit.height
    level = as_level(plane, lit.normal)
    normal = lit.normal if level is None else level.rotated(lit.normal)
    pitch = lit.pitch_mm if pitch_mm is None else pitch_mm
    return integrate_normals(normal, 1.0 if pitch is None else pitch, threads=threads)

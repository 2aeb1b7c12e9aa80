"""Normals to height; shadows of heights, and how much of the sky they leave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import is_whole, length_mm, number, numbers, real, truth
from impasto._internal.waiting import floats
from impasto.errors import ArgumentError
from impasto.level import Level, as_level, level_of_height


def integrate_normals(
    normal: ArrayLike,
    pitch_mm: float = 1.0,
    *,
    level: bool | Level = False,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> NDArray[np.float32]:
    """Height of the surface whose slopes are closest to those of the normals.

    Least squares over all pixel edges with free borders, solved exactly by the cosine transform
    (Simchony, Chellappa and Shao 1990) in double precision.

    Parameters
    ----------
    normal
        ``(3, y, x)``; only the direction counts. Where it is not finite or does not point to the
        viewer, an edge takes the slope of its other pixel, or 0 between two such pixels. Slopes
        beyond 80 degrees count as 80.
    pitch_mm
        Width of a pixel in mm.
    level
        True: heights about the plane of the panel, as :func:`impasto.find_level` finds it; or that
        plane, with its bending. Default: heights towards the viewer, with the lean of the panel.
    threads, progress
        As everywhere: None means every allowed core; a bool or a callable ``(done, total)``.

    Returns
    -------
    ndarray
        ``(y, x)`` float32, mm, towards the viewer; mean 0, a number everywhere.

    Raises
    ------
    ArgumentError
        A wrong shape or pitch.

    Notes
    -----
    Small errors of the lights tilt and bend the whole plane: only fine relief is reliable.
    ``level=find_level(normal, bend=True)`` takes out both.
    """
    if hasattr(normal, "normal"):
        raise ArgumentError(
            f"normal: expected an array (3, y, x), found {type(normal).__name__}; give its .normal"
        )
    array = floats(real(normal, "normal", "unit normals (3, y, x)"))
    if array.ndim != 3 or array.shape[0] != 3 or 0 in array.shape:
        raise ArgumentError(f"normal: expected shape (3, y, x), found {array.shape}")
    pitch = length_mm(pitch_mm, "pitch_mm")
    plane = as_level(level, array)
    if plane is not None:
        array = plane.rotated(array)
    with reporting(progress, "integrating normals") as callback:
        return _core.integrate_normals(array, pitch, thread_count(threads), callback)


def cast_shadows(
    height: ArrayLike,
    pitch_mm: float,
    light: ArrayLike,
    *,
    point: bool = False,
    radius: float = 0.0,
    level: bool = False,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The pixels that a light reaches over the relief.

    Parameters
    ----------
    height
        ``(y, x)`` mm, towards the viewer. NaN throws no shadow and receives none.
    pitch_mm
        Width of a pixel in mm.
    light
        Direction ``(3,)`` to a distant light, or with ``point`` a position in mm.
    point
        Whether the light is near.
    radius
        Of a lamp with a size: its angular radius in radians (the sun has 0.0047), or with ``point``
        its radius in mm. 0, the default: hard shadows.
    level
        Whether light and relief are taken about the plane of the relief: a panel that leans by 10
        degrees is otherwise in its own shadow under a light at 8 degrees.
    threads
        None means every allowed core.

    Returns
    -------
    ndarray
        ``(y, x)`` float32: 1 lit, 0 in shadow; with a radius, the share of the lamp that is seen.

    Raises
    ------
    ArgumentError, GeometryError
        A wrong shape, pitch or light; a light that is not in front of the painting.
    """
    relief = _relief(height)
    pitch = length_mm(pitch_mm, "pitch_mm")
    vector = numbers(light, "light", "three finite numbers")
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ArgumentError(f"light: expected three finite numbers, found {light!r}")
    if truth(level, "level"):
        plane = level_of_height(relief, pitch)
        relief = np.asarray(relief - plane.surface(relief.shape, pitch), dtype=np.float32)
    x, y, z = vector.tolist()
    size = number(radius, "radius", "0 or a positive radius")
    if not (math.isfinite(size) and size >= 0.0):
        raise ArgumentError(f"radius: expected 0 or a positive radius, found {radius}")
    if size > 0.0:
        lamp = (x, y, z)
        return _core.soft_shadows(relief, pitch, lamp, size, bool(point), thread_count(threads))
    return _core.cast_shadows(relief, pitch, (x, y, z), bool(point), thread_count(threads))


def sky_visibility(
    height: ArrayLike,
    pitch_mm: float,
    *,
    azimuths: int = 32,
    albedo: float = 0.0,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The share of an even sky's light that reaches each place of a relief.

    Ambient occlusion from horizons (Timonen and Westerholm 2010), weighted by the cosine to the
    painting's normal. Sky below 1.8 degrees is left out.

    Parameters
    ----------
    height
        ``(y, x)`` mm, towards the viewer. NaN hides nothing and sees everything.
    pitch_mm
        Width of a pixel in mm.
    azimuths
        Directions in which horizons are searched for, 4 to 1024.
    albedo
        Mean reflectance of the surroundings, 0 to 1: light that they reflect once is added. 0, the
        default: the sky alone.
    threads
        None means every allowed core.

    Returns
    -------
    ndarray
        ``(y, x)`` float32, 0 to 1: irradiance relative to a flat painting.

    Raises
    ------
    ArgumentError
        A wrong shape, pitch, number of azimuths or albedo.

    Examples
    --------
    >>> import numpy as np
    >>> from impasto import sky_visibility
    >>> sky_visibility(np.zeros((2, 3)), 0.1).min().round(5)
    np.float32(1.0)
    """
    relief = _relief(height)
    pitch = length_mm(pitch_mm, "pitch_mm")
    if not (is_whole(azimuths) and 4 <= azimuths <= 1024):
        raise ArgumentError(f"azimuths: expected 4 to 1024, found {azimuths!r}")
    share = number(albedo, "albedo", "a reflectance from 0 to 1")
    if not 0.0 <= share <= 1.0:
        raise ArgumentError(f"albedo: expected a reflectance from 0 to 1, found {albedo}")
    return _core.sky_visibility(relief, pitch, int(azimuths), share, thread_count(threads))


def _relief(height: ArrayLike) -> NDArray[np.float32]:
    relief = floats(real(height, "height", "heights (y, x) in mm"))
    if relief.ndim != 2 or 0 in relief.shape:
        raise ArgumentError(f"height: expected shape (y, x), found {relief.shape}")
    return relief

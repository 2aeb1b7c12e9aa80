"""Normals to height, and cast shadows of heights."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import length_mm, truth
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
    array = floats(normal)
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
    level
        Whether light and relief are taken about the plane of the relief: a panel that leans by 10
        degrees is otherwise in its own shadow under a light at 8 degrees.
    threads
        None means every allowed core.

    Returns
    -------
    ndarray
        ``(y, x)`` float32: 1 lit, 0 in shadow.

    Raises
    ------
    ArgumentError, GeometryError
        A wrong shape, pitch or light; a light that is not in front of the painting.
    """
    relief = floats(height)
    if relief.ndim != 2 or 0 in relief.shape:
        raise ArgumentError(f"height: expected shape (y, x), found {relief.shape}")
    pitch = length_mm(pitch_mm, "pitch_mm")
    vector = np.asarray(light, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ArgumentError(f"light: expected three finite numbers, found {light!r}")
    if truth(level, "level"):
        plane = level_of_height(relief, pitch)
        relief = np.asarray(relief - plane.surface(relief.shape, pitch), dtype=np.float32)
    x, y, z = vector.tolist()
    return _core.cast_shadows(relief, pitch, (x, y, z), bool(point), thread_count(threads))

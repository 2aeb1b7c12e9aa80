"""What a surface shows under given lights: eq. 1 and 9 of the papers, forwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto.checks import refractive_index
from impasto.errors import ArgumentError
from impasto.fit.border import ProgressCallback, RigArguments, reporting, thread_count
from impasto.rig import Rig


def predict(
    normal: ArrayLike,
    diffuse: ArrayLike,
    beta: ArrayLike,
    gamma: ArrayLike,
    rig: Rig,
    *,
    index: float = 1.45,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> NDArray[np.float32]:
    """Samples that a surface shows, white board 1.0.

    Radiance of eq. 1 (six-band paper) and eq. 9 (RGB-camera paper): the diffuse term plus the
    interface term of every coat, times the light's intensity and, for near lights, its fall-off.

    Parameters
    ----------
    normal
        ``(3, y, x)`` unit vectors, NaN where unknown (the samples are NaN there).
    diffuse
        ``(band, y, x)`` reflectance relative to the white board.
    beta, gamma
        Strength, and half-width of the facets in radians: a number, ``(y, x)``, or with several
        coats ``(coat,)`` or ``(coat, y, x)``.
    rig
        Who lights and who looks.
    index
        Index of refraction of the interface.
    threads, progress
        As everywhere: None means every allowed core; a bool or a callable ``(done, total)``.

    Returns
    -------
    ndarray
        ``(obs, band, y, x)`` float32.
    """
    normal = np.ascontiguousarray(normal, dtype=np.float32)
    diffuse = np.ascontiguousarray(diffuse, dtype=np.float32)
    if diffuse.ndim != 3 or 0 in diffuse.shape:
        raise ArgumentError(f"diffuse: expected (band, y, x), found shape {diffuse.shape}")
    size = diffuse.shape[1:]
    if normal.shape != (3, *size):
        raise ArgumentError(f"normal: expected shape {(3, *size)}, found {normal.shape}")
    index = refractive_index(index)
    with reporting(progress, "predict") as callback:
        return _core.predict(
            normal,
            diffuse,
            _coats(beta, size, "beta"),
            _coats(gamma, size, "gamma"),
            index,
            RigArguments.of(rig),
            rig.intensities,
            thread_count(threads),
            callback,
        )


def predict_lobes(
    normal: ArrayLike,
    diffuse: ArrayLike,
    specular: ArrayLike,
    cxy: ArrayLike,
    cz: ArrayLike,
    exponent: ArrayLike,
    rig: Rig,
    *,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> NDArray[np.float32]:
    """Samples that a surface of Lafortune lobes shows, white board 1.0.

    Radiance ``(N.L) (diffuse + sum over lobes of specular d^exponent)`` with
    ``d = cxy (L.V - (N.L)(N.V)) + cz (N.L)(N.V)``: Lafortune et al. 1997 with ``Cx = Cy`` and the
    third paper's free normal.

    Parameters
    ----------
    normal
        ``(3, y, x)`` unit vectors, NaN where unknown (the samples are NaN there).
    diffuse
        ``(band, y, x)`` reflectance relative to the white board.
    specular
        ``(lobe, band, y, x)`` strength, 0 where a pixel has fewer lobes.
    cxy, cz, exponent
        ``(lobe, y, x)``; ``cxy**2 + cz**2`` about 2.
    rig
        Who lights and who looks.
    threads, progress
        As everywhere: None means every allowed core; a bool or a callable ``(done, total)``.

    Returns
    -------
    ndarray
        ``(obs, band, y, x)`` float32.
    """
    normal, diffuse, specular, cxy, cz, exponent = (
        np.ascontiguousarray(map_, dtype=np.float32)
        for map_ in (normal, diffuse, specular, cxy, cz, exponent)
    )
    if diffuse.ndim != 3 or 0 in diffuse.shape:
        raise ArgumentError(f"diffuse: expected (band, y, x), found shape {diffuse.shape}")
    size = diffuse.shape[1:]
    lobes = exponent.shape[:1] or (0,)
    for name, map_, shape in (
        ("normal", normal, (3, *size)),
        ("specular", specular, (*lobes, *diffuse.shape)),
        ("cxy", cxy, (*lobes, *size)),
        ("cz", cz, (*lobes, *size)),
        ("exponent", exponent, (*lobes, *size)),
    ):
        if map_.shape != shape:
            raise ArgumentError(f"{name}: expected shape {shape}, found {map_.shape}")
    with reporting(progress, "predict") as callback:
        return _core.predict_lobes(
            normal, diffuse, specular, cxy, cz, exponent,
            RigArguments.of(rig), rig.intensities, thread_count(threads), callback,
        )  # fmt: skip


def _coats(values: ArrayLike, size: tuple[int, ...], name: str) -> NDArray[np.float32]:
    array = np.asarray(values, dtype=np.float32)
    if array.ndim == 2:
        array = array[None]
    array = np.ascontiguousarray(np.atleast_1d(array))
    if array.ndim == 1 or array.shape[1:] == size:
        return array
    raise ArgumentError(
        f"{name}: expected a number, (coat,), {size} or (coat, *{size}), found {array.shape}"
    )

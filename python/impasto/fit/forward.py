"""What a surface shows under given lights: the papers' reflection models, forwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback
from impasto.rig import Rig
from impasto.surface import Surface


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
        ``(obs, band, y, x)`` float32, never infinite: what exceeds the largest float32 is given as
        that number.
    """
    surface = Surface.torrance_sparrow(normal, diffuse, beta, gamma, index=index, origin=rig.origin)
    return surface.predict(rig, threads=threads, progress=progress)


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
        ``(obs, band, y, x)`` float32, never infinite: what exceeds the largest float32 is given as
        that number.
    """
    surface = Surface.lafortune(normal, diffuse, specular, cxy, cz, exponent, origin=rig.origin)
    return surface.predict(rig, threads=threads, progress=progress)

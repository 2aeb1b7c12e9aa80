"""A quick Lambert surface for the sampled tiles, with which photographs are compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LOW, _HIGH = 0.2, 0.8
"""Ranks of a pixel's samples that are kept: lower may be shadow, higher highlight."""
_ENOUGH = 6
"""Pixels with fewer usable samples keep all of them."""
_RIDGE = 1e-9


def fit_surface(grey: NDArray[np.floating], lights: Floats) -> Floats:
    """Albedo times normal ``(3, n)`` by least squares over the middle ranks.

    ``method="trimmed"`` of :func:`impasto.fit_normals` without its last steps: accurate enough for
    the checks, also of stacks that a fit would refuse.

    Parameters
    ----------
    grey
        ``(obs, n)``, NaN for samples without weight.
    lights
        ``(obs, 3)`` or ``(obs, n, 3)``.

    Returns
    -------
    NaN where fewer than three samples count or the lights do not determine the surface.
    """
    kept = kept_ranks(grey)
    values = np.where(kept, grey, 0.0).astype(np.float64)
    weight = kept.astype(np.float64)
    if lights.ndim == 2:
        outer = np.einsum("ki,kj->kij", lights, lights).reshape(len(lights), 9)
        normal = (weight.T @ outer).reshape(-1, 3, 3)
        right = values.T @ lights
    else:
        normal = np.einsum("kn,kni,knj->nij", weight, lights, lights, optimize=True)
        right = np.einsum("kn,kni->ni", values, lights)
    trace = np.trace(normal, axis1=1, axis2=2)
    solvable = (weight.sum(axis=0) >= 3) & (trace > 0)
    # det / trace^3 is scale-free and 1/27 for three orthogonal lights.
    solvable &= np.linalg.det(normal) > 1e-6 * np.maximum(trace, 1e-300) ** 3
    normal = normal + (_RIDGE * np.where(solvable, trace, 1.0))[:, None, None] * np.eye(3)
    surface = np.linalg.solve(normal, right[..., None])[..., 0].T
    surface[:, ~solvable] = np.nan
    return np.asarray(surface)


def kept_ranks(grey: NDArray[np.floating]) -> NDArray[np.bool_]:
    """``(obs, n)``: the samples of middle rank in each pixel, or all if there are few."""
    order = np.argsort(grey, axis=0, kind="stable")
    ranks = np.empty(grey.shape, dtype=np.int32)
    np.put_along_axis(ranks, order, np.arange(len(grey), dtype=np.int32)[:, None], axis=0)
    usable = np.isfinite(grey)
    count = usable.sum(axis=0)
    low = np.where(count >= _ENOUGH, np.floor(_LOW * count), 0)
    high = np.where(count >= _ENOUGH, np.round(_HIGH * count), count)
    return np.asarray(usable & (ranks >= low) & (ranks < high))


def shading(surface: Floats, lights: Floats) -> Floats:
    """Radiance of the surface under each light ``(obs, n)``, negative where it faces away."""
    if lights.ndim == 2:
        return np.asarray(lights @ surface)
    return np.asarray(np.einsum("kni,in->kn", lights, surface))

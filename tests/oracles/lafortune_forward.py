"""Lafortune lobes about a free normal in plain float64 numpy, written from the papers alone.

Lafortune et al. 1997 eq. 6 with Cx = Cy, in a frame that stands on the surface (x, y, N):

    f = rho_d + sum of A (Cxy (lx vx + ly vy) + Cz lz vz)^n,    Y = (N.L) f E,

0 where light or view is behind the surface. The frame is built explicitly, which impasto's own
form does without, and powers are taken by `**`: this file is to be right, not fast.
"""

from __future__ import annotations

import numpy as np


def frame(normal):
    """Two unit vectors ``(3, ...)`` that stand on the normal and on each other."""
    n = np.asarray(normal, np.float64)
    axis = np.where(np.abs(n[0]) < 0.6, 1.0, 0.0)
    seed = np.stack([axis, 1.0 - axis, np.zeros_like(axis)])
    x = np.cross(n, seed, axis=0)
    x = x / np.linalg.norm(x, axis=0)
    return x, np.cross(n, x, axis=0)


def radiance(normal, diffuse, specular, cxy, cz, exponent, light, view):
    """Radiance ``(band, ...)`` under one distant light of unit irradiance, white board 1.0.

    ``normal`` (3, ...); ``diffuse`` (band, ...); ``specular`` (lobe, band, ...); ``cxy``, ``cz``,
    ``exponent`` (lobe, ...); ``light``, ``view`` (3,).
    """
    n = np.asarray(normal, np.float64)
    n = n / np.linalg.norm(n, axis=0)
    x, y = frame(n)
    light, view = (np.asarray(d, np.float64) / np.linalg.norm(d) for d in (light, view))
    lx, ly, lz = (np.tensordot(light, axis, axes=(0, 0)) for axis in (x, y, n))
    vx, vy, vz = (np.tensordot(view, axis, axes=(0, 0)) for axis in (x, y, n))
    total = np.array(diffuse, np.float64)
    for a, c, z, power in zip(specular, cxy, cz, exponent, strict=True):
        c, z, power = (np.asarray(p, np.float64) for p in (c, z, power))
        base = c * (lx * vx + ly * vy) + z * lz * vz
        lobe = np.where((base > 0) & (vz > 0), np.maximum(base, 0.0) ** power, 0.0)
        total = total + np.asarray(a, np.float64) * lobe
    return total * np.maximum(lz, 0.0)


def stack(normal, diffuse, specular, cxy, cz, exponent, rig):
    """Radiance ``(obs, band, ...)`` of a rig of distant lights."""
    return np.array(
        [
            radiance(normal, diffuse, specular, cxy, cz, exponent, light.direction, view)
            * light.intensity
            for light, view in zip(rig.lights, rig.views, strict=True)
        ]
    )

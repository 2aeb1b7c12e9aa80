"""Lafortune lobes of one pixel by SciPy, in double precision.

The model is `lafortune_forward.py`'s, on the mean of the bands: with a given normal, the sum of
squares of `y - (N.L) (rho_d + sum A d^n)` over (rho_d, and per lobe A, the angle of (Cxy, Cz),
ln n), by `scipy.optimize.least_squares` (trust region; rho_d, A >= 0). Which minimum it finds is
the caller's choice of a start.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares


def design(normal, lights, views):
    """(N.L), and the upright and tangential products, 0 and nothing behind the surface."""
    n = np.asarray(normal, np.float64)
    n = n / np.linalg.norm(n)
    n_l, n_v = lights @ n, views @ n
    upright = n_l * n_v
    tangential = (lights * views).sum(axis=1) - upright
    seen = (n_l > 0) & (n_v > 0)
    return np.where(seen, n_l, 0.0), upright, tangential


def radiance(parameters, cosine, upright, tangential):
    """Samples of a pixel; parameters (rho_d, then A, angle from Phong, ln n of each lobe)."""
    total = np.full(cosine.shape, parameters[0])
    for a, psi, log_n in np.reshape(parameters[1:], (-1, 3)):
        base = (np.sin(psi) - np.cos(psi)) * tangential + (np.sin(psi) + np.cos(psi)) * upright
        lit = base > 0
        total = total + np.where(lit, a * np.where(lit, base, 1.0) ** np.exp(log_n), 0.0)
    return cosine * total


def parameters(diffuse, specular, cxy, cz, exponent):
    """Parameters of lobes in any gauge."""
    found = [diffuse]
    for a, x, z, n in zip(specular, cxy, cz, exponent, strict=True):
        length = np.hypot(x, z) / np.sqrt(2.0)
        psi = np.arctan2((z + x) / 2, (z - x) / 2)
        found += [a * length**n, psi, np.log(n)]
    return np.array(found)


def refined(start, samples, normal, lights, views):
    """The minimum that a start leads to, and its sum of squares."""
    scene = design(normal, lights, views)
    lobes = (len(start) - 1) // 3
    lower = [0.0, *(lobes * [0.0, -np.pi, -0.7])]
    upper = [np.inf, *(lobes * [np.inf, np.pi, 10.0])]
    found = least_squares(
        lambda p: samples - radiance(p, *scene),
        np.clip(start, lower, upper),
        bounds=(lower, upper),
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=400,
    )
    return found.x, 2.0 * found.cost

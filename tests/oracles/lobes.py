"""One pixel's lobes by SciPy, in double precision, every unknown a parameter of its own.

The model is that of :class:`impasto.LobeSbrdf` on the mean of the bands, written with the formulas
of oracles/forward.py (arc cosines, Snel's law): tilts of the normal, log of each lobe's sharpness,
and the diffuse part, the lobes' strengths and the ambient part, none of these negative. Weights are
one over the sample, or over a tenth of the pixel's mean where that is more. ``least_squares`` (trf,
with bounds and numerical derivatives) starts from the same places as impasto: gamma 0.08, 0.2 and
0.45 about the given normal and about the facet that mirrors the brightest photograph.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares, nnls

from oracles.forward import fresnel

GAMMAS = (0.08, 0.2, 0.45)
VIEW = np.array([0.0, 0.0, 1.0])


def columns(normal, gammas, lights):
    """``(obs, 2 + lobes)``: the diffuse part, the lobes, the ambient part of unit strength."""
    half = lights + VIEW
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    n_l, n_v, n_h = lights @ normal, normal @ VIEW, half @ normal
    v_h = half @ VIEW
    shape = fresnel(np.arccos(np.clip(v_h, -1.0, 1.0)))
    shape = shape * np.minimum(1.0, np.minimum(2 * n_h * n_v / v_h, 2 * n_h * n_l / v_h)) / n_v
    shape = np.where(n_l > 0.0, shape, 0.0)
    phi = np.arccos(np.clip(n_h, -1.0, 1.0))
    lobes = [shape * np.exp(-np.log(2.0) * (phi / gamma) ** 2) for gamma in gammas]
    return np.stack([np.maximum(n_l, 0.0), *lobes, np.ones_like(n_l)], axis=1)


def weights(samples):
    """``(obs,)`` for samples ``(obs, band)``: those that impasto begins with."""
    grey = samples.mean(axis=1)
    return 1.0 / np.maximum(grey, 0.1 * samples.mean())


def cost(samples, normal, gammas, lights):
    """Weighted sum of squares on the mean of the bands, with the best colours for the shapes."""
    root = np.sqrt(weights(samples))
    matrix = columns(normal, gammas, lights) * root[:, None]
    return nnls(matrix, samples.mean(axis=1) * root)[1] ** 2


def tilted(normal, p, q):
    """A unit normal after two tilts."""
    across = np.cross([0.0, 1.0, 0.0], normal)
    across = across / np.linalg.norm(across)
    n = normal + p * across + q * np.cross(normal, across)
    return n / np.linalg.norm(n)


def fit(samples, normal, lights):
    """The best of all starts with one lobe: cost, normal, gamma, variances of tilts and log k."""
    grey, root = samples.mean(axis=1), np.sqrt(weights(samples))
    half = lights + VIEW
    facing = half[np.argmax(grey)] / np.linalg.norm(half[np.argmax(grey)])
    best = None
    for start in (normal, facing):
        for gamma in GAMMAS:

            def residuals(p, start=start):
                gammas = [np.sqrt(np.log(2.0) / np.exp(p[2]))]
                return root * (columns(tilted(start, *p[:2]), gammas, lights) @ p[3:] - grey)

            matrix = columns(start, [gamma], lights) * root[:, None]
            colours = nnls(matrix, grey * root)[0]
            first = [0.0, 0.0, np.log(np.log(2.0) / gamma**2), *np.maximum(colours, 1e-6)]
            lower = [-6.0, -6.0, np.log(np.log(2.0) / 1.25**2), 0.0, 0.0, 0.0]
            upper = [6.0, 6.0, np.log(np.log(2.0) / 5e-4**2), np.inf, np.inf, np.inf]
            found = least_squares(
                residuals, first, bounds=(lower, upper), xtol=1e-12, ftol=1e-12, gtol=1e-12
            )
            if best is None or 2 * found.cost < best[0]:
                error = np.linalg.pinv(found.jac.T @ found.jac) * 2 * found.cost / len(grey)
                width = np.sqrt(np.log(2.0) / np.exp(found.x[2]))
                best = (2 * found.cost, tilted(start, *found.x[:2]), width, np.diag(error)[:3])
    return best


# What all bands, here one, settle on once samples are weighed by what was left of them.


def renewed(samples, normal, gamma, colours, lights):
    """Weights ``(obs,)`` of samples ``(obs,)`` after a surface that shows them with these colours.

    ``colours``: diffuse part, strength, ambient part. Variances grow with the light shown, from a
    tenth of the mean sample on; beyond the mean absolute deviation a residual counts by its size; a
    sample darker than the diffuse part alone is a shadow.
    """
    parts = columns(normal, [gamma], lights) * colours
    shown, matte = parts.sum(axis=1), parts[:, 0]
    variance = np.maximum(shown / samples.mean(), 0.1)
    far = (samples - shown) / np.sqrt(variance)
    tail = 1.0 + (far / np.abs(far).mean()) ** 2
    lit = np.maximum(samples / np.where(matte > 0.0, matte, 1.0), 1.0 / tail)
    return np.where(matte > samples, lit**2, 1.0) / (np.sqrt(tail) * variance)


def weighted_cost(samples, weights, normal, gamma, lights):
    """Sum of squares ``(obs,)`` with the best colours, and those colours."""
    root = np.sqrt(weights)
    colours, left = nnls(columns(normal, [gamma], lights) * root[:, None], samples * root)
    return left**2, colours


def least(samples, weights, normal, gamma, lights):
    """The smallest of that about a place: cost, normal, log of gamma."""
    root = np.sqrt(weights)

    def residuals(p):
        matrix = columns(tilted(normal, *p[:2]), [np.exp(p[2])], lights)
        return root * (matrix @ p[3:] - samples)

    first = [0.0, 0.0, np.log(gamma), *weighted_cost(samples, weights, normal, gamma, lights)[1]]
    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    found = least_squares(residuals, first, jac="3-point", method="lm", x_scale="jac", **tight)
    return 2.0 * found.cost, tilted(normal, *found.x[:2]), found.x[2]

"""Sensitivities of a camera's bands from patches of known reflectance under a known light.

A band reads c_p = L_p sum over wavelengths of S_p a, with the reflectance S_p of a patch, the
sensitivity times the light, a >= 0, and the light's slope over the chart, L_p = 1 + u x_p + v y_p.
a is the smoothest that fits, in the sense of its second difference (regularised least squares,
Tikhonov's method [@tikhonov1963regularization]), by the active-set method for non-negative least
squares [@lawson1974nnls]. How smooth, leave-one-out cross-validation over the patches decides: the
smoothest whose error lies within one standard error of the least [@breiman1984cart]. A real chart
is not its table: without that rule differences of one or two percent become spikes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMOOTHNESS = tuple(10.0**power for power in np.arange(-7.0, 2.1, 1.0))
"""Weights of the second difference that are tried, relative to the fit."""
SHOT = 0.02
"""Light, relative to the brightest patch, below which all errors weigh alike; above it they are
taken to grow with the root of the light."""
ROUNDS = 6
"""Rounds in which sensitivities and slope of the light are found in turn."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """What patches tell about a camera.

    Parameters
    ----------
    weights
        ``(band, n)``: sensitivity times light, so that ``weights @ reflectance`` is linear light.
    slope
        ``(2,)``: how the light changes across the chart, from its left to its right and from its
        upper to its lower end, as a share of that in its middle.
    smoothness
        The weight that cross-validation chose.
    left_out
        ``(patch, band)``: light of each patch less what the other patches predict.
    """

    weights: Array
    slope: Array
    smoothness: float
    left_out: Array


def fit_sensitivities(
    light: Array, reflectance: Array, places: Array, smoothness: float | None = None
) -> Sensitivities:
    """The smoothest non-negative sensitivities that explain the light of patches.

    Parameters
    ----------
    light
        ``(patch, band)`` linear.
    reflectance
        ``(patch, n)`` at equal steps of wavelength.
    places
        ``(patch, 2)`` on the chart, -0.5 to 0.5 from end to end.
    smoothness
        Default: by cross-validation.
    """
    slope, shaded = np.zeros(2), reflectance
    chosen = _smoothest(light, shaded) if smoothness is None else smoothness
    for _ in range(ROUNDS):
        weights = np.array([_solved(band, shaded, chosen) for band in light.T])
        slope, before = _slope(light, reflectance @ weights.T, places), slope
        shaded = (1.0 + places @ slope)[:, None] * reflectance
        if np.abs(slope - before).max() < 1e-4:
            break
    chosen = _smoothest(light, shaded) if smoothness is None else smoothness
    weights = np.array([_solved(band, shaded, chosen) for band in light.T])
    return Sensitivities(weights, slope, chosen, _left_out(light, shaded, chosen))


def non_negative(matrix: Array, right: Array, start: NDArray[np.bool_] | None = None) -> Array:
    """The x >= 0 with the least squares of matrix x - right, by the active-set method.

    Parameters
    ----------
    matrix
        ``(m, n)``.
    right
        ``(m,)``.
    start
        ``(n,)`` which numbers are probably above 0; default: none.
    """
    count = matrix.shape[1]
    largest = float(np.abs(matrix.T @ right).max())
    small = 10.0 * np.finfo(np.float64).eps * count * largest
    free = np.zeros(count, dtype=bool) if start is None else start.copy()
    # Positive where free, so that a step towards least squares keeps it so.
    found = np.where(free, largest / max(float(np.square(matrix).sum()), 1e-300), 0.0)
    for _ in range(3 * count):
        found, free = _within(matrix, right, found, free)
        gradient = np.where(free, -np.inf, matrix.T @ (right - matrix @ found))
        if not gradient.max() > small:
            break
        free[int(gradient.argmax())] = True
    return found


def _within(
    matrix: Array, right: Array, found: Array, free: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Least squares over the free numbers, of which those that would fall below 0 become 0."""
    while free.any():
        trial = np.zeros(len(found))
        trial[free] = np.linalg.lstsq(matrix[:, free], right, rcond=None)[0]
        over = free & (trial <= 0.0)
        if not over.any():
            return trial, free
        step = found[over] / np.maximum(found[over] - trial[over], np.finfo(np.float64).tiny)
        found = np.where(free, found + float(step.min()) * (trial - found), 0.0)
        first = np.flatnonzero(over)[int(step.argmin())]
        free = free & (found > 0.0)
        free[first] = False
        found = np.where(free, found, 0.0)
    return np.zeros(len(found)), free


def _system(band: Array, shaded: Array, smoothness: float) -> tuple[Array, Array]:
    """Rows of the patches and of the second difference, and what they should give."""
    count = shaded.shape[1]
    weight = 1.0 / np.sqrt(np.maximum(band, 0.0) / band.max() + SHOT)
    bend = np.diff(np.eye(count), 2, axis=0)
    # Of one scale whatever the units: a sum over wavelengths of about the brightest light.
    rough = np.sqrt(smoothness) * len(band) * bend
    return np.concatenate([weight[:, None] * shaded, rough]), np.concatenate(
        [weight * band, np.zeros(len(bend))]
    )


def _solved(
    band: Array, shaded: Array, smoothness: float, start: NDArray[np.bool_] | None = None
) -> Array:
    return non_negative(*_system(band, shaded, smoothness), start)


def _smoothest(light: Array, shaded: Array) -> float:
    """The largest weight that predicts each patch from the others about as well as any."""
    scaled = light.max(axis=0)
    weight = 1.0 / (np.maximum(light, 0.0) / scaled + SHOT)
    errors = np.array(
        [
            (weight * np.square(_left_out(light, shaded, one) / scaled)).sum(axis=1)
            for one in SMOOTHNESS
        ]
    )
    means = errors.mean(axis=1)
    best = int(means.argmin())
    allowed = means[best] + errors[best].std(ddof=1) / np.sqrt(errors.shape[1])
    return float(SMOOTHNESS[int(np.flatnonzero(means <= allowed)[-1])])


def _left_out(light: Array, shaded: Array, smoothness: float) -> Array:
    """Light of each patch less what the others predict."""
    left_out = np.empty_like(light)
    for band, values in enumerate(light.T):
        start = _solved(values, shaded, smoothness) > 0.0
        for patch in range(len(values)):
            others = np.arange(len(values)) != patch
            weights = _solved(values[others], shaded[others], smoothness, start)
            left_out[patch, band] = values[patch] - shaded[patch] @ weights
    return left_out


def _slope(light: Array, expected: Array, places: Array) -> Array:
    """The slope of the light that explains all bands best."""
    weight = 1.0 / (light.max(axis=0) * np.sqrt(np.maximum(light, 0.0) / light.max(axis=0) + SHOT))
    sides = [(weight * expected * side[:, None]).ravel() for side in places.T]
    right = (weight * (light - expected)).ravel()
    return np.asarray(np.linalg.lstsq(np.stack(sides, axis=1), right, rcond=None)[0])

"""Photographs as products of lamps and surface: factorisation of rank 3 with outliers.

The brightness of a matte pixel under a lamp is the product of two vectors, the lamp and the
pixel's normal times its albedo, so that photographs over pixels are a matrix of rank 3
[@hayakawa1994photometric]. Highlights, shadows and clipped samples are outliers: RANSAC
[@fischler1981ransac] looks for three photographs of which the others are mixtures, and alternating
least squares with Tukey's weights [@holland1977robust] fit all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.uncalibrated.patches import Array

TRIALS = 300
"""Triples of photographs tried: with half of them matte, one in eight triples is."""
FEW = 800
"""Pixels on which triples are tried."""
ROUNDS = 40
"""Rounds of alternating least squares, once with all photographs and once with the clean ones."""
NOISY = 3.0
"""Noise of a photograph, in lower quartiles, above which highlights spoil it."""
DARK = 0.3
"""Share of what a flat painting would show below which a sample may be in shadow."""
CUT = 3.0
"""Standard deviations at which Tukey's weight is 0: lower than usual, since highlights are many."""
FLOOR = 0.002
"""Least relative noise of a photograph: the model is no better."""
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Factors:
    """Lamps and surface up to a common linear map of three dimensions.

    Parameters
    ----------
    lamps
        ``(lamp, 3)``.
    surface
        ``(3, pixel)``: lamps @ surface are the samples.
    weights
        ``(lamp, pixel)`` 0 to 1: how far each sample follows that.
    noise
        ``(lamp,)`` standard deviation of the residuals relative to a flat painting.
    clean
        ``(lamp,)`` whether a photograph has few enough highlights to tell of the surface.
    """

    lamps: Array
    surface: Array
    weights: Array
    noise: Array
    clean: NDArray[np.bool_]


def factorise(samples: Array, seed: int = 0) -> Factors:
    """Factors of ``(lamp, pixel)`` samples, NaN where one is not known.

    Parameters
    ----------
    samples
        Of pixels that are not black; of eight lamps or more.
    seed
        Of the random triples.
    """
    level = np.nanmedian(samples, axis=1)[:, None]
    albedo = np.nanmedian(samples / level, axis=0)[None]
    relative = samples / (level * albedo)
    known = np.isfinite(relative) & (relative > DARK)
    relative = np.where(known, relative, 0.0)
    lamps, scale = _consensus(relative, known, seed)
    # Noise of photons: of relative samples, over the root of what a flat painting would show.
    photons = np.sqrt(level * albedo / np.median(level * albedo))
    clean = np.ones(len(samples), dtype=bool)
    noise = np.full((len(samples), 1), max(1.5 * scale, FLOOR))
    weights = known.astype(float)
    for round_ in range(2 * ROUNDS):
        if round_ == ROUNDS:
            # Photographs full of highlights would bend the surface of the others a little.
            clean = noise[:, 0] <= NOISY * np.quantile(noise, 0.25)
        # Alike for all that could be: three photographs alone have no residual at all.
        usual = float(np.quantile(noise, 0.25))
        inverse_variance = np.square(photons / np.where(noise <= NOISY * usual, usual, noise))
        for _ in range(3 if round_ == 0 else 1):
            surface = solved((weights * inverse_variance)[clean], relative[clean], lamps[clean])
            residual = photons * (relative - lamps @ surface)
            if round_ == 0:
                size = np.maximum(np.abs(residual), FLOOR * noise)
                weights = known * np.minimum(1.0, 1.345 * noise / size)
        lamps = solved((weights * inverse_variance).T, relative.T, surface.T).T
        residual = photons * (relative - lamps @ surface)
        noise = np.maximum(_spread(residual, known), FLOOR)[:, None]
        noise = np.maximum(noise, 0.5 * np.median(noise[clean]))
        # Wide at first, so that a start that is a little wrong does not lose half of the samples.
        usual = float(np.quantile(noise, 0.25))
        wide = (2 * CUT if round_ < 6 else CUT) * np.maximum(noise, usual)
        weights = known * tukey(residual / wide)
    return Factors(lamps * level, surface * albedo, weights, noise[:, 0], clean)


def solved(weights: Array, values: Array, table: Array) -> Array:
    """``(3, n)`` weighted least squares of each column of values ``(m, n)`` over table ``(m, 3)``.

    A column with too little weight gets the solution of least length.
    """
    products = np.stack([table[:, i] * table[:, j] for i, j in _PAIRS], axis=1)
    sums = weights.T @ products
    matrix = np.empty((len(sums), 3, 3))
    for number, (i, j) in enumerate(_PAIRS):
        matrix[:, i, j] = matrix[:, j, i] = sums[:, number]
    right = (weights * values).T @ table
    ridge = 1e-12 * np.trace(matrix, axis1=1, axis2=2) + np.finfo(float).tiny
    matrix += ridge[:, None, None] * np.eye(3)
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0].T)


def tukey(residual: Array) -> Array:
    """Tukey's weights of residuals in units of where they become 0."""
    return np.asarray(np.square(np.clip(1.0 - np.square(residual), 0.0, None)))


def _spread(residual: Array, known: NDArray[np.bool_]) -> Array:
    """``(lamp,)`` standard deviation, from the median absolute residual."""
    return np.asarray(1.4826 * np.nanmedian(np.where(known, np.abs(residual), np.nan), axis=1))


def _consensus(relative: Array, known: NDArray[np.bool_], seed: int) -> tuple[Array, float]:
    """``(lamp, 3)`` mixtures of the three photographs that explain most others, and how well."""
    random = np.random.default_rng(seed)
    count = len(relative)
    pixels = random.choice(relative.shape[1], min(FEW, relative.shape[1]), replace=False)
    values, there = relative[:, pixels], known[:, pixels].astype(float)
    best, found = np.inf, np.zeros((count, 3))
    for _ in range(TRIALS):
        triple = random.choice(count, 3, replace=False)
        basis = values[triple]
        seen = there * there[triple].prod(axis=0)
        weights = seen
        for _ in range(4):
            mixtures = solved(weights.T, values.T, basis.T).T
            residual = np.abs(values - mixtures @ basis)
            weights = seen / np.maximum(residual, 1e-3)
        # Noise of the three photographs is in the residuals, too.
        own = np.sqrt(1.0 + np.square(mixtures).sum(axis=1))
        size = np.sort(np.delete(np.median(residual, axis=1) / own, triple))
        score = float(size[: max(3, len(size) * 3 // 4)].mean())
        if score < best:
            best, found = score, mixtures
    return found, best

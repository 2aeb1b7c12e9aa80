"""How far directions of lamps can be trusted: the photographs are asked again, in part.

The bootstrap over patches [@efron1979bootstrap] shows what noise and the choice of relief do, the
delete-a-group jackknife over lamps [@kott2001jackknife] what unequal strengths do, and the half of
the photographs with the fewest highlights what those do. Gloss, scattered light and a wrong tone
curve bend directions without a spread. They add the same light to dark paint as to bright, of which
it is a larger share of dark paint: dark and bright paint alone then say different directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.geometry import tangents
from impasto.calibrate.uncalibrated.equal_strengths import LEAST, EqualStrengths, with_weights
from impasto.calibrate.uncalibrated.factorisation import Factors, factorise, solved
from impasto.calibrate.uncalibrated.panel import panel_frame
from impasto.calibrate.uncalibrated.patches import Array, median_of_known

PIXELS = 8000
"""Of the patches, for the factors: three numbers of each lamp from thousands of samples."""
DARK = 0.2
"""Share of the median albedo below which a pixel tells little."""
TINY = 1e-9
"""Residual in levels of a photograph below which there is none."""
RESAMPLES = 24
"""Of the bootstrap over patches."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Pixels for the factors, and where they lie.

    Parameters
    ----------
    light
        ``(lamp, patch, y, x)`` of all pixels.
    values
        ``(lamp, pixel)`` of some.
    patch
        ``(pixel,)`` their patches.
    """

    light: Array
    values: Array
    patch: NDArray[np.intp]

    @classmethod
    def of(cls, light: Array, seed: int) -> Sample:
        """Some of the pixels that are not dark, of ``(lamp, patch, y, x)``."""
        albedo = median_of_known(light / median_of_known(light, (1, 2, 3)), 0)[0]
        bright = albedo > DARK * np.nanmedian(albedo)
        index = np.flatnonzero(bright)
        chosen = np.random.default_rng(seed).permutation(index)[:PIXELS]
        chosen.sort()
        return cls(light, light.reshape(len(light), -1)[:, chosen], chosen // albedo[0].size)


@dataclass(frozen=True, eq=False)
class Fit:
    """What directions follow from, for frames and errors.

    Parameters
    ----------
    weights
        ``(lamp, pixel)`` of all pixels of the patches.
    relative
        ``(lamp, pixel)`` samples over the level of their photograph.
    level
        ``(lamp, 1)``.
    """

    sample: Sample
    factors: Factors
    form: EqualStrengths
    weights: Array
    relative: Array
    level: Array

    @classmethod
    def of(cls, sample: Sample, factors: Factors, form: EqualStrengths) -> Fit:
        """Least absolute deviations of each pixel under the lamps that were found."""
        flat = sample.light.reshape(len(sample.light), -1)
        level = median_of_known(flat, 1)
        relative = flat / level
        known = np.isfinite(relative)
        albedo = np.nan_to_num(median_of_known(relative, 0))
        relative = np.where(known, relative, 0.0)
        noise = factors.noise[:, None]
        known = known & factors.clean[:, None]
        weights = known / noise**2
        for _ in range(6):
            surface = solved(weights, relative, factors.lamps / level)
            residual = np.abs(relative - factors.lamps / level @ surface)
            weights = known / (noise * np.maximum(residual, np.maximum(noise * albedo, TINY)))
        return cls(sample, factors, form, weights, relative, level)

    def surface(self, lamps: Array) -> Array:
        """``(3, patch, y, x)`` normals times albedo of all pixels up to the map of the lamps."""
        found = solved(self.weights, self.relative, lamps / self.level)
        return found.reshape(3, *self.sample.light.shape[1:])

    def errors(
        self, directions: Array, known: NDArray[np.bool_], groups: NDArray[np.intp], seed: int
    ) -> Array:
        """``(lamp,)`` standard deviations of directions.

        Parameters
        ----------
        directions
            ``(lamp, 3)`` that were found.
        known
            ``(lamp,)`` which of them count.
        groups
            ``(lamp,)`` of :func:`~impasto.calibrate.uncalibrated.equal_strengths.same_lamps`: left
            out together.
        seed
            Of the resamples.
        """
        random = np.random.default_rng(seed)
        patches = self.sample.light.shape[1]
        samples = np.where(np.isfinite(self.sample.values), self.sample.values, 0.0)
        surface = self.factors.surface
        length = np.linalg.norm(surface, axis=0)
        usual = self.factors.weights / np.square(np.where(length > 0.0, length, np.inf))
        by_patch, by_lamp = [], []
        for _ in range(RESAMPLES):
            counts = np.bincount(random.integers(patches, size=patches), minlength=patches)
            lamps = solved((usual * counts[self.sample.patch]).T, samples.T, surface.T).T
            by_patch.append(
                self._again(lamps, self.surface(lamps), self.form.weights, counts, directions)
            )
        lamps, whole = self.factors.lamps, self.surface(self.factors.lamps)
        for group in np.unique(groups[known]):
            weights = np.where(groups == group, 0.0, self.form.weights)
            by_lamp.append(self._again(lamps, whole, weights, np.ones(patches), directions))
        spread = _tangent_covariance(by_patch, directions)
        spread += (len(by_lamp) - 1) * _tangent_covariance(by_lamp, directions)
        # What highlights bend shows where only the photographs with the fewest are asked.
        fewest = self.factors.noise <= np.median(self.factors.noise[known])
        if (fewest & known).sum() >= LEAST:
            weights = np.where(fewest, self.form.weights, 0.0)
            half = self._again(lamps, whole, weights, np.ones(patches), directions)
            spread += _tangent_covariance([half], directions)
        spread += self._dark_from_bright(directions, seed)
        return np.asarray(np.sqrt(np.linalg.eigvalsh(spread)[:, -1]))

    def _dark_from_bright(self, directions: Array, seed: int) -> Array:
        """``(lamp, 2, 2)`` square of what bright paint alone says otherwise than dark."""
        albedo = np.linalg.norm(self.factors.surface, axis=0)
        bright = albedo > np.median(albedo)
        found = []
        for part in (bright, ~bright):
            lamps = factorise(self.sample.values[:, part], seed).lamps
            count = np.ones(self.sample.light.shape[1])
            found.append(
                self._again(lamps, self.surface(lamps), self.form.weights, count, directions)
            )
        apart = found[0] - found[1]
        return _tangent_covariance([directions + apart], directions)

    def _again(
        self,
        lamps: Array,
        surface: Array,
        weights: Array,
        counts: NDArray[np.generic],
        directions: Array,
    ) -> Array:
        """Directions by other samples or lamps, on the side of those that were found."""
        matrix = with_weights(lamps, weights)
        if matrix is None:
            return np.full(directions.shape, np.nan)
        frame = panel_frame(lamps @ matrix, mapped(surface, matrix), counts.astype(np.float64))
        found = unit(lamps @ matrix @ frame.matrix)
        rotated = found * (-1.0, -1.0, 1.0)
        same = np.nansum(found * directions) >= np.nansum(rotated * directions)
        return found if same else rotated


def mapped(surface: Array, matrix: Array) -> Array:
    """The surface that goes with lamps @ matrix."""
    return np.tensordot(np.linalg.inv(matrix), surface, axes=1)


def unit(vectors: Array) -> Array:
    """Vectors ``(n, 3)`` of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _tangent_covariance(found: list[Array], directions: Array) -> Array:
    """``(lamp, 2, 2)`` mean square across the directions; a radian where there is no solution."""
    across = np.stack(tangents(directions), axis=1)
    apart = np.einsum("lij,rlj->rli", across, np.array(found) - directions)
    apart = np.where(np.isfinite(apart), apart, 1.0)
    return np.asarray(np.einsum("rli,rlj->lij", apart, apart) / len(found))

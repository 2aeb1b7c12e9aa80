"""Kriging [@rasmussen2006gaussian] of what a model leaves of the photographs.

The fitted model is the mean of a Gaussian process over the directions of light. Its residuals at
the fitted lights, as differences of codes of the sRGB curve, are interpolated to new lights by one
linear operator for the whole painting. A pixel keeps the leading principal components of its
residuals, not all of them: they are smaller, and they predict better.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments, StackArguments
from impasto._internal.calls import thread_count
from impasto._internal.hull import into_hull
from impasto._internal.thin_plate import stereographic
from impasto._internal.waiting import wait_for, wait_for_each
from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.choice import MARGIN, PIXELS, PROCESSES, psnr
from impasto.fit.cross_validation import FEWEST, Fold, folds_of, full_scale
from impasto.fit.saved import over
from impasto.fit.subsample import subsampled_to
from impasto.io.results import SavedMaps
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

LENGTHS = (0.15, 0.3, 0.6, 1.2)
"""Length scales of the process that are tried, in stereographic coordinates: 0.15 is a step of 17
degrees about the vertical."""
NOISES = (0.001, 0.01, 0.1, 0.3)
"""Variances of what is not smooth that are tried, relative to that of the process."""
COMPONENTS = (4, 8, 16, 24, 32, 48)
"""Numbers of principal components that are tried: two bytes of each per pixel and band."""
CLOSE = 0.05
"""dB by which numbers of components may differ and count as equal."""
LEFT = 0.5
"""Root mean square of what other components hold, in codes, from which on they are left out."""
BEYOND = 0.15
"""Distance from the lights seen over which residuals fade out, in stereographic coordinates."""
SEEN = 0.03
"""The same up to which pixels without a model are shown: 2 % darker, and black farther away."""
ONE_VIEW = 0.05
"""Views within this angle, radians, are one view, as in the numerics."""
TOGETHER = 6
"""Photographs whose part is added to the maps together. Reading and writing the maps of all
components takes longest, and is done once for so many photographs."""
ROWS, WIDTH = 32, 1024
"""Rows of a picture that are computed together, and the width from which on they are fewer."""

_CURVE = Encoding("srgb", white=255.0)
_STEPS = 16384
_CODES = _CURVE.encode(np.linspace(0.0, 1.0, _STEPS + 1) ** 2)
"""Codes at equal steps of the square root of light: within 0.012 of a code, in half the time of the
curve itself."""

Helped: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32], float, bool]
"""A photograph, how each component contributes to it, its full scale, and whether what no model
shows is interpolated."""
Setting: TypeAlias = tuple[float, float, int]
"""Length, noise and number of components."""
Fit = Callable[[Stack], Any]
"""Fits photographs and returns a result that can ``predict`` others."""


@dataclass(frozen=True, eq=False)
class LearnedResiduals:
    """What the residuals of a tile must know about the whole painting.

    Attributes
    ----------
    basis
        ``(component, observation)``: principal components, orthonormal rows.
    length, noise
        Of the process: length scale in stereographic coordinates, and variance of what is not
        smooth relative to that of the process.
    top
        Linear light of full scale, under a light of strength 1.
    gain
        dB by which held-out photographs are predicted better than by the model alone. The numbers
        above were chosen by the same photographs: new ones may gain a little less.
    """

    basis: NDArray[np.float64] = field(metadata=over("component", "observation", dtype=np.float64))
    length: float = field(metadata=over(dtype=np.float64))
    noise: float = field(metadata=over(dtype=np.float64))
    top: float = field(metadata=over(dtype=np.float64))
    gain: float = field(metadata=over(dtype=np.float64))


@dataclass(frozen=True, eq=False, repr=False)
class Residuals(LearnedResiduals):
    """The residuals of a painting's photographs, compressed.

    Attributes
    ----------
    maps
        ``(component, band, y, x)`` float16, differences of 8-bit sRGB codes.
    """

    maps: NDArray[np.float16] = field(
        metadata=over("component", "band", "y", "x", dtype=np.float16)
    )

    def __repr__(self) -> str:
        return (
            f"<Residuals, {len(self.basis)} components, length {self.length:g}, "
            f"noise {self.noise:g}, gain {self.gain:.1f} dB>"
        )

    def weights(self, known: Rig, wanted: Rig) -> NDArray[np.float64]:
        """How each component contributes to new photographs.

        Parameters
        ----------
        known
            The rig of the fitted photographs.
        wanted
            That of the new ones.

        Returns
        -------
        ndarray
            ``(new, component)``; 0 for another view than that of the fitted photographs (a near
            camera is another view than a distant one). They fade out beyond the hull of the known
            lights; near lamps count by their direction from the middle.
        """
        operator = kriging_weights(
            stereographic(known.directions), stereographic(wanted.directions), self
        )
        return np.where(_seen_alike(known, wanted)[:, None], operator @ self.basis.T, 0.0)

    def add_to(self, shown: NDArray[np.float32], known: Rig, wanted: Rig) -> None:
        """Add to what the model shows ``(obs, band, y, x)``, in place."""
        weights = self.weights(known, wanted)
        _, beyond = into_hull(stereographic(known.directions), stereographic(wanted.directions))
        near = beyond <= SEEN
        each = zip(shown, weights, wanted.intensities.tolist(), near.tolist(), strict=True)
        helped = [
            (photograph, row.astype(np.float32), light * self.top, whole)
            for photograph, row, light, whole in each
            if row.any()
        ]
        height, width = self.maps.shape[2:]
        rows = max(ROWS * WIDTH // max(width, WIDTH), 1)
        for start in range(0, height if helped else 0, rows):
            wait_for(self._add_rows, np.s_[:, start : start + rows], helped)

    def _add_rows(self, rows: Any, photographs: Sequence[Helped]) -> None:
        planes = [plane[rows].astype(np.float32) for plane in self.maps]
        for photograph, weights, unit, whole in photographs:
            if whole:
                # Where there is no model, the photographs alone are interpolated.
                photograph[rows] = np.nan_to_num(photograph[rows], nan=0.0, posinf=np.inf)
            with np.errstate(over="ignore"):  # samples near the largest float32: white
                model = _CURVE.encode(photograph[rows] / np.float32(unit))
            codes = model.copy()
            for weight, plane in zip(weights, planes, strict=True):
                codes += weight * plane
            change = _CURVE.decode(np.clip(codes, 0.0, 255.0)) - _CURVE.decode(model)
            photograph[rows] += np.float32(unit) * change


def kriging_weights(
    known: NDArray[np.float64], wanted: NDArray[np.float64], process: LearnedResiduals
) -> NDArray[np.float64]:
    """The operator ``(wanted, known)`` from values at known places to those at wanted places.

    Simple kriging: a process of mean 0 with Matérn's covariance of smoothness 3/2 and independent
    noise. Beyond the convex hull of the known places there is the nearest value in it, faded out
    over :data:`BEYOND`: what was extrapolated made photographs of gilding worse by 6 dB.
    """
    covariance = _covariance(known, known, process.length)
    covariance[np.diag_indices_from(covariance)] += process.noise
    places, distance = into_hull(known, wanted)
    weights = np.linalg.solve(covariance, _covariance(known, places, process.length)).T
    return np.asarray(weights * np.exp(-0.5 * (distance / BEYOND) ** 2)[:, None], np.float64)


def learn_residuals(
    stack: Stack,
    fit: Fit,
    *,
    part: Stack | None = None,
    truth: Stack | None = None,
    threads: int | None,
) -> LearnedResiduals | None:
    """The process that predicts held-out photographs best; None if the model alone does.

    Parameters
    ----------
    stack
        The photographs.
    fit
        The fit whose residuals are meant; called by several threads at once, for a fold each, which
        Ctrl-C leaves to themselves.
    part
        The pixels to learn from; default: a sample of some 1000 of the stack's.
    truth
        What is compared with predictions of ``part``; default: ``part``.
    threads
        None means every allowed core.

    Returns
    -------
    LearnedResiduals or None
        None, too, with fewer than 8 photographs or several views.
    """
    if len(stack.rig) < FEWEST or _core.views_differ(RigArguments.of(stack.rig)):
        return None
    part = subsampled_to(stack, PIXELS) if part is None else part
    try:
        folds = [fold for fold in folds_of(part, threads, truth=truth) if fold.unknown is None]
    except GeometryError:
        return None
    if all(np.isnan(fold.compared).all() for fold in folds):
        return None
    top, ceiling = full_light(part), part.ceiling[:, None, None]

    def gains_of(fold: Fold) -> dict[Setting, NDArray[np.float64]]:
        result = fit(fold.known)
        units, compared = top * fold.rig.intensities, fold.compared
        limit = _coded_by(np.broadcast_to(ceiling, compared.shape), units)
        model = _coded_by(result.predict(fold.rig, threads=threads), units)
        real = np.minimum(_coded_by(compared, units), limit)
        real[np.isnan(compared)] = np.nan
        alone = psnr(np.minimum(model, limit), real)
        basis, residual = components_of(fold.known, result)
        scores = np.tensordot(basis, residual, axes=1)
        places = stereographic(fold.known.rig.directions), stereographic(fold.rig.directions)
        gains: dict[Setting, NDArray[np.float64]] = {}
        for length, noise in itertools.product(LENGTHS, NOISES):
            process = LearnedResiduals(basis, length, noise, top, 0.0)
            weights = kriging_weights(*places, process) @ basis.T
            for count in COMPONENTS:
                change = np.tensordot(weights[:, :count], scores[:count], axes=1)
                better = psnr(np.clip(model + change, 0.0, limit), real) - alone
                gains[length, noise, count] = better
        return gains

    def components_of(known: Stack, result: Any) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        shown = result.predict(known.rig, threads=threads)
        residual = _residual_codes(known, result, shown, top, threads)
        return principal_components(residual), residual

    # The fit to all photographs is one more step beside those of the folds.
    steps: list[Callable[[], Any]] = [lambda: components_of(part, fit(part))]
    steps += [partial(gains_of, fold) for fold in folds]
    (basis, residual), *each = wait_for_each(lambda step: step(), steps, thread_count(threads))
    every = {setting: np.concatenate([one[setting] for one in each]) for setting in each[0]}
    setting = _best(every, _enough(residual, basis))
    gain, scatter = float(every[setting].mean()), float(every[setting].std())
    if gain <= max(MARGIN, scatter / np.sqrt(len(every[setting]))):
        return None
    length, noise, count = setting
    return LearnedResiduals(basis[:count], length, noise, top, gain)


def _best(gains: dict[Setting, NDArray[np.float64]], enough: int) -> Setting:
    """The best length and noise, and the most components that do about as well as the best number.

    Fits to some of the photographs are worse than the fit to all, and hide what the last components
    are worth.
    """
    mean = {setting: float(each.mean()) for setting, each in gains.items()}
    good = [setting for setting in mean if mean[setting] >= max(mean.values()) - CLOSE]
    count = min(enough, max(count for *_, count in good))
    return max((one for one in mean if one[2] == count), key=mean.__getitem__)


def _enough(residual: NDArray[np.float32], basis: NDArray[np.float64]) -> int:
    """The fewest components that leave no more than :data:`LEFT`."""
    rows = residual.reshape(len(residual), -1)
    scores = (basis @ rows).astype(np.float64)
    total = np.vdot(rows.astype(np.float64), rows)
    left = total - np.cumsum((scores**2).sum(axis=1))
    small = np.flatnonzero(left <= LEFT**2 * rows.size)
    fewest = int(small[0]) + 1 if small.size else COMPONENTS[-1]
    return next((count for count in COMPONENTS if count >= fewest), COMPONENTS[-1])


def usual_residuals(stack: Stack, result: Any, top: float, threads: int | None) -> Residuals:
    """Residuals with usual numbers, for comparing fits that will have their own.

    Of few pixels: codes of all photographs are held at once. ``top`` is :func:`full_light` of the
    stack.
    """
    shown = result.predict(stack.rig, threads=threads)
    codes = _residual_codes(stack, result, shown, top, threads)
    learned = LearnedResiduals(principal_components(codes), *PROCESSES[0], top, 0.0)
    maps = np.zeros((len(learned.basis), *stack.shape[1:]), np.float32)
    _add_scores(maps, stack, 0, shown, learned.basis, top, threads)
    return _residuals(learned, maps, result)


def apply_residuals(
    learned: LearnedResiduals, stack: Stack, result: Any, *, threads: int | None
) -> Residuals:
    """The residuals of a tile: of each pixel from its own samples alone.

    Parameters
    ----------
    learned
        What :func:`learn_residuals` returned for the whole painting.
    stack, result
        The photographs of the tile and their fit.
    threads
        None means every allowed core.
    """
    maps = np.zeros((len(learned.basis), *stack.shape[1:]), np.float32)
    for first in range(0, len(stack.rig), TOGETHER):
        some = stack.rig.take(range(first, min(first + TOGETHER, len(stack.rig))))
        shown = result.modelled(some, threads=threads)
        _add_scores(maps, stack, first, shown, learned.basis, learned.top, threads)
    return _residuals(learned, maps, result)


def _residuals(learned: LearnedResiduals, maps: NDArray[np.float32], result: Any) -> Residuals:
    # A pixel that was not to be seen stays without a number.
    maps[..., result.status >= Status.INVALID_INPUT] = np.nan
    return Residuals(
        learned.basis,
        learned.length,
        learned.noise,
        learned.top,
        learned.gain,
        maps.astype(np.float16),
    )


def residuals_of(maps: SavedMaps, fields: dict[str, Any]) -> Residuals:
    """The residuals of a file, from their fields; errors name the array."""
    found = Residuals(**fields)
    positive = {"length": found.length, "noise": found.noise, "top": found.top}
    for name, value in positive.items():
        maps.demand(f"residuals.{name}", 0.0 < value < np.inf, f"is {value:g}, not positive")
    return found


def principal_components(residual: NDArray[np.float32]) -> NDArray[np.float64]:
    """The leading directions ``(component, obs)`` of residuals ``(obs, ...)``, about 0."""
    rows = residual.reshape(len(residual), -1)
    _, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    leading = vectors[:, ::-1][:, : COMPONENTS[-1]].T
    # The sign of an eigenvector is arbitrary: the largest entry is positive.
    largest = np.take_along_axis(leading, np.abs(leading).argmax(axis=1)[:, None], axis=1)
    return np.ascontiguousarray(leading * np.where(largest < 0.0, -1.0, 1.0))


def _add_scores(
    scores: NDArray[np.float32],
    stack: Stack,
    first: int,
    shown: NDArray[np.float32],
    basis: NDArray[np.float64],
    top: float,
    threads: int | None,
) -> None:
    """Add the part of the photographs from ``first`` on, of which a fit shows ``shown``."""
    arguments, intensities = StackArguments.of(stack), stack.rig.intensities
    count = thread_count(threads)
    _core.add_residual_scores(
        arguments, first, shown, intensities, top, _CODES, basis, scores, count
    )


def _residual_codes(
    stack: Stack, result: Any, shown: NDArray[np.float32], top: float, threads: int | None
) -> NDArray[np.float32]:
    """``(obs, band, y, x)``; 0 where a sample is missing.

    They are the scores along the axes.
    """
    codes = np.zeros(stack.shape, np.float32)
    _add_scores(codes, stack, 0, shown, np.eye(len(stack.rig)), top, threads)
    codes[..., result.status >= Status.INVALID_INPUT] = 0.0
    return codes


def full_light(stack: Stack) -> float:
    """Linear light of full scale, relative to the strength of the light."""
    lights = stack.rig.intensities.astype(np.float32)
    with np.errstate(over="ignore"):  # then they are no number to be counted
        return full_scale(stack.linear(index) / light for index, light in enumerate(lights))


def _coded_by(photographs: NDArray[np.float32], units: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.array([_coded(*each) for each in zip(photographs, units.tolist(), strict=True)])


def _coded(linear: NDArray[np.float32], unit: float) -> NDArray[np.float32]:
    """Codes of linear light; a clipped sample is white, a missing one black."""
    with np.errstate(over="ignore"):  # samples near the largest float32: white
        light = np.nan_to_num(linear / np.float32(unit), nan=0.0, posinf=1.0)
    step = np.sqrt(np.clip(light, 0.0, 1.0)) * np.float32(_STEPS) + np.float32(0.5)
    return np.asarray(_CODES[step.astype(np.int32)])


def _covariance(
    first: NDArray[np.float64], second: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    steps = np.sqrt(3.0) * np.linalg.norm(first[:, None] - second, axis=-1) / length
    return np.asarray((1.0 + steps) * np.exp(-steps))


def _seen_alike(known: Rig, wanted: Rig) -> NDArray[np.bool_]:
    """``(new,)``: whether a view is that of the fitted photographs."""
    alike = wanted.views @ known.views[0] >= np.cos(ONE_VIEW)
    eye = known.view_positions[0]
    if not known.near_views[0]:
        return np.asarray(alike & ~wanted.near_views)
    away = np.linalg.norm(wanted.view_positions - eye, axis=1)
    # NaN, and so not alike, where the camera is distant.
    return np.asarray(away <= ONE_VIEW * np.linalg.norm(eye))

"""The Cramér-Rao bound of a pixel's normal and gloss: the least error of an unbiased fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.rig import Rig
from impasto.simulate.planning import Truth
from impasto.simulate.sensor import Noise
from study.minpack import base_of, radiance

STRIDE = 6
"""Stride of the pixels that have a bound: it is averaged over the painting."""
DEVIATE = 0.6744897501960817
"""Median absolute value of a standard normal variable."""
STEP = 1e-5
"""Step of the central differences: a balance of rounding and curvature."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Least errors of a fit at every :data:`STRIDE`-th pixel.

    Attributes
    ----------
    normal
        ``(pixel,)`` mean angle in degrees.
    width, strength
        ``(pixel,)`` deviation of log gamma, and relative deviation of beta; infinite where the
        photographs do not determine them.
    """

    normal: NDArray[np.float64]
    width: NDArray[np.float64]
    strength: NDArray[np.float64]


def bound_of(truth: Truth, rig: Rig, bits: int = 12) -> Bound:
    """Bounds for one lobe and a free normal per pixel.

    From the Fisher information of two tilts, a diffuse colour per band, beta and log gamma, under
    the sensor's shot, read and rounding noise; clipped samples carry no information. The errors of
    the two tilts are taken as equal, so that the mean angle is ``sqrt(pi / 2)`` of their deviation.
    """
    noise, full = Noise(), 2.0**bits - 1.0
    angles, widths, strengths = [], [], []
    for y, x in zip(*_places(truth.normal.shape[1:]), strict=True):
        base = base_of(truth.normal[:, y, x].astype(np.float64))
        diffuse = truth.diffuse[:, y, x].astype(np.float64)
        lobe = [float(truth.beta[0, y, x]), float(np.log(truth.gamma[0, y, x]))]
        unknowns = np.concatenate([[0.0, 0.0], diffuse, lobe])
        shown = radiance(rig, unknowns, base, len(diffuse)).ravel()
        exposed = shown * truth.exposure
        electrons = np.maximum(exposed, 0.0) * noise.full_well + noise.read**2
        deviation = np.sqrt(electrons) / noise.full_well
        deviation = np.hypot(deviation, 1.0 / full / np.sqrt(12.0)) / truth.exposure
        slopes = _slopes(rig, unknowns, base, len(diffuse)) / deviation
        known = exposed < 1.0
        information = slopes[:, known] @ slopes[:, known].T
        # Without gloss the width is undetermined; the pseudo-inverse keeps the other unknowns.
        size = np.sqrt(np.maximum(information.diagonal(), 1e-30))
        covariance = np.linalg.pinv(information / np.outer(size, size)) / np.outer(size, size)
        angles.append(np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))
        # Undetermined even if all other unknowns were known.
        determined = size[-1] > 1.0, lobe[0] * size[-2] > 1.0
        widths.append(np.sqrt(covariance[-1, -1]) if determined[0] else np.inf)
        strengths.append(np.sqrt(covariance[-2, -2]) / lobe[0] if determined[1] else np.inf)
    angles = np.degrees(angles) * np.sqrt(np.pi / 2.0)
    return Bound(angles, np.array(widths), np.array(strengths))


def widths_off(
    gammas: Sequence[NDArray[Any]], truths: Sequence[Truth], bounds: Sequence[Bound]
) -> float:
    """Errors of the widths of the paintings' first lobes ``(y, x)``, in units of their bounds.

    The median over the pixels whose width the photographs determine, divided by that of a normal
    deviate: 1 is the least possible. A pixel without a width counts as infinite, so the result is
    infinite if half of them have none.
    """
    pairs = zip(gammas, truths, strict=True)
    logs = [np.log(_here(gamma) / _here(truth.gamma[0])) for gamma, truth in pairs]
    return _off(logs, [bound.width for bound in bounds])


def strengths_off(
    betas: Sequence[NDArray[Any]], truths: Sequence[Truth], bounds: Sequence[Bound]
) -> float:
    """The same for their strengths ``(y, x)``, in the mean of the bands."""
    pairs = zip(betas, truths, strict=True)
    # Zero strength divides by zero and is left out below.
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = [_here(beta) / _here(truth.beta[0]) - 1.0 for beta, truth in pairs]
    return _off(shares, [bound.strength for bound in bounds])


def _off(errors: Sequence[NDArray[Any]], deviations: Sequence[NDArray[Any]]) -> float:
    error, deviation = np.concatenate(errors), np.concatenate(deviations)
    known = np.isfinite(deviation)
    if not known.any():
        return float("inf")
    bounds = np.nan_to_num(np.abs(error[known]), nan=np.inf) / deviation[known]
    return float(np.median(bounds)) / DEVIATE


def _here(image: NDArray[Any]) -> NDArray[np.float64]:
    """The pixels of a map ``(y, x)`` that have a bound."""
    return np.asarray(image[_places(image.shape)], np.float64)


def _places(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    grid = np.meshgrid(*(np.arange(STRIDE // 2, size, STRIDE) for size in shape), indexing="ij")
    rows, columns = (axis.ravel() for axis in grid)
    return rows, columns


def _slopes(
    rig: Rig, unknowns: NDArray[np.float64], base: NDArray[np.float64], bands: int
) -> NDArray[np.float64]:
    """``(unknown, obs * band)`` central differences."""
    rows = []
    for number in range(len(unknowns)):
        step = np.zeros_like(unknowns)
        step[number] = STEP
        ahead = radiance(rig, unknowns + step, base, bands)
        behind = radiance(rig, unknowns - step, base, bands)
        rows.append((ahead - behind).ravel() / (2.0 * STEP))
    return np.array(rows)

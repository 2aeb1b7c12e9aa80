"""The Cramer-Rao bound of a pixel's normal and gloss: what no unbiased fit can beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.rig import Rig
from impasto.simulate.photography import Noise, Truth
from study.minpack import base_of, radiance

STRIDE = 6
"""Every so many pixels: the bound is a mean over the painting."""
DEVIATE = 0.6744897501960817
"""Median of the size of a normal deviate."""
STEP = 1e-5
"""Of the differences, in the unknowns' own units: halfway between rounding and curvature."""


@dataclass(frozen=True, eq=False)
class Bound:
    """By how much a fit of every :data:`STRIDE`-th pixel must be off.

    Attributes
    ----------
    normal
        ``(pixel,)`` mean angle in degrees.
    width, strength
        ``(pixel,)`` deviation of log gamma, and of beta as a share of it; Inf where the photographs
        tell nothing of them.
    """

    normal: NDArray[np.float64]
    width: NDArray[np.float64]
    strength: NDArray[np.float64]


def bound_of(truth: Truth, rig: Rig, bits: int = 12) -> Bound:
    """Of a lobe and a free normal per pixel.

    From the Fisher information of two tilts, a diffuse colour per band, beta and log gamma, under
    the sensor's shot, read and rounding noise; clipped samples tell nothing. The two tilts' errors
    are taken for equal, so that the mean angle is ``sqrt(pi / 2)`` of their deviation.
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
        # A matte pixel tells nothing of a width: the unknowns that matter stay determined.
        size = np.sqrt(np.maximum(information.diagonal(), 1e-30))
        covariance = np.linalg.pinv(information / np.outer(size, size)) / np.outer(size, size)
        angles.append(np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))
        # As if all else were known: what even that leaves open nothing tells.
        told = size[-1] > 1.0, lobe[0] * size[-2] > 1.0
        widths.append(np.sqrt(covariance[-1, -1]) if told[0] else np.inf)
        strengths.append(np.sqrt(covariance[-2, -2]) / lobe[0] if told[1] else np.inf)
    angles = np.degrees(angles) * np.sqrt(np.pi / 2.0)
    return Bound(angles, np.array(widths), np.array(strengths))


def widths_off(
    gammas: Sequence[NDArray[Any]], truths: Sequence[Truth], bounds: Sequence[Bound]
) -> float:
    """How many bounds the widths of some paintings' first lobes ``(y, x)`` are off.

    The median over the pixels whose width the photographs tell, over that of a normal deviate: 1
    is as near as can be. A pixel without a width is as far off as can be; infinite where half of
    them have none, or the photographs tell of none.
    """
    pairs = zip(gammas, truths, strict=True)
    logs = [np.log(_here(gamma) / _here(truth.gamma[0])) for gamma, truth in pairs]
    return _off(logs, [bound.width for bound in bounds])


def strengths_off(
    betas: Sequence[NDArray[Any]], truths: Sequence[Truth], bounds: Sequence[Bound]
) -> float:
    """The same of their strengths ``(y, x)``, in the mean of the bands."""
    pairs = zip(betas, truths, strict=True)
    # Where there is no gloss nothing is told of it.
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = [_here(beta) / _here(truth.beta[0]) - 1.0 for beta, truth in pairs]
    return _off(shares, [bound.strength for bound in bounds])


def _off(errors: Sequence[NDArray[Any]], deviations: Sequence[NDArray[Any]]) -> float:
    error, deviation = np.concatenate(errors), np.concatenate(deviations)
    told = np.isfinite(deviation)
    if not told.any():
        return float("inf")
    bounds = np.nan_to_num(np.abs(error[told]), nan=np.inf) / deviation[told]
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

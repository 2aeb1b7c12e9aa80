"""An exposure bracket as one linear photograph, of the range of all its exposures.

Each exposure tells the light with the variance of an affine model of noise, read noise and shot
noise; the estimate of least variance weighs it by the inverse [@hasinoff2010noise]. Unlike the hat
function of [@debevec1997recovering], these weights leave out no code but clipped ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import positive
from impasto.errors import ArgumentError

Floats = NDArray[np.float32]

READ_NOISE, SHOT_NOISE = 0.001, 0.005
"""Standard deviations as shares of full scale: in the dark, and at full scale without that."""


def merge_exposures(
    exposures: Sequence[ArrayLike],
    seconds: Sequence[float],
    *,
    clipped_from: float | None = 1.0,
    black: ArrayLike = 0.0,
    read_noise: float = READ_NOISE,
    shot_noise: float = SHOT_NOISE,
) -> Floats:
    """Merge photographs of one scene with different exposure times.

    With signals ``s = code - black`` at times ``t``, the light per second is
    ``sum(w s / t) / sum(w)``, ``w = t^2 / (read^2 + shot^2 x t)``, over the exposures that are not
    clipped. The light ``x`` in the weights is ``sum(s) / sum(t)``, which is the estimate of least
    variance where there is shot noise alone: the noise of a single code in its own weight would
    bias the mean.

    Parameters
    ----------
    exposures
        Each ``(band, y, x)`` linear codes, full scale 1.
    seconds
        Exposure time of each.
    clipped_from
        The code from which a sample is clipped; None: none is.
    black
        Codes that are no light, one number or an array that fits; the same in all exposures.
    read_noise, shot_noise
        Standard deviation of a code in the dark, and of one at full scale without that.

    Returns
    -------
    ndarray
        ``(band, y, x)`` float32: the codes of the shortest exposure, had it less noise, with its
        black. Where all exposures are clipped, ``clipped_from``: the light is at least that.

    Raises
    ------
    ArgumentError
        Exposures of different shapes, other numbers of times, or noise that is none.
    """
    planes = [np.asarray(one, np.float32) for one in exposures]
    times = [positive(one, "seconds", "a positive number of seconds") for one in seconds]
    positive(read_noise, "read_noise", "a positive share of full scale")
    positive(shot_noise, "shot_noise", "a positive share of full scale")
    if not planes or len(planes) != len(times):
        raise ArgumentError(f"seconds: expected one of each exposure, found {len(times)}")
    for one in planes:
        if one.shape != planes[0].shape:
            raise ArgumentError(f"exposures: shapes {planes[0].shape} and {one.shape} differ")
    shape = planes[0].shape
    none = np.asarray(black, np.float32)
    signal, time = np.zeros(shape), np.zeros(shape)
    for one, seconds_of in zip(planes, times, strict=True):
        whole = _whole(one, clipped_from)
        signal += np.where(whole, one - none, 0.0)
        time += whole * seconds_of
    light = np.maximum(signal, 0.0) / np.maximum(time, min(times))
    total, weights = np.zeros(shape), np.zeros(shape)
    for one, seconds_of in zip(planes, times, strict=True):
        variance = read_noise**2 + shot_noise**2 * light * seconds_of
        weight = np.where(_whole(one, clipped_from), seconds_of / variance, 0.0)
        total += np.where(weight > 0.0, weight * (one - none), 0.0)
        weights += weight * seconds_of
    known = weights > 0.0
    merged = none + min(times) * total / np.where(known, weights, 1.0)
    if clipped_from is None:
        return np.asarray(merged, np.float32)
    below = np.nextafter(np.float32(clipped_from), np.float32(0.0))
    return np.where(known, np.minimum(merged, below), clipped_from).astype(np.float32)


def _whole(codes: Floats, clipped_from: float | None) -> NDArray[np.bool_]:
    """Finite samples below the code of clipped ones."""
    found: NDArray[np.bool_] = np.isfinite(codes)
    return found if clipped_from is None else found & (codes < clipped_from)

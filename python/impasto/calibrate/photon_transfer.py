"""Photon transfer: shot and read noise of a camera from pairs of photographs [@janesick2007photon].

The variance of linear light s (full scale 1) is s / N + (r / N)^2, with N electrons at full scale
and r electrons of read noise. Half the variance of the difference of two photographs of the same is
this variance, without the pattern that both have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

SIDE = 24
"""Pixels of a side of the blocks within which light counts as even."""
BRIGHTEST = 0.9
"""Share of full scale from which noise begins to be clipped."""
ROUNDS = 8
FEWEST = 16
"""Blocks; a line needs light of several strengths, too."""
SPREAD = 0.05
"""Least range of the signal, as a share of full scale, that tells shot noise."""


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Noise of one band.

    Parameters
    ----------
    full_well
        Electrons at full scale, and its standard deviation.
    read
        Read noise in electrons, the rounding of codes in it, and its standard deviation; 0 where
        the photographs show none.
    signal, variance
        ``(n,)`` means and variances of blocks; full scale is 1.
    """

    full_well: tuple[float, float]
    read: tuple[float, float]
    signal: Floats
    variance: Floats

    def deviation(self, signal: Floats) -> Floats:
        """Standard deviation of light; full scale is 1."""
        well, read = self.full_well[0], self.read[0]
        return np.asarray(np.sqrt(np.maximum(signal, 0.0) * well + read * read) / well)


def pair_blocks(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Means and variances of the blocks ``(n,)`` of two photographs ``(y, x)`` of the same.

    The light between them may change: only variations within a block count.
    """
    rows, columns = (side // SIDE for side in first.shape)
    if rows * columns == 0:
        raise ArgumentError(
            f"photographs of {first.shape[1]} x {first.shape[0]} pixels: blocks of {SIDE} are the "
            "least for noise"
        )

    def blocks(plane: Floats) -> Floats:
        cut = plane[: rows * SIDE, : columns * SIDE]
        parts = cut.reshape(rows, SIDE, columns, SIDE).transpose(0, 2, 1, 3)
        return parts.reshape(rows * columns, SIDE * SIDE)

    mean = 0.5 * (blocks(first) + blocks(second)).mean(axis=1)
    variance = 0.5 * blocks(first - second).var(axis=1, ddof=1)
    return mean, variance


def photon_transfer(signal: Floats, variance: Floats) -> PhotonTransfer:
    """The line through variances of blocks over their signals, by iterated weighted least squares.

    A variance of n samples has the relative standard deviation sqrt(2 / (n - 1)).

    Parameters
    ----------
    signal, variance
        ``(n,)`` means and half the variances of differences, of blocks of 24 x 24 pixels in pairs
        of photographs; full scale is 1, black subtracted.

    Raises
    ------
    ArgumentError
        Too few blocks, light of one strength only, or variances that do not rise with the light.
    """
    usable = (signal < BRIGHTEST) & np.isfinite(variance)
    signal, variance = signal[usable], variance[usable]
    if len(signal) < FEWEST or np.ptp(signal) < SPREAD:
        raise ArgumentError(
            "noise: needs pairs of photographs with brighter and darker parts; found "
            f"{len(signal)} blocks of {SIDE} x {SIDE} pixels"
            + (f" from {signal.min():.3f} to {signal.max():.3f} of full scale" * bool(len(signal)))
        )
    if not (variance > 0.0).any():
        raise ArgumentError("noise: there is none; is the second photograph a copy of the first?")
    relative = np.sqrt(2.0 / (SIDE * SIDE - 1))
    design = np.stack([np.ones_like(signal), signal], axis=1)
    expected = np.maximum(variance, 1e-3 * variance.max())
    for _ in range(ROUNDS):
        weight = 1.0 / (relative * expected)
        line, *_ = np.linalg.lstsq(design * weight[:, None], variance * weight, rcond=None)
        expected = np.maximum(design @ line, 1e-3 * variance.max())
    weight = 1.0 / (relative * expected)
    covariance = np.linalg.inv((design * weight[:, None]).T @ (design * weight[:, None]))
    offset, slope = line.tolist()
    if slope <= 3.0 * np.sqrt(covariance[1, 1]):
        raise ArgumentError(
            "noise: does not grow with the light, as that of photons does; were the photographs "
            "averaged, denoised, or is the second one a copy of the first?"
        )
    well = 1.0 / slope
    read = well * np.sqrt(max(offset, 0.0))
    # d(read) = d(offset) well / (2 sqrt(offset)) - read d(slope) / slope; the first at its error
    # where the offset is none.
    rise = well / (2.0 * np.sqrt(max(offset, np.sqrt(covariance[0, 0]))))
    gradient = np.array([rise, -read / slope])
    sigma = np.sqrt(gradient @ covariance @ gradient)
    return PhotonTransfer(
        (float(well), float(well * np.sqrt(covariance[1, 1]) / slope)),
        (float(read), float(sigma)),
        signal,
        variance,
    )

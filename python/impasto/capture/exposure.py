"""Exposures from a pilot photograph: noise of dark paint from below, highlights from above.

The third paper exposes as little as the noise of the diffuse reflection allows, because highlights
clip [@snel]. Where one exposure cannot hold both, a bracket of several does.
"""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.checks import numbers, positive
from impasto.capture.expected import Noise
from impasto.errors import ArgumentError

PERCENTILE = 99.99
"""Of the light: what is brighter is a few pixels."""
HIGHEST = 0.9
"""Of full scale that this percentile may reach."""
SIGNAL_TO_NOISE = 30.0
"""Of the median, which is diffuse reflection wherever highlights cover less than half."""
RATIO = 4.0
"""Largest step of a bracket: two stops."""


def exposures_from_pilot(
    pilot: ArrayLike,
    seconds: float,
    *,
    noise: Noise | None = None,
    signal_to_noise: float = SIGNAL_TO_NOISE,
    ratio: float = RATIO,
) -> tuple[float, ...]:
    """The exposures that a scene needs.

    Parameters
    ----------
    pilot
        ``(y, x)`` or ``(band, y, x)`` linear light of one photograph, dark subtracted, as a share
        of full scale. None of the brightest 0.01 % may be clipped: expose the pilot briefly.
    seconds
        Its exposure.
    noise
        Of a sample, relative to full scale; default: :class:`Noise`'s.
    signal_to_noise
        Least ratio of the median to its noise.
    ratio
        Largest step between two exposures of a bracket.

    Returns
    -------
    tuple
        Seconds, the shortest first. One exposure if it holds both: the shortest whose median is
        exact enough. Else from the longest at which highlights are whole to that one, evenly.

    Raises
    ------
    ArgumentError
        A pilot that is dark, or clipped.
    """
    light = numbers(pilot, "pilot", "linear light from 0 to 1")
    positive(seconds, "seconds", "a positive number of seconds")
    positive(signal_to_noise, "signal_to_noise", "a positive number")
    if not (positive(ratio, "ratio", "a number above 1") > 1.0):
        raise ArgumentError(f"ratio: expected a number above 1, found {ratio!r}")
    if light.size == 0 or not np.isfinite(light).all():
        raise ArgumentError("pilot: expected finite samples")
    middle, top = np.percentile(light, [50.0, PERCENTILE]).tolist()
    if middle <= 0.0:
        raise ArgumentError(f"pilot: its median is {middle:g}; expose it longer")
    if top >= 1.0:
        raise ArgumentError(
            f"pilot: its percentile {PERCENTILE} is clipped ({top:g} of full scale); expose it "
            "less, so that the highlights are known"
        )
    noise = Noise() if noise is None else noise
    # signal = k * sqrt(read^2 + shot^2 * signal), solved for the signal.
    shot, read = (signal_to_noise * noise.shot) ** 2, (signal_to_noise * noise.read) ** 2
    needed = (shot + sqrt(shot**2 + 4.0 * read)) / 2.0
    if needed > HIGHEST:
        raise ArgumentError(
            f"signal_to_noise: {signal_to_noise:g} needs {needed:.2f} of full scale with this "
            "noise; ask for less, or average photographs"
        )
    longest = seconds * needed / middle
    whole = seconds * HIGHEST / top
    if longest <= whole:
        return (longest,)
    steps = max(1, ceil(np.log(longest / whole) / np.log(ratio) - 1e-9))
    return tuple(np.geomspace(whole, longest, steps + 1).tolist())

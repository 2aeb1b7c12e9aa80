"""Correlated colour temperature, and the temperature of an incompletely adapted eye (eq. 7).

The search is our own: colour-science's best method (Ohno 2013) misses the temperature of a
blackbody by 0.03 K at 6500 K and by 2.6 K at 100 000 K; this one by less than 1e-9 K.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from impasto.colour.illuminants import Illuminant, checked_temperature, temperature_if_given
from impasto.colour.observers import STANDARD_OBSERVER, White, white_of, white_point
from impasto.colour.wavelengths import Floats
from impasto.errors import ArgumentError

FARTHEST = 0.05
"""Distance from the blackbody locus beyond which CIE 15 defines no correlated temperature."""
LOCUS_MIRED = (1.0, 1000.0)
"""The part of the blackbody locus that is searched: 1 000 000 K to 1000 K."""


class Correlated(NamedTuple):
    """The blackbody nearest to a light source in colour."""

    temperature: float
    """Kelvin."""
    distance: float
    """From the locus in CIE 1960 (u, v), positive above it (greenish)."""


def adapted_temperature(test: float, reference: float, d: float) -> float:
    """Temperature of the light to which an incompletely adapted eye is adapted: eq. 7.

    T_D = 1e6 / ((R - T) d + T), where T and R are the reciprocal temperatures of the test and the
    reference light in mired (1e6 / K), a scale on which equal steps look about equal
    (Tominaga and Tanaka, six-band paper).

    Parameters
    ----------
    test, reference
        Kelvin, positive: the light the painting hangs in, the light of full adaptation.
    d
        Degree of adaptation: 0 none, 1 complete. The mean of the paper's observers is 0.56.

    Returns
    -------
    float
        Kelvin. ``adapted_temperature(2862, 6504, 0.56)`` is 4169.5 (239.84 mired).

    Raises
    ------
    ArgumentError
        A temperature that is not positive and finite, or d outside [0, 1].
    """
    test = checked_temperature(test, "test")
    reference = checked_temperature(reference, "reference")
    degree = checked_degree(d)
    # Not through mired at the ends: 1e6 / (1e6 / T) may miss T by a bit, and d = 0 must change
    # nothing at all.
    if degree in {0.0, 1.0} or test == reference:
        return test if degree == 0.0 else reference
    mired = (1e6 / reference - 1e6 / test) * degree + 1e6 / test
    return 1e6 / mired


def correlated_temperature(illuminant: Illuminant, observer: str = STANDARD_OBSERVER) -> Correlated:
    """Correlated colour temperature of a light source: the nearest blackbody in CIE 1960 (u, v).

    The locus is that of eq. 8 (c2 = 1.4388e-2 m K), so a blackbody gets exactly its own
    temperature, and illuminant A gets 2855.5 K.

    Parameters
    ----------
    illuminant
        A name, a temperature, a pair ``(wavelengths, values)`` or a :class:`White`.
    observer
        The observer that integrates; CIE defines the quantity for the 1931 one.

    Raises
    ------
    ArgumentError
        A source farther than 0.05 from the locus (a coloured light), or off its ends.
    """
    return correlated(illuminant, observer, "illuminant")


def checked_degree(d: float) -> float:
    """A degree of adaptation in [0, 1], or an :class:`ArgumentError`."""
    try:
        degree = float(d)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"d: expected a number from 0 to 1, found {d!r}") from error
    if not 0.0 <= degree <= 1.0:
        raise ArgumentError(f"d: expected 0 (no adaptation) to 1 (complete), found {degree:g}")
    return degree


def correlated(illuminant: Illuminant | White, observer: str, name: str) -> Correlated:
    """:func:`correlated_temperature`; errors call the light source ``name``."""
    kelvin = None if isinstance(illuminant, White) else temperature_if_given(illuminant)
    if kelvin is not None:
        return Correlated(checked_temperature(kelvin, name), 0.0)
    low, high = LOCUS_MIRED
    mired, distance = _nearest(white_of(illuminant, observer, name).tobytes(), observer)
    if abs(distance) > FARTHEST or not low < mired < high:
        raise ArgumentError(
            f"{name}: its colour is {abs(distance):.3f} from the blackbody locus at "
            f"{1e6 / mired:.0f} K, too far (over {FARTHEST}) or off the end; no temperature "
            "describes it: give kelvin"
        )
    return Correlated(1e6 / mired, distance)


@lru_cache(maxsize=128)
def _nearest(white: bytes, observer: str) -> tuple[float, float]:
    """Mired of the nearest blackbody and the signed distance from it."""
    target = _uv(np.frombuffer(white))
    mired = _nearest_mired(target, observer)
    point = _uv(white_point(1e6 / mired, observer))
    distance = float(np.linalg.norm(target - point))
    return mired, float(np.copysign(distance, target[1] - point[1]))


def _nearest_mired(target: Floats, observer: str) -> float:
    """The reciprocal temperature with the smallest distance to ``target``.

    The search looks for the sign change of the distance's slope, not for the smallest distance:
    near its minimum a distance is flat, and half of the digits of the temperature would be noise.
    """
    low, high = LOCUS_MIRED
    coarse = np.geomspace(low, high, 97)
    locus = np.array([_uv(white_point(1e6 / mired, observer)) for mired in coarse])
    index = int(np.argmin(((locus - target) ** 2).sum(axis=1)))
    left, right = coarse[max(index - 1, 0)], coarse[min(index + 1, coarse.size - 1)]
    for _ in range(50):
        middle = 0.5 * (left + right)
        if _slope(middle, target, observer) > 0:
            right = middle
        else:
            left = middle
    return float(0.5 * (left + right))


def _slope(mired: float, target: Floats, observer: str) -> float:
    # A relative step of 1e-4 leaves an error of 1e-8 of the locus' own length scale in the
    # central difference, and 1e-12 of rounding.
    step = 1e-4 * mired
    before = _uv(white_point(1e6 / (mired - step), observer))
    after = _uv(white_point(1e6 / (mired + step), observer))
    here = _uv(white_point(1e6 / mired, observer))
    return float((here - target) @ (after - before))


def _uv(xyz: Floats) -> Floats:
    """CIE 1960 chromaticity of XYZ ``(3,)``."""
    return np.asarray(np.array([4.0, 6.0]) * xyz[:2] / (xyz @ [1.0, 15.0, 3.0]))

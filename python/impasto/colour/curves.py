"""Tone curves of displays; measured ones by monotone cubic interpolation [@fritsch1984monotone].

A curve gives the light that a channel emits for a code, and the code that emits a light. Both run
from 0 to 1; every curve maps 0 to 0 and 1 to 1 and never decreases.

The formulas are implemented here: colour-science's sRGB curve gives the same bits but takes a
second to import, for every picture, and SciPy (isotonic regression, monotone cubic interpolation)
would be a dependency of 35 MB for 45 lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour.wavelengths import Floats
from impasto.errors import ArgumentError

ROOT = 1.0 / 2.4
"""Measured ramps are interpolated as light^(1/2.4), in which real displays are almost straight
lines: 17 steps of a gamma-2.2 ramp are enough for 0.05 L* (a straight toe like sRGB's wants 52)."""
LARGEST_FALL = 0.05
"""Largest decrease (noise) of a measured ramp, as a share of its range."""
SAMPLES = 4097
"""Points, besides the readings, at which a measured curve is tabulated: a quarter of a 10-bit code
apart."""


class Curve(Protocol):
    """One channel's tone curve."""

    def decode(self, code: Floats) -> Floats:
        """Light from codes, any shape; codes lie in [0, 1]."""

    def encode(self, light: Floats) -> Floats:
        """Codes from light, any shape; light lies in [0, 1]."""


@dataclass(frozen=True, slots=True)
class SrgbCurve:
    """The piecewise curve of IEC 61966-2-1 (sRGB, Display P3)."""

    def decode(self, code: Floats) -> Floats:
        """Light from codes, any shape."""
        return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)

    def encode(self, light: Floats) -> Floats:
        """Codes from light, any shape."""
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@dataclass(frozen=True, slots=True)
class GammaCurve:
    """light = code^gamma; 1.0 is a linear display."""

    gamma: float

    def __post_init__(self) -> None:
        if not 0.2 <= self.gamma <= 5.0:
            raise ArgumentError(f"gamma: expected 0.2 to 5, found {self.gamma}")

    def decode(self, code: Floats) -> Floats:
        """Light from codes, any shape."""
        return np.asarray(code**self.gamma)

    def encode(self, light: Floats) -> Floats:
        """Codes from light, any shape."""
        return np.asarray(light ** (1.0 / self.gamma))


@dataclass(frozen=True, init=False, eq=False)
class MeasuredCurve:
    """A curve through a measured ramp.

    The reading at the first code is the black level and is subtracted, the last one becomes 1.
    Readings that fall through noise are pooled with their neighbours (isotonic regression); between
    readings runs a monotone cubic [@fritsch1980monotone] in light^(1/2.4).

    Parameters
    ----------
    codes
        ``(m,)``, m >= 3, strictly increasing from 0 to full drive (1, 255, 1023 ...).
    light
        ``(m,)`` readings in any unit (cd/m^2 as a rule).

    Attributes
    ----------
    codes
        ``(m,)`` from 0 to 1.
    light
        ``(m,)`` from 0 to 1, monotone.
    largest_fall
        Largest decrease below an earlier reading, as a share of the range.
    """

    codes: Floats
    light: Floats
    largest_fall: float
    _code: Floats
    _root: Floats
    _inverse: tuple[Floats, Floats]

    def __init__(self, codes: ArrayLike, light: ArrayLike) -> None:
        code = _ramp_codes(codes)
        reading = np.asarray(light, dtype=np.float64)
        if reading.shape != code.shape or not np.isfinite(reading).all():
            raise ArgumentError(
                f"ramp: expected {code.size} finite readings, one per code, "
                f"found shape {reading.shape}"
            )
        span = reading[-1] - reading[0]
        if not span > 0:
            raise ArgumentError(
                f"ramp: the reading at full drive ({reading[-1]:g}) must exceed the one at code 0 "
                f"({reading[0]:g})"
            )
        relative = (reading - reading[0]) / span
        fall = float((np.maximum.accumulate(relative) - relative).max())
        if fall > LARGEST_FALL:
            raise ArgumentError(
                f"ramp: the readings fall by {fall:.1%} of their range; a display gets brighter "
                "with its code, so measure again (flicker, a moved probe, swapped rows?)"
            )
        monotone = np.clip(_isotonic(relative), 0.0, 1.0)
        # Pooling may change black and white, which are exact by definition.
        monotone[0], monotone[-1] = 0.0, 1.0
        fine = np.union1d(np.linspace(0.0, 1.0, SAMPLES), code)
        set_ = object.__setattr__
        set_(self, "codes", code)
        set_(self, "light", monotone)
        set_(self, "largest_fall", fall)
        root = _monotone_cubic(code, monotone**ROOT, fine)
        rising, first = np.unique(root, return_index=True)
        set_(self, "_code", fine)
        set_(self, "_root", root)
        set_(self, "_inverse", (rising, fine[first]))

    def decode(self, code: Floats) -> Floats:
        """Light from codes, any shape."""
        return np.asarray(np.interp(code, self._code, self._root) ** (1.0 / ROOT))

    def encode(self, light: Floats) -> Floats:
        """Codes from light, any shape; where several codes emit the same light, the lowest."""
        return np.asarray(np.interp(light**ROOT, *self._inverse))


def _ramp_codes(codes: ArrayLike) -> Floats:
    code = np.asarray(codes, dtype=np.float64)
    if code.ndim != 1 or code.size < 3 or not np.isfinite(code).all():
        raise ArgumentError(f"ramp: expected codes (m,) with m >= 3, found shape {code.shape}")
    if code[0] != 0.0 or (np.diff(code) <= 0).any():
        raise ArgumentError(
            "ramp: expected codes that increase from 0 (the black level) to full drive, "
            f"found {code[0]:g} ... {code[-1]:g}"
        )
    return np.asarray(code / code[-1])


def _isotonic(values: Floats) -> Floats:
    """The nearest nondecreasing sequence by least squares (pool adjacent violators)."""
    means: list[float] = []
    counts: list[int] = []
    for value in values.tolist():
        mean, count = value, 1
        while means and means[-1] > mean:
            before, weight = means.pop(), counts.pop()
            mean = (mean * count + before * weight) / (count + weight)
            count += weight
        means.append(mean)
        counts.append(count)
    return np.repeat(means, counts)


def _monotone_cubic(x: Floats, y: Floats, at: Floats) -> Floats:
    """Monotone cubic Hermite interpolation [@fritsch1984monotone].

    Interior slopes are weighted harmonic means of the neighbouring secants (Fritsch and Butland
    1984), 0 beside a flat stretch; the ends take the secant itself.
    """
    width = np.diff(x)
    secant = np.diff(y) / width
    before, after = secant[:-1], secant[1:]
    weight_before, weight_after = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    slope = np.zeros_like(y)
    slope[0], slope[-1] = secant[0], secant[-1]
    rising = (before > 0) & (after > 0)
    inner = np.zeros_like(before)
    np.divide(
        (weight_before + weight_after) * before * after,
        weight_before * after + weight_after * before,
        out=inner,
        where=rising,
    )
    slope[1:-1] = inner
    left = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    h = width[left]
    t = (at - x[left]) / h
    rise = y[left + 1] - y[left]
    value = y[left] + t * (
        h * slope[left]
        + t * (3 * rise - h * (2 * slope[left] + slope[left + 1]))
        + t * t * (h * (slope[left] + slope[left + 1]) - 2 * rise)
    )
    # The end belongs to its interval by the sum of the cubic: white is exact by definition.
    value = np.where(at >= x[-1], y[-1], value)
    # Rounding may make a flat part decrease by a bit.
    return np.maximum.accumulate(np.clip(value, y[0], y[-1]))

"""Light sources: by name, by temperature, or measured."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour._science import science
from impasto.colour.wavelengths import Floats, checked_wavelengths
from impasto.errors import ArgumentError

Illuminant: TypeAlias = ArrayLike | tuple[ArrayLike, ArrayLike]
"""A light source.

* a name: ``"A"``, ``"D65"``, ``"FL11"``, ``"LED-B3"``, ``"HP1"`` ... (:func:`illuminant_names`);
* a temperature in kelvin: ``2856.0``, ``"2856 K"`` or, from 1000 on, ``"2856"``, a
  blackbody (eq. 8);
* an array ``(n,)`` on the wavelengths that go with it;
* a pair ``(wavelengths, values)``, or any object with these two attributes (colour-science's
  ``SpectralDistribution``).
"""

FIRST_RADIATION_CONSTANT = 3.7418e-16
"""c1 of eq. 8 in W m^2, as printed in the paper."""
SECOND_RADIATION_CONSTANT = 1.4388e-2
"""c2 of eq. 8 in m K (the paper prints "Watts-K")."""

HOTTEST = 1e12
"""Kelvin. Far above it eq. 8 overflows a double; the colour is constant from 1e7 on."""


def planck(temperature: float, wavelengths: ArrayLike) -> Floats:
    """Spectrum of a blackbody: eq. 8 of Tominaga and Tanaka (six-band paper).

    Parameters
    ----------
    temperature
        Kelvin, positive.
    wavelengths
        ``(n,)`` nm.

    Returns
    -------
    ndarray
        ``(n,)`` float64, radiant exitance per wavelength in W m^-3. Values too small for a double
        are 0.

    Raises
    ------
    ArgumentError
        A temperature that is not positive and finite; wavelengths that are no grid in nm.
    """
    kelvin = checked_temperature(temperature)
    metres = checked_wavelengths(wavelengths) * 1e-9
    # Our own: colour-science's agrees to 1e-15, but overflows with a warning where this is 0.
    # exp(-x) / -expm1(-x) is 1 / (exp(x) - 1) without the overflow of exp(x) below 25 K.
    exponent = SECOND_RADIATION_CONSTANT / (metres * kelvin)
    return np.asarray(
        FIRST_RADIATION_CONSTANT * metres**-5 * np.exp(-exponent) / -np.expm1(-exponent)
    )


def spectrum(illuminant: Illuminant, wavelengths: ArrayLike) -> Floats:
    """Spectral power of a light source on a wavelength grid.

    Tables are interpolated linearly, as the CIE does for its illuminants, and their end values
    continue outside. The scale is the source's own (CIE tables are 100 at 560 nm, blackbodies are
    absolute): wherever light becomes colour it is normalised to Y = 1.

    Parameters
    ----------
    illuminant
        A name, a temperature in kelvin, ``(n,)`` values on these very wavelengths, or a pair
        ``(wavelengths, values)``; see :data:`Illuminant`.
    wavelengths
        ``(n,)`` nm, strictly increasing.

    Returns
    -------
    ndarray
        ``(n,)`` float64, not negative. For spiky sources (FL, HP) on a coarse grid these are point
        samples: integrate on 1 nm instead (:func:`xyz_from_spectrum` always does).

    Raises
    ------
    ArgumentError
        An unknown name (the message lists the nearest ones), a temperature <= 0, values that are
        NaN, infinite, negative or all zero, or whose length is not that of the wavelengths.
    """
    grid = checked_wavelengths(wavelengths)
    return sampled(illuminant, grid, own_grid=grid)


def sampled(
    illuminant: Illuminant, at: Floats, own_grid: Floats | None = None, name: str = "illuminant"
) -> Floats:
    """The spectrum at ``at``; a bare array of values is taken to stand on ``own_grid``."""
    if isinstance(illuminant, str):
        kelvin = _kelvin(illuminant)
        if kelvin is not None:
            return planck(checked_temperature(kelvin, name), at)
        grid, values = _table(_key(illuminant, name))
        return np.interp(at, grid, values)
    if hasattr(illuminant, "wavelengths") and hasattr(illuminant, "values"):
        measured: Any = illuminant
        illuminant = (measured.wavelengths, measured.values)
    if isinstance(illuminant, tuple) and len(illuminant) == 2 and np.ndim(illuminant[0]) == 1:
        grid = checked_wavelengths(illuminant[0], f"{name} wavelengths")
        return np.interp(at, grid, _checked_power(illuminant[1], grid.size, name))
    try:
        values = np.asarray(illuminant, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"{name}: expected a name, a temperature in kelvin, values (n,) or a pair "
            f"(wavelengths, values), found {type(illuminant).__name__}"
        ) from error
    if values.ndim == 0:
        return planck(checked_temperature(float(values), name), at)
    if own_grid is None:
        raise ArgumentError(
            f"{name}: values without wavelengths, shape {values.shape}; "
            "give a pair (wavelengths, values)"
        )
    return np.interp(at, own_grid, _checked_power(values, own_grid.size, name))


def checked_illuminant(illuminant: Illuminant, name: str = "illuminant") -> None:
    """Refuse what is no light source: an unknown name, a temperature of 0, values that are NaN.

    Values without wavelengths pass: only their length tells whether they fit a grid.
    """
    bare = isinstance(illuminant, np.ndarray | list) and np.ndim(illuminant) == 1
    # The default needs no table: colour-science takes a second to be loaded.
    if not (bare or (isinstance(illuminant, str) and illuminant == "D65")):
        sampled(illuminant, np.array([555.0]), name=name)


def temperature_if_given(illuminant: Illuminant) -> float | None:
    """Kelvin, if the light source was given as a temperature."""
    if isinstance(illuminant, str):
        return _kelvin(illuminant)
    if isinstance(illuminant, np.ndarray) and illuminant.ndim == 0:
        illuminant = illuminant.item()
    return float(illuminant) if isinstance(illuminant, int | float | np.number) else None


def illuminant_names() -> tuple[str, ...]:
    """All names for :func:`spectrum`: CIE and ISO illuminants, then other sources."""
    tables = science()
    return (*tables.SDS_ILLUMINANTS.keys(), *tables.SDS_LIGHT_SOURCES.keys())


def checked_temperature(kelvin: float, name: str = "temperature") -> float:
    """A positive, finite temperature in kelvin, or an :class:`ArgumentError`."""
    try:
        value = float(kelvin)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: expected kelvin, found {kelvin!r}") from error
    if not 0 < value <= HOTTEST:
        raise ArgumentError(
            f"{name}: expected a positive temperature in kelvin, at most {HOTTEST:g}, "
            f"found {value:g}"
        )
    return value


def _checked_power(values: ArrayLike, count: int, name: str) -> Floats:
    power = np.asarray(values, dtype=np.float64)
    if power.shape != (count,):
        raise ArgumentError(
            f"{name}: expected {count} values, one per wavelength, found shape {power.shape}"
        )
    if not np.isfinite(power).all():
        index = int(np.flatnonzero(~np.isfinite(power))[0])
        raise ArgumentError(f"{name}: expected finite values, found {power[index]} at {index}")
    if (power < 0).any():
        index = int(np.argmin(power))
        raise ArgumentError(
            f"{name}: expected values >= 0, found {power[index]:g} at {index}; "
            "subtract the dark reading and clip before use"
        )
    if not power.any():
        raise ArgumentError(f"{name}: all values are 0; a light source must emit something")
    return power


def _kelvin(text: str) -> float | None:
    match = re.fullmatch(r"\s*([+-]?\d+(?:\.\d*)?)\s*([kK]?)\s*", text)
    if match is None:
        return None
    kelvin = float(match[1])
    # Without the unit, "65" may stand for D65 and "11" for FL11; four digits can be kelvin only.
    return kelvin if match[2] or kelvin >= 1000.0 else None


def _plain(name: str) -> str:
    """``"cie illuminant fl 2"`` and ``"FL2"`` are the same name."""
    folded = re.sub(r"[\s_]+", "", name.casefold())
    return folded.removeprefix("cie").removeprefix("standard").removeprefix("illuminant")


@lru_cache(maxsize=1)
def _names() -> dict[str, str]:
    return {_plain(name): name for name in reversed(illuminant_names())}


def _key(name: str, argument: str) -> str:
    known = _names()
    if _plain(name) in known:
        return known[_plain(name)]
    raise ArgumentError(
        f"{argument}: unknown name {name!r}; nearest: {_nearest(_plain(name), known)} "
        '(a temperature is written "2856 K")'
    )


def _nearest(plain: str, known: dict[str, str]) -> str:
    close: Iterable[str] = difflib.get_close_matches(plain, known, n=4, cutoff=0.4)
    return ", ".join(known[key] for key in close) or ", ".join(list(illuminant_names())[:8])


@lru_cache(maxsize=64)
def _table(name: str) -> tuple[Floats, Floats]:
    tables = science()
    source: Any = (
        tables.SDS_ILLUMINANTS[name]
        if name in tables.SDS_ILLUMINANTS
        else tables.SDS_LIGHT_SOURCES[name]
    )
    return (
        np.asarray(source.wavelengths, dtype=np.float64),
        np.asarray(source.values, dtype=np.float64),
    )

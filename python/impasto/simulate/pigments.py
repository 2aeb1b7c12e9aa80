"""Paint: real spectra, mixed by the one-constant theory of Kubelka and Munk.

Kubelka & Munk 1931; Duncan 1940: with K/S = (1 - R)^2 / (2 R) a mixture's K/S is the sum of its
pigments' K/S weighted by concentration, and R = 1 + K/S - sqrt((K/S)^2 + 2 K/S) leads back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.colour import Display, lab_from_xyz, xyz_from_spectrum
from impasto.colour._science import science
from impasto.encoding import Encoding
from impasto.errors import ArgumentError

WAVELENGTHS: NDArray[np.float64] = np.arange(380.0, 781.0, 5.0)
"""Grid of the simulated spectra in nm."""

ROLES: dict[str, tuple[float, float, float]] = {
    "white": (97, 0, 2),
    "lemon": (84, -6, 82),
    "yellow": (76, 10, 74),
    "orange": (60, 42, 58),
    "red": (42, 55, 28),
    "crimson": (34, 40, -6),
    "flesh": (66, 18, 20),
    "earth": (38, 14, 17),
    "olive": (44, -15, 24),
    "green": (54, -44, 26),
    "viridian": (70, -32, 2),
    "sky": (54, 4, -40),
    "blue": (30, 24, -50),
    "violet": (31, 24, -21),
    "black": (20, 0, 0),
}
"""The paints of the palette, each with its wanted CIE L*a*b* (D65)."""


@dataclass(frozen=True)
class Palette:
    """Paints and their mixtures.

    Attributes
    ----------
    names
        One role per paint.
    reflectance
        ``(paint, n)`` masstone reflectances on :data:`WAVELENGTHS`.
    recipes
        ``(mixture, paint)`` concentrations, each row sums to 1.
    lab
        ``(mixture, 3)`` CIE L*a*b* of the mixtures under D65.
    """

    names: tuple[str, ...]
    reflectance: NDArray[np.float64]
    recipes: NDArray[np.float32]
    lab: NDArray[np.float32]

    def match(self, lab: NDArray[np.floating]) -> NDArray[np.int32]:
        """The mixture nearest to each wanted colour: ``(count, 3)`` to ``(count,)``."""
        wanted = np.asarray(lab, dtype=np.float32).reshape(-1, 3)
        # Errors of lightness weigh most.
        weight = np.array([1.25, 1.0, 1.0], dtype=np.float32)
        table = self.lab * weight
        norm = (table * table).sum(axis=1)
        picked = []
        for part in np.array_split(wanted, max(1, len(wanted) // 1024)):
            distances = (-2.0 * weight * part) @ table.T
            distances += norm
            picked.append(distances.argmin(axis=1))
        return np.concatenate(picked).astype(np.int32)


def absorption(reflectance: NDArray[np.floating]) -> NDArray[np.floating]:
    """K/S of a reflectance, any shape."""
    bounded = np.clip(reflectance, 0.004, 0.985)
    return np.asarray((1.0 - bounded) ** 2 / (2.0 * bounded))


def reflectance(absorption: NDArray[np.floating]) -> NDArray[np.floating]:
    """Reflectance of an opaque layer from its K/S, any shape."""
    return np.asarray(1.0 + absorption - np.sqrt(absorption * (absorption + 2.0)))


def palette(pigments: tuple[ArrayLike, ArrayLike] | None = None) -> Palette:
    """Paints selected from measured spectra, one for each role.

    Parameters
    ----------
    pigments
        ``(reflectance (count, n), wavelengths (n,) nm)`` to pick from. Default: the
        ColorChecker (N. Ohta) and the PMC chart of colour-science. They are not among the default
        training spectra of ``fit_reflectance``, so a fit cannot have seen them.
    """
    spectra = _charts() if pigments is None else _checked(*pigments)
    lab = lab_of(spectra)
    wanted = np.array(list(ROLES.values()))
    picked = np.linalg.norm(lab[None] - wanted[:, None], axis=2).argmin(axis=1)
    paints = spectra[picked]
    recipes = _recipes(len(paints))
    mixtures = reflectance(recipes @ absorption(paints))
    return Palette(tuple(ROLES), paints, recipes.astype(np.float32), lab_of(mixtures).astype("f4"))


def lab_of(spectra: NDArray[np.floating]) -> NDArray[np.float64]:
    """CIE L*a*b* under D65 (2 degree observer) of spectra ``(count, n)`` on :data:`WAVELENGTHS`."""
    xyz = xyz_from_spectrum(WAVELENGTHS, "D65") @ np.asarray(spectra, dtype=np.float64).T
    return lab_from_xyz(xyz).T


def lab_from_srgb(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """CIE L*a*b* of sRGB colours 0 .. 1, any shape ``(..., 3)``."""
    linear = Encoding("srgb").decode(np.clip(srgb, 0.0, 1.0)).astype(np.float64)
    xyz = linear @ np.linalg.inv(Display.named("srgb").linear_from_xyz).T
    return np.moveaxis(lab_from_xyz(np.moveaxis(xyz, -1, 0)), 0, -1)


def _recipes(count: int) -> NDArray[np.float64]:
    """Pure paints, pairs and pairs mixed with white, in ratios that double."""
    white = 0
    ratios = [1.0, 0.5, 0.2, 0.08, 0.03]
    shares = [1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.015, 0.006]
    rows: list[NDArray[np.float64]] = [np.eye(count)[white]]
    for first in range(1, count):
        for second in range(1, count):
            if first == second:
                continue
            for ratio in ratios if second > first else ratios[1:]:
                pair = np.zeros(count)
                pair[first], pair[second] = 1.0, ratio
                pair /= pair.sum()
                for share in shares:
                    row = share * pair
                    row[white] = 1.0 - share
                    rows.append(row)
    return np.array(rows)


def _charts() -> NDArray[np.float64]:
    rows = [
        np.interp(WAVELENGTHS, spectrum.wavelengths, spectrum.values)
        for chart in ("ColorChecker N Ohta", "PMC")
        for spectrum in science().SDS_COLOURCHECKERS[chart].values()
    ]
    return np.asarray(np.clip(np.array(rows), 0.0, 0.98))


def _checked(spectra: ArrayLike, wavelengths: ArrayLike) -> NDArray[np.float64]:
    values, grid = np.asarray(spectra, np.float64), np.asarray(wavelengths, np.float64)
    if grid.ndim != 1 or values.ndim != 2 or values.shape[1] != len(grid) or len(values) == 0:
        raise ArgumentError(
            "pigments: expected (reflectance (count, n), wavelengths (n,)), found shapes "
            f"{values.shape} and {grid.shape}"
        )
    if not (np.diff(grid) > 0).all() or not np.isfinite(values).all():
        raise ArgumentError("pigments: wavelengths must increase and reflectances be finite")
    resampled = np.array([np.interp(WAVELENGTHS, grid, row) for row in values])
    physical = (resampled >= 0.0).all(axis=1) & (resampled <= 1.0).all(axis=1)
    if not physical.any():
        raise ArgumentError("pigments: no spectrum stays within 0 .. 1")
    return np.asarray(resampled[physical])

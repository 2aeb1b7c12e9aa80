"""Training spectra for estimators of reflectance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour import interpolation_matrix
from impasto.colour._science import science
from impasto.colour.wavelengths import Floats, checked_spectra, checked_wavelengths
from impasto.errors import ArgumentError

PIGMENTS = Path(__file__).with_name("data") / "pigments768.npz"
"""Beside it, ``ATTRIBUTION.md`` says whose work it is."""


@dataclass(frozen=True, init=False, eq=False)
class Training:
    """Measured reflectances of surfaces like those to be estimated.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm, strictly increasing.
    reflectance
        ``(N, n)`` relative to a perfect white.
    name
        Their source; it is stored in the ``info`` of estimates.
    names
        Of the spectra, one each; none where they are not known.
    """

    wavelengths: Floats
    reflectance: Floats
    name: str
    names: tuple[str, ...]

    def __init__(
        self,
        wavelengths: ArrayLike,
        reflectance: ArrayLike,
        name: str = "user",
        names: Sequence[str] = (),
    ) -> None:
        grid = checked_wavelengths(wavelengths, "training wavelengths")
        spectra = checked_spectra(reflectance, grid, "training", "spectrum")
        spectra.setflags(write=False)
        set_ = object.__setattr__
        set_(self, "wavelengths", grid)
        set_(self, "reflectance", spectra)
        set_(self, "name", name)
        if len(names) not in {0, len(spectra)}:
            raise ArgumentError(f"names: expected {len(spectra)} or none, found {len(names)}")
        set_(self, "names", tuple(names))

    def __len__(self) -> int:
        return len(self.reflectance)

    def __add__(self, other: Training) -> Training:
        """Both sets, on the wavelengths of the first."""
        spectra = np.vstack([self.reflectance, other.at(self.wavelengths)])
        names = self.names + other.names if self.names and other.names else ()
        return Training(self.wavelengths, spectra, f"{self.name} + {other.name}", names)

    def at(self, wavelengths: ArrayLike) -> Floats:
        """Spectra ``(N, m)`` on another grid: piecewise cubic, end values continued."""
        grid = checked_wavelengths(wavelengths)
        if np.array_equal(grid, self.wavelengths):
            return np.array(self.reflectance)
        return np.asarray(self.reflectance @ interpolation_matrix(self.wavelengths, grid).T)


TrainingSpectra: TypeAlias = Training | tuple[ArrayLike, ArrayLike] | ArrayLike
"""A :class:`Training`, a pair ``(wavelengths, spectra)``, or spectra ``(N, n)`` on the wavelengths
of the estimate."""


@lru_cache(maxsize=1)
def ces99() -> Training:
    """The 99 colour evaluation samples of CIE 224:2017, 380-780 nm in steps of 5 nm."""
    colour: Any = science()
    spectra = colour.quality.cfi2017.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    return Training(spectra.wavelengths, spectra.values.T, "CES 99")


@lru_cache(maxsize=1)
def ampas190() -> Training:
    """The 190 training spectra of the Academy's raw-to-ACES tool, 380-780 nm in steps of 5 nm.

    A few fluorescent ones exceed 1 above 700 nm.
    """
    colour: Any = science()
    spectra = colour.characterisation.read_training_data_rawtoaces_v1()
    return Training(spectra.wavelengths, spectra.values.T, "AMPAS 190")


@lru_cache(maxsize=1)
def pigments768() -> Training:
    """768 cluster centres of 1586 measured spectra of pigments, 400-780 nm in steps of 10 nm.

    Made from the Hyperspectral Pigment Dataset by Hilda Deborah (WHISPERS 2022,
    doi 10.5281/zenodo.5592485), licensed under CC BY 4.0: name the source where you show results.
    """
    with np.load(PIGMENTS) as file:
        spectra = file["reflectance"].astype(np.float64) / file["one"]
        return Training(file["wavelengths"].astype(np.float64), spectra, "HypPigments 768")


@lru_cache(maxsize=1)
def general_training() -> Training:
    """:func:`ces99` and :func:`ampas190`: 289 spectra of all kinds of objects.

    The systems of the papers learn from these: the papers' own spectra were never published.
    """
    return ces99() + ampas190()


@lru_cache(maxsize=1)
def default_training() -> Training:
    """The default: :func:`general_training` and :func:`pigments768`, 1057 spectra."""
    return general_training() + pigments768()


def checked_training(training: TrainingSpectra | None, wavelengths: Floats) -> Training:
    """The training set for an argument."""
    if training is None:
        return default_training()
    if isinstance(training, Training):
        return training
    if isinstance(training, tuple) and len(training) == 2 and np.ndim(training[0]) == 1:
        return Training(*training)
    return Training(wavelengths, np.asarray(training))

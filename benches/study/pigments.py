"""Measured pigments photographed by three cameras, and errors of estimated spectra.

400 to 700 nm in steps of 10 (the first as at 405, where the data begin), plain sums; the light is a
blackbody of 3000 K, a white board reads 1 in each band; the noise is that of eight averaged frames
of a sensor that holds 30 000 electrons and reads three. The pigments are those of HypPigments
(Deborah, WHISPERS 2022, CC BY 4.0), which are not part of impasto.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impasto.bands import Camera
from impasto.colour import delta_e, lab_from_xyz, xyz_from_spectrum
from impasto.colour.wavelengths import Floats

GRID = np.arange(400.0, 701.0, 10.0)
LIGHT = 3000.0
"""Colour temperature of the lamp, K."""
NOISE = 9.1e-4
"""Standard deviation of a response; the estimators get the same value."""
FULL_WELL, READ, FRAMES = 30_000.0, 3.0, 8
PIGMENTS = "spectra/hyppigments.npz"
SENSITIVITIES = "spectra/cameras.npz"
FILTERS = "spectra/filters.npz"
"""Files below the folder of real data."""
BODY = "Nikon_D5100"
PAIR = ("Tiffen 80A", "Tiffen 8 Yellow 2")


def rgb(folder: Path) -> Camera:
    """Three bands."""
    return Camera(GRID, _body(folder), LIGHT)


def filtered(folder: Path) -> Camera:
    """The same camera twice, through one filter and through another: six bands."""
    file = np.load(folder / FILTERS)
    names = list(file["name"])
    through = [
        np.interp(GRID, file["wavelength"], file["transmittance"][names.index(name)])
        for name in PAIR
    ]
    return Camera(GRID, np.vstack([_body(folder) * filter_ for filter_ in through]), LIGHT)


def six_bands(folder: Path) -> Camera:
    """Six bandpass filters, 50 nm wide, before a silicon sensor."""
    del folder
    efficiency = np.interp(GRID, np.arange(400, 701, 50), [0.35, 0.5, 0.6, 0.62, 0.6, 0.55, 0.45])
    centres = np.arange(425, 676, 50)[:, None]
    return Camera(GRID, np.exp2(-4 * ((GRID - centres) / 50.0) ** 2) * efficiency, LIGHT)


CAMERAS: dict[str, tuple[Callable[[Path], Camera], tuple[str, ...]]] = {
    "RGB": (rgb, (PIGMENTS, SENSITIVITIES)),
    "RGB+2": (filtered, (PIGMENTS, SENSITIVITIES, FILTERS)),
    "6BP": (six_bands, (PIGMENTS,)),
}
"""Each camera's maker and the files that it needs."""


def _body(folder: Path) -> Floats:
    file = np.load(folder / SENSITIVITIES)
    curves = file["sensitivity"][list(file["name"]).index(BODY)].T
    return np.array([np.interp(GRID, file["wavelength"], curve) for curve in curves])


def read_pigments(folder: Path) -> tuple[Floats, NDArray[Any]]:
    """Spectra ``(1586, 31)`` and pigment numbers; six spectra that exceed 1 are left out."""
    file = np.load(folder / PIGMENTS)
    wavelength = file["wavelength"].astype(float)
    visible = (wavelength >= 400) & (wavelength <= 720)
    keep = file["reflectance"][:, visible].max(axis=1) <= 1
    rows = file["reflectance"][keep].astype(float)
    return np.array([np.interp(GRID, wavelength, row) for row in rows]), file["kremer"][keep]


@dataclass(frozen=True, eq=False)
class PigmentPhotograph:
    """One photograph of pigments: the input of an estimator.

    Attributes
    ----------
    camera
        The camera.
    responses
        ``(band, 1, pixel)`` float32, a white board at 1.
    """

    camera: Camera
    responses: NDArray[np.float32]


def photographed(camera: Camera, spectra: Floats, rng: np.random.Generator) -> PigmentPhotograph:
    """One pixel per spectrum ``(N, 31)``, with shot and read noise."""
    rho = camera.response(spectra, GRID, integration="sum")
    electrons = np.maximum(FULL_WELL * rho + READ**2, 0.0)
    deviation = np.sqrt(electrons) / FULL_WELL / np.sqrt(FRAMES)
    noisy = rho + rng.standard_normal(rho.shape) * deviation
    return PigmentPhotograph(camera, np.ascontiguousarray(noisy.T[:, None], np.float32))


@dataclass(frozen=True, eq=False)
class PigmentData:
    """A data set: pigments photographed by one camera, repeated to a large picture.

    Attributes
    ----------
    name
        Of the data set.
    stack
        The photograph to fit, large enough that the time of a fit is that of its pixels.
    spectra
        ``(N, 31)`` true spectra of the first N pixels; the others repeat them.
    """

    name: str
    stack: PigmentPhotograph
    spectra: Floats
    truth: None = None
    share: float = 1.0

    @property
    def megapixels(self) -> float:
        """Size of the picture."""
        return float(self.stack.responses.shape[2]) / 1e6


def pigment_data(name: str, camera: str, folder: Path, pixels: int, seed: int) -> PigmentData:
    """The pigments by a camera of :data:`CAMERAS`, in at least ``pixels`` pixels."""
    spectra, _ = read_pigments(folder)
    photograph = photographed(CAMERAS[camera][0](folder), spectra, np.random.default_rng(seed))
    times = -(-pixels // len(spectra))
    return PigmentData(
        name,
        PigmentPhotograph(photograph.camera, np.tile(photograph.responses, (1, 1, times))),
        spectra,
    )


class Estimated(Protocol):
    """What an estimate, ours or a peer's, offers."""

    @property
    def coefficients(self) -> NDArray[np.float32]:
        """``(k, 1, pixel)``."""

    @property
    def basis(self) -> Floats:
        """``(k, 31)``."""


@dataclass(frozen=True, slots=True)
class SpectralErrors:
    """Errors of estimated spectra over the pigments.

    Attributes
    ----------
    colour, colour_p95
        CIEDE2000 under D65, mean and 95th percentile.
    spectrum, spectrum_p95
        Root mean square over wavelengths, mean and 95th percentile.
    fitness
        Mean cosine between the two spectra (goodness of fit).
    """

    colour: float
    colour_p95: float
    spectrum: float
    spectrum_p95: float
    fitness: float


def judged_spectra(
    estimates: Sequence[Estimated], photographs: Sequence[PigmentData]
) -> SpectralErrors:
    """Errors of the estimate of a data set's one picture; every pigment counts once."""
    (estimate,), (photograph,) = estimates, photographs
    return spectral_errors(spectra_of(estimate, len(photograph.spectra)), photograph.spectra)


def spectra_of(estimate: Estimated, count: int) -> Floats:
    """``(count, 31)`` of the first pixels."""
    return np.asarray(estimate.coefficients[:, 0, :count].T.astype(np.float64) @ estimate.basis)


def spectral_errors(found: Floats, truth: Floats) -> SpectralErrors:
    """Errors of spectra ``(N, 31)``."""
    operator = xyz_from_spectrum(GRID, "D65")

    def lab(spectra: Floats) -> Floats:
        # A colour has no name below black, where a linear estimate may end.
        return lab_from_xyz(operator @ np.maximum(spectra, 1e-4).T, operator.sum(axis=1))

    colour = delta_e(lab(found), lab(truth))
    spectrum = np.sqrt(((found - truth) ** 2).mean(axis=1))
    cosine = (found * truth).sum(axis=1)
    cosine /= np.linalg.norm(found, axis=1) * np.linalg.norm(truth, axis=1)
    return SpectralErrors(
        colour=float(colour.mean()),
        colour_p95=float(np.percentile(colour, 95)),
        spectrum=float(spectrum.mean()),
        spectrum_p95=float(np.percentile(spectrum, 95)),
        fitness=float(cosine.mean()),
    )

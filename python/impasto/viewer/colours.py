"""The colours of a painting in every light of the page, as matrices, without adaptation.

For each illuminant the page gets the matrix from coefficients to XYZ and the XYZ of the light, as
:func:`impasto.colour.xyz_from_coefficients` makes them without adaptation. Adaptation multiplies
both by the matrix of eq. 12 of the six-band paper, which the page computes for any degree d: it has
the colour-matching functions, Planck's law (eq. 8) and the cone matrix (eq. 9). Nothing is
interpolated.

Under a yellowed varnish the matrix depends on the light's way through the film. It is given at
Chebyshev points of that way and interpolated by the polynomial through them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.colour import Display, xyz_from_coefficients, xyz_from_spectrum
from impasto.colour.adaptation import CONES_FROM_XYZ
from impasto.colour.illuminants import SECOND_RADIATION_CONSTANT
from impasto.colour.observers import STANDARD_OBSERVER, matching_functions
from impasto.colour.primaries import primary_spectra
from impasto.colour.temperature import correlated_temperature
from impasto.colour.wavelengths import interpolation_matrix
from impasto.environment import Environment
from impasto.fit.reflectance import noise_of_spectra
from impasto.illumination import MIXING_GRID, channel_colours, lamp_colours
from impasto.lighting import DENSEST, head_on
from impasto.lights import DistantLight
from impasto.rig import FRONTAL
from impasto.scene import Scene
from impasto.varnish import Varnish

ILLUMINANTS = {
    "D65": "Daylight, D65",
    "D50": "Daylight, D50",
    "A": "Incandescent lamp, A",
    "LED-B3": "White LED, LED-B3",
}
"""Lights of the page by the names that :mod:`impasto.colour` gives them."""
REFERENCE = "D65"
"""The light of complete adaptation."""
MEAN_DEGREE = 0.56
"""The mean degree of adaptation of the observers of the six-band paper."""
VARNISHES = {
    "clear": ("Clear varnish", Varnish()),
    "yellowed": ("Yellowed varnish", Varnish(yellowness=10.0)),
    "brown": ("Brown varnish", Varnish(yellowness=30.0)),
}
"""The coats of ``impasto render --varnish``: 50 micrometres each."""
NODES = 6
"""Chebyshev points of the way through a film. From 2 thicknesses to the longest way, 2.63 at an
index of 1.54, absorbance at 450 nm changes by up to 0.95; the polynomial of degree 5 misses an
exponential of that by 0.47^6 / (6! 2^5), 5e-7."""


def colours_of(reflectance: Any, bands: int) -> dict[str, Any]:
    """What the page needs to show coefficients, or bands, in colour.

    Parameters
    ----------
    reflectance
        Spectra of the colours; None: three bands as linear sRGB, one band as grey.
    bands
        Planes of the diffuse colours.

    Raises
    ------
    ArgumentError
        Neither spectra nor one or three bands.
    """
    display = Display.named("srgb")
    found: dict[str, Any] = {
        "linear_from_xyz": _rows(display.linear_from_xyz),
        "illuminants": _illuminants(reflectance, bands),
        "varnishes": [],
    }
    if reflectance is None:
        return found
    grid, functions = matching_functions(STANDARD_OBSERVER)
    return found | {
        "basis": _rows(np.asarray(reflectance.basis, np.float64)),
        "wavelengths": _numbers(reflectance.wavelengths),
        "interval": _interval(reflectance),
        "adaptation": {
            "reference": float(correlated_temperature(REFERENCE).temperature),
            "mean": MEAN_DEGREE,
            "cones_from_xyz": _rows(CONES_FROM_XYZ),
            "second_radiation_constant": SECOND_RADIATION_CONSTANT,
            "wavelengths": _numbers(grid),
            "matching_functions": _rows(functions),
        },
        "varnishes": [
            _coat(name, label, coat, reflectance) for name, (label, coat) in VARNISHES.items()
        ],
    }


def _interval(reflectance: Any) -> dict[str, Any] | None:
    """How far spectra may be off (:meth:`impasto.Reflectance.interval`); None where unknown."""
    spread = getattr(reflectance, "spread", None)
    if spread is None:
        return None
    return {"spread": _numbers(spread), "noise": noise_of_spectra(reflectance.info)}


def _illuminants(reflectance: Any, bands: int) -> list[dict[str, Any]]:
    lamp = DistantLight(FRONTAL)
    names = ILLUMINANTS if reflectance is not None else {"D65": "As photographed"}
    found = []
    for name, label in names.items():
        matrices, interface, _, _ = lamp_colours(
            Scene([lamp], illuminant=name), reflectance, bands, FRONTAL
        )
        found.append(
            {
                "name": name,
                "label": label,
                "kelvin": None
                if reflectance is None
                else float(correlated_temperature(name).temperature),
                "diffuse": _rows(matrices[0].T),
                "interface": _numbers(interface[0]),
                "channels": _channels(name, reflectance, bands),
            }
        )
    return found


def _channels(name: str, reflectance: Any, bands: int) -> dict[str, Any]:
    """Of the channels of an environment, whose maps do not count here: matrices and XYZ."""
    even = Environment(np.full((3, 1, 2), 1.0 / np.pi, np.float32))
    scene = Scene(environment=even, illuminant=name)
    found = channel_colours(scene, reflectance, bands, FRONTAL)
    return {"diffuse": [_rows(one.T) for one in found.diffuse], "interface": _rows(found.interface)}


def _coat(name: str, label: str, coat: Varnish, reflectance: Any) -> dict[str, Any]:
    """A coat for the page: its lobe, what it leaves of the lobes below, and its film."""
    longest = coat.path(0.0, 0.0)
    shortest = coat.path()
    angles = np.pi * np.arange(NODES) / (NODES - 1)
    paths = 0.5 * (shortest + longest) - 0.5 * (longest - shortest) * np.cos(angles)
    finely = interpolation_matrix(reflectance.wavelengths, MIXING_GRID)
    basis = np.asarray(reflectance.basis, np.float64) @ finely.T
    absorption = 1e-3 * coat.thickness_um * coat.coefficients(MIXING_GRID)
    films = {}
    for one in ILLUMINANTS:
        folds = [
            xyz_from_coefficients(basis * np.exp(-path * absorption), MIXING_GRID, one)
            for path in paths
        ]
        parts = primary_spectra(one, MIXING_GRID)
        luminosity = np.asarray(xyz_from_spectrum(MIXING_GRID, np.ones(MIXING_GRID.size))[1])
        shares = parts @ luminosity / (parts.sum(axis=0) @ luminosity)
        channels = [
            [
                _rows(
                    share
                    * xyz_from_coefficients(
                        basis * np.exp(-path * absorption),
                        MIXING_GRID,
                        (MIXING_GRID, part),
                        test=one,
                    ).diffuse
                )
                for share, part in zip(shares, parts, strict=True)
            ]
            for path in paths
        ]
        films[one] = {
            "diffuse": [_rows(fold.diffuse) for fold in folds],
            "interface": _numbers(folds[0].interface),
            "films": channels,
        }
    return {
        "name": name,
        "label": label,
        "index": coat.index,
        "gamma": coat.gamma,
        "beta": coat.strength,
        "exponent": math.log(2.0) / (2.0 * coat.gamma**2),
        "head_on": head_on(coat.index),
        "densest": head_on(DENSEST),
        "paths": _numbers(paths),
        "films": films,
    }


def _rows(matrix: NDArray[Any]) -> list[list[float]]:
    return [[float(value) for value in row] for row in np.asarray(matrix, np.float64)]


def _numbers(values: Any) -> list[float]:
    return [float(value) for value in np.asarray(values, np.float64).ravel()]

"""Bands of two photographs as tristimulus values under one illuminant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.bands import Camera
from impasto.colour import Display, white_point, xyz_from_coefficients
from impasto.colour.illuminants import Illuminant, checked_illuminant
from impasto.errors import ArgumentError
from impasto.fit.reflectance import fit_reflectance, matching_camera

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Colours:
    """How bands become colours.

    Attributes
    ----------
    matrices
        ``(3, band)`` of each painting, to XYZ with white at Y = 1; None: colours cannot be
        compared.
    white
        XYZ ``(3,)`` of the illuminant.
    words
        The illuminant, or why there are no colours.
    """

    matrices: tuple[Floats, Floats] | None
    white: Floats
    words: str

    def shown(self, side: int, diffuse: NDArray[Any]) -> NDArray[np.float64]:
        """Linear sRGB ``(3, y, x)`` of one of the paintings; without colours its mean as grey."""
        if self.matrices is None:
            return np.repeat(diffuse.mean(axis=0, dtype=np.float64)[None], 3, axis=0)
        matrix = Display.named("srgb").linear_from_xyz @ self.matrices[side]
        return np.asarray(np.tensordot(matrix, diffuse.astype(np.float64), axes=1))


def colours_of(
    bands: tuple[tuple[str, ...], tuple[str, ...]],
    cameras: tuple[Camera | None, Camera | None],
    illuminant: Illuminant,
) -> Colours:
    """The matrices of both paintings.

    With a camera spectra are estimated by Wiener's estimator, which is linear; without, three bands
    are linear sRGB and one is grey, as everywhere.

    Raises
    ------
    ArgumentError
        An illuminant other than D65 for colours without spectra; a camera of other bands.
    """
    checked_illuminant(illuminant)
    name = illuminant if isinstance(illuminant, str) else "the given illuminant"
    matrices = []
    for own, camera in zip(bands, cameras, strict=True):
        if camera is not None:
            matrices.append(_by_spectra(matching_camera(camera, own), illuminant))
        elif len(own) in {1, 3}:
            if illuminant != "D65":
                raise ArgumentError(
                    f"illuminant: {name} needs spectra; give camera=, or leave it at D65, under "
                    "which three bands are sRGB"
                )
            matrices.append(_as_srgb(len(own)))
        else:
            words = f"not compared: {len(own)} bands have no colour without camera="
            return Colours(None, white_point("D65"), words)
    white = white_point(illuminant)
    words = f"under {name}"
    if len({one.shape[1] == 1 for one in matrices}) > 1:
        return Colours(None, white, "not compared: one painting has one band, which has no colour")
    if all(camera is None for camera in cameras):
        words += ", bands taken as linear sRGB"
    return Colours((matrices[0], matrices[1]), white, words)


def _as_srgb(count: int) -> Floats:
    matrix = Display.named("srgb").xyz_from_linear
    return np.asarray(matrix if count == 3 else matrix.sum(axis=1, keepdims=True))


def _by_spectra(camera: Camera, illuminant: Illuminant) -> Floats:
    """``(3, band)``: a linear estimator is known by what it makes of each band alone."""
    count = len(camera.bands)
    unit = np.eye(count, dtype=np.float32).reshape(count, 1, count)
    found = fit_reflectance(None, unit, camera, estimator="wiener")
    fold = xyz_from_coefficients(found.basis, found.wavelengths, illuminant)
    return np.asarray(fold.diffuse @ found.coefficients[:, 0].astype(np.float64))

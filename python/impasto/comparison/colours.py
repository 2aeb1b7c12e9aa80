"""Bands of two photographs as tristimulus values under one illuminant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.bands import Camera
from impasto.colour import Display, white_point, xyz_from_coefficients
from impasto.colour.illuminants import Illuminant, checked_illuminant
from impasto.errors import ArgumentError
from impasto.fit.reflectance import Reflectance, fit_reflectance, matching_camera
from impasto.status import Status

Floats = NDArray[np.float64]
Spectra: TypeAlias = tuple[NDArray[np.float32], Reflectance]
"""Diffuse colours ``(band, y, x)`` and the spectra that were estimated from them."""

MOST_SPECTRA = 20_000
"""Pixels from which the map from bands to colours is found."""


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
    spectra: tuple[Spectra | None, Spectra | None] = (None, None),
) -> Colours:
    """The matrices of both paintings.

    With a camera spectra are estimated by Wiener's estimator, which is linear. With spectra that
    were estimated before, the linear map from bands to colours that is nearest to all of them is
    taken, one map where the bands are the same: what an estimator errs by then cancels. Without
    either, three bands are linear sRGB and one is grey, as everywhere.

    Raises
    ------
    ArgumentError
        An illuminant other than D65 for colours without spectra; a camera of other bands.
    """
    checked_illuminant(illuminant)
    name = illuminant if isinstance(illuminant, str) else "the given illuminant"
    matrices = []
    maps = _nearest(bands, spectra, illuminant)
    for own, camera, nearest in zip(bands, cameras, maps, strict=True):
        if nearest is not None:
            matrices.append(nearest)
        elif camera is not None:
            matrices.append(_by_spectra(matching_camera(camera, own), illuminant))
        elif len(own) in {1, 3}:
            if illuminant != "D65":
                raise ArgumentError(
                    f"illuminant: {name} needs spectra; give camera=, or leave it at D65, under "
                    "which three bands are sRGB"
                )
            matrices.append(_as_srgb(len(own)))
        else:
            words = f"not compared: {len(own)} bands have no colour without a camera"
            return Colours(None, white_point("D65"), words)
    white = white_point(illuminant)
    words = f"under {name}"
    if len({one.shape[1] == 1 for one in matrices}) > 1:
        return Colours(None, white, "not compared: one painting has one band, which has no colour")
    if all(camera is None for camera in cameras) and all(one is None for one in spectra):
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


def _nearest(
    bands: tuple[tuple[str, ...], tuple[str, ...]],
    spectra: tuple[Spectra | None, Spectra | None],
    illuminant: Illuminant,
) -> list[Floats | None]:
    """``(3, band)`` of each painting with spectra, by least squares."""
    pairs = [None if one is None else _pairs(*one, illuminant) for one in spectra]
    first, second = pairs
    if first is not None and second is not None and bands[0] == bands[1]:
        both = np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])
        pairs = [both, both]
    return [
        None if one is None else np.asarray(np.linalg.lstsq(*one, rcond=None)[0].T, np.float64)
        for one in pairs
    ]


def _pairs(
    diffuse: NDArray[np.float32], reflectance: Reflectance, illuminant: Illuminant
) -> tuple[Floats, Floats]:
    """Bands ``(n, band)`` and XYZ ``(n, 3)`` of evenly spread pixels."""
    if reflectance.shape != diffuse.shape[1:]:
        raise ArgumentError(
            f"reflectance: expected spectra of {diffuse.shape[1:]} pixels as the result has, found "
            f"{reflectance.shape}"
        )
    fold = xyz_from_coefficients(reflectance.basis, reflectance.wavelengths, illuminant)
    flat = diffuse.reshape(len(diffuse), -1)
    known = np.flatnonzero(
        np.isfinite(flat).all(axis=0) & (reflectance.status.ravel() < Status.DARK)
    )
    if known.size < len(diffuse):
        raise ArgumentError("reflectance: too few pixels were estimated to know their colours")
    every = known[np.linspace(0, known.size - 1, min(known.size, MOST_SPECTRA)).astype(int)]
    coefficients = reflectance.coefficients.reshape(len(reflectance.basis), -1)[:, every]
    return flat[:, every].T.astype(np.float64), (fold.diffuse @ coefficients.astype(np.float64)).T

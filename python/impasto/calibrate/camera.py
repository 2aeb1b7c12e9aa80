"""A camera from one photograph of a ColorChecker: sensitivities, matrix, and how good both are."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.bands import Camera
from impasto.calibrate.chart import (
    COLUMNS,
    GRID,
    ROWS,
    Array,
    Chart,
    chart_reflectances,
    read_chart,
)
from impasto.calibrate.sensitivities import Sensitivities, fit_sensitivities
from impasto.colour import delta_e, lab_from_xyz, spectrum, xyz_from_spectrum
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.fit.reflectance import fit_reflectance
from impasto.io.images import read_image
from impasto.io.session.frames import FrameSource, read_dark
from impasto.io.tone_curve import named_curve

FOLDS = 6
"""Groups of patches that are left out in turn where reflectance is estimated."""


@dataclass(frozen=True, eq=False)
class ChartCamera:
    """What a photograph of a ColorChecker tells about the camera that took it.

    Parameters
    ----------
    camera
        Sensitivities under the light of the chart, for :func:`impasto.fit_reflectance`.
    chart
        What was read.
    white
        ``(band,)`` linear light of a perfect white in the middle of the chart.
    matrix
        ``(3, band)`` from bands relative to that white to XYZ under the light.
    fit
        The sensitivities with the slope of the light and errors of patches left out.
    delta_e
        ``(24,)`` CIEDE2000 of each patch under the light, its reflectance estimated by
        :func:`impasto.fit_reflectance` with a camera from the others; NaN of patches not used.
    matrix_delta_e
        ``(24,)`` the same by a matrix from the others.
    """

    camera: Camera
    chart: Chart
    white: Array
    matrix: Array
    fit: Sensitivities
    delta_e: Array
    matrix_delta_e: Array

    def summary(self) -> str:
        """Errors in a sentence."""
        mean, worst = np.nanmean(self.delta_e), np.nanmax(self.delta_e)
        matrix, most = np.nanmean(self.matrix_delta_e), np.nanmax(self.matrix_delta_e)
        return (
            f"patches that were left out: {mean:.2f} dE00 in the mean, {worst:.2f} at most "
            f"(a matrix: {matrix:.2f}, {most:.2f})"
        )


def camera_from_chart(
    photograph: str | os.PathLike[str] | NDArray[Any],
    illuminant: Any,
    *,
    encoding: Encoding | str | None = None,
    corners: ArrayLike | None = None,
    bands: tuple[str, ...] | None = None,
    name: str = "photograph",
) -> ChartCamera:
    """Find a ColorChecker with 24 patches in a photograph and make a camera of it.

    Parameters
    ----------
    photograph
        A file, or ``(band, y, x)`` linear light in which 1 is clipped.
    illuminant
        The light, as :class:`impasto.Camera` takes it: a name such as ``"D50"``, kelvin, or
        ``(31,)`` power from 400 to 700 nm.
    encoding
        How linear light became the codes of the file. Default: 8-bit files are sRGB, others linear.
    corners
        ``(4, 2)`` x and y in pixels of the middles of dark skin, bluish green, black and white.
        Default: the chart is found.
    bands
        One name per band, as in :class:`impasto.Camera`.
    name
        Of an array, for messages.

    Returns
    -------
    ChartCamera
        The camera and its errors.

    Raises
    ------
    ArgumentError
        No chart, an overexposed one, an unknown light or encoding; see :func:`read_chart`.
    """
    power = spectrum(illuminant, GRID)
    if isinstance(photograph, np.ndarray):
        if photograph.ndim != 3 or encoding is not None:
            raise ArgumentError(
                "photograph: expected linear light (band, y, x) without an encoding, or a file, "
                f"found an array of shape {photograph.shape}"
            )
        linear, where = photograph, name
    else:
        linear, where = linear_photograph(photograph, encoding), str(photograph)
    chart = read_chart(linear, where, corners)
    used = np.flatnonzero(chart.used)
    reflectance = chart_reflectances()
    rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    places = np.stack([columns / (COLUMNS - 1), rows / (ROWS - 1)], axis=1) - 0.5
    fit = fit_sensitivities(chart.light[used], reflectance[used], places[used])
    white = fit.weights.sum(axis=1)
    camera = Camera(GRID, _sensitivities(fit.weights, power), illuminant, bands)
    shading = 1.0 + places @ fit.slope
    responses = chart.light / shading[:, None] / white
    colours = reflectance @ xyz_from_spectrum(GRID, illuminant).T
    estimated = np.full_like(colours, np.nan)
    for group in range(FOLDS):
        left, others = used[group::FOLDS], np.delete(used, np.s_[group::FOLDS])
        own = fit_sensitivities(
            chart.light[others], reflectance[others], places[others], fit.smoothness
        )
        apart = Camera(GRID, _sensitivities(own.weights, power), illuminant, bands)
        estimated[left] = _colours(
            chart.light[left] / (1.0 + places[left] @ own.slope)[:, None] / own.weights.sum(axis=1),
            apart,
            illuminant,
        )
    by_matrix = np.full_like(colours, np.nan)
    for patch in used:
        others = used[used != patch]
        by_matrix[patch] = responses[patch] @ _matrix(responses[others], colours[others]).T
    perfect = xyz_from_spectrum(GRID, illuminant).sum(axis=1)
    return ChartCamera(
        camera,
        chart,
        white,
        _matrix(responses[used], colours[used]),
        fit,
        _differences(estimated, colours, perfect),
        _differences(by_matrix, colours, perfect),
    )


def linear_photograph(
    path: str | os.PathLike[str],
    encoding: Encoding | str | None = None,
    dark: FrameSource | None = None,
) -> NDArray[np.float32]:
    """``(band, y, x)`` linear light of a file, full scale 1.

    Parameters
    ----------
    path
        What :func:`impasto.io.read_image` reads.
    encoding
        Default: 8-bit files are sRGB, others linear.
    dark
        Dark frame, folder of dark frames, or a black level in codes, as for
        :func:`impasto.read_stack`.
    """
    codes = read_image(Path(path))
    full = float(np.iinfo(codes.dtype).max) if codes.dtype.kind == "u" else 1.0
    usual = "srgb" if codes.dtype == np.uint8 else "linear"
    chosen = (
        encoding
        if isinstance(encoding, Encoding)
        else Encoding(usual if encoding is None else named_curve(encoding), full)
    )
    light = chosen.decode(codes)
    if dark is None:
        return light
    bands, rows, columns = light.shape
    black = read_dark(dark, (bands, rows, columns), chosen, None, None)
    return np.asarray((light - black) / (1.0 - black), dtype=np.float32)


def _sensitivities(weights: Array, power: Array) -> Array:
    """Where the light has nothing, nothing is known of the camera."""
    there = power > 1e-6 * power.max()
    return np.where(there, weights / np.where(there, power, 1.0), 0.0)


def _matrix(responses: Array, colours: Array) -> Array:
    """Least squares of relative errors, so that dark patches count."""
    weight = 1.0 / (colours[:, 1:2] + 0.05)
    found = np.linalg.lstsq(weight * responses, weight * colours, rcond=None)[0]
    return np.asarray(found.T, dtype=np.float64)


def _colours(responses: Array, camera: Camera, illuminant: Any) -> Array:
    """XYZ of patches whose reflectance is estimated from the camera's bands."""
    planes = np.ascontiguousarray(responses.T[:, None], dtype=np.float32)
    found = fit_reflectance(None, planes, camera)
    spectra = found.coefficients[:, 0].T.astype(np.float64) @ found.basis
    return np.asarray(spectra @ xyz_from_spectrum(found.wavelengths, illuminant).T)


def _differences(found: Array, colours: Array, white: Array) -> Array:
    known = np.isfinite(found).all(axis=1)
    differences = np.full(len(colours), np.nan)
    labs = [lab_from_xyz(xyz[known].T, white) for xyz in (found, colours)]
    differences[known] = delta_e(*labs)
    return differences

"""Errors of a fit relative to the truth of a simulated painting."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import holding, instance
from impasto.colour import (
    delta_e,
    interpolation_matrix,
    lab_from_xyz,
    white_point,
    xyz_from_coefficients,
)
from impasto.errors import ArgumentError
from impasto.simulate.paintings import Painting
from impasto.simulate.planning import Truth

ILLUMINANTS = ("D65", "A")
"""Illuminants under which colours are compared."""
_BLOCK = 32768
"""Pixels per block of expanded spectra."""


@dataclass(frozen=True, eq=False)
class Score:
    """Errors of a fit relative to the truth, over the pixels that were estimated.

    Attributes
    ----------
    estimated
        Share of the pixels with a normal and a colour.
    normal_mean, normal_median, normal_p95
        Angle between fitted and true normal, degrees.
    reflectance_rmse
        Root mean square over pixels and wavelengths; white is 1. NaN without a reflectance.
    colour_mean, colour_p95
        CIEDE2000 of the diffuse colour, by illuminant; empty without a reflectance.
    beta, gamma
        Relative error of the pooled specular parameters; the truth is the median of the top coat.
        NaN if the painting has no varnish or none was found, and for lobes per segment or pixel.
    normal_error, colour_error
        Maps ``(y, x)``: degrees, and CIEDE2000 under D65 (None without a reflectance).
    """

    estimated: float
    normal_mean: float
    normal_median: float
    normal_p95: float
    reflectance_rmse: float
    colour_mean: dict[str, float]
    colour_p95: dict[str, float]
    beta: float
    gamma: float
    normal_error: NDArray[np.float32]
    colour_error: NDArray[np.float32] | None

    def numbers(self) -> dict[str, Any]:
        """All values except the maps."""
        return {name: value for name, value in asdict(self).items() if not name.endswith("_error")}


def score(truth: Truth, sbrdf: Any, reflectance: Any = None) -> Score:
    """Compare a fit with the truth of its photographs.

    Parameters
    ----------
    truth
        ``Capture.truth``.
    sbrdf
        The result of :func:`impasto.fit_sbrdf` for ``Capture.stack``.
    reflectance
        The result of :func:`impasto.fit_reflectance`.

    Raises
    ------
    ArgumentError
        Arguments of other types, or maps of another size than the painting's.
    """
    instance(truth, Truth, "truth", "the truth of an impasto.simulate.Capture")
    holding(("normal", "diffuse"), sbrdf, "sbrdf", "what impasto.fit_sbrdf returns")
    _same_size(sbrdf.normal, truth, "sbrdf")
    if reflectance is not None:
        spectral = ("coefficients", "basis", "wavelengths")
        holding(spectral, reflectance, "reflectance", "what impasto.fit_reflectance returns")
        _same_size(reflectance.coefficients, truth, "reflectance")
    angle = normal_error(sbrdf.normal, truth.normal)
    known = np.isfinite(angle) & np.isfinite(sbrdf.diffuse).all(axis=0)
    rmse, means, tails = float("nan"), dict[str, float](), dict[str, float]()
    daylight: NDArray[np.float32] | None = None
    if reflectance is not None:
        rmse = _rmse(truth.painting, reflectance)
        for name in ILLUMINANTS:
            difference = colour_error(truth.painting, reflectance, name)
            values = difference[np.isfinite(difference)]
            means[name], tails[name] = _mean(values), _percentile(values, 95)
            daylight = difference if name == "D65" else daylight
    angles = angle[known]
    return Score(
        estimated=float(known.mean()),
        normal_mean=_mean(angles),
        normal_median=_percentile(angles, 50),
        normal_p95=_percentile(angles, 95),
        reflectance_rmse=rmse,
        colour_mean=means,
        colour_p95=tails,
        beta=_relative(sbrdf, "beta", truth),
        gamma=_relative(sbrdf, "gamma", truth),
        normal_error=angle,
        colour_error=daylight,
    )


def normal_error(normal: ArrayLike, truth: ArrayLike) -> NDArray[np.float32]:
    """Angle ``(y, x)`` in degrees between unit vectors ``(3, y, x)``; NaN stays NaN.

    From ``atan2(|a x b|, a . b)``, which is exact for small angles where an arc cosine is not.
    """
    a, b = np.asarray(normal, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    across = np.linalg.norm(np.cross(a, b, axis=0), axis=0)
    angle = np.arctan2(across, (a * b).sum(axis=0))
    return np.asarray(np.degrees(angle), dtype=np.float32)


def colour_error(
    painting: Painting, reflectance: Any, illuminant: str = "D65"
) -> NDArray[np.float32]:
    """CIEDE2000 ``(y, x)`` between estimated and true diffuse colour under an illuminant."""
    fold = xyz_from_coefficients(reflectance.basis, reflectance.wavelengths, illuminant)
    found = np.tensordot(fold.diffuse, reflectance.coefficients, axes=(1, 0))
    white = white_point(illuminant)
    first, second = (lab_from_xyz(xyz, white) for xyz in (found, painting.xyz(illuminant)))
    return np.asarray(delta_e(first, second), dtype=np.float32)


def _same_size(maps: NDArray[Any], truth: Truth, name: str) -> None:
    height, width = truth.painting.size
    if maps.shape[1:] != (height, width):
        size = " x ".join(map(str, maps.shape[:0:-1]))
        raise ArgumentError(
            f"{name}: expected {width} x {height} pixels as of the painting, found {size}; "
            "fit the photographs that belong to this truth"
        )


def _rmse(painting: Painting, reflectance: Any) -> float:
    """Over the estimator's wavelengths; the true spectra are interpolated to them."""
    resample = interpolation_matrix(painting.wavelengths, reflectance.wavelengths)
    true_basis = painting.basis @ resample.T
    true, found = (
        planes.reshape(len(planes), -1)
        for planes in (painting.coefficients, reflectance.coefficients)
    )
    total, count = 0.0, 0
    for start in range(0, true.shape[1], _BLOCK):
        part = slice(start, start + _BLOCK)
        error = found[:, part].T @ reflectance.basis - true[:, part].T @ true_basis
        error = error[np.isfinite(error[:, 0])]
        total += float((error * error).sum())
        count += error.size
    return float(np.sqrt(total / count)) if count else float("nan")


def _relative(sbrdf: Any, name: str, truth: Truth) -> float:
    """Relative error; NaN for a fit without such a number for the whole painting."""
    found, true = getattr(sbrdf, name, None), float(np.median(getattr(truth, name)[0]))
    if found is None or np.ndim(found) > 0 or true == 0.0:
        return float("nan")
    return float(found) / true - 1.0


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else float("nan")


def _percentile(values: NDArray[Any], share: float) -> float:
    return float(np.percentile(values, share)) if values.size else float("nan")

"""Sensitivities of a camera's bands from photographs under narrow-band light of known power.

Photograph k of exposure time t reads y_k = t P_k integral of h_k(w) s(w) dw: P its radiant power, h
the bandpass of the monochromator, of area 1 about the wavelength. What differs from s_k is the
curvature of s over the bandpass: s - y is minus half its variance times the second difference of y,
the correction of Stearns and Stearns [@stearns1988bandpass]. It is linear: errors of the means go
through it exactly.

Noise of a mean comes from its own photograph: the mean square successive difference of pixels along
the lit area [@vonneumann1941successive] knows nothing of how evenly it is lit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of
from impasto.bands import Camera
from impasto.calibrate.monochromator_series import Reading, Window, read_series
from impasto.errors import ArgumentError
from impasto.io.cameras import write_camera
from impasto.io.notes import few
from impasto.io.session.frames import FrameSource

Floats = NDArray[np.float64]
Slit = Literal["triangle", "gaussian"]

SHARE = {"triangle": 1.0 / 6.0, "gaussian": 1.0 / (8.0 * np.log(2.0))}
"""Variance of a bandpass of full width at half maximum 1."""
PASSED = 0.01
"""Sensitivity, relative to the largest, down to which a band passes light."""
LEAKY = 0.01
"""Share of a band's sensitivity outside of what it passes that deserves a warning."""
SPARSE = 3.0
"""Bandwidths between two wavelengths from which the curve between is not seen."""
SURE = 3.0
"""Standard deviations from which a difference counts."""


@dataclass(frozen=True, eq=False)
class MonochromatorCamera:
    """What a series of narrow-band photographs tells about a camera.

    Attributes
    ----------
    wavelengths
        ``(n,)`` nm, each once.
    sensitivities
        ``(band, n)`` share of full scale per unit of radiant power and second, or per unit of
        power where no times are known; noise may take it below 0.
    covariance
        ``(band, n, n)`` of these.
    names
        Of the bands.
    passed
        ``(band, 2)`` nm: between the first and the last wavelength about the largest value with at
        least 1 % of it.
    leakage
        ``(band, 2)``: share of the sum over wavelengths that lies outside of ``passed``, and its
        standard deviation.
    correction
        ``(band,)`` largest change by the correction for the bandwidth, relative to the largest
        value.
    reading
        The means that it was made of.
    findings
        What deserves attention, in words.
    """

    wavelengths: Floats
    sensitivities: Floats
    covariance: Floats
    names: tuple[str, ...]
    passed: Floats
    leakage: Floats
    correction: Floats
    reading: Reading
    findings: tuple[str, ...] = field(default=())

    @property
    def sigma(self) -> Floats:
        """``(band, n)`` standard deviations of the sensitivities."""
        return np.asarray(np.sqrt(np.einsum("bii->bi", self.covariance)))

    def camera(self, illuminant: str | float | Floats) -> Camera:
        """The camera under a light, without values below 0."""
        return Camera(self.wavelengths, np.maximum(self.sensitivities, 0.0), illuminant, self.names)

    def save(self, path: str | Path, illuminant: str | float | None = None) -> None:
        """Write a file for :func:`impasto.io.read_camera`, with the standard deviations.

        Parameters
        ----------
        path
            The file, replaced atomically.
        illuminant
            The light of the painting's photographs; None: the file names none, and its reader needs
            one.
        """
        camera = self.camera("E" if illuminant is None else illuminant)
        write_camera(path, camera, sigma=self.sigma, light=illuminant is not None)


def camera_from_monochromator(
    folder: str | Path,
    series: str | Path,
    *,
    dark: FrameSource | None = None,
    region: Window | None = None,
    slit: Slit = "triangle",
    correct: bool = True,
    encoding: str | None = None,
    saturation: float | None = None,
    bands: Sequence[str] | None = None,
) -> MonochromatorCamera:
    """Sensitivities from photographs of a white patch or an exit slit under narrow-band light.

    Parameters
    ----------
    folder
        The photographs: camera, patch and aperture unchanged.
    series
        CSV file with the columns ``photograph`` (its name), ``wavelength`` and ``bandwidth`` in nm
        (full width at half maximum) and ``power`` (radiant, in any unit), optionally
        ``power_sigma`` (standard deviation, the same unit) and ``seconds`` (exposure time; default:
        that of EXIF where all photographs have one, else all alike). A wavelength may have several
        photographs, such as a shorter one for a band that clips.
    dark
        Dark frame, folder of dark frames, or a black level in codes; default: 0.
    region
        Top, left, height and width of the area that is read. Default: the lit area is found.
    slit
        Shape of the bandpass: ``triangle`` (equal slits) or ``gaussian``.
    correct
        Whether the bandwidth is corrected for; else sensitivities are those seen through it.
    encoding
        Tone curve; default: 8-bit files are sRGB, others linear.
    saturation
        Code from which samples are clipped; default: the largest.
    bands
        One name per band, as in :class:`impasto.Camera`.

    Raises
    ------
    ArgumentError
        Photographs without a line or the other way round, clipped ones without another of that
        wavelength, no lit area, fewer than three wavelengths.
    CorruptInputError
        A file of the series or a photograph that is none.
    """
    one_of(slit, ("triangle", "gaussian"), "slit")
    reading = read_series(
        Path(folder), Path(series), dark=dark, region=region, encoding=encoding,
        saturation=saturation,
    )  # fmt: skip
    wavelengths, widths, values, variance = _combined(reading)
    second = _second_difference(wavelengths)
    matrix = np.eye(len(wavelengths))
    if correct:
        matrix -= (0.5 * SHARE[slit] * np.square(widths))[:, None] * second
    sensitivities = values @ matrix.T
    covariance = np.einsum("ij,bj,kj->bik", matrix, variance, matrix)
    names = Camera(wavelengths, np.maximum(sensitivities, 0.0), "E", bands).bands
    if (sensitivities.max(axis=1) <= 0.0).any():
        dark_band = names[int(sensitivities.max(axis=1).argmin())]
        raise ArgumentError(f"{series}: band {dark_band} saw no light at any wavelength")
    passed, leakage = _leakage(wavelengths, sensitivities, covariance)
    largest = sensitivities.max(axis=1)
    found = MonochromatorCamera(
        wavelengths, sensitivities, covariance, names, passed, leakage,
        np.abs(sensitivities - values).max(axis=1) / largest, reading,
    )  # fmt: skip
    return MonochromatorCamera(**{**vars(found), "findings": tuple(_findings(found, widths))})


def _combined(reading: Reading) -> tuple[Floats, Floats, Floats, Floats]:
    """Wavelengths, bandwidths, and ``(band, n)`` values and variances of unclipped photographs."""
    wavelengths, where = np.unique(reading.wavelengths, return_inverse=True)
    if len(wavelengths) < 3:
        raise ArgumentError(
            f"{reading.source}: {len(wavelengths)} wavelengths, three are the least"
        )
    widths = np.zeros(len(wavelengths))
    for number in range(len(wavelengths)):
        own = np.unique(reading.bandwidths[where == number])
        if len(own) > 1:
            raise ArgumentError(
                f"{reading.source}: {wavelengths[number]:g} nm has the bandwidths "
                f"{', '.join(f'{one:g}' for one in own)}; photographs of a wavelength share one"
            )
        widths[number] = own[0]
    bands = reading.values.shape[1]
    values, variance = np.zeros((2, bands, len(wavelengths)))
    blind = []
    for number, wavelength in enumerate(wavelengths.tolist()):
        for band in range(bands):
            usable = (where == number) & ~reading.clipped[:, band]
            if not usable.any():
                lost = np.flatnonzero(where == number)
                blind += [f"{reading.names[one]} ({wavelength:g} nm, band {band})" for one in lost]
                continue
            weight = 1.0 / reading.variance[usable, band]
            values[band, number] = (weight * reading.values[usable, band]).sum() / weight.sum()
            variance[band, number] = 1.0 / weight.sum()
    if blind:
        raise ArgumentError(
            f"{reading.source}: clipped: {few(blind)}; photograph these wavelengths again with "
            "less light or a shorter exposure, and add them to the series"
        )
    return wavelengths, widths, values, variance


def _second_difference(x: Floats) -> Floats:
    """``(n, n)`` that of three neighbours at any distances, continued on a line at the ends."""
    count = len(x)
    matrix = np.zeros((count, count))
    for row in range(1, count - 1):
        before, after = x[row] - x[row - 1], x[row + 1] - x[row]
        matrix[row, row - 1] = 2.0 / (before * (before + after))
        matrix[row, row] = -2.0 / (before * after)
        matrix[row, row + 1] = 2.0 / (after * (before + after))
    for end, one, other in ((0, 1, 2), (count - 1, count - 2, count - 3)):
        if count == 3:
            matrix[end] = matrix[1]
        else:
            far = (x[end] - x[one]) / (x[one] - x[other])
            matrix[end] = matrix[one] + far * (matrix[one] - matrix[other])
    return matrix


def _leakage(wavelengths: Floats, curves: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """What each band passes, and its share outside of that with a standard deviation."""
    weight = np.gradient(wavelengths)
    weight[[0, -1]] *= 0.5  # the trapezoidal rule
    passed, leakage = np.zeros((2, len(curves), 2))
    for band, curve in enumerate(curves):
        above = curve >= PASSED * curve.max()
        low = high = int(curve.argmax())
        while low > 0 and above[low - 1]:
            low -= 1
        while high < len(curve) - 1 and above[high + 1]:
            high += 1
        outside = np.ones(len(curve))
        outside[low : high + 1] = 0.0
        whole = float(weight @ curve)
        share = float((outside * weight) @ curve) / whole
        slope = weight * (outside - share) / whole
        passed[band] = wavelengths[low], wavelengths[high]
        leakage[band] = share, np.sqrt(slope @ covariance[band] @ slope)
    return passed, leakage


def _findings(found: MonochromatorCamera, widths: Floats) -> list[str]:
    said = []
    reading = found.reading
    spared = [
        f"{name} ({', '.join(found.names[b] for b in np.flatnonzero(bands))})"
        for name, bands in zip(reading.names, reading.clipped, strict=True)
        if bands.any()
    ]
    if spared:
        said.append(f"clipped, other photographs of the wavelength were taken: {few(spared)}")
    steps = np.diff(found.wavelengths)
    wide = steps > SPARSE * np.minimum(widths[:-1], widths[1:])
    if wide.any():
        at = int(steps.argmax())
        said.append(
            f"{found.wavelengths[at]:g} to {found.wavelengths[at + 1]:g} nm is more than "
            f"{SPARSE:g} bandwidths: what the bands see between is not measured"
        )
    for band, name in enumerate(found.names):
        share, sigma = found.leakage[band]
        if share > LEAKY and share > SURE * sigma:
            low, high = found.passed[band]
            said.append(
                f"{name}: {100 * share:.1f} % of the sensitivity lies outside of {low:g} to "
                f"{high:g} nm; is it the camera, or stray light of the monochromator?"
            )
        ends = found.sensitivities[band, [0, -1]]
        spread = found.sigma[band, [0, -1]]
        for end, value, error in zip(found.wavelengths[[0, -1]], ends, spread, strict=True):
            if value > PASSED * found.sensitivities[band].max() + SURE * error:
                said.append(f"{name}: still sensitive at {end:g} nm, where the series ends")
    return said

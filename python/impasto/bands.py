"""Cameras: the sensitivities of their bands, and the light of the photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.checks import instance
from impasto.colour import interpolation_matrix, spectrum
from impasto.colour.wavelengths import Floats, checked_spectra, checked_wavelengths
from impasto.errors import ArgumentError

Integration = Literal["1nm", "sum"]


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Camera:
    """Band sensitivities and the light of the photographs.

    A band's response to a reflectance S is the integral of E(λ) S(λ) R(λ) (eq. 1 of both Tominaga
    papers) divided by its response to a perfect white: the board that is S = 1 everywhere reads
    1.0 in each band, as the samples of a :class:`~impasto.Stack` do.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm, strictly increasing: the grid of the sensitivities.
    sensitivities
        ``(band, n)``, in any unit that is the same over a row (the white board removes it). Zero
        outside the grid. Filters in front of the lens are multiplied in.
    illuminant
        The light: a name (``"A"``, ``"D65"``, ``"FL2"``), a temperature in kelvin (a blackbody,
        eq. 8), or ``(n,)`` power per wavelength on the same grid.
    bands
        One name per band; default ``"red", "green", "blue"`` for three, ``"band 0"`` ... else.

    Examples
    --------
    >>> import numpy as np
    >>> from impasto import Camera
    >>> wavelengths = np.arange(400, 701, 10)
    >>> centres = np.array([450, 550, 620])
    >>> curves = np.exp(-(((wavelengths - centres[:, None]) / 40.0) ** 2))
    >>> camera = Camera(wavelengths, curves, "A")
    >>> camera.response(np.full(31, 0.5), wavelengths)
    array([0.5, 0.5, 0.5])
    """

    wavelengths: Floats
    sensitivities: Floats
    illuminant: str | float | Floats
    bands: tuple[str, ...]

    def __init__(
        self,
        wavelengths: ArrayLike,
        sensitivities: ArrayLike,
        illuminant: str | float | ArrayLike,
        bands: Sequence[str] | None = None,
    ) -> None:
        grid = checked_wavelengths(wavelengths).copy()
        curves = checked_spectra(sensitivities, grid, "sensitivities", "band")
        names = _band_names(len(curves)) if bands is None else tuple(str(name) for name in bands)
        if len(names) != len(curves):
            raise ArgumentError(f"bands: expected {len(curves)} names, found {len(names)}")
        light: Any = illuminant
        if not isinstance(illuminant, str):
            light = np.array(illuminant, dtype=np.float64)
            light = float(light) if light.ndim == 0 else light
        for array in (grid, curves, light):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        set_ = object.__setattr__
        set_(self, "wavelengths", grid)
        set_(self, "sensitivities", curves)
        set_(self, "illuminant", light)
        set_(self, "bands", names)
        # Raises an error that names the band if a white board gives no response.
        self._weights(self.wavelengths)

    def __repr__(self) -> str:
        light = self.illuminant
        under = "a spectrum" if isinstance(light, np.ndarray) else light
        under = f"{under:g} K" if isinstance(under, float) else under
        grid = self.wavelengths
        return f"<Camera {', '.join(self.bands)} from {grid[0]:g} to {grid[-1]:g} nm under {under}>"

    @classmethod
    def srgb(cls) -> Camera:
        """The camera whose bands are linear sRGB: the CIE 1931 observer, D65, and sRGB's matrix.

        For photographs that were developed to sRGB colours, as a camera's JPEGs are: what they say
        about spectra is what an eye in daylight could say. Some sensitivities are negative.
        """
        from impasto.colour import Display, xyz_from_spectrum

        grid = np.arange(380.0, 781.0)
        observer = xyz_from_spectrum(grid, "E")
        return cls(grid, Display.named("srgb").linear_from_xyz @ observer, "D65")

    def operator(self, wavelengths: ArrayLike, *, integration: Integration = "1nm") -> Floats:
        """The matrix H ``(band, n)`` with rho = H @ S; its rows sum to 1.

        Parameters
        ----------
        wavelengths
            ``(n,)`` nm, strictly increasing: where reflectances are sampled.
        integration
            ``"1nm"`` integrates on a 1 nm grid with the reflectance interpolated by cubic pieces
            and continued by its end values; ``"sum"`` is the plain sum of the papers over the
            samples of the reflectance, which depends on their spacing.
        """
        grid = checked_wavelengths(wavelengths)
        if integration == "sum":
            return self._weights(grid)
        if integration != "1nm":
            raise ArgumentError(f'integration: expected "1nm" or "sum", found {integration!r}')
        first, last = self.wavelengths[0], self.wavelengths[-1]
        fine = np.arange(np.ceil(first), np.floor(last) + 0.5)
        return np.asarray(self._weights(fine) @ interpolation_matrix(grid, fine))

    def response(
        self,
        reflectance: ArrayLike,
        wavelengths: ArrayLike,
        *,
        integration: Integration = "1nm",
    ) -> Floats:
        """Responses of the bands ``(..., band)``; a perfect white is 1.0 in each.

        Parameters
        ----------
        reflectance
            ``(..., n)`` relative to the white board.
        wavelengths
            ``(n,)`` nm of the reflectances.
        integration
            See :meth:`operator`.
        """
        spectra = np.asarray(reflectance, dtype=np.float64)
        operator = self.operator(wavelengths, integration=integration)
        if spectra.ndim == 0 or spectra.shape[-1] != operator.shape[1]:
            raise ArgumentError(
                f"reflectance: expected (..., {operator.shape[1]}), one value per wavelength, "
                f"found shape {spectra.shape}"
            )
        return np.asarray(spectra @ operator.T)

    def _weights(self, at: Floats) -> Floats:
        """Light times sensitivity ``(band, m)`` at some wavelengths; rows sum to 1."""
        curves = np.stack(
            [np.interp(at, self.wavelengths, curve, 0.0, 0.0) for curve in self.sensitivities]
        )
        measured = isinstance(self.illuminant, np.ndarray)
        light = (self.wavelengths, self.illuminant) if measured else self.illuminant
        with np.errstate(over="ignore", invalid="ignore"):  # refused below
            weights = curves * spectrum(light, at)
            white = weights.sum(axis=1, keepdims=True)
        if not np.isfinite(white).all():
            band = self.bands[int(np.argmin(np.isfinite(white[:, 0])))]
            raise ArgumentError(
                f"sensitivities: those of band {band!r} times the illuminant exceed the largest "
                "number; give both relative to 1"
            )
        if not (white > 0).all():
            band = self.bands[int(np.argmin(white[:, 0]))]
            raise ArgumentError(
                f"sensitivities: band {band!r} has no response to a white board under this "
                f"illuminant between {at[0]:g} and {at[-1]:g} nm"
            )
        return np.asarray(weights / white)


def checked_camera(camera: Any) -> Camera:
    """The camera, or an error that says how to make one."""
    made_by = "impasto.io.read_camera or Camera.srgb"
    instance(camera, Camera, "camera", f"an impasto.Camera, as of {made_by}")
    found: Camera = camera
    return found


def _band_names(count: int) -> tuple[str, ...]:
    if count == 3:
        return ("red", "green", "blue")
    return tuple(f"band {i}" for i in range(count))

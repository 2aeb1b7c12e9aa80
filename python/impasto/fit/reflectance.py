"""Spectral reflectance of every pixel, from the diffuse responses of a few camera bands."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any, Literal, Protocol, TypeAlias, get_args, runtime_checkable
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import instance, is_whole, one_of
from impasto._internal.recent import Recent
from impasto._internal.waiting import floats, wait_for
from impasto._internal.windows import place
from impasto.bands import Camera, Integration, checked_camera
from impasto.colour.wavelengths import Floats, checked_wavelengths
from impasto.errors import ArgumentError
from impasto.fit.interface import interface_operator
from impasto.fit.noise import noise_of_diffuse
from impasto.fit.pixel_maps import PixelMaps
from impasto.fit.saved import over
from impasto.io.results import read_maps, write_maps
from impasto.stack import Stack
from impasto.training import Training, TrainingSpectra, checked_training

Estimator = Literal["ensemble", "root-polynomial", "radial-basis", "wiener", "linear-model"]

DEFAULT_NOISE = 1e-3
"""Noise of a diffuse response, relative to white, where there is no stack to measure it on."""

DEFAULT_GRID = np.arange(400.0, 701.0, 5.0)
"""Wavelengths of spectra in nm, unless others are asked for."""

NOISE_FLOOR = 1e-4
"""Measured noise below this is a simulation's or a short stack's luck, not a camera's."""

KIND = "impasto.Reflectance"
"""Says in a saved file what it holds."""

COVERED = 0.95
"""Share of the estimates of training spectra that lie within the interval, at each wavelength."""
NORMAL = 1.96
"""Standard deviations within which that share of normally distributed errors lies."""

SEED = 1
"""Fixes the noise replicas, folds and centres: the same call gives the same estimate."""


@runtime_checkable
class _Sbrdf(Protocol):
    @property
    def diffuse(self) -> NDArray[np.float32]: ...


@runtime_checkable
class _Normals(Protocol):
    @property
    def albedo(self) -> NDArray[np.float32]: ...


DiffuseSource: TypeAlias = _Sbrdf | _Normals | ArrayLike
"""An ``Sbrdf``, a ``Normals`` or an array ``(band, y, x)``."""


@dataclass(frozen=True, eq=False, repr=False)
class Reflectance(PixelMaps):
    """Spectral reflectance of every pixel as coefficients of a few basis spectra.

    Attributes
    ----------
    coefficients
        ``(k, y, x)`` float32, unclipped. NaN where the status says that nothing was estimated;
        zero where it is ``DARK``.
    basis
        ``(k, n)`` float64, orthonormal rows, strongest first.
    wavelengths
        ``(n,)`` nm.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`: that of the diffuse source, and
        ``ILL_CONDITIONED`` where some bands were missing and the others stood in.
    info
        How it was estimated: estimator, training set, noise and where it is known from, and the
        diagnostics ``condition`` (of H R H^T), ``effective_rank``, ``noise_gain`` (rms over
        wavelengths per unit of noise), ``training_rmse``, ``truncation``, ``ridge``, ``gamma``.
    interface
        ``(k, band)`` float64: from the strengths of a coloured lobe in the camera's bands to the
        coefficients of its spectrum, the smoothest that has them (van Trigt 1990); None in files
        of versions that had none.
    spread
        ``(n,)`` float64: the error below which 95 % of the training spectra are estimated at each
        wavelength, relative to the root mean square of the estimated spectrum. They are the spectra
        that the estimator was made of: left out of it, their errors were up to 5 % larger. None in
        files of versions that had none.
    """

    coefficients: NDArray[np.float32] = field(metadata=over("k", "y", "x"))
    basis: Floats
    wavelengths: Floats
    status: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    info: dict[str, Any]
    interface: Floats | None = None
    spread: Floats | None = None

    def __repr__(self) -> str:
        count, height, width = self.coefficients.shape
        grid = self.wavelengths
        return (
            f"<Reflectance {width} x {height} pixels, {count} basis spectra from {grid[0]:g} to "
            f"{grid[-1]:g} nm, {self.info.get('estimator', 'unknown estimator')}>"
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: size, basis, estimator and colours under D65."""
        from impasto.notebook import reflectance_view

        return reflectance_view(self)

    def spectrum(self, y: int, x: int) -> Floats:
        """Reflectance ``(n,)`` of one pixel, unclipped; negative numbers count from the end.

        Raises
        ------
        ArgumentError
            A pixel outside of the painting.
        """
        y, x = place(y, x, self.coefficients.shape[1:])
        return np.asarray(self.coefficients[:, y, x].astype(np.float64) @ self.basis)

    def interval(self, y: int, x: int) -> Floats | None:
        """Between which spectra that of a pixel lies, ``(2, n)``, at 95 % for each wavelength.

        Errors of the estimator as on its training spectra (:attr:`spread`), and the noise of the
        responses, the same at all wavelengths. Paints that resemble none of the training spectra
        lie outside more often. None where the spread is not known.
        """
        if self.spread is None:
            return None
        found = self.spectrum(y, x)
        size = float(np.sqrt(np.mean(found**2)))
        half = np.hypot(self.spread * size, noise_of_spectra(self.info))
        return np.stack([found - half, found + half])

    def cube(self, clip: tuple[float, float] | None = None) -> NDArray[np.float32]:
        """Reflectance ``(n, y, x)`` of all pixels: n / k times the memory of the coefficients.

        Parameters
        ----------
        clip
            Limits, ``(0, 1)`` as a rule; default: none (fluorescent paints exceed 1).
        """
        basis = self.basis.astype(np.float32)
        cube = np.tensordot(basis, self.coefficients, axes=(0, 0))
        return np.asarray(cube if clip is None else np.clip(cube, *clip, out=cube))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an ``.npz``; the file appears whole or not at all."""
        arrays: dict[str, NDArray[Any]] = {
            "coefficients": self.coefficients,
            "basis": self.basis,
            "wavelengths": self.wavelengths,
            "status": self.status,
            "info": np.array(json.dumps(self.info)),
        }
        arrays |= {} if self.interface is None else {"interface": self.interface}
        arrays |= {} if self.spread is None else {"spread": self.spread}
        write_maps(path, KIND, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Reflectance:
        """Reads what :meth:`save` wrote.

        Raises
        ------
        CorruptInputError
            A file that is truncated, damaged or holds something else; the array is named.
        """
        with read_maps(path, KIND) as maps:
            coefficients = maps.array("coefficients", np.float32, (None, None, None))
            count, height, width = coefficients.shape
            grid = maps.array("wavelengths", np.float64, (None,))
            lobes, spread = ("interface" in maps.arrays), ("spread" in maps.arrays)
            return cls(
                coefficients=coefficients,
                basis=maps.array("basis", np.float64, (count, len(grid))),
                wavelengths=grid,
                status=maps.array("status", np.uint8, (height, width)),
                info=json.loads(str(maps.array("info", np.str_, ()))),
                interface=maps.array("interface", np.float64, (count, None)) if lobes else None,
                spread=maps.array("spread", np.float64, (len(grid),)) if spread else None,
            )


def fit_reflectance(
    stack: Stack | None,
    diffuse: DiffuseSource,
    camera: Camera,
    *,
    estimator: Estimator = "ensemble",
    training: TrainingSpectra | None = None,
    noise: float | None = None,
    wavelengths: ArrayLike | None = None,
    rank: int | None = None,
    integration: Integration = "1nm",
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Reflectance:
    """Estimate the spectral reflectance of every pixel.

    All estimators are homogeneous of degree one: twice the diffuse response, twice the
    reflectance. They are built in double precision and applied in single precision.

    Parameters
    ----------
    stack
        The photographs, from which the noise is measured; None: ``noise`` is used, or 0.1 % of
        white.
    diffuse
        Responses of the bands to the diffuse part under frontal unit light; a white board has 1:
        ``Sbrdf.diffuse``, ``Normals.albedo`` or an array ``(band, y, x)``. Both maps are already
        divided by the cosine of incidence and by the white board (eq. 8 of the RGB paper);
        correct other responses with :func:`white_corrected` first.
    camera
        Sensitivities and the light of the photographs.
    estimator
        * ``"ensemble"`` (default): the mean of the next two; best or nearly so on every material
          and camera tried.
        * ``"root-polynomial"``: ridge regression on the responses and the roots of their products;
          ten times as fast.
        * ``"radial-basis"``: Gaussians around training responses; best where 700 or more spectra
          of the same materials are given.
        * ``"wiener"``: eq. 5 of Tominaga and Tanaka's six-band paper; linear.
        * ``"linear-model"``: eq. 4-7 of their RGB paper: principal components that reproduce the
          responses, not regularised.
    training
        Spectra to learn from: :class:`~impasto.Training` (:func:`~impasto.read_spectra` reads
        tables), a pair ``(wavelengths, spectra)`` or an array ``(N, n)`` on ``wavelengths``.
        Default: :func:`~impasto.training.default_training`; ``default_training() + mine`` adds
        to it.
    noise
        Standard deviation of a diffuse response, relative to white. Default: measured on the
        stack (at least 1e-4), else 1e-3.
    wavelengths
        ``(n,)`` nm of the result; default 400 to 700 in steps of 5.
    rank
        Coefficients per pixel; for ``"linear-model"`` the number of principal components (default:
        one per band, three for an RGB camera as in the paper). Default of the other estimators:
        all of a linear one, otherwise so many that the training error rises by less than 1e-4.
    integration
        How responses are predicted from spectra, see :meth:`Camera.operator`.
    threads, progress
        Threads (default: all allowed) and a progress bar or callable.

    Returns
    -------
    Reflectance
        Coefficients and basis; never a cube.

    Raises
    ------
    ArgumentError
        Sizes or an order that do not agree with the camera's bands, an unknown estimator, a
        training set that is too small or not finite, negative noise.
    """
    one_of(estimator, get_args(Estimator), "estimator")
    if stack is not None:
        instance(stack, Stack, "stack", "an impasto.Stack or None")
    checked_camera(camera)
    responses, status = _responses(diffuse, camera)
    if stack is not None and stack.shape[1:] != responses.shape:
        raise ArgumentError(
            f"stack: expected {responses.shape} bands and pixels, as diffuse has, "
            f"found {stack.shape[1:]}"
        )
    _check_order(getattr(diffuse, "bands", None) if stack is None else stack.bands, camera)
    grid = DEFAULT_GRID if wavelengths is None else checked_wavelengths(wavelengths)
    spectra = checked_training(training, grid)
    if rank is not None and not (is_whole(rank) and rank >= 1):
        raise ArgumentError(f"rank: expected a positive integer or None, found {rank!r}")
    noise_from = "given"
    if noise is None:
        measured = None if stack is None else wait_for(noise_of_diffuse, stack, diffuse, responses)
        noise = DEFAULT_NOISE if measured is None else max(measured, NOISE_FLOOR)
        noise_from = "default" if measured is None else "stack"
    built = _built(camera, estimator, spectra, noise, noise_from, grid, rank, integration)
    with reporting(progress, "reflectance") as callback:
        return built.applied(responses, status, threads, callback)


class ReflectanceEstimator:
    """An estimator of spectra that is built once, for maps that are seen part by part.

    :func:`fit_reflectance` builds one for the whole of a map; a part of its result has the bits
    that the same part of the map gives here, for the same noise.

    Parameters
    ----------
    camera
        Sensitivities and the light of the photographs.
    bands
        Names of the bands of the maps.

    Raises
    ------
    ArgumentError
        Bands that are not the camera's, or in another order.
    """

    def __init__(self, camera: Camera, bands: tuple[str, ...]) -> None:
        own = matching_camera(camera, bands)
        spectra = checked_training(None, DEFAULT_GRID)
        self._camera = own
        self._built = _built(
            own, "ensemble", spectra, DEFAULT_NOISE, "default", DEFAULT_GRID, None, "1nm"
        )

    @property
    def basis(self) -> Floats:
        """``(k, n)``, as of :class:`Reflectance`."""
        return self._built.basis

    @property
    def wavelengths(self) -> Floats:
        """``(n,)`` nm."""
        return self._built.wavelengths

    @property
    def spread(self) -> Floats | None:
        """``(n,)``, as of :class:`Reflectance`."""
        return self._built.spread

    @property
    def info(self) -> dict[str, Any]:
        """How spectra are estimated, as of :class:`Reflectance`."""
        return self._built.info

    def apply(self, diffuse: DiffuseSource, *, threads: int | None = None) -> Reflectance:
        """The spectra of a part of a map, as :func:`fit_reflectance` has them of the whole."""
        return self._built.applied(*_responses(diffuse, self._camera), threads, None)


@dataclass(frozen=True, eq=False, repr=False)
class _Built:
    """What the Rust core has built, and what goes into every result of it."""

    core: Any
    basis: Floats
    wavelengths: Floats
    info: dict[str, Any]
    interface: Floats | None
    spread: Floats | None = None

    def applied(
        self, responses: NDArray[np.float32], status: NDArray[np.uint8] | None,
        threads: int | None, callback: ProgressCallback | None,
    ) -> Reflectance:  # fmt: skip
        """The spectra of some responses."""
        found = Reflectance(
            # numpy asks for large pages: touching small new ones takes longer than the estimate.
            coefficients=np.empty((len(self.basis), *responses.shape[1:]), np.float32),
            # Copies: what is built is shared by calls, and a result belongs to its caller.
            basis=self.basis.copy(),
            wavelengths=self.wavelengths.copy(),
            status=np.empty(responses.shape[1:], np.uint8),
            info=deepcopy(self.info),
            interface=None if self.interface is None else self.interface.copy(),
            spread=None if self.spread is None else self.spread.copy(),
        )
        self.core.apply(responses, status, found, thread_count(threads), callback)
        return found


def _built(
    camera: Camera, estimator: Estimator, spectra: Training, noise: float, noise_from: str,
    grid: Floats, rank: int | None, integration: Integration,
) -> _Built:  # fmt: skip
    operator = np.ascontiguousarray(camera.operator(grid, integration=integration))
    known, digest = _on_grid(spectra, grid)
    terms = None if rank is None else int(rank)
    info = {
        "estimator": estimator,
        "training": spectra.name,
        "training_count": len(spectra),
        "noise": float(noise),
        "noise_from": noise_from,
        "integration": integration,
        "bands": list(camera.bands),
    }
    key = (json.dumps(info), terms, operator.shape, operator.tobytes(), grid.tobytes(), digest)
    return RECENT.get(key, lambda: _newly_built(operator, known, grid, terms, info))


def _on_grid(spectra: Training, grid: Floats) -> tuple[Floats, bytes]:
    """Training spectra on the wavelengths of the estimate, and their digest."""
    grids = (grid.tobytes(), spectra.wavelengths.tobytes())
    last = ON_GRID.get(spectra)
    if last is None or last[0] != grids:
        known = np.ascontiguousarray(spectra.at(grid))
        last = grids, known, blake2b(known.tobytes(), digest_size=32).digest()
        ON_GRID[spectra] = last
    return last[1:]


def _newly_built(
    operator: Floats, known: Floats, grid: Floats, rank: int | None, info: dict[str, Any]
) -> _Built:
    built = _core.spectral_estimator(info["estimator"], operator, known, info["noise"], rank, SEED)
    basis = np.ascontiguousarray(built.basis.T)
    found = _Built(
        core=built,
        basis=basis,
        wavelengths=np.array(grid),
        info=info | dict(built.diagnostics),
        interface=interface_operator(operator, basis),
    )
    return replace(found, spread=_spread(found, known, known @ operator.T))


ON_GRID: WeakKeyDictionary[Training, tuple[tuple[bytes, bytes], Floats, bytes]] = (
    WeakKeyDictionary()
)
"""Of each set, whose spectra cannot be written to, what was made last: it takes a fifth as long as
the estimate of a megapixel."""
RECENT: Recent[_Built] = Recent(8)
"""To build a linear estimator takes as long as to apply it to a megapixel, and a painting that is
estimated part by part asks for the same one every time."""


def _spread(built: _Built, known: Floats, responses: Floats) -> Floats:
    """See :class:`Reflectance`; of training spectra ``known (N, n)``, ``responses (N, band)``."""
    row = np.ascontiguousarray(responses.T[:, None], np.float32)
    found = built.applied(row, None, 1, None).coefficients[:, 0].T @ built.basis
    size = np.sqrt(np.mean(found**2, axis=1))
    some = size > 0.0
    errors = np.abs(found - known)[some] / size[some, None]
    return np.asarray(np.quantile(errors, COVERED, axis=0))


def noise_of_spectra(info: dict[str, Any]) -> float:
    """What the noise of the responses makes of a spectrum, to be left out in 5 % of the cases."""
    return NORMAL * float(info.get("noise_gain", 0.0)) * float(info.get("noise", 0.0))


def white_corrected(
    responses: ArrayLike, cos_incidence: ArrayLike, white: ArrayLike, cos_white: ArrayLike = 1.0
) -> NDArray[np.float32]:
    """Eq. 8 of Tominaga and Tanaka's RGB paper, on the responses instead of the spectrum.

    ``(rho / cos(theta_i)) / (W / cos(theta_w))``: light falls obliquely on the surface and on the
    white board. The estimators are homogeneous of degree one, so dividing their input divides the
    spectrum, as the paper does. Maps fitted by impasto are already divided.

    Parameters
    ----------
    responses
        ``(band, y, x)`` of one photograph.
    cos_incidence
        ``(y, x)`` cosine of the angle between normal and light.
    white
        ``(band, y, x)``, ``(y, x)`` or a number: the photograph of the white board.
    cos_white
        The same cosine on the board.

    Returns
    -------
    ndarray
        ``(band, y, x)`` float32; NaN where the light does not reach the surface or the board.
    """
    rho, cosine, board, cos_board = (
        np.asarray(a, dtype=np.float64) for a in (responses, cos_incidence, white, cos_white)
    )
    lit = (cosine > 0) & (cos_board > 0) & (board > 0)
    scale = np.divide(cos_board, board * cosine, out=np.full(lit.shape, np.nan), where=lit)
    return np.asarray(rho * scale, dtype=np.float32)


def matching_camera(camera: Any, bands: tuple[str, ...]) -> Camera:
    """The camera, if the photographs' bands can be its own.

    Raises
    ------
    ArgumentError
        No camera, one of another number of bands, or of the same bands in another order.
    """
    found = checked_camera(camera)
    if len(found.bands) != len(bands):
        raise ArgumentError(
            f"camera: expected the {len(bands)} bands of the photographs, {', '.join(bands)}, "
            f"found {', '.join(found.bands)}"
        )
    _check_order(bands, found)
    return found


def _check_order(bands: tuple[str, ...] | None, camera: Camera) -> None:
    """Names that agree but for their order are the camera's rows in the wrong order."""
    if bands is None or bands == camera.bands or sorted(bands) != sorted(camera.bands):
        return
    numbered = sorted(f"band {i}" for i in range(len(bands)))
    if sorted(bands) != numbered:
        raise ArgumentError(
            f"camera: its bands {', '.join(camera.bands)} are those of the photographs in another "
            f"order ({', '.join(bands)}); bring the sensitivities into the photographs' order"
        )


def _responses(
    source: DiffuseSource, camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.uint8] | None]:
    status = getattr(source, "status", None)
    if isinstance(source, _Sbrdf):
        array: Any = source.diffuse
    elif isinstance(source, _Normals):
        array = source.albedo
    else:
        array, status = source, None
    if not hasattr(array, "__array__") and not isinstance(array, Sequence):
        raise ArgumentError(
            "diffuse: expected what impasto.fit_sbrdf or impasto.fit_normals returns or an array "
            f"(band, y, x), found {type(array).__name__}"
        )
    responses = floats(array)
    if responses.ndim != 3 or len(responses) != len(camera.bands) or responses.size == 0:
        raise ArgumentError(
            f"diffuse: expected ({len(camera.bands)}, y, x) for the camera's bands "
            f"{', '.join(camera.bands)}, found shape {responses.shape}"
        )
    if status is not None:
        status = np.ascontiguousarray(status, dtype=np.uint8)
        if status.shape != responses.shape[1:]:
            raise ArgumentError(
                f"status: expected shape {responses.shape[1:]}, found {status.shape}"
            )
    return responses, status

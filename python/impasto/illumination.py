"""The colours of a scene's light: for each distinct illuminant one matrix and one vector to XYZ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.colour import Display, spectrum, xyz_from_coefficients, xyz_from_spectrum
from impasto.colour.primaries import primary_spectra
from impasto.colour.wavelengths import interpolation_matrix
from impasto.environment import LUMINANCE
from impasto.errors import ArgumentError
from impasto.rig import PointView
from impasto.scene import Scene
from impasto.varnish import Varnish

MIXING_GRID = np.arange(360.0, 831.0)
"""Wavelengths in nm at which several illuminants are added."""


@dataclass(frozen=True)
class ChannelColours:
    """The three channels of an environment as colours.

    Attributes
    ----------
    diffuse
        ``(3, k, 3)``: columns of the matrix of each channel.
    interface
        ``(3, 3)``: XYZ of each channel.
    white
        ``(3,)``: XYZ of a white board that faces the viewer.
    """

    diffuse: NDArray[np.float64]
    interface: NDArray[np.float64]
    white: NDArray[np.float64]


def channel_colours(scene: Scene, reflectance: Any, bands: int, eye: Any) -> ChannelColours:
    """What the channels of a scene's environment make of a surface.

    With spectra a channel is the illuminant behind the filter of its primary
    (:func:`impasto.colour.primaries.primary_spectra`), and white the illuminant itself. Without,
    the three bands of the photographs are lit by their own channel each.
    """
    room = scene.environment
    if room is None:
        raise ArgumentError("environment: the scene has none")
    if reflectance is None:
        primaries = Display.named("srgb").xyz_from_linear.T
        captured = _captured(scene, bands)
        if bands == 3:
            own = np.eye(3)[:, :, None] * primaries[:, None, :]
        else:
            own = primaries[:, None, :] * np.ones_like(captured)
        diffuse, interface = own, primaries
    else:
        illuminant = scene.illuminants[-1]
        test = _test(scene)
        spectra = primary_spectra(_with_grid(illuminant, reflectance.wavelengths), MIXING_GRID)
        shares = _luminosity() @ spectra.T
        # Light of a room comes from everywhere: on average at 60 degrees, whose cosine is 1/2.
        film = _under_varnish(reflectance, scene.varnish, 0.5, _height(eye))
        folds = [
            xyz_from_coefficients(
                *film,
                (MIXING_GRID, one),
                test=_with_grid(test, reflectance.wavelengths),
                reference=_with_grid(scene.reference, reflectance.wavelengths),
                d=scene.adaptation,
                mode=scene.adaptation_mode,
            )
            for one in spectra
        ]
        shares = shares / shares.sum()
        diffuse = np.stack([share * f.diffuse.T for share, f in zip(shares, folds, strict=True)])
        interface = np.stack([share * f.interface for share, f in zip(shares, folds, strict=True)])
    # Maps do not know the intensity: they are kept.
    board = room.irradiance()
    if scene.exposure is None and not scene.lights and not board.any():
        raise ArgumentError(
            f"environment: {room.name!r} is black in front of the painting, so that no exposure "
            "follows from it; turn the room (rotation=), add a lamp, or give exposure="
        )
    return ChannelColours(
        np.ascontiguousarray(room.intensity * diffuse),
        room.intensity * interface,
        board @ interface,
    )


def lamp_colours(
    scene: Scene, reflectance: Any, bands: int, eye: Any
) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.uint32], NDArray[Any]]:
    """Matrices ``(g, k, 3)``, vectors ``(g, 3)``, the row of each light, and XYZ of white."""
    if reflectance is None:
        matrix = _captured(scene, bands)
        white = Display.named("srgb").xyz_from_linear.sum(axis=1)
        total = sum(light.intensity for light in scene.lights)
        return (
            matrix[None],
            white[None],
            np.zeros(len(scene.lights), np.uint32),
            np.asarray(total * white),
        )
    # Lamps of one illuminant have one matrix; under a varnish, those at one angle.
    distinct: list[tuple[Any, float | None]] = []
    which = []
    for light, illuminant in zip(scene.lights, scene.illuminants, strict=False):
        angle = None if scene.varnish is None or scene.varnish.removed else light.direction[2]
        same = [
            index
            for index, (other, at) in enumerate(distinct)
            if at == angle and _same(illuminant, other)
        ]
        which.append(same[0] if same else len(distinct))
        if not same:
            distinct.append((illuminant, angle))
    test, height = _test(scene), _height(eye)
    folds = [
        xyz_from_coefficients(
            *_under_varnish(reflectance, scene.varnish, angle, height),
            _with_grid(illuminant, reflectance.wavelengths),
            test=_with_grid(test, reflectance.wavelengths),
            reference=_with_grid(scene.reference, reflectance.wavelengths),
            d=scene.adaptation,
            mode=scene.adaptation_mode,
        )
        for illuminant, angle in distinct
    ]
    if len(reflectance.basis) != bands:
        raise ArgumentError(
            f"reflectance: {bands} coefficients but a basis of {len(reflectance.basis)}"
        )
    if not folds:
        return np.zeros((0, bands, 3)), np.zeros((0, 3)), np.zeros(0, np.uint32), np.zeros(3)
    interface = np.stack([fold.interface for fold in folds])
    strength = np.array([light.intensity for light in scene.lights])
    return (
        np.ascontiguousarray(np.stack([fold.diffuse.T for fold in folds])),
        interface,
        np.array(which, dtype=np.uint32),
        strength @ interface[which],
    )


def _under_varnish(
    reflectance: Any, varnish: Varnish | None, light: float | None, view: float
) -> tuple[Any, Any]:
    """The basis ``(k, n)`` with what a film transmits of it, and its wavelengths.

    Light and eye are cosines. The film's curve may be steep: the product is formed on 1 nm, on
    which light becomes colour.
    """
    if varnish is None:
        return reflectance.basis, reflectance.wavelengths
    finely = interpolation_matrix(reflectance.wavelengths, MIXING_GRID)
    basis = np.asarray(reflectance.basis, dtype=np.float64) @ finely.T
    factor = varnish.factor(MIXING_GRID, 1.0 if light is None else light, view)
    return basis * factor, MIXING_GRID


def _with_grid(illuminant: Any, wavelengths: Any) -> Any:
    """A bare array of values stands on the wavelengths of the spectra."""
    bare = isinstance(illuminant, np.ndarray | list) and np.ndim(illuminant) == 1
    return (wavelengths, illuminant) if bare else illuminant


def _captured(scene: Scene, bands: int) -> NDArray[np.float64]:
    """Matrix ``(band, 3)`` from bands without spectra to XYZ."""
    if bands not in {1, 3}:
        raise ArgumentError(
            f"camera: {bands} bands have no colours without spectra; give camera=, or "
            "reflectance= from impasto.fit_reflectance"
        )
    as_it_was = all(_same(illuminant, "D65") for illuminant in scene.illuminants)
    if scene.varnish is not None:
        raise ArgumentError(
            "varnish: a film is a factor on spectra; give camera=, or reflectance= from "
            "impasto.fit_reflectance"
        )
    if scene.adaptation is not None or not as_it_was:
        raise ArgumentError(
            "camera: without camera= or reflectance= only the colours under the light of the "
            "capture are known; give one of them for another illuminant or an adaptation"
        )
    primaries = Display.named("srgb").xyz_from_linear
    columns = primaries if bands == 3 else primaries.sum(axis=1, keepdims=True)
    return np.ascontiguousarray(columns.T)


def _same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    if isinstance(one, str) or isinstance(other, str):
        return bool(isinstance(one, str) and isinstance(other, str) and one == other)
    return np.ndim(one) == 0 and np.ndim(other) == 0 and bool(one == other)


def _test(scene: Scene) -> Any:
    """The light to which the observer adapts."""
    first = scene.illuminants[0]
    return first if all(_same(first, one) for one in scene.illuminants) else _mixture(scene)


def _height(eye: Any) -> float:
    """Cosine of the angle from the panel's normal to the eye."""
    towards = np.asarray(eye.position if isinstance(eye, PointView) else eye, dtype=np.float64)
    return float(towards[2] / np.linalg.norm(towards))


def _luminosity() -> NDArray[np.float64]:
    return np.asarray(xyz_from_spectrum(MIXING_GRID, np.ones(MIXING_GRID.size))[1])


def _mixture(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The sum of all lights; each has Y = its intensity, an environment that of a white board."""
    luminosity = _luminosity()
    strengths = [light.intensity for light in scene.lights]
    if scene.environment is not None:
        strengths.append(float(LUMINANCE @ scene.environment.irradiance()))
    total = np.zeros(MIXING_GRID.size)
    for strength, illuminant in zip(strengths, scene.illuminants, strict=True):
        power = spectrum(illuminant, MIXING_GRID)
        total += strength * power / (luminosity @ power)
    return MIXING_GRID, total

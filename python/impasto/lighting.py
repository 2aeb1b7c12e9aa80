"""A scene on a surface as arrays for the Rust core: colours as matrices, lamps, view, relief."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.border import RigArguments
from impasto._internal.checks import holding, instance, length_mm
from impasto._internal.waiting import floats
from impasto.bands import Camera, checked_camera
from impasto.colour import Display, spectrum, xyz_from_coefficients, xyz_from_spectrum
from impasto.colour import white_scale as white_scale_of
from impasto.colour.wavelengths import interpolation_matrix
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.interface import spectra_of_lobes
from impasto.fit.reflectance import Reflectance, fit_reflectance
from impasto.height import integrate_normals
from impasto.level import Level, as_level, find_level
from impasto.rig import PointLight, PointView, Rig
from impasto.scene import Scene
from impasto.surface import Lobe, Relightable, Surface
from impasto.varnish import Varnish

_ENOUGH = 100
"""A panel has more normals than that."""
MIXING_GRID = np.arange(360.0, 831.0)
"""Wavelengths in nm at which several illuminants are added."""


@dataclass(frozen=True)
class SceneArguments:
    """A scene as arrays: for each distinct illuminant one matrix and one vector to XYZ."""

    rig: RigArguments
    intensity: NDArray[np.float64]
    colour: NDArray[np.uint32]
    diffuse: NDArray[np.float64]
    interface: NDArray[np.float64]
    background: tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Prepared:
    """A surface and a scene, ready for the Rust core.

    Attributes
    ----------
    surface
        The maps with the coefficients of spectra as their colours, levelled.
    relief
        ``(y, x)`` height in mm where the scene has shadows, otherwise None.
    arguments
        The scene.
    rig
        The scene's lights and eye, relative to the whole painting.
    exposure
        The factor from XYZ to display light; 1 where it follows from the picture.
    from_picture
        Whether the exposure follows from the picture: ``exposure="maximum"``.
    in_bands
        Whether colours are those of the bands, without spectra: one matrix for all lights.
    reflectance
        What has the spectra of the colours; None for those of the bands.
    as_photographed
        Whether the picture can show what photographs show besides the model: the panel is not
        rotated, no shadows are cast, the painting is seen on its own pixels, its colours are those
        of the bands.
    """

    surface: Surface
    relief: NDArray[np.float32] | None
    arguments: SceneArguments
    rig: Rig
    exposure: float
    from_picture: bool
    in_bands: bool
    reflectance: Any
    as_photographed: bool


def prepare(
    surface: Relightable,
    scene: Scene,
    *,
    reflectance: Reflectance | None = None,
    camera: Camera | None = None,
    height: ArrayLike | None = None,
    pitch_mm: float | None = None,
    index: float | None = None,
    level: bool | Level | None = None,
    threads: int | None = None,
) -> Prepared:
    """A surface and a scene as arrays; the parameters are those of :func:`impasto.render`.

    Raises
    ------
    ArgumentError
        Shapes that do not match; an illuminant or an adaptation for colours without spectra.
    GeometryError
        A point light without the width of a pixel.
    """
    instance(scene, Scene, "scene", "an impasto.Scene, as in Scene([DistantLight((0, 1, 1))])")
    made_by = "what impasto.fit_sbrdf or impasto.load_sbrdf returns, or an impasto.Surface"
    instance(surface, Relightable, "surface", made_by)
    if reflectance is not None:
        spectral = ("coefficients", "basis", "wavelengths")
        holding(spectral, reflectance, "reflectance", "what impasto.fit_reflectance returns")
    if camera is not None:
        checked_camera(camera)
    lit = surface.surface()
    pitch = lit.pitch_mm if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
    if pitch is None and any(isinstance(light, PointLight) for light in scene.lights):
        raise GeometryError(
            "pitch_mm: point lights need the width of a pixel on the painting in mm, which the "
            "surface does not contain; give pitch_mm="
        )
    pitch = 1.0 if pitch is None else pitch
    if reflectance is None:
        reflectance = surface.spectra()
    if reflectance is None and camera is not None:
        source: Any = surface
        reflectance = fit_reflectance(None, source, camera)
    lit = _coloured(lit, type(surface).__name__, reflectance, index)
    if scene.varnish is not None:
        lit = varnished(lit, scene.varnish)
    stood = lit.normal
    lit = _levelled(lit, level, has_height=height is not None, shadows=scene.shadows)
    unmoved = lit.normal is stood and not scene.shadows
    relief = _relief(lit, height, pitch, threads) if scene.shadows else None
    eye = surface.eye() if scene.view is None else scene.view
    whole = Rig(scene.lights, views=eye, pitch_mm=pitch, origin=lit.origin)
    lit, arguments, exposure = arranged(lit, scene, whole, eye, reflectance)
    return Prepared(
        surface=lit,
        relief=relief,
        arguments=arguments,
        rig=whole,
        exposure=exposure,
        from_picture=isinstance(scene.exposure, str),
        in_bands=reflectance is None,
        reflectance=reflectance,
        as_photographed=reflectance is None and unmoved and _in_front(eye),
    )


def arranged(
    lit: Surface, scene: Scene, whole: Rig, eye: Any, reflectance: Any
) -> tuple[Surface, SceneArguments, float]:
    """The surface with the scene's share of ambient light, the scene as arrays, its exposure.

    ``whole`` has the scene's lights and ``eye``, relative to the whole painting. An exposure that
    follows from the picture is 1 here, and the background is 0 with it.
    """
    rig = whole.here
    diffuse, interface, which, white = _colours(scene, reflectance, len(lit.diffuse), eye)
    from_picture = isinstance(scene.exposure, str)
    exposure = 1.0 if isinstance(scene.exposure, str) else scene.exposure
    if exposure is None:
        exposure = white_scale_of(white, scene.display).scale
    behind = np.zeros(3) if from_picture else np.asarray(scene.background)
    background = np.linalg.solve(exposure * scene.display.linear_from_xyz, behind)
    arguments = SceneArguments(
        rig=RigArguments.of(rig),
        intensity=rig.intensities,
        colour=which,
        diffuse=diffuse,
        interface=interface,
        background=(float(background[0]), float(background[1]), float(background[2])),
    )
    return _with_ambient_of(lit, scene, rig), arguments, float(exposure)


def _coloured(lit: Surface, kind: str, reflectance: Any, index: float | None) -> Surface:
    """The surface to render, with the coefficients of a reflectance as its colours."""
    if reflectance is None:
        return lit if index is None else replace(lit, index=index)
    planes = _planes(reflectance.coefficients, lit.shape)
    if not lit.tinted:
        return lit.with_diffuse(planes, index=index)
    operator = getattr(reflectance, "interface", None)
    bands = len(lit.diffuse)
    if operator is None or operator.shape != (len(planes), bands):
        raise ArgumentError(
            f"reflectance: the lobes of a {kind} have strengths in {bands} bands, whose spectra "
            "only the result of impasto.fit_reflectance for these bands has; fit it again, or "
            "leave reflectance= out"
        )

    def spectra(strength: NDArray[np.float32]) -> NDArray[np.float32]:
        return spectra_of_lobes(strength, operator, reflectance.basis)

    return lit.with_diffuse(planes, index=index, spectra=spectra)


def varnished(lit: Surface, varnish: Varnish) -> Surface:
    """The surface with the gloss of a coat, and its own as what the coat leaves of it."""
    if varnish.removed:
        return lit
    own, coat, between = (
        ((one - 1.0) / (one + 1.0)) ** 2
        for one in (lit.index, varnish.index, varnish.index / lit.index)
    )
    mirror = lit.model == "lafortune"
    # Torrance-Sparrow lobes are multiplied by Fresnel's reflectance of the surface's index.
    bare = own if mirror else coat
    share = between / bare if bare > 0.0 else 1.0
    lobes = [Lobe(share * lobe.strength, lobe.shape) for lobe in lit.lobes if share > 0.0]
    gamma, beta = varnish.gamma, varnish.strength
    if beta > 0.0:
        # cos^n of the angle from the mirror direction, twice that of the facet, is one half where
        # exp(-ln 2 (phi / gamma)^2) is.
        phong = Lobe(beta * coat, (-1.0, 1.0, math.log(2.0) / (2.0 * gamma**2)))
        lobes.append(phong if mirror else Lobe(beta, (gamma,)))
    return replace(lit, lobes=tuple(lobes), index=varnish.index)


def _with_ambient_of(lit: Surface, scene: Scene, rig: Rig) -> Surface:
    """Scale the ambient light of a part of a painting to that of the whole.

    Ambient light is relative to the light that arrives at the centre. ``rig`` has the intensities
    that near lights have at the centre of the part. Lobes with ambient light have one illuminant.
    """
    there = float(sum(light.intensity for light in scene.lights))
    here = float(rig.intensities.sum())
    if lit.ambient is None or here == there:
        return lit
    return replace(lit, ambient=lit.ambient * np.float32(there / here))


def _planes(values: Any, size: tuple[int, ...]) -> NDArray[np.float32]:
    planes = floats(values)
    if planes.ndim != 3 or planes.shape[1:] != size:
        raise ArgumentError(
            f"reflectance: expected coefficients (k, {size[0]}, {size[1]}), found {planes.shape}"
        )
    return planes


def _levelled(
    lit: Surface, level: bool | Level | None, *, has_height: bool, shadows: bool
) -> Surface:
    """The surface relative to the plane of its panel, if that is wanted."""
    if level is None:
        if not shadows or has_height or lit.height is not None or not _faces(lit.normal):
            return lit
        found = find_level(lit.normal)
        plane = found if found.leans else None
    else:
        plane = as_level(level, lit.normal)
    return lit if plane is None else replace(lit, normal=plane.rotated(lit.normal))


def _faces(normal: NDArray[np.float32]) -> bool:
    """Whether there are enough normals to find a plane."""
    return int((normal[2] > 0).sum()) >= _ENOUGH


def _relief(
    lit: Surface, height: ArrayLike | None, pitch: float, threads: int | None
) -> NDArray[np.float32]:
    relief = lit.height if height is None else floats(height)
    if relief is None:
        return integrate_normals(lit.normal, pitch, threads=threads)
    if relief.shape != lit.shape:
        raise ArgumentError(f"height: expected {lit.shape}, found shape {relief.shape}")
    return relief


def _colours(
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
    for light, illuminant in zip(scene.lights, scene.illuminants, strict=True):
        angle = None if scene.varnish is None or scene.varnish.removed else light.direction[2]
        same = [
            index
            for index, (other, at) in enumerate(distinct)
            if at == angle and _same(illuminant, other)
        ]
        which.append(same[0] if same else len(distinct))
        if not same:
            distinct.append((illuminant, angle))
    first = distinct[0][0]
    one = all(_same(illuminant, first) for illuminant, _ in distinct)
    test = first if one else _mixture(scene)
    towards = np.asarray(eye.position if isinstance(eye, PointView) else eye, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    folds = [
        xyz_from_coefficients(
            *_under_varnish(reflectance, scene.varnish, angle, towards[2]),
            _with_grid(illuminant, reflectance.wavelengths),
            test=_with_grid(test, reflectance.wavelengths),
            reference=_with_grid(scene.reference, reflectance.wavelengths),
            d=scene.adaptation,
            mode=scene.adaptation_mode,
        )
        for illuminant, angle in distinct
    ]
    if folds[0].diffuse.shape[1] != bands:
        raise ArgumentError(
            f"reflectance: {bands} coefficients but a basis of {folds[0].diffuse.shape[1]}"
        )
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


def _mixture(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The sum of all lights, to which the observer adapts; each has Y = its intensity."""
    luminosity = xyz_from_spectrum(MIXING_GRID, np.ones(MIXING_GRID.size))[1]
    total = np.zeros(MIXING_GRID.size)
    for light, illuminant in zip(scene.lights, scene.illuminants, strict=True):
        power = spectrum(illuminant, MIXING_GRID)
        total += light.intensity * power / (luminosity @ power)
    return MIXING_GRID, total


def _in_front(eye: Any) -> bool:
    """Whether a picture has the painting's own pixels: from the side, it is foreshortened."""
    return isinstance(eye, PointView) or not np.any(np.asarray(eye, dtype=np.float64)[:2])

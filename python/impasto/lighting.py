"""A scene on a surface as arrays for the Rust core: colours as matrices, lamps, view, relief."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import thread_count
from impasto._internal.checks import holding, instance, is_whole, length_mm
from impasto._internal.waiting import floats
from impasto.bands import Camera, checked_camera
from impasto.colour import white_scale as white_scale_of
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.interface import spectra_of_lobes
from impasto.fit.reflectance import Reflectance, fit_reflectance
from impasto.height import integrate_normals
from impasto.illumination import channel_colours, lamp_colours
from impasto.level import Level, as_level, find_level
from impasto.lights import DistantLight, PointLight
from impasto.rig import FRONTAL, PointView, Rig
from impasto.scene import Scene
from impasto.surface import Lobe, Relightable, Surface
from impasto.varnish import Varnish

DENSEST = 1.7
"""Index of refraction that no varnish and no binder reaches."""
_ENOUGH = 100
"""A panel has more normals than that."""

_SAMPLE = 100_000
"""Pixels of which a mean is taken, about."""


@dataclass(frozen=True)
class SceneArguments:
    """A scene as arrays: for each distinct illuminant one matrix and one vector to XYZ."""

    rig: RigArguments
    intensity: NDArray[np.float64]
    radius: NDArray[np.float64]
    colour: NDArray[np.uint32]
    diffuse: NDArray[np.float64]
    interface: NDArray[np.float64]
    background: tuple[float, float, float]
    environment: tuple[Any, tuple[int, int, int], float] | None = None
    """What :meth:`impasto.Environment.prefiltered` gives, the illuminants of its channels, and the
    mean reflectance of what surrounds a pixel."""
    perspective: bool = False
    rectified: bool = False
    """Whether the picture stays on the painting's own grid wherever the eye is."""
    shadows: bool = False
    parallax: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Prepared:
    """A surface and a scene, ready for the Rust core.

    Attributes
    ----------
    surface
        The maps with the coefficients of spectra as their colours, levelled.
    relief
        ``(y, x)`` height in mm where the scene has shadows or parallax, otherwise None.
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
    reduce
        How many pixels of the surface, along a side, are one of the picture.
    as_photographed
        Whether the picture can show what photographs show besides the model: the panel is not
        rotated, no relief is wanted, the painting is seen on its own pixels, its colours are those
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
    reduce: int
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
    reduce: int = 1,
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
    made_by = (
        "what impasto.fit_sbrdf or impasto.load_sbrdf returns, a part of what impasto.open_sbrdf "
        "returns, or an impasto.Surface"
    )
    instance(surface, Relightable, "surface", made_by)
    if reflectance is not None:
        spectral = ("coefficients", "basis", "wavelengths")
        holding(spectral, reflectance, "reflectance", "what impasto.fit_reflectance returns")
    if camera is not None:
        checked_camera(camera)
    lit = surface.surface()
    if pitch_mm is None and surface.known_pitch_mm is None:
        check_pitchless(scene)
    pitch = lit.pitch_mm if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
    pitch = 1.0 if pitch is None else pitch
    if reflectance is None:
        reflectance = surface.spectra()
    if reflectance is None and camera is not None:
        source: Any = surface
        reflectance = fit_reflectance(None, source, camera)
    coat = scene.varnish
    # Strengths are those of bands here, and of basis spectra afterwards.
    beneath = 0.0 if coat is None or coat.removed else metallic(lit)
    lit = coloured(lit, type(surface).__name__, reflectance, index)
    if coat is not None:
        lit = varnished(lit, coat, beneath)
    stood = lit.normal
    over = scene.shadows or scene.has_parallax
    lit = _levelled(lit, level, has_height=height is not None, wanted=over)
    unmoved = lit.normal is stood and not over
    relief = _relief(lit, height, pitch, threads) if over else None
    if reduce != 1:
        lit, relief = reduced(lit, relief, reduce, threads)
        pitch *= reduce
    eye = surface.eye_in_mm(pitch_mm) if scene.view is None else scene.view
    whole = rig_of(scene, eye, pitch, lit)
    arguments, exposure = arranged(lit, scene, whole, eye, reflectance, threads)
    return Prepared(
        surface=lit,
        relief=relief,
        arguments=arguments,
        rig=whole,
        exposure=exposure,
        from_picture=isinstance(scene.exposure, str),
        in_bands=reflectance is None,
        reflectance=reflectance,
        reduce=reduce,
        as_photographed=(
            reflectance is None
            and bool(scene.lights)
            and unmoved
            and reduce == 1
            and _in_front(eye)
            and not scene.perspective
        ),
    )


def check_pitchless(scene: Scene) -> None:
    """Refuse a scene that needs the width of a pixel."""
    near = any(isinstance(light, PointLight) for light in scene.lights)
    if near or scene.perspective:
        what = "point lights need" if near else "a perspective needs"
        raise GeometryError(
            f"pitch_mm: {what} the width of a pixel on the painting in mm, which the surface does "
            "not contain; give pitch_mm="
        )


def rig_of(scene: Scene, eye: Any, pitch: float, lit: Surface) -> Rig:
    """Lights and eye of a scene; without lamps the rig only says where the eye is."""
    lamps = scene.lights or (DistantLight(FRONTAL),)
    return Rig(lamps, views=eye, pitch_mm=pitch, origin=lit.origin)


def arranged(
    lit: Surface,
    scene: Scene,
    whole: Rig,
    eye: Any,
    reflectance: Any,
    threads: int | None = None,
) -> tuple[SceneArguments, float]:
    """The scene on a surface as arrays, and its exposure.

    ``whole`` has the scene's lights and ``eye``, relative to the whole painting. An exposure that
    follows from the picture is 1 here, and the background is 0 with it.
    """
    if scene.perspective and not isinstance(eye, PointView):
        raise ArgumentError(
            f"perspective: it is that of a near eye; give view=PointView((x, y, z)) in mm, found "
            f"{eye!r}"
        )
    bands = len(lit.diffuse)
    diffuse, interface, which, white = lamp_colours(scene, reflectance, bands, eye)
    if scene.environment is not None:
        channels = channel_colours(scene, reflectance, bands, eye)
        diffuse = np.concatenate([diffuse, channels.diffuse])
        interface = np.concatenate([interface, channels.interface])
        white = white + channels.white
    from_picture = isinstance(scene.exposure, str)
    exposure = 1.0 if isinstance(scene.exposure, str) else scene.exposure
    if exposure is None:
        exposure = white_scale_of(white, scene.display).scale
    behind = np.zeros(3) if from_picture else np.asarray(scene.background)
    background = np.linalg.solve(exposure * scene.display.linear_from_xyz, behind)
    arguments = SceneArguments(
        rig=RigArguments.of(whole),
        intensity=whole.intensities[: len(scene.lights)],
        radius=whole.radii[: len(scene.lights)],
        colour=which,
        diffuse=diffuse,
        interface=interface,
        background=(float(background[0]), float(background[1]), float(background[2])),
        environment=_surroundings(scene, lit, reflectance, len(diffuse), threads),
        perspective=scene.perspective,
        shadows=scene.shadows,
        parallax=scene.has_parallax,
    )
    return arguments, float(exposure)


def reduced(
    lit: Surface, relief: NDArray[np.float32] | None, factor: int, threads: int | None = None
) -> tuple[Surface, NDArray[np.float32] | None]:
    """Every ``factor`` x ``factor`` pixels of a surface and its relief as one.

    Normals that scatter within a group widen its lobes (Toksvig 2005, Olano and Baker 2010).
    """
    rows, columns = lit.shape
    most = min(rows, columns)
    if not is_whole(factor) or not 1 <= factor <= most:
        raise ArgumentError(f"reduce: expected a whole number from 1 to {most}, found {factor!r}")
    normal, diffuse, ambient, lobes, small = _core.reduced_surface(
        lit, relief, int(factor), thread_count(threads)
    )
    # Rows and columns that fill no group are left out on the right and below.
    right, up = 0.5 * (columns % factor), 0.5 * (rows % factor)
    origin = ((lit.origin[0] - right) / factor, (lit.origin[1] + up) / factor)
    pitch = None if lit.pitch_mm is None else lit.pitch_mm * factor
    found = replace(
        lit,
        normal=normal,
        diffuse=diffuse,
        ambient=ambient,
        lobes=tuple(Lobe(strength, tuple(shape)) for strength, shape in lobes),
        height=None,
        pitch_mm=pitch,
        origin=origin,
    )
    return found, small


def coloured(lit: Surface, kind: str, reflectance: Any, index: float | None) -> Surface:
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


def metallic(lit: Surface) -> float | NDArray[np.float32]:
    """The share of Torrance-Sparrow lobes that no varnish or binder reflects, 0 to 1.

    A lobe of ``beta = ln 2 / (4 gamma^2)`` reflects as much as a smooth interface of the surface's
    index. What all lobes of a pixel reflect beyond an interface of index :data:`DENSEST` comes from
    metal leaf. A number or a map ``(y, x)``; strengths are those of bands.
    """
    if lit.model != "torrance-sparrow" or not lit.index > 1.0:
        return 0.0
    most = head_on(DENSEST) / head_on(lit.index)
    total: Any = np.float32(0.0)
    for lobe in lit.lobes:
        strength = np.asarray(lobe.strength, dtype=np.float32)
        mean = strength.mean(axis=0) if strength.ndim == 3 else strength
        energy = mean * np.square(lobe.shape[0]) * np.float32(4.0 / math.log(2.0))
        # A pixel without this lobe has no gamma.
        total = total + np.where(mean > 0.0, energy, np.float32(0.0))
    share = 1.0 - most / np.maximum(total, most)
    return float(share) if np.ndim(share) == 0 else floats(share)


def head_on(index: float) -> float:
    """Fresnel reflectance at normal incidence."""
    return ((index - 1.0) / (index + 1.0)) ** 2


def varnished(
    lit: Surface, varnish: Varnish, beneath: float | NDArray[np.float32] = 0.0
) -> Surface:
    """The surface with the gloss of a coat, and its own as what the coat leaves of it.

    ``beneath``: the share of its gloss that lies deeper than its interface (:func:`metallic`).
    """
    if varnish.removed:
        return lit
    indices = (lit.index, varnish.index, varnish.index / lit.index)
    own, coat, between = (head_on(index) for index in indices)
    mirror = lit.model == "lafortune"
    # Torrance-Sparrow lobes are multiplied by Fresnel's reflectance of the surface's index.
    bare = own if mirror else coat
    share = between / bare if bare > 0.0 else 1.0
    # Metal reflects under the coat what it reflected without it, now with Fresnel's for the coat.
    kept: Any = share if mirror else share + beneath * ((own / coat if coat > 0.0 else 1.0) - share)
    lobes = [Lobe(kept * lobe.strength, lobe.shape) for lobe in lit.lobes if np.any(kept > 0.0)]
    gamma, beta = varnish.gamma, varnish.strength
    if beta > 0.0:
        # cos^n of the angle from the mirror direction, twice that of the facet, is one half where
        # exp(-ln 2 (phi / gamma)^2) is.
        phong = Lobe(beta * coat, (-1.0, 1.0, math.log(2.0) / (2.0 * gamma**2)))
        lobes.append(phong if mirror else Lobe(beta, (gamma,)))
    return replace(lit, lobes=tuple(lobes), index=varnish.index)


def _surroundings(
    scene: Scene, lit: Surface, reflectance: Any, colours: int, threads: int | None
) -> tuple[Any, tuple[int, int, int], float] | None:
    """The environment for the numerics; the last three colours are its channels'."""
    if scene.environment is None:
        return None
    lobes = lit.model == "lafortune" and len(lit.lobes) > 0
    built = scene.environment.prefiltered(lobes=lobes, threads=threads)
    albedo = _mean_reflectance(lit, reflectance) if scene.shadows else 0.0
    return built, (colours - 3, colours - 2, colours - 1), albedo


def _mean_reflectance(lit: Surface, reflectance: Any) -> float:
    """Mean diffuse reflectance over the painting and its bands or wavelengths, 0 to 1."""
    rows, columns = lit.shape
    apart = max(1, math.isqrt(rows * columns // _SAMPLE))
    picked = lit.diffuse[:, ::apart, ::apart].reshape(len(lit.diffuse), -1).astype(np.float64)
    known = np.isfinite(picked).all(axis=0)
    if not known.any():
        return 0.0
    mean = picked[:, known].mean(axis=1)
    spectrum = mean if reflectance is None else mean @ np.asarray(reflectance.basis, np.float64)
    return float(np.clip(spectrum.mean(), 0.0, 1.0))


def _planes(values: Any, size: tuple[int, ...]) -> NDArray[np.float32]:
    planes = floats(values)
    if planes.ndim != 3 or planes.shape[1:] != size:
        raise ArgumentError(
            f"reflectance: expected coefficients (k, {size[0]}, {size[1]}), found {planes.shape}"
        )
    return planes


def _levelled(
    lit: Surface, level: bool | Level | None, *, has_height: bool, wanted: bool
) -> Surface:
    """The surface relative to the plane of its panel, if that is wanted."""
    if level is None:
        if not wanted or has_height or lit.height is not None or not _faces(lit.normal):
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


def _in_front(eye: Any) -> bool:
    """Whether a picture has the painting's own pixels: from the side, it is foreshortened."""
    return isinstance(eye, PointView) or not np.any(np.asarray(eye, dtype=np.float64)[:2])

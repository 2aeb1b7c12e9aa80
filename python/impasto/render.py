"""Maps into pictures: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import holding, instance, length_mm
from impasto._internal.html import png
from impasto._internal.waiting import floats
from impasto.bands import Camera, checked_camera
from impasto.colour import Display, Fold, spectrum, xyz_from_coefficients, xyz_from_spectrum
from impasto.colour import white_scale as white_scale_of
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.reflectance import Reflectance, fit_reflectance
from impasto.height import integrate_normals
from impasto.rig import PointLight, Rig
from impasto.scene import Scene
from impasto.surface import Relightable, Surface

CELLS = 2048
"""Cells of the tone curve's table; the numerics fix the number."""
MIXING_GRID = np.arange(360.0, 831.0)
"""nm, for the sum of several illuminants."""


@dataclass(frozen=True)
class SceneArguments:
    """A scene as plain arrays: one matrix and one vector to XYZ per distinct illuminant."""

    rig: RigArguments
    intensity: NDArray[np.float64]
    colour: NDArray[np.uint32]
    diffuse: NDArray[np.float64]
    interface: NDArray[np.float64]
    background: tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture of a painting.

    Attributes
    ----------
    xyz
        ``(3, y, x)`` float32, as the adapted eye sees it; a white board in light of intensity 1
        has Y = 1. Not clipped.
    linear
        ``(3, y, x)`` float32 linear display light, scaled by ``exposure``. Not clipped.
    display
        ``(y, x, 3)`` uint8 codes.
    coverage
        ``(y, x)`` float32: how much of the pixel shows the painting. 0 where its maps hold no
        number and outside it; there the picture is the scene's background.
    exposure
        The factor between ``xyz`` and display light.
    clipped
        Channel to the share of pixels that are too bright for the display.
    outside
        Channel to the share of pixels whose colour is outside the display's gamut.
    screen
        The display that the codes are for.
    """

    xyz: NDArray[np.float32]
    linear: NDArray[np.float32]
    display: NDArray[np.uint8]
    coverage: NDArray[np.float32]
    exposure: float
    clipped: dict[str, float]
    outside: dict[str, float]
    screen: Display

    def __repr__(self) -> str:
        height, width = self.coverage.shape
        clipped = 100 * max(self.clipped.values())
        return (
            f"<Image {width} x {height} pixels, exposure {self.exposure:.3g}, "
            f"{clipped:.1f} % clipped>"
        )

    @property
    def valid(self) -> NDArray[np.bool_]:
        """``(y, x)``: at least half of the pixel shows the painting."""
        return np.asarray(self.coverage >= 0.5)

    @property
    def white_scale(self) -> float:
        """The exposure, by its other name."""
        return self.exposure

    def report(self) -> dict[str, Any]:
        """Plain numbers for a report file."""
        return {
            "exposure": self.exposure,
            "clipped": dict(self.clipped),
            "outside_gamut": dict(self.outside),
            "covered": float(self.coverage.mean(dtype=np.float64)),
            "display": self.screen.name,
        }

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The codes of the display ``(y, x, 3)``: ``np.asarray(image)``."""
        return np.array(self.display, dtype=dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        return png(self.display)

    def save(self, path: str | Path) -> None:
        """Write the picture; the suffix says in which format.

        ``.png``, ``.jpg`` and ``.tif``: 8-, 8- and 16-bit codes of the display, with its profile in
        PNG and TIFF unless it is sRGB. ``.exr``: linear light R, G, B and coverage A.

        Raises
        ------
        ArgumentError
            Another suffix; a JPEG for a display other than sRGB, which it could not name.
        """
        from impasto.colour import icc_profile
        from impasto.io import write_exr, write_jpeg, write_png8, write_tiff16

        suffix = checked_suffix(path)
        standard = self.screen.name == "srgb"
        icc = None if standard else icc_profile(self.screen)
        if suffix == ".png":
            write_png8(path, self.display, icc=icc)
        elif suffix in {".jpg", ".jpeg"}:
            if not standard:
                raise ArgumentError(
                    f"path: {path} would carry no profile of the display {self.screen.name!r}; "
                    "save .png or .tif"
                )
            write_jpeg(path, self.display)
        elif suffix in {".tif", ".tiff"}:
            write_tiff16(path, self.screen.encode(self.linear), icc=icc)
        else:
            write_exr(path, dict(zip("RGBA", (*self.linear, self.coverage), strict=True)))


def checked_suffix(path: str | Path, name: str = "path") -> str:
    """The suffix of a picture's file, in small letters.

    Raises
    ------
    ArgumentError
        A suffix that :meth:`Image.save` does not know.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr"}:
        raise ArgumentError(
            f"{name}: expected a name ending in .png, .jpg, .tif or .exr, found {path}"
        )
    return suffix


def render(
    surface: Relightable,
    scene: Scene,
    *,
    reflectance: Reflectance | None = None,
    camera: Camera | None = None,
    height: ArrayLike | None = None,
    pitch_mm: float | None = None,
    index: float | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Image:
    """Light a painting and show it.

    Parameters
    ----------
    surface
        What :func:`impasto.fit_sbrdf` returns, a :class:`Surface`, or a simulated painting. NaN is
        a pixel about which nothing is known: it shows the background.
    scene
        What lights it and who looks.
    reflectance
        What :func:`impasto.fit_reflectance` returns: colours under any illuminant. Default: the
        own spectra of a simulated painting, else none.
    camera
        Instead of a reflectance: the camera that took the bands; the reflectance is estimated from
        the surface's diffuse colours. With neither, three bands are taken for linear sRGB and one
        for grey: colours as captured, under the light of the capture.
    height
        ``(y, x)`` mm, for shadows; default: the surface's own, else the normals, integrated.
    pitch_mm
        Width of a pixel; default: the surface's own. Needed by point lights only.
    index
        Index of refraction of the interface; default: the surface's own.
    threads, progress
        As everywhere: None means every allowed core; a bool or a callable ``(done, total)``.

    Raises
    ------
    ArgumentError
        Shapes that disagree; an illuminant or an adaptation for colours without spectra.
    GeometryError
        A point light, and no width of a pixel.
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
        raise GeometryError("pitch_mm: point lights need the width of a pixel on the painting")
    pitch = 1.0 if pitch is None else pitch
    if reflectance is None:
        reflectance = surface.spectra()
    if reflectance is None and camera is not None:
        source: Any = surface
        reflectance = fit_reflectance(None, source, camera)
    lit = _coloured(lit, type(surface).__name__, reflectance, index)
    relief = _relief(lit, height, pitch, threads) if scene.shadows else None

    diffuse, interface, which, white = _colours(scene, reflectance, len(lit.diffuse))
    exposure = scene.exposure
    if exposure is None:
        exposure = white_scale_of(white, scene.display).scale
    to_display = exposure * scene.display.linear_from_xyz
    rig = Rig(scene.lights, views=scene.view, pitch_mm=pitch, origin=lit.origin).here
    lit = _with_ambient_of(lit, scene, rig)
    background = np.linalg.solve(to_display, np.asarray(scene.background))
    arguments = SceneArguments(
        rig=RigArguments.of(rig),
        intensity=rig.intensities,
        colour=which,
        diffuse=diffuse,
        interface=interface,
        background=(float(background[0]), float(background[1]), float(background[2])),
    )
    workers = thread_count(threads)
    with reporting(progress, "rendering") as callback:
        xyz, coverage = _core.render(lit, relief, arguments, workers, callback)
    matrix = np.ascontiguousarray(to_display.T)
    linear = _core.linear_from_bands(xyz, matrix, workers)
    display, below, above = _core.display_from_bands(xyz, matrix, _table(scene.display), 8, workers)
    pixels = coverage.size
    names = ("red", "green", "blue")
    return Image(
        xyz=xyz,
        linear=linear,
        display=display,
        coverage=coverage,
        exposure=float(exposure),
        clipped={name: count / pixels for name, count in zip(names, above, strict=True)},
        outside={name: count / pixels for name, count in zip(names, below, strict=True)},
        screen=scene.display,
    )


def display_from_bands(
    bands: ArrayLike, fold: Fold, *, bits: Literal[8, 16, 32] = 8, threads: int | None = None
) -> NDArray[Any]:
    """Display codes from reflectance coefficients in one pass, without any geometry.

    Parameters
    ----------
    bands
        ``(k, y, x)`` coefficients.
    fold
        What :func:`impasto.colour.display_from_coefficients` returns for their basis.
    bits
        8 or 16 for integer codes, 32 for float32 codes from 0 to 1.
    threads
        None means every allowed core.

    Returns
    -------
    ndarray
        ``(y, x, 3)``: the tone curve of ``fold.diffuse @ bands``, clipped to the display, within
        half an 8-bit code of exact arithmetic. NaN shows as 0.
    """
    planes = floats(bands)
    if planes.ndim != 3 or planes.shape[0] != fold.diffuse.shape[1]:
        raise ArgumentError(
            f"bands: expected ({fold.diffuse.shape[1]}, y, x), found shape {planes.shape}"
        )
    if bits not in {8, 16, 32}:
        raise ArgumentError(f"bits: expected 8, 16 or 32, found {bits!r}")
    matrix = np.ascontiguousarray(fold.diffuse.T)
    table = _table(fold.display)
    codes: NDArray[Any] = _core.display_from_bands(
        planes, matrix, table, bits, thread_count(threads)
    )[0]
    return codes


def _table(display: Display) -> NDArray[np.float32]:
    """The tone curve over the square root of light, ``(3, 2049)``."""
    light = np.linspace(0.0, 1.0, CELLS + 1) ** 2
    return np.ascontiguousarray(
        display.encode(np.broadcast_to(light, (3, light.size))), dtype=np.float32
    )


def _coloured(lit: Surface, kind: str, reflectance: Any, index: float | None) -> Surface:
    """The surface to be lit; with a reflectance its coefficients are the colours."""
    if reflectance is None:
        return lit if index is None else replace(lit, index=index)
    if lit.tinted:
        raise ArgumentError(
            f"reflectance: the lobes of a {kind} have strengths per band, which spectra do not "
            "tell; leave camera= and reflectance= out"
        )
    return lit.with_diffuse(_planes(reflectance.coefficients, lit.shape), index=index)


def _with_ambient_of(lit: Surface, scene: Scene, rig: Rig) -> Surface:
    """A part of a painting has the whole's ambient light, whatever near lights give its middle.

    ``rig`` has the intensities that arrive there; lobes with an ambient part share one illuminant.
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
    scene: Scene, reflectance: Any, bands: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.uint32], NDArray[Any]]:
    """Matrices ``(g, k, 3)``, vectors ``(g, 3)``, each light's row, and XYZ of white."""
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
    distinct: list[Any] = []
    which = []
    for illuminant in scene.illuminants:
        same = [index for index, other in enumerate(distinct) if _same(illuminant, other)]
        which.append(same[0] if same else len(distinct))
        if not same:
            distinct.append(illuminant)
    test = distinct[0] if len(distinct) == 1 else _mixture(scene)
    folds = [
        xyz_from_coefficients(
            reflectance.basis,
            reflectance.wavelengths,
            illuminant,
            test=test,
            reference=scene.reference,
            d=scene.adaptation,
            mode=scene.adaptation_mode,
        )
        for illuminant in distinct
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


def _captured(scene: Scene, bands: int) -> NDArray[np.float64]:
    """Columns to XYZ for bands without spectra."""
    if bands not in {1, 3}:
        raise ArgumentError(
            f"camera: {bands} bands are no colours yet; say camera=, or reflectance= of "
            "impasto.fit_reflectance"
        )
    as_it_was = all(_same(illuminant, "D65") for illuminant in scene.illuminants)
    if scene.adaptation is not None or not as_it_was:
        raise ArgumentError(
            "camera: without camera= or reflectance= only the colours under the light of the "
            "capture are known; another illuminant or an adaptation needs one of them"
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
    """The light of all lamps together, which the eye adapts to; each has Y = its intensity."""
    luminosity = xyz_from_spectrum(MIXING_GRID, np.ones(MIXING_GRID.size))[1]
    total = np.zeros(MIXING_GRID.size)
    for light, illuminant in zip(scene.lights, scene.illuminants, strict=True):
        power = spectrum(illuminant, MIXING_GRID)
        total += light.intensity * power / (luminosity @ power)
    return MIXING_GRID, total

"""Render a painting from its maps: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import holding, instance, length_mm, one_of
from impasto._internal.html import png
from impasto._internal.waiting import floats, wait_for
from impasto.bands import Camera, checked_camera
from impasto.colour import Display, Fold
from impasto.colour import white_scale as white_scale_of
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.interface import spectra_of_lobes
from impasto.fit.reflectance import Reflectance, fit_reflectance
from impasto.height import integrate_normals
from impasto.level import Level, as_level, find_level
from impasto.lighting import channel_colours, lamp_colours
from impasto.rig import FRONTAL, DistantLight, PointLight, PointView, Rig
from impasto.scene import Scene
from impasto.surface import Relightable, Surface

Fidelity = Literal["photographs", "model"]

CELLS = 2048
"""Cells in the table of the tone curve; the Rust core requires this number."""
_ENOUGH = 100
"""A panel has more normals than that."""


@dataclass(frozen=True)
class SceneArguments:
    """A scene as arrays: for each distinct illuminant one matrix and one vector to XYZ."""

    rig: RigArguments
    intensity: NDArray[np.float64]
    colour: NDArray[np.uint32]
    diffuse: NDArray[np.float64]
    interface: NDArray[np.float64]
    background: tuple[float, float, float]
    environment: tuple[Any, tuple[int, int, int]] | None = None
    """What :meth:`impasto.Environment.prefiltered` gives, and the illuminants of its channels."""


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """A picture of a painting.

    Attributes
    ----------
    xyz
        ``(3, y, x)`` float32 tristimulus values for the adapted observer; a white board in light of
        intensity 1 has Y = 1. Not clipped.
    linear
        ``(3, y, x)`` float32 linear display light, scaled by ``exposure``. Not clipped.
    display
        ``(y, x, 3)`` uint8 codes.
    coverage
        ``(y, x)`` float32: the share of the pixel that shows the painting. It is 0 outside the
        painting and where its maps are NaN; the picture shows the scene's background there.
    exposure
        The factor from ``xyz`` to display light.
    clipped
        For each channel, the share of pixels that are too bright for the display.
    outside
        For each channel, the share of pixels whose colour is outside the display's gamut.
    screen
        The display that the codes are made for.
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
        """``(y, x)``: whether at least half of the pixel shows the painting."""
        return np.asarray(self.coverage >= 0.5)

    @property
    def white_scale(self) -> float:
        """Another name of ``exposure``."""
        return self.exposure

    def report(self) -> dict[str, Any]:
        """Numbers for a report file."""
        return {
            "exposure": self.exposure,
            "clipped": dict(self.clipped),
            "outside_gamut": dict(self.outside),
            "covered": float(self.coverage.mean(dtype=np.float64)),
            "display": self.screen.name,
        }

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """``np.asarray(image)``: the display codes ``(y, x, 3)``."""
        return np.array(self.display, dtype=dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        """PNG for notebooks."""
        return png(self.display)

    def save(self, path: str | Path) -> None:
        """Write the picture; the suffix selects the format.

        ``.png``, ``.jpg`` and ``.tif``: 8-, 8- and 16-bit display codes; PNG and TIFF contain an
        ICC profile unless the display is sRGB. ``.exr``: linear light R, G, B and coverage A.

        Raises
        ------
        ArgumentError
            Another suffix; or a JPEG, which is written without a profile, for a display other than
            sRGB.
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
                    f"path: {path} would have no profile of the display {self.screen.name!r}; "
                    "save .png or .tif"
                )
            write_jpeg(path, self.display)
        elif suffix in {".tif", ".tiff"}:
            write_tiff16(path, self.screen.encode(self.linear), icc=icc)
        else:
            write_exr(path, dict(zip("RGBA", (*self.linear, self.coverage), strict=True)))


def checked_suffix(path: str | Path, name: str = "path") -> str:
    """The suffix of a picture file, in lower case.

    Raises
    ------
    ArgumentError
        A suffix that :meth:`Image.save` does not support.
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
    fidelity: Fidelity = "photographs",
    level: bool | Level | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Image:
    """Render a painting under the lights of a scene.

    Parameters
    ----------
    surface
        The result of :func:`impasto.fit_sbrdf`, a :class:`Surface`, or a simulated painting. Pixels
        that are NaN show the background.
    scene
        Lights, view, illuminant, adaptation and display.
    reflectance
        The result of :func:`impasto.fit_reflectance`, for colours under any illuminant. Default:
        the spectra of a simulated painting, otherwise none.
    camera
        Alternative to ``reflectance``: the camera that took the bands. The reflectance is then
        estimated from the diffuse colours of the surface. Without both, three bands are interpreted
        as linear sRGB and one band as grey: the colours under the light of the capture.
    height
        ``(y, x)`` mm, for shadows; default: that of the surface, otherwise integrated from the
        normals.
    pitch_mm
        Width of a pixel in mm; default: that of the surface. Only point lights need it.
    index
        Index of refraction of the interface; default: that of the surface.
    fidelity
        ``"photographs"``: the model and, where a result has them, its ``relief`` and interpolated
        ``residuals``, as long as the view is that of the photographs, no shadows are cast, the
        panel is not rotated and the colours are those of the bands; ``"model"``: the model alone.
        The ``"model"`` of :meth:`Sbrdf.predict` has the relief, that of a picture has not.
    level
        True: the panel is rotated to face the viewer, so that the lights shine on its own plane; or
        the plane itself, as :func:`impasto.find_level` finds it in a larger part of the painting.
        Default: True with shadows, for a surface without a height of its own whose panel leans by
        more than a degree; False without. A leaning panel is in its own shadow under raking light.
    threads
        Number of threads; None means every allowed core.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Image
        XYZ, linear display light and display codes.

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
    one_of(fidelity, get_args(Fidelity), "fidelity")
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
    stood = lit.normal
    lit = _levelled(lit, level, has_height=height is not None, shadows=scene.shadows)
    as_photographed = lit.normal is stood and not scene.shadows
    relief = _relief(lit, height, pitch, threads) if scene.shadows else None

    diffuse, interface, which, white = lamp_colours(scene, reflectance, len(lit.diffuse))
    if scene.environment is not None:
        channels = channel_colours(scene, reflectance, len(lit.diffuse))
        diffuse = np.concatenate([diffuse, channels.diffuse])
        interface = np.concatenate([interface, channels.interface])
        white = white + channels.white
    # The largest Y is known when the picture is.
    unknown = isinstance(scene.exposure, str)
    exposure = 1.0 if isinstance(scene.exposure, str) else scene.exposure
    if exposure is None:
        exposure = white_scale_of(white, scene.display).scale
    to_display = exposure * scene.display.linear_from_xyz
    eye = surface.eye() if scene.view is None else scene.view
    # Without lamps the rig only says where the eye is.
    lamps = scene.lights or (DistantLight(FRONTAL),)
    whole = Rig(lamps, views=eye, pitch_mm=pitch, origin=lit.origin)
    rig = whole.here
    lit = _with_ambient_of(lit, scene, rig)
    behind = np.zeros(3) if unknown else np.asarray(scene.background)
    background = np.linalg.solve(to_display, behind)
    arguments = SceneArguments(
        rig=RigArguments.of(rig),
        intensity=rig.intensities[: len(scene.lights)],
        colour=which,
        diffuse=diffuse,
        interface=interface,
        background=(float(background[0]), float(background[1]), float(background[2])),
        environment=_surroundings(scene, lit, len(diffuse), threads),
    )
    workers = thread_count(threads)
    with reporting(progress, "rendering") as callback:
        xyz, coverage = _core.render(lit, relief, arguments, workers, callback)
    lamplit = bool(scene.lights) and reflectance is None
    if fidelity == "photographs" and lamplit and as_photographed and _in_front(eye):
        extra = surface.unmodelled(whole)
        if extra is not None:
            # Colours without spectra have one matrix for all lights.
            xyz += wait_for(_xyz_of, diffuse[0], extra)
    if unknown:
        exposure = _exposure_of_maximum(xyz, coverage)
        to_display = exposure * scene.display.linear_from_xyz
        light = np.linalg.solve(to_display, np.asarray(scene.background)).astype(np.float32)
        xyz += light[:, None, None] * (1.0 - coverage)
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
    """Display codes from reflectance coefficients, without lights and normals, in one pass.

    Parameters
    ----------
    bands
        ``(k, y, x)`` coefficients.
    fold
        The result of :func:`impasto.colour.display_from_coefficients` for their basis.
    bits
        8 or 16: integer codes; 32: float32 codes from 0 to 1.
    threads
        None means every allowed core.

    Returns
    -------
    ndarray
        ``(y, x, 3)``: the tone curve of ``fold.diffuse @ bands``, clipped to the display, within
        half an 8-bit code of exact arithmetic. NaN becomes 0.
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


def _in_front(eye: Any) -> bool:
    """Whether a picture has the painting's own pixels: from the side, it is foreshortened."""
    return isinstance(eye, PointView) or not np.any(np.asarray(eye, dtype=np.float64)[:2])


def _table(display: Display) -> NDArray[np.float32]:
    """The tone curve at equal steps of the square root of light, ``(3, 2049)``."""
    light = np.linspace(0.0, 1.0, CELLS + 1) ** 2
    return np.ascontiguousarray(
        display.encode(np.broadcast_to(light, (3, light.size))), dtype=np.float32
    )


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


def _with_ambient_of(lit: Surface, scene: Scene, rig: Rig) -> Surface:
    """Scale the ambient light of a part of a painting to that of the whole.

    Ambient light is relative to the light that arrives at the centre. ``rig`` has the intensities
    that near lights have at the centre of the part. Lobes with ambient light have one illuminant.
    """
    there = float(sum(light.intensity for light in scene.lights))
    here = float(rig.intensities[: len(scene.lights)].sum())
    if lit.ambient is None or here == there:
        return lit
    return replace(lit, ambient=lit.ambient * np.float32(there / here))


def _surroundings(
    scene: Scene, lit: Surface, colours: int, threads: int | None
) -> tuple[Any, tuple[int, int, int]] | None:
    """The environment for the numerics; the last three colours are its channels'."""
    if scene.environment is None:
        return None
    lobes = lit.model == "lafortune" and len(lit.lobes) > 0
    built = scene.environment.prefiltered(lobes=lobes, threads=threads)
    return built, (colours - 3, colours - 2, colours - 1)


def _xyz_of(matrix: NDArray[Any], extra: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light of bands in XYZ; the background stays as it is."""
    return np.tensordot(matrix.T.astype(np.float32), np.nan_to_num(extra, nan=0.0), axes=1)


def _exposure_of_maximum(xyz: NDArray[np.float32], coverage: NDArray[np.float32]) -> float:
    """The factor at which the largest Y of the picture is that of the display's white."""
    luminance = xyz[1][coverage > 0.0]
    highest = float(luminance.max(initial=0.0))
    return 1.0 / highest if highest > 0.0 else 1.0


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

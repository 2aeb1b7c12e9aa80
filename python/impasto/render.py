"""Render a painting from its maps: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, reporting, thread_count
from impasto._internal.checks import one_of
from impasto._internal.waiting import floats, wait_for
from impasto.bands import Camera
from impasto.colour import Fold
from impasto.errors import ArgumentError
from impasto.fit.reflectance import Reflectance
from impasto.image import Image, Output, Shown, columns_to_display, tone_table
from impasto.level import Level
from impasto.lighting import Prepared, prepare
from impasto.scene import Scene
from impasto.surface import Relightable

Fidelity = Literal["photographs", "model"]


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
    output: Output = "display",
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
    output
        What is computed now; the rest is computed when it is first used. ``"display"``: display
        codes, where nothing stands in between without planes of light; :attr:`Image.xyz` then
        lights the painting again. ``"light"``: XYZ, of which display codes are made.
    threads
        Number of threads; None means every allowed core.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Image
        Display codes, linear display light and XYZ.

    Raises
    ------
    ArgumentError
        Shapes that do not match; an illuminant or an adaptation for colours without spectra.
    GeometryError
        A point light without the width of a pixel.
    """
    one_of(fidelity, get_args(Fidelity), "fidelity")
    one_of(output, get_args(Output), "output")
    options: dict[str, Any] = {
        "reflectance": reflectance,
        "camera": camera,
        "height": height,
        "pitch_mm": pitch_mm,
        "index": index,
        "level": level,
        "threads": threads,
    }
    prepared = prepare(surface, scene, **options)
    plan = _core.Plan.forced(prepared.surface, prepared.arguments, prepared.relief is not None)
    extra = None
    if fidelity == "photographs" and prepared.as_photographed:
        extra = surface.unmodelled(prepared.rig)

    def again() -> NDArray[np.float32]:
        # From what the caller has: no prepared maps are kept.
        return render(surface, scene, fidelity=fidelity, output="light", **options).xyz

    return picture(
        prepared,
        plan,
        scene,
        extra,
        again=again if output == "display" else None,
        threads=threads,
        progress=progress,
    )


def picture(
    prepared: Prepared,
    plan: _core.Plan,
    scene: Scene,
    extra: NDArray[np.float32] | None,
    *,
    again: Callable[[], NDArray[np.float32]] | None = None,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Image:
    """A prepared scene as planned.

    ``extra`` is light ``(band, y, x)`` besides the model's. With ``again``, which returns the XYZ
    of the same picture, display codes are made without planes of light where that is possible.
    """
    arguments, exposure = prepared.arguments, prepared.exposure
    workers = thread_count(threads)
    surface, relief = prepared.surface, prepared.relief
    if again and extra is None and not prepared.from_picture and not plan.projected:
        matrix, table = columns_to_display(scene.display, exposure), tone_table(scene.display)
        with reporting(progress, "rendering") as callback:
            codes, coverage, below, above = _core.paint(
                surface, relief, arguments, plan, matrix, table, workers, callback
            )
        shown = Shown(codes, below, above)
        return Image(coverage, exposure, scene.display, again, shown, threads)
    with reporting(progress, "rendering") as callback:
        xyz, coverage = _core.render(surface, relief, arguments, plan, workers, callback)
    if extra is not None:
        # Colours without spectra have one matrix for all lights.
        xyz += wait_for(_xyz_of, arguments.diffuse[0], extra)
    if prepared.from_picture:
        exposure = _exposure_of_maximum(xyz, coverage)
        to_display = exposure * scene.display.linear_from_xyz
        light = np.linalg.solve(to_display, np.asarray(scene.background)).astype(np.float32)
        xyz += light[:, None, None] * (1.0 - coverage)
    return Image(coverage, exposure, scene.display, xyz, threads=threads)


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
    table = tone_table(fold.display)
    codes: NDArray[Any] = _core.display_from_bands(
        planes, matrix, table, bits, thread_count(threads)
    )[0]
    return codes


def _xyz_of(matrix: NDArray[Any], extra: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light of bands in XYZ; the background stays as it is."""
    return np.tensordot(matrix.T.astype(np.float32), np.nan_to_num(extra, nan=0.0), axes=1)


def _exposure_of_maximum(xyz: NDArray[np.float32], coverage: NDArray[np.float32]) -> float:
    """The factor at which the largest Y of the picture is that of the display's white."""
    luminance = xyz[1][coverage > 0.0]
    highest = float(luminance.max(initial=0.0))
    return 1.0 / highest if highest > 0.0 else 1.0

"""Render a painting from its maps: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, thread_count
from impasto._internal.checks import one_of
from impasto._internal.waiting import floats
from impasto.bands import Camera
from impasto.colour import Fold
from impasto.errors import ArgumentError
from impasto.fit.reflectance import Reflectance
from impasto.image import Image, Output, tone_curve
from impasto.level import Level
from impasto.lighting import prepare
from impasto.picture import Backend, Fidelity, picture
from impasto.plan import plan
from impasto.scene import Scene
from impasto.surface import Relightable


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
    reduce: int = 1,
    tolerance: str | float | None = None,
    output: Output = "display",
    backend: Backend = "cpu",
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
        ``(y, x)`` mm, for shadows and parallax; default: that of the surface, otherwise
        integrated from the normals.
    pitch_mm
        Width of a pixel in mm; default: that of the surface. Point lights and perspectives need it.
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
        Default: True with shadows or parallax, for a surface without a height of its own whose
        panel leans by more than a degree; False without. A leaning panel is in its own shadow
        under raking light.
    reduce
        How many pixels of the surface, along a side, become one of the picture: the gloss of a
        small picture is that of the whole, as normals that scatter within a pixel widen its lobes
        (Toksvig 2005, Olano and Baker 2010). Rows and columns that fill no pixel are left out.
        Default: 1.
    tolerance
        What may be left out of the picture where it cannot be seen: 0, ``"code:1"`` or
        ``"dE:0.5"``, as in :func:`impasto.plan`. Default: nothing is left out, and no statistics of
        the surface are made, which pay from the second picture on.
    output
        What is computed now; the rest is computed when it is first used. ``"display"``: display
        codes, where nothing stands in between without planes of light; :attr:`Image.xyz` then
        lights the painting again. ``"light"``: XYZ, of which display codes are made.
    backend
        ``"cpu"``: the same bits on every machine. ``"gpu"``: a graphics card, within 4e-6 of the
        encoded value; ``"auto"``: a card, but no driver that computes on the CPU. Where a card
        cannot do it the CPU does, with one :class:`ImpastoWarning`. For many pictures of one
        surface :class:`impasto.gpu.Renderer` keeps it on the card.
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
    one_of(backend, get_args(Backend), "backend")
    options: dict[str, Any] = {
        "reflectance": reflectance,
        "camera": camera,
        "height": height,
        "pitch_mm": pitch_mm,
        "index": index,
        "level": level,
        "reduce": reduce,
        "threads": threads,
    }
    if tolerance is not None:
        planned = plan(surface, scene, tolerance=tolerance, fidelity=fidelity, **options)
        return planned.render(output=output, backend=backend, threads=threads, progress=progress)
    # One picture does not pay for the statistics that a plan needs.
    prepared = prepare(surface, scene, **options)
    everything = _core.Plan.forced(prepared.surface, prepared.arguments)
    extra = None
    if fidelity == "photographs" and prepared.as_photographed:
        extra = surface.unmodelled(prepared.rig)

    def again() -> NDArray[np.float32]:
        # From what the caller has: no prepared maps are kept.
        return render(surface, scene, fidelity=fidelity, output="light", **options).xyz

    return picture(
        prepared,
        everything,
        scene,
        extra,
        again=again if output == "display" else None,
        backend=backend,
        threads=threads,
        progress=progress,
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
    curve = tone_curve(fold.display)
    codes: NDArray[Any] = _core.display_from_bands(
        planes, matrix, curve, bits, thread_count(threads)
    )[0]
    return codes

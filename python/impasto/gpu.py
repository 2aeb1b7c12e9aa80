"""Pictures by a graphics card: a surface is uploaded once and shown under scene after scene.

No driver is loaded before the first call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto import _core
from impasto._internal.calls import ProgressCallback, thread_count
from impasto._internal.checks import instance, length_mm, truth
from impasto._internal.png import png
from impasto.bands import Camera
from impasto.colour import Display
from impasto.errors import ArgumentError, GpuUnavailableError
from impasto.fit.reflectance import Reflectance
from impasto.image import columns_to_display, exposure_of_maximum, tone_curve
from impasto.level import Level
from impasto.lighting import (
    SceneArguments,
    arranged,
    check_pitchless,
    metallic,
    prepare,
    rig_of,
    varnished,
)
from impasto.scene import Scene
from impasto.surface import Relightable, Surface
from impasto.varnish import Varnish

__all__ = ["Adapter", "Frame", "Renderer", "adapters"]

Kind = Literal["discrete", "integrated", "virtual", "other", "cpu"]

_NOT_BUILT = (
    "this impasto was built without its GPU renderer; build it with the feature gpu (the default), "
    'or use backend="cpu"'
)


@dataclass(frozen=True)
class Adapter:
    """A graphics card as its driver describes it.

    Attributes
    ----------
    name
        The card's name; a part of it selects the card.
    kind
        ``"cpu"`` is a driver that computes on the CPU, as Mesa's llvmpipe.
    backend
        ``"vulkan"``, ``"metal"`` or ``"dx12"``.
    driver
        The driver and its version.
    """

    name: str
    kind: Kind
    backend: str
    driver: str


def adapters() -> tuple[Adapter, ...]:
    """The graphics cards that can render, the best first; none without a driver.

    Returns
    -------
    tuple
        :class:`Adapter` by :class:`Adapter`; those of kind ``"cpu"`` come last.
    """
    if not is_built():
        return ()
    return tuple(Adapter(**found) for found in _core.gpu_adapters())


def is_built() -> bool:
    """Whether the extension has the GPU renderer."""
    return hasattr(_core, "gpu_render")


def lit_by_card(
    surface: Surface,
    height: NDArray[np.float32] | None,
    scene: SceneArguments,
    plan: _core.Plan,
    threads: int,
    progress: ProgressCallback | None,
    adapter: str,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Light ``(3, y, x)`` and coverage as the CPU's ``_core.render`` gives them, by a card.

    Raises
    ------
    GpuUnavailableError
        No such card, too little memory, a lost card, or a surface that it cannot show.
    """
    if not is_built():
        raise GpuUnavailableError(_NOT_BUILT)
    return _core.gpu_render(surface, height, scene, plan, threads, progress, adapter)


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """A picture as a display shows it.

    Attributes
    ----------
    codes
        ``(y, x, 4)`` uint8: red, green, blue, and the coverage from 0 to 255.
    exposure
        The factor from XYZ, where a white board in light of intensity 1 has Y = 1, to display
        light.
    screen
        The display that the codes are made for.
    """

    codes: NDArray[np.uint8]
    exposure: float
    screen: Display

    @property
    def display(self) -> NDArray[np.uint8]:
        """``(y, x, 3)`` codes, without the coverage."""
        return self.codes[..., :3]

    def __repr__(self) -> str:
        height, width = self.codes.shape[:2]
        return f"<Frame {width} x {height} pixels, exposure {self.exposure:.3g}>"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """``np.asarray(frame)``: the display codes ``(y, x, 3)``."""
        return np.array(self.display, dtype=dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        """PNG for notebooks."""
        return png(np.ascontiguousarray(self.display))


class Renderer:
    """A surface on a graphics card, for many pictures of it.

    Shows the model of the surface, as :func:`impasto.render` does with ``fidelity="model"``.

    Parameters
    ----------
    surface, reflectance, camera, height, pitch_mm, index, level
        As in :func:`impasto.render`.
    shadows
        Whether scenes may have shadows and parallax; the relief is then kept on the card, too.
    adapter
        ``"auto"``: the best card, but no driver that computes on the CPU; ``"any"``: such a driver
        if there is no card; or a part of the name of one of :func:`adapters`.
    threads
        Number of threads of what the CPU does: shadows of point lights, slanted views. None means
        every allowed core.

    Raises
    ------
    GpuUnavailableError
        No such card, too little memory, or more than 8 lobes.
    ArgumentError
        Shapes that do not match.

    Examples
    --------
    >>> import impasto
    >>> from impasto.gpu import Renderer
    >>> def turn_lamp(surface):
    ...     renderer = Renderer(surface)
    ...     for angle in range(0, 360, 5):
    ...         light = impasto.DistantLight.from_angles(azimuth=angle, elevation=20)
    ...         yield renderer.frame(impasto.Scene([light])).display
    """

    def __init__(
        self,
        surface: Relightable,
        *,
        reflectance: Reflectance | None = None,
        camera: Camera | None = None,
        height: ArrayLike | None = None,
        pitch_mm: float | None = None,
        index: float | None = None,
        level: bool | Level | None = None,
        shadows: bool = False,
        adapter: str = "auto",
        threads: int | None = None,
    ) -> None:
        if not is_built():
            raise GpuUnavailableError(_NOT_BUILT)
        instance(adapter, str, "adapter", '"auto", "any" or a part of a name')
        self._shadows = truth(shadows, "shadows")
        options: dict[str, Any] = {
            "reflectance": reflectance,
            "camera": camera,
            "height": height,
            "pitch_mm": pitch_mm,
            "index": index,
            "level": level,
            "threads": threads,
        }
        # Any scene with the same surface.
        frontal = Scene([(0.0, 0.0, 1.0)], shadows=self._shadows)
        prepared = prepare(surface, frontal, **options)
        self._upright: Callable[[], Renderer] | None = None
        if self._shadows and level is None:
            stood = prepare(surface, frontal.changed(shadows=False), **options).surface.normal
            if not np.array_equal(stood, prepared.surface.normal, equal_nan=True):
                # Shadows rotate a panel that leans; scenes without show it as it stood.
                self._upright = cache(lambda: Renderer(surface, adapter=adapter, **options))
        self._reflectance = prepared.reflectance
        self._lit, self._relief = prepared.surface, prepared.relief
        # Strengths are those of bands there, and of basis spectra in what is prepared.
        self._metallic = cache(lambda: metallic(surface.surface()))
        self._pitch = self._lit.pitch_mm if pitch_mm is None else length_mm(pitch_mm, "pitch_mm")
        self._threads = thread_count(threads)
        self._eye = surface.eye_in_mm(pitch_mm)
        self._in_mm = pitch_mm is not None or surface.known_pitch_mm is not None
        self._wanted = adapter
        self._uploaded = self._upload(self._lit)
        self._varnish: Varnish | None = None

    def _upload(self, lit: Surface) -> _core.GpuRenderer:
        pitch = 1.0 if self._pitch is None else self._pitch
        return _core.GpuRenderer(lit, self._relief, pitch, self._wanted)

    def __repr__(self) -> str:
        height, width = self._lit.shape
        return f"<Renderer {width} x {height} pixels on {self.adapter.name}>"

    @property
    def adapter(self) -> Adapter:
        """The card that the surface is on."""
        return Adapter(**self._uploaded.adapter)

    def frame(self, scene: Scene) -> Frame:
        """The surface under the lights of a scene, as codes of its display.

        Parameters
        ----------
        scene
            Lights, view, illuminant, adaptation and display.

        Returns
        -------
        Frame
            The codes of :func:`impasto.render`, each within one; slanted views are resampled on
            the CPU.

        Raises
        ------
        ArgumentError
            Shadows in a renderer without; an illuminant for colours without spectra.
        GeometryError
            A point light without the width of a pixel.
        GpuUnavailableError
            The card was lost, or has too little memory.
        """
        if self._upright is not None and not _has_relief(_scene(scene)):
            return self._upright().frame(scene)
        arguments, exposure, uploaded = self._prepared(scene)
        if exposure is None:
            xyz, coverage = uploaded.light(arguments, self._threads)
            exposure = exposure_of_maximum(xyz, coverage)
        to_display = exposure * scene.display.linear_from_xyz
        behind = np.linalg.solve(to_display, np.asarray(scene.background))
        arguments = replace(arguments, background=_three(behind))
        columns = columns_to_display(scene.display, exposure)
        curve = tone_curve(scene.display)
        codes = uploaded.codes(arguments, columns, curve, self._threads)
        return Frame(codes=codes, exposure=float(exposure), screen=scene.display)

    def light(self, scene: Scene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The surface under the lights of a scene, as light.

        Parameters
        ----------
        scene
            As in :meth:`frame`; where nothing of the painting is known the light is 0.

        Returns
        -------
        tuple
            ``(3, y, x)`` XYZ and ``(y, x)`` coverage, as of :func:`impasto.render`.
        """
        if self._upright is not None and not _has_relief(_scene(scene)):
            return self._upright().light(scene)
        arguments, _, uploaded = self._prepared(scene)
        return uploaded.light(arguments, self._threads)

    def _prepared(self, scene: Scene) -> tuple[SceneArguments, float | None, _core.GpuRenderer]:
        """A scene as arrays, its exposure if it is known before the picture, and the surface."""
        if _has_relief(_scene(scene)) and not self._shadows:
            found = "shadows" if scene.shadows else "parallax"
            raise ArgumentError(
                f"scene: it has {found}, but the renderer has no relief; make it with shadows=True"
            )
        if not self._in_mm:
            check_pitchless(scene)
        # A varnish has a lobe of its own.
        coated = self._lit
        if scene.varnish is not None:
            coated = varnished(coated, scene.varnish, self._metallic())
        eye = self._eye if scene.view is None else scene.view
        pitch = 1.0 if self._pitch is None else self._pitch
        whole = rig_of(scene, eye, pitch, coated)
        arguments, known = arranged(coated, scene, whole, eye, self._reflectance)
        if scene.varnish is not self._varnish:
            self._uploaded, self._varnish = self._upload(coated), scene.varnish
        exposure = None if isinstance(scene.exposure, str) else known
        # The background is added when the exposure of the picture is known.
        arguments = replace(arguments, background=(0.0, 0.0, 0.0))
        return arguments, exposure, self._uploaded


def _scene(scene: Scene) -> Scene:
    instance(scene, Scene, "scene", "an impasto.Scene, as in Scene([DistantLight((0, 1, 1))])")
    return scene


def _has_relief(scene: Scene) -> bool:
    return scene.shadows or scene.has_parallax


def _three(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])

"""What is exported, and what impasto itself shows of it: the reference of every loss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto.colour import display_from_coefficients
from impasto.errors import ArgumentError
from impasto.lighting import prepare
from impasto.lights import DistantLight
from impasto.overview import visible
from impasto.render import render
from impasto.rig import PointView
from impasto.scene import Scene
from impasto.surface import Relightable, Surface

Map = NDArray[np.float32]
Direction = tuple[float, float, float]
FAR_MM = 1e7
"""An eye so far away sees all pixels from one direction to 1e-4 radians on a painting of a
metre."""


@dataclass(frozen=True, eq=False)
class Source:
    """A painting that goes into another format.

    Parameters
    ----------
    result
        The result of :func:`impasto.fit_sbrdf`, a :class:`impasto.Surface`, or a simulated
        painting. Of bands that are neither one nor three, without spectra, the last, the middle and
        the first stand in for red, green and blue.
    reflectance
        The result of :func:`impasto.fit_reflectance`: colours are then those under D65.
    pitch_mm
        Width of a pixel on the painting; default: that of the result.
    name
        Of the painting, for formats that have a place for it.
    """

    result: Relightable
    reflectance: Any = None
    pitch_mm: float | None = None
    name: str = "painting"

    def __post_init__(self) -> None:
        if not isinstance(self.result, Relightable):
            raise ArgumentError(
                "result: expected what impasto.fit_sbrdf or impasto.load_sbrdf returns, or an "
                f"impasto.Surface, found {type(self.result).__name__}"
            )
        pitch = self.pitch_mm
        known = self.result.known_pitch_mm if pitch is None else length_mm(pitch, "pitch_mm")
        object.__setattr__(self, "pitch_mm", known)
        object.__setattr__(self, "result", visible(self.result, self.spectra))

    @property
    def spectra(self) -> Any:
        """The reflectance that was given, or that of a simulated painting; None without spectra."""
        return self.result.spectra() if self.reflectance is None else self.reflectance

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.result.surface().shape

    @property
    def size_mm(self) -> tuple[float, float]:
        """Height and width of the painting; 1 mm per pixel where no width of a pixel is known."""
        pitch = self.pitch_mm or 1.0
        rows, columns = self.shape
        return rows * pitch, columns * pitch

    def linear(self, light: Direction, view: Direction | None = None) -> Map:
        """``(3, y, x)`` linear sRGB that :func:`impasto.render` shows, not clipped.

        A white board in full light is 1. With a ``view`` the pixels stay those of the painting,
        each as seen from that direction.
        """
        eye = None
        if view is not None:
            x, y, z = (FAR_MM * one for one in view)
            eye = PointView((x, y, z))
        scene = Scene([DistantLight(light)], view=eye, exposure=1.0)
        image = render(
            self.result,
            scene,
            reflectance=self.reflectance,
            pitch_mm=self.pitch_mm or 1.0,
            output="light",
        )
        shown = image.linear
        shown[:, ~self.known] = 0.0
        return shown

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """``(y, x)``: whether the pixel has a normal and colours."""
        lit = self.surface
        return np.asarray(np.isfinite(lit.normal[2]) & np.isfinite(lit.diffuse).all(axis=0))

    @cached_property
    def surface(self) -> Surface:
        """Its maps in linear sRGB under D65: ``diffuse (3, y, x)``, lobes grey or ``(3, y, x)``."""
        scene = Scene([DistantLight((0.0, 0.0, 1.0))], exposure=1.0)
        lit = prepare(self.result, scene, reflectance=self.reflectance).surface
        bands = len(lit.diffuse)
        spectra = self.spectra
        if spectra is None:
            return lit if bands == 3 else _of_colours(lit, np.ones((3, bands)) / bands)
        fold = display_from_coefficients(spectra.basis, spectra.wavelengths, "D65", white=1.0)
        return _of_colours(lit, np.asarray(fold.diffuse))


def _of_colours(lit: Surface, matrix: NDArray[np.float64]) -> Surface:
    operator = np.float32(matrix)

    def colours(planes: Map) -> Map:
        return np.asarray(np.tensordot(operator, planes, axes=1), dtype=np.float32)

    return lit.with_diffuse(colours(lit.diffuse), spectra=colours)

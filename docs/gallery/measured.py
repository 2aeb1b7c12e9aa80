"""A measured painting, and pictures of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import impasto
from impasto import Image, Scene
from impasto.pictures import BACKGROUND, Panel

CANDLE = 1900.0
"""Kelvin: the flame of a wax candle."""
EYES = {0.0: "d = 0, not adapted", 0.56: "d = 0.56, as measured", 1.0: "d = 1, fully adapted"}
"""Degrees of adaptation; the middle one is that of the six-band paper."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What the fits made of photographs.

    Attributes
    ----------
    sbrdf
        The result of :func:`impasto.fit_sbrdf`.
    reflectance
        The result of :func:`impasto.fit_reflectance`.
    options
        Options of :func:`impasto.render` for every picture.
    """

    sbrdf: Any
    reflectance: Any
    options: Mapping[str, Any] = field(default_factory=dict)

    def image(self, scene: Scene, surface: Any = None) -> Image:
        """The painting in a scene; ``surface``: other maps with the same spectra."""
        return impasto.render(
            self.sbrdf if surface is None else surface,
            scene.changed(background=background()),
            reflectance=self.reflectance,
            **self.options,
        )

    def panel(self, title: str, note: str, scene: Scene, surface: Any = None) -> Panel:
        """The painting in a scene, with the words above it."""
        return Panel(title, self.image(scene, surface).display, note)


@cache
def background() -> tuple[float, float, float]:
    """The dark grey of a sheet as linear light."""
    red, green, blue = (((np.array(BACKGROUND) / 255.0 + 0.055) / 1.055) ** 2.4).tolist()
    return (red, green, blue)


def difference(first: ArrayLike, second: ArrayLike) -> float:
    """Mean CIEDE2000 of two pictures ``(3, y, x)`` in XYZ, white at Y = 1."""
    lab, other = (impasto.colour.lab_from_xyz(xyz) for xyz in (first, second))
    return float(impasto.colour.delta_e(lab, other).mean())

"""The relief of a painting before a camera that looks askew.

A ray meets the highest part of the relief in its way: it is followed downwards in steps of at most
a pixel, and bisected where it first lies below the surface (relief mapping
[@policarpo2005relief]). So one part of the relief hides another, which the estimation of depth does
not foresee.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from impasto import simulate
from impasto.rehearsal.studio import Floats
from impasto.simulate.fields import smoothstep, stream
from impasto.simulate.surface import normals

RANGE = (1.49 + 2.44) / 200.0
"""From the lowest to the highest part of the paper's relief (figure 11), in widths of a painting of
200 mm."""
WAVE = 0.4
"""Shortest wave of a bulge, in widths of the painting."""
BORDER = 0.2
"""Width of the rim over which bulges fall to nothing, in widths of the painting."""
STROKES = 0.5
"""Factor on the relief of canvas and strokes."""
BISECTIONS = 8


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights about the middle of a plane, which is flat beyond them.

    Parameters
    ----------
    height
        ``(y, x)`` float32 in mm above the plane.
    pitch_mm
        Width of a pixel.
    """

    height: NDArray[np.float32]
    pitch_mm: float

    def at(self, x: Floats, y: Floats) -> Floats:
        """``(y, x)`` heights at places in mm, between pixels bilinear."""
        rows, columns = self.height.shape
        across = (x / self.pitch_mm + (columns - 1) / 2).astype(np.float32)
        down = ((rows - 1) / 2 - y / self.pitch_mm).astype(np.float32)
        found = cv2.remap(
            self.height, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return np.asarray(found, np.float64)

    def met(self, place: Floats, rays: Floats) -> tuple[Floats, Floats]:
        """Places x and y ``(y, x)`` in mm where rays ``(3, y, x)`` first meet the surface.

        Rays start at a place ``(3,)`` above the surface and go down.
        """
        slant_x, slant_y = rays[0] / rays[2], rays[1] / rays[2]
        x, y = place[0] - place[2] * slant_x, place[1] - place[2] * slant_y
        top, bottom = (float(value) for value in (self.height.max(), self.height.min()))
        top, bottom = max(top, 0.0), min(bottom, 0.0)
        slant = float(np.hypot(slant_x, slant_y).max())
        # Only rays that come near the painting.
        reach = max(top, -bottom) * slant + self.pitch_mm
        rows, columns = self.height.shape
        near = (np.abs(x) < columns * self.pitch_mm / 2 + reach) & (
            np.abs(y) < rows * self.pitch_mm / 2 + reach
        )
        part = _box(near)
        x[part], y[part] = self._followed(place, slant_x[part], slant_y[part], top, bottom)
        return x, y

    def _followed(
        self, place: Floats, slant_x: Floats, slant_y: Floats, top: float, bottom: float
    ) -> tuple[Floats, Floats]:
        """As :meth:`met`, of rays that move so far per mm upwards, between two heights."""
        across = (top - bottom) * float(np.hypot(slant_x, slant_y).max(initial=0.0))
        steps = max(int(np.ceil(across / self.pitch_mm)), 1)

        def below(level: Floats) -> NDArray[np.bool_]:
            x, y = place[0] + (level - place[2]) * slant_x, place[1] + (level - place[2]) * slant_y
            return np.asarray(self.at(x, y) >= level)

        above, under = np.full(slant_x.shape, top), np.full(slant_x.shape, bottom)
        going = np.ones(slant_x.shape, bool)
        for level in np.linspace(top, bottom, steps + 1)[1:]:
            hit = going & below(np.full_like(above, level))
            under[hit] = level
            going &= ~hit
            above[going] = level
        for _ in range(BISECTIONS):
            middle = 0.5 * (above + under)
            hit = below(middle)
            under, above = np.where(hit, middle, under), np.where(hit, above, middle)
        level = 0.5 * (above + under) - place[2]
        return place[0] + level * slant_x, place[1] + level * slant_y


def _box(marked: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The smallest rectangle ``(y, x)`` with all that is marked."""
    sides = (np.flatnonzero(marked.any(axis=axis)) for axis in (1, 0))
    first, second = (slice(one[0], one[-1] + 1) if one.size else slice(0, 0) for one in sides)
    return first, second


def with_bulges(painting: simulate.Painting, seed: int) -> simulate.Painting:
    """The painting on a panel with bulges: smooth waves with the range of the paper's relief.

    They carry the painting's own canvas and strokes, flatter by :data:`STROKES`, whose median is in
    the plane of the marks. At the border the bulges are flat.
    """
    rows, columns = painting.size
    width = columns * painting.pitch_mm
    rng = stream(seed, "bulges")
    y, x = np.mgrid[:rows, :columns] / columns
    waves = np.zeros(painting.size)
    for _ in range(8):
        turn, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        length = WAVE * rng.uniform(1.0, 2.5)
        along = x * np.cos(turn) + y * np.sin(turn)
        waves += length * np.cos(2.0 * np.pi * along / length + phase)
    rim = np.minimum.reduce([x, y, (columns - 1) / columns - x, (rows - 1) / columns - y])
    waves *= smoothstep(0.0, BORDER, rim)
    waves *= RANGE * width / float(np.ptp(waves))
    strokes = STROKES * (painting.height - float(np.median(painting.height)))
    height = np.asarray(strokes + waves, np.float32)
    return replace(painting, height=height, normal=normals(height, painting.pitch_mm))

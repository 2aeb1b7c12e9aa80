"""All that is known of one pixel, to read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impasto.status import Status
from impasto.surface import SHAPES, Surface


@dataclass(frozen=True)
class PixelLobe:
    """A lobe of one pixel.

    Attributes
    ----------
    strength
        By band; one number under the name ``"all"`` where every band has the same.
    shape
        The model's own numbers by name: ``gamma`` (radians), or ``cxy``, ``cz``, ``exponent``.
    """

    strength: Mapping[str, float]
    shape: Mapping[str, float]


@dataclass(frozen=True, repr=False)
class Pixel:
    """What a result says of one pixel; NaN is a number that is not known.

    Attributes
    ----------
    y, x
        Row and column.
    normal
        Unit vector (x, y, z).
    tilt, azimuth
        Radians: angle between normal and viewer, and where it leans (0 right, pi/2 up).
    diffuse
        By band, relative to the white board.
    lobes
        The lobes that the pixel has, in the order of the maps.
    status
        :class:`~impasto.Status`.
    reason
        The status in words.
    residual
        Root mean square of the residuals, linear light.
    sigma
        Standard deviation of the normal along its worst axis, radians.
    """

    y: int
    x: int
    normal: tuple[float, float, float]
    diffuse: Mapping[str, float]
    lobes: tuple[PixelLobe, ...]
    status: Status
    residual: float
    sigma: float

    @property
    def tilt(self) -> float:
        """Radians between the normal and the direction to the viewer."""
        x, y, z = self.normal
        return math.atan2(math.hypot(x, y), z)

    @property
    def azimuth(self) -> float:
        """Radians: where the normal leans, 0 to the right, pi/2 up."""
        return math.atan2(self.normal[1], self.normal[0])

    @property
    def reason(self) -> str:
        """The status in words."""
        return self.status.reason

    def __repr__(self) -> str:
        lines = [f"Pixel y={self.y}, x={self.x}: {self.status.name.lower()}, {self.reason}"]
        if math.isfinite(self.tilt):
            error = f", ± {math.degrees(self.sigma):.2g}°" if math.isfinite(self.sigma) else ""
            vector = ", ".join(f"{value:.3f}" for value in self.normal)
            lines.append(
                f"  normal    ({vector}): tilt {math.degrees(self.tilt):.1f}° towards "
                f"{math.degrees(self.azimuth) % 360:.0f}°{error}"
            )
        if any(math.isfinite(value) for value in self.diffuse.values()):
            lines.append(f"  diffuse   {_named(self.diffuse)}")
        for number, lobe in enumerate(self.lobes, start=1):
            angles = {"gamma"} & lobe.shape.keys()
            shape = {
                name: f"{math.degrees(value):.3g}°" if name in angles else f"{value:.3g}"
                for name, value in lobe.shape.items()
            }
            words = ", ".join(f"{name} {value}" for name, value in shape.items())
            lines.append(f"  lobe {number}    {words}; strength {_named(lobe.strength)}")
        if math.isfinite(self.residual):
            lines.append(f"  residual  {100 * self.residual:.2g} % of white")
        return "\n".join(lines)


def lobes_of(surface: Surface, bands: Sequence[str]) -> tuple[PixelLobe, ...]:
    """The lobes of a surface of one pixel that reflect anything."""
    lobes = []
    for lobe in surface.lobes:
        strength = np.ravel(lobe.strength).tolist()
        if np.isfinite(strength).all() and max(strength) > 0.0:
            names = bands if np.ndim(lobe.strength) == 3 else ("all",)
            shape = [float(np.ravel(value)[0]) for value in lobe.shape]
            lobes.append(
                PixelLobe(
                    dict(zip(names, strength, strict=True)),
                    dict(zip(SHAPES[surface.model], shape, strict=True)),
                )
            )
    return tuple(lobes)


def _named(values: Mapping[str, float]) -> str:
    if list(values) == ["all"]:
        return f"{values['all']:.3g}"
    return ", ".join(f"{name} {value:.3g}" for name, value in values.items())

"""A stored painting at a smaller scale: its maps, their names, and where they lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.rig import PointView
from impasto.surface import SHAPES, Lobe, Relightable, Surface


@dataclass(frozen=True, eq=False)
class StoredLevel(Relightable):
    """A painting at a smaller scale, for :func:`impasto.render`.

    Attributes
    ----------
    maps
        The surface.
    view
        From where pictures show it.
    in_mm
        Whether lengths are in mm; False: in pixels of the painting itself.
    """

    maps: Surface
    view: tuple[float, float, float] | PointView
    in_mm: bool = True

    def surface(self) -> Surface:
        """The maps, ready to be lit."""
        return self.maps

    def eye(self) -> tuple[float, float, float] | PointView:
        """From where pictures show it unless a scene says so."""
        return self.view

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel in the unit of its lengths."""
        return self.maps.pitch_mm

    @property
    def known_pitch_mm(self) -> float | None:
        """Width of a pixel in mm; None where nobody has said it."""
        return self.maps.pitch_mm if self.in_mm else None

    @property
    def diffuse(self) -> NDArray[np.float32]:
        """``(band, y, x)``."""
        return self.maps.diffuse

    @property
    def normal(self) -> NDArray[np.float32]:
        """``(3, y, x)``."""
        return self.maps.normal

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.maps.shape

    def with_bands(self, chosen: list[int]) -> StoredLevel:
        """The surface in some of its bands, by number."""
        return replace(self, maps=self.maps.with_bands(chosen))


def maps_of_level(surface: Surface) -> dict[str, NDArray[np.float32]]:
    """The maps of a surface whose lobes are all maps, by their names in a store."""
    maps: dict[str, Any] = {"normal": surface.normal, "diffuse": surface.diffuse}
    if surface.ambient is not None:
        maps["ambient"] = surface.ambient
    for number, lobe in enumerate(surface.lobes, start=1):
        maps[f"lobe{number}.strength"] = lobe.strength
        names = SHAPES[surface.model]
        maps |= {
            f"lobe{number}.{name}": plane for name, plane in zip(names, lobe.shape, strict=True)
        }
    return maps


def surface_of_level(maps: dict[str, NDArray[Any]], template: Surface) -> Surface:
    """The surface of these maps; what is no map is that of a template of the same model."""
    names = SHAPES[template.model]
    lobes = tuple(
        Lobe(maps[f"lobe{number}.strength"], tuple(maps[f"lobe{number}.{n}"] for n in names))
        for number in range(1, len(template.lobes) + 1)
    )
    return replace(
        template,
        normal=maps["normal"],
        diffuse=maps["diffuse"],
        ambient=maps.get("ambient"),
        lobes=lobes,
        height=None,
    )


def place_of_level(
    shape: tuple[int, int], origin: tuple[float, float], factor: int
) -> tuple[float, float]:
    """Where a scale lies in the painting, in its own pixels: ``origin`` of a surface.

    Rows and columns that fill no group are left out on the right and below, at every step.
    """
    rows, columns = shape
    right, up = origin
    while factor > 1:
        right, up = (right - 0.5 * (columns % 2)) / 2, (up + 0.5 * (rows % 2)) / 2
        rows, columns, factor = rows // 2, columns // 2, factor // 2
    return right, up

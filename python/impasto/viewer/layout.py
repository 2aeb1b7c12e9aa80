"""How the maps of a painting lie in the tiles of the page: planes of numbers, four to a texel.

Normals are whole numbers of 16 bits, ``round(32767 n)``, 1.5e-5 from the truth: half precision
would be 16 times as coarse where it counts, and a narrow lobe under raking light shows it. Colours
and the lobes of Torrance and Sparrow are in half precision, which changes a display code by at most
0.03. Lobes of Lafortune are in single precision: a base is raised to powers of hundreds.

Where a picture cannot show a pixel its flag is missing and its numbers are 0: no shader computes
with what is no number.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from impasto.surface import SHAPES, Surface

UNIT = 32767
"""What stands for 1 in the numbers of a normal."""
SHOWN = 256
"""Added to the status of a pixel that a picture shows."""
UNREAD = 254
"""In place of a status at scales at which it was not read."""
LARGEST_HALF = 65504.0
QUALITY = ("sigma", "residual")
"""Maps of how far a fit can be trusted: the standard deviation of the normal in radians, and what
the fit leaves of the photographs, relative to the white board."""
UNKNOWN = -1.0
"""In place of a number of them that is not known."""
Number = Literal["int16", "half", "single"]
Scalar = TypeVar("Scalar", bound=np.generic)
TYPES: dict[Number, type[np.generic]] = {
    "int16": np.int16,
    "half": np.float16,
    "single": np.float32,
}
COMPRESSION = 1
"""Level of gzip: 6 takes twice the time for 2 % less."""
CHANNELS = 4
"""Of a texel."""


@dataclass(frozen=True)
class Group:
    """Planes of one type of number: one texture with a layer for every four of them.

    Attributes
    ----------
    number
        The type.
    planes
        Their names; layers are filled up with zeros.
    """

    number: Number
    planes: tuple[str, ...]

    @property
    def layers(self) -> int:
        """Textures of four channels that the planes fill."""
        return -(-len(self.planes) // CHANNELS)

    def record(self) -> dict[str, Any]:
        """For the page."""
        return {"number": self.number, "planes": list(self.planes), "layers": self.layers}


@dataclass(frozen=True)
class Layout:
    """The planes of every tile of a painting.

    Attributes
    ----------
    groups
        In the order in which a tile holds them.
    """

    groups: tuple[Group, ...]

    @classmethod
    def of(cls, surface: Surface, *, beneath: bool = False, quality: Sequence[str] = ()) -> Layout:
        """What a surface has, in any part of it and at any scale.

        ``beneath``: whether there is a map of the share of the gloss that a varnish leaves as it is
        (:func:`impasto.lighting.metallic`). ``quality``: which of :data:`QUALITY` there are.
        """
        count = len(surface.diffuse)
        colours = [f"diffuse{k}" for k in range(count)]
        if surface.ambient is not None:
            colours += [f"ambient{k}" for k in range(count)]
        if surface.height is not None:
            colours.append("height")
        if beneath:
            colours.append("beneath")
        colours += quality
        lobes: list[str] = []
        for number, lobe in enumerate(surface.lobes):
            tinted = np.ndim(lobe.strength) == 3
            lobes += [f"strength{number}_{k}" for k in range(count if tinted else 1)]
            lobes += [f"{name}{number}" for name in SHAPES[surface.model]]
        halves = tuple(colours if surface.model == "lafortune" else colours + lobes)
        groups = [Group("int16", ("x", "y", "z", "flags")), Group("half", halves)]
        if surface.model == "lafortune" and lobes:
            groups.append(Group("single", tuple(lobes)))
        return cls(tuple(groups))

    def tile(
        self,
        part: Surface,
        status: NDArray[np.uint8] | None,
        beneath: NDArray[np.float32] | None = None,
        quality: Mapping[str, NDArray[np.float32]] | None = None,
    ) -> bytes:
        """A part of a surface as the page reads it, compressed by gzip.

        Parameters
        ----------
        part
            Of a surface for which the layout was made.
        status
            ``(y, x)`` :class:`~impasto.Status`; None where it was not read.
        beneath, quality
            Maps ``(y, x)``, as in :meth:`of`.
        """
        planes = _planes(part)
        shown = np.ones(part.shape, bool)
        for name, plane in planes.items():
            if not name.startswith(tuple(SHAPES[part.model])):
                shown &= np.isfinite(plane)
        for number in range(len(part.lobes)):
            strengths = [p for name, p in planes.items() if name.startswith(f"strength{number}_")]
            there = np.any([one != 0.0 for one in strengths], axis=0)
            for name in SHAPES[part.model]:
                # A lobe of no strength shows nothing, whatever its shape.
                shape = np.where(there, planes[f"{name}{number}"], 1.0)
                shown &= ~np.isnan(shape)
                planes[f"{name}{number}"] = shape
        if beneath is not None:
            planes["beneath"] = np.nan_to_num(beneath, nan=0.0)
        for name, plane in (quality or {}).items():
            planes[name] = np.where(np.isfinite(plane), plane, UNKNOWN)
        codes = np.full(part.shape, UNREAD, np.int16) if status is None else status.astype(np.int16)
        planes["flags"] = codes + np.int16(SHOWN) * shown
        return gzip.compress(self.texels(planes, shown), COMPRESSION, mtime=0)

    def texels(self, planes: Mapping[str, NDArray[Any]], shown: NDArray[np.bool_]) -> bytes:
        """Planes by their names as the textures of the page hold them; 0 where nothing is shown."""
        found = []
        for group in self.groups:
            stacked = np.zeros((group.layers * CHANNELS, *shown.shape), TYPES[group.number])
            for index, name in enumerate(group.planes):
                if name == "flags":
                    stacked[index] = planes[name]
                    continue
                known = np.where(shown, planes.get(name, 0.0), 0.0)
                if group.number == "int16":
                    known = np.rint(UNIT * np.clip(known, -1.0, 1.0))
                elif group.number == "half":
                    known = np.clip(known, -LARGEST_HALF, LARGEST_HALF)
                stacked[index] = known
            texels = stacked.reshape(group.layers, CHANNELS, *shown.shape).transpose(0, 2, 3, 1)
            found.append(np.ascontiguousarray(texels).tobytes())
        return b"".join(found)

    def record(self) -> list[dict[str, Any]]:
        """For the page."""
        return [group.record() for group in self.groups]


def middle_of(plane: NDArray[Scalar], factor: int) -> NDArray[Scalar]:
    """The number of the pixel in the middle of every ``factor`` x ``factor``."""
    middle = factor // 2
    return plane[middle::factor, middle::factor] if factor > 1 else plane


def _planes(part: Surface) -> dict[str, NDArray[Any]]:
    """Every plane of a surface by its name, numbers for the whole painting as maps."""
    planes: dict[str, NDArray[Any]] = dict(zip("xyz", part.normal, strict=True))
    planes |= {f"diffuse{k}": plane for k, plane in enumerate(part.diffuse)}
    if part.ambient is not None:
        planes |= {f"ambient{k}": plane for k, plane in enumerate(part.ambient)}
    if part.height is not None:
        planes["height"] = np.nan_to_num(part.height, nan=0.0)
    for number, lobe in enumerate(part.lobes):
        strengths = np.asarray(lobe.strength, np.float32)
        if strengths.ndim != 3:
            strengths = np.broadcast_to(strengths, (1, *part.shape))
        planes |= {f"strength{number}_{k}": plane for k, plane in enumerate(strengths)}
        for name, value in zip(SHAPES[part.model], lobe.shape, strict=True):
            planes[f"{name}{number}"] = np.broadcast_to(np.asarray(value, np.float32), part.shape)
    return planes

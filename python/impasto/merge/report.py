"""What a merge found: where frames lie, what was done to them, and what is left at the seams."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.colour.difference import delta_e, lab_from_xyz
from impasto.colour.display import Display
from impasto.merge.overlaps import Overlap

Floats = NDArray[np.float64]

COLOUR, DEGREES, SHIFT = 0.2, 0.1, 0.25
"""Above these residuals a seam has a warning: dE00, degrees and pixels."""


@dataclass(frozen=True)
class FrameReport:
    """A frame in the merged painting.

    Attributes
    ----------
    name
        Its file, or its number in the list.
    left, top
        Column and row of the merged painting at which the middle of its first pixel lies.
    scale
        Pixels of the merged painting for one of the frame, along a side.
    angle
        Radians by which it was rotated in its plane, counterclockwise.
    gain
        Per band, what its colours were multiplied by.
    tilt
        Radians by which its normals were tilted.
    """

    name: str
    left: float
    top: float
    scale: float
    angle: float
    gain: tuple[float, ...]
    tilt: float


@dataclass(frozen=True)
class SeamReport:
    """What is left between two frames, in what both show.

    Differences are root mean squares over means of blocks of 16 x 16 pixels, where a step at a seam
    would show; those of single pixels, medians, contain the noise of both frames.

    Attributes
    ----------
    first, second
        Numbers of the frames.
    pixels
        Pixels of the merged painting that both cover.
    shift
        Root mean square of what patches miss each other by, pixels; NaN: there is none.
    colour, degrees
        dE00 of diffuse colours and angle of normals (degrees) in the merged painting.
    colour_before, degrees_before
        The same before gains and before rotations of normals other than in the frame's plane.
    pixel_colour, pixel_degrees
        Medians over single pixels, in the merged painting.
    """

    first: int
    second: int
    pixels: int
    shift: float
    colour: float
    colour_before: float
    degrees: float
    degrees_before: float
    pixel_colour: float
    pixel_degrees: float


@dataclass(frozen=True)
class MergeReport:
    """What :func:`impasto.merge` did and what is left.

    Attributes
    ----------
    shape
        Rows and columns of the merged painting.
    reference
        Number of the frame whose pixels, plane and lamps are those of the merged painting.
    affine
        Whether frames were sheared and stretched, or only scaled, rotated and shifted.
    lobes
        What the merged painting has for its gloss, in words.
    frames, seams
        One entry per frame, and per pair of frames that overlap.
    """

    shape: tuple[int, int]
    reference: int
    affine: bool
    lobes: str
    frames: tuple[FrameReport, ...]
    seams: tuple[SeamReport, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for every seam at which more is left than the bounds of :doc:`merge`."""
        found = []
        for seam in self.seams:
            rows = (
                ("colours differ by", seam.colour, COLOUR, "dE00"),
                ("normals differ by", seam.degrees, DEGREES, "degrees"),
                ("patches miss each other by", seam.shift, SHIFT, "pixels"),
            )
            over = [
                f"{words} {value:.3g} {unit} (bound: {bound:g})"
                for words, value, bound, unit in rows
                if value > bound
            ]
            if over:
                names = (self.frames[seam.first].name, self.frames[seam.second].name)
                found.append(f"{names[0]} and {names[1]}: {', '.join(over)}")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; what is not known is None."""
        found = _plain(asdict(self) | {"warnings": list(self.warnings)})
        assert isinstance(found, dict)
        return found

    def to_json(self) -> str:
        """:meth:`to_dict` as text."""
        return json.dumps(self.to_dict(), indent=2, sort_keys=True) + "\n"

    def __str__(self) -> str:
        height, width = self.shape
        lines = [f"{width} x {height} pixels, {self.lobes}", ""]
        lines.append("frame       left        top     scale  angle °   tilt °  gains")
        for index, one in enumerate(self.frames):
            gains = " ".join(f"{gain:.4f}" for gain in one.gain)
            mark = "*" if index == self.reference else " "
            lines.append(
                f"{index:3d}{mark} {one.left:10.2f} {one.top:10.2f} {one.scale:9.5f} "
                f"{math.degrees(one.angle):8.3f} {math.degrees(one.tilt):8.3f}  {gains}"
            )
        lines += ["", "seam         pixels  shift px  dE00 before, after   degrees before, after"]
        for seam in self.seams:
            lines.append(
                f"{seam.first:3d} -{seam.second:3d} {seam.pixels:11d} {seam.shift:9.3f} "
                f"{seam.colour_before:11.3f} {seam.colour:7.3f} "
                f"{seam.degrees_before:15.3f} {seam.degrees:7.3f}"
            )
        return "\n".join(lines)


def colour_differences(diffuse: Floats) -> Floats:
    """dE00 ``(n,)`` between colours ``(2, n, band)``, which no camera describes.

    Three bands are linear sRGB and one is grey, as :func:`impasto.render` shows them; of another
    number each band is a grey of its own, and the root mean square over them counts.
    """
    if diffuse.shape[-1] == 3:
        return _difference(np.moveaxis(diffuse, -1, 1))
    greys = [_difference(np.stack([plane] * 3, axis=1)) for plane in np.moveaxis(diffuse, -1, 0)]
    return np.asarray(np.sqrt(np.mean(np.square(greys), axis=0)))


def angles(normal: Floats) -> Floats:
    """Radians ``(n,)`` between vectors ``(2, n, 3)``."""
    one, other = normal
    cross = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.asarray(np.arctan2(cross, np.sum(one * other, axis=-1)))


def seam_of(pair: tuple[int, int], before: Overlap, after: Overlap, shift: float) -> SeamReport:
    """The entry of a pair of frames."""
    return SeamReport(
        first=pair[0],
        second=pair[1],
        pixels=after.pixels,
        shift=shift,
        colour=_rms(colour_differences(after.diffuse)),
        colour_before=_rms(colour_differences(before.diffuse)),
        degrees=math.degrees(_rms(angles(after.normal))),
        degrees_before=math.degrees(_rms(angles(before.normal))),
        pixel_colour=float(np.median(colour_differences(after.pixel_diffuse))),
        pixel_degrees=math.degrees(float(np.median(angles(after.pixel_normal)))),
    )


def _difference(rgb: Floats) -> Floats:
    """``(2, 3, n)`` linear sRGB."""
    matrix = Display.named("srgb").xyz_from_linear
    one, other = (lab_from_xyz(matrix @ np.maximum(planes, 0.0)) for planes in rgb)
    return delta_e(one, other)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""Where the painting after lies in the pixels of the one before.

As frames are merged: features and RANSAC, then patches of colours and slopes by Lucas and Kanade's
method, robust least squares. What changed between the two are outliers of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto.comparison.entries import Registration
from impasto.errors import ArgumentError
from impasto.merge.adjustment import misses
from impasto.merge.frames import Frame
from impasto.merge.gains import gains_of
from impasto.merge.levels import rotations_of, tilt_of
from impasto.merge.overlaps import sampled
from impasto.merge.placement import Placement
from impasto.merge.solution import registered

Floats = NDArray[np.float64]
Exposure = Literal["measured", "matched"]
Align = Literal["found", "same"]

UNMOVED = 0.02
"""Pixels below which nothing is moved: what placements are known to, and interpolation would blur
one of the two only."""
RAYLEIGH_MEDIAN = 1.17741
"""Median of the length of two errors of standard deviation 1."""


@dataclass(frozen=True, eq=False)
class Greys(Frame):
    """A frame whose colours are their mean, where two have different bands."""

    def map(self, name: str, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of one map."""
        found = super().map(name, rows, columns)
        return found.mean(axis=0, keepdims=True) if name == "diffuse" else found


@dataclass(frozen=True, eq=False)
class Alignment:
    """What is done to the painting after.

    Attributes
    ----------
    placement
        Where it lies; None: the pixels are the same.
    turn
        ``(3, 3)`` of its normals, with the rotation in the plane.
    gain
        ``(band,)`` of its colours.
    report
        The same in numbers.
    """

    placement: Placement | None
    turn: Floats
    gain: Floats
    report: Registration


def aligned(frames: tuple[Frame, Frame], align: Align, exposure: Exposure) -> Alignment:
    """Find it.

    Raises
    ------
    ArgumentError
        Paintings that do not fit on each other, or other sizes with ``align="same"``.
    """
    before, after = frames
    same_bands = before.bands == after.bands
    used: list[Frame] = list(frames)
    if not same_bands:
        used = [Greys(one.name, one.result) for one in frames]
    place, affine, sigma = Placement.identity(), False, 0.0
    if align == "same":
        if before.shape != after.shape:
            sizes = (f"{one.shape[1]} x {one.shape[0]}" for one in frames)
            raise ArgumentError(
                f'align: "same" needs the same pixels, found {" and ".join(sizes)}; leave it at '
                '"found"'
            )
    else:
        place, affine, sigma = _found(used)
    moved = before.shape != after.shape or _farthest(place, after.shape) > UNMOVED
    if not moved:
        place, affine, sigma = Placement.identity(), False, 0.0
    overlaps = sampled(used, [Placement.identity(), place])
    turn = np.eye(3)
    gain = np.ones(len(after.bands))
    if overlaps:
        # Rotations and gains of a pair from what both show; changed parts weigh little.
        turn = rotations_of(overlaps, 2, 0)[1]
        if exposure == "matched":
            found = gains_of(overlaps, 2, 0)[1]
            gain = found if same_bands else np.full(len(after.bands), found[0])
    report = Registration(
        linear=_rows(place.linear),
        offset=(float(place.offset[0]), float(place.offset[1])),
        scale=place.scale,
        angle=place.angle,
        affine=affine,
        sigma=sigma,
        tilt=tilt_of(turn),
        gain=tuple(gain.tolist()),
    )
    return Alignment(place if moved else None, turn @ place.rotation, gain, report)


def _found(frames: list[Frame]) -> tuple[Placement, bool, float]:
    try:
        placements, affine, matches = registered(frames, 0)
    except ArgumentError as error:
        if not str(error).startswith("frames: "):
            raise
        raise ArgumentError(
            f"after: {frames[1].name} cannot be placed on {frames[0].name}: too few features of "
            "the two agree on a shift, a rotation and a scale within 0.67 to 1.50; are both of "
            'the same painting? Where their pixels are the same, give align="same"'
        ) from error
    off = np.linalg.norm(misses(matches[0, 1], placements, (0, 1)), axis=1)
    sigma = float(np.median(off)) / RAYLEIGH_MEDIAN
    return placements[1], affine, sigma


def _farthest(place: Placement, shape: tuple[int, int]) -> float:
    """Pixels by which a corner moves."""
    still = Placement.identity().corners(shape)
    return float(np.linalg.norm(place.corners(shape) - still, axis=1).max())


def _rows(linear: Floats) -> tuple[tuple[float, float], tuple[float, float]]:
    (a, b), (c, d) = linear.tolist()
    return (a, b), (c, d)

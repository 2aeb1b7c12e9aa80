"""Registration, gains and levels of all frames, one after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto.merge.adjustment import (
    Matches,
    Pair,
    adjusted,
    affine_is_likelier,
    misses,
)
from impasto.merge.features import connected, features_of, first_placements
from impasto.merge.frames import Frame
from impasto.merge.gains import gains_of
from impasto.merge.levels import rotations_of
from impasto.merge.overlaps import Overlap, matched, sampled, with_gains, with_rotations
from impasto.merge.placement import Placement
from impasto.merge.report import SeamReport, seam_of

Floats = NDArray[np.float64]

FEW, MANY = 16, 100
"""Patches of a pair in the first rounds and in the last one."""
MORE_PATCHES = 4
"""Patches per unknown from which on shears are looked for."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What is done to frames so that they agree.

    Attributes
    ----------
    placements
        Of frames in the pixels of the reference frame, moved by whole pixels so that none of them
        begins before row or column 0.
    shape
        Rows and columns that hold all frames.
    affine
        Whether placements shear and stretch.
    gains, rotations
        ``(frame, band)`` of colours, and ``(frame, 3, 3)`` of normals after the rotation in the
        plane that the placement has.
    seams
        What is left.
    """

    placements: list[Placement]
    shape: tuple[int, int]
    affine: bool
    gains: Floats
    rotations: Floats
    seams: tuple[SeamReport, ...]


def solved(frames: Sequence[Frame], reference: int, white: int | None) -> Solution:
    """Find it, the reference frame being at rest and, unless None, frame ``white`` uncoloured."""
    placements, affine, matches = registered(frames, reference)
    # A frame covers half a pixel around its outermost ones.
    low = np.ceil(
        np.min([p.corners(f.shape) for p, f in zip(placements, frames, strict=True)], axis=(0, 1))
        - 0.5
    )
    placements = [replace(one, offset=one.offset - low) for one in placements]
    high = np.max(
        [p.corners(f.shape) for p, f in zip(placements, frames, strict=True)], axis=(0, 1)
    )
    width, height = (math.floor(value + 0.5) + 1 for value in high.tolist())
    before = sampled(frames, placements)
    gains = gains_of(before, len(frames), white)
    rotations = rotations_of(before, len(frames), reference)
    seams = tuple(
        _seam(pair, overlap, gains, rotations, matches.get(pair), placements)
        for pair, overlap in before.items()
    )
    return Solution(placements, (height, width), affine, gains, rotations, seams)


def registered(
    frames: Sequence[Frame], reference: int
) -> tuple[list[Placement], bool, dict[Pair, Matches]]:
    """Placements, whether they are affine, and the patches that they were found by.

    Raises
    ------
    ArgumentError
        A frame that nothing connects with the others.
    """
    features = [features_of(frame) for frame in frames]
    found = connected(frames, features)
    first_placements(frames, found, reference)  # all are connected
    placements = adjusted(found, len(frames), reference)
    affine = False
    smoothing = float(max(2, *(one.step for one in features)))
    for sigma, most, precision in ((smoothing, FEW, 0.02), (1.0, FEW, 0.02), (0.5, MANY, 0.002)):
        # Pairs without patches, whose overlap is too narrow, keep their features.
        fine = matched(frames, placements, sigma, most=most, precision=precision)
        matches = {**found, **fine} if set(found) - set(fine) else fine
        matches = _weighed(matches, fine)
        placements = adjusted(matches, len(frames), reference)
        unknowns = 6 * (len(frames) - 1)
        affine = False
        if 2 * sum(len(one.weight) for one in fine.values()) > MORE_PATCHES * unknowns:
            sheared = adjusted(matches, len(frames), reference, affine=True)
            affine = affine_is_likelier(matches, placements, sheared)
            placements = sheared if affine else placements
    return placements, affine, matches


def _weighed(matches: dict[Pair, Matches], fine: dict[Pair, Matches]) -> dict[Pair, Matches]:
    """Features beside patches: their variance is that of pixels, not of hundredths of pixels."""
    if not fine:
        return matches
    typical = float(np.median(np.concatenate([one.weight for one in fine.values()])))
    largest = 10.0 * typical  # a patch of strong edges is no surer than its model
    return {
        pair: replace(
            one,
            weight=np.minimum(one.weight, largest) if pair in fine else one.weight * 1e-3 * typical,
        )
        for pair, one in matches.items()
    }


def _seam(
    pair: Pair,
    overlap: Overlap,
    gains: Floats,
    rotations: Floats,
    matches: Matches | None,
    placements: Sequence[Placement],
) -> SeamReport:
    shift = math.nan
    if matches is not None:
        # A difference of points does not depend on where the merged painting begins.
        off = np.sum(misses(matches, placements, pair) ** 2, axis=1)
        shift = math.sqrt(float(np.average(off, weights=matches.weight)))
    after = with_rotations(with_gains(overlap, gains[list(pair)]), rotations[list(pair)])
    return seam_of(pair, overlap, after, shift)

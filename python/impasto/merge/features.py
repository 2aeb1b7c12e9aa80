"""A first registration: features of small pictures, and which frames they connect.

SIFT [@lowe2004sift] on the logarithm of the diffuse luminance, which no lamp changes, and a
similarity of each pair by RANSAC [@fischler1981ransac].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.merge.adjustment import Matches
from impasto.merge.frames import Frame
from impasto.merge.placement import Placement

LARGEST = 1200
"""Rows or columns of a small picture at most."""
FEATURES = 8000
"""Features of a picture at most."""
RATIO = 0.8
"""A match is kept if the second best is so much farther away [@lowe2004sift]."""
NEAR = 2.0
"""Pixels of a small picture by which a match may miss its similarity."""
LEAST = 12
"""Matches that connect two frames. A similarity has 4 unknowns, 2 matches; that 10 more agree to 2
pixels in a thousand by chance, with a tenth of some thousand matches right, does not happen."""
SCALES = (2 / 3, 3 / 2)
"""A frame of another scale was not taken from about the same distance: pixels would be mixed."""


@dataclass(frozen=True, eq=False)
class Features:
    """Features of a frame: places ``(n, 2)`` in its pixels, and descriptors."""

    places: NDArray[np.float64]
    descriptors: NDArray[np.float32]
    step: int


def features_of(frame: Frame) -> Features:
    """The features of a frame's small picture."""
    import cv2

    step = max(-(-max(frame.shape) // LARGEST), 1)
    picture = _overview(frame, step)
    found = cv2.SIFT.create(nfeatures=FEATURES, contrastThreshold=0.02)
    points, descriptors = found.detectAndCompute(picture, None)
    places = np.array([point.pt for point in points], np.float64).reshape(-1, 2)
    if descriptors is None:
        descriptors = np.zeros((0, 128), np.float32)
    # The middle of a block of pixels, where whole numbers are the middles of pixels.
    return Features(places * step + (step - 1) / 2, np.asarray(descriptors, np.float32), step)


def connected(
    frames: Sequence[Frame], features: Sequence[Features]
) -> dict[tuple[int, int], Matches]:
    """Matches of all pairs of frames whose features agree on a similarity."""
    found = {}
    for i in range(len(frames)):
        for j in range(i + 1, len(frames)):
            if (matches := _matches(features[i], features[j])) is not None:
                found[i, j] = matches
    return found


def first_placements(
    frames: Sequence[Frame], matches: dict[tuple[int, int], Matches], reference: int
) -> list[Placement]:
    """Frames placed one after another, each by the pair with the most matches.

    Raises
    ------
    ArgumentError
        Frames that nothing connects with the reference, by name.
    """
    placed = {reference: Placement.identity()}
    while len(placed) < len(frames):
        bridges = [pair for pair in matches if (pair[0] in placed) != (pair[1] in placed)]
        if not bridges:
            lost = [frame.name for i, frame in enumerate(frames) if i not in placed]
            raise ArgumentError(
                f"frames: {', '.join(lost)} share{'s' * (len(lost) == 1)} too little with the "
                f"frames around {frames[reference].name}: no {LEAST} features agree on a shift, a "
                f"rotation and a scale within {SCALES[0]:.2f} to {SCALES[1]:.2f}; leave out what "
                "is of another painting, or take frames that overlap more (a third is good)"
            )
        pair = max(bridges, key=lambda one: len(matches[one].first))
        i, j = pair
        found = similarity(matches[pair].first, matches[pair].second)
        if found is None:
            del matches[pair]
        elif i in placed:
            placed[j] = placed[i].after(found.inverse)
        else:
            placed[i] = placed[j].after(found)
    return [placed[i] for i in range(len(frames))]


def similarity(first: NDArray[np.float64], second: NDArray[np.float64]) -> Placement | None:
    """From points of one frame to those of another, by least squares; None if no scale fits."""
    (x, y), (u, v) = (first - first.mean(axis=0)).T, (second - second.mean(axis=0)).T
    size = float(np.sum(x * x + y * y))
    if size == 0.0:
        return None
    a, b = float(np.sum(x * u + y * v)) / size, float(np.sum(x * v - y * u)) / size
    linear = np.array([[a, -b], [b, a]])
    found = Placement(linear, second.mean(axis=0) - linear @ first.mean(axis=0))
    return found if SCALES[0] <= found.scale <= SCALES[1] else None


def _matches(one: Features, other: Features) -> Matches | None:
    import cv2

    if min(len(one.places), len(other.places)) < LEAST:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(one.descriptors, other.descriptors, k=2)
    kept = [pair[0] for pair in pairs if pair[0].distance < RATIO * pair[1].distance]
    if len(kept) < LEAST:
        return None
    first = one.places[[match.queryIdx for match in kept]]
    second = other.places[[match.trainIdx for match in kept]]
    _, agree = cv2.estimateAffinePartial2D(
        first,
        second,
        method=cv2.RANSAC,
        ransacReprojThreshold=NEAR * max(one.step, other.step),
        maxIters=5000,
        confidence=0.9999,
    )
    if agree is None or int(agree.sum()) < LEAST:
        return None
    fine = agree.ravel().astype(bool)
    if similarity(first[fine], second[fine]) is None:
        return None
    return Matches(first[fine], second[fine], np.ones(int(fine.sum())))


def _overview(frame: Frame, step: int) -> NDArray[np.uint8]:
    """The logarithm of the mean diffuse colour of ``step x step`` pixels, in 8 bits."""
    height, width = frame.shape
    small = np.full((-(-height // step), -(-width // step)), np.nan)
    for rows, columns in frame.blocks(step):
        light = frame.map("diffuse", rows, columns).mean(axis=0, dtype=np.float64)
        down, across = light.shape
        padded = np.pad(
            light, ((0, -down % step), (0, -across % step)), constant_values=np.nan
        ).reshape(-(-down // step), step, -(-across // step), step)
        known = np.isfinite(padded)
        with np.errstate(invalid="ignore"):
            mean = np.where(known, padded, 0.0).sum(axis=(1, 3)) / known.sum(axis=(1, 3))
        top, left = rows.start // step, columns.start // step
        small[top : top + mean.shape[0], left : left + mean.shape[1]] = mean
    known = np.isfinite(small)
    if not known.any():
        raise ArgumentError(f"frames: {frame.name} has no pixel that was estimated")
    middle = max(float(np.median(small[known])), 1e-6)
    tone = np.log(np.maximum(small, 0.0) + 0.05 * middle)
    low, high = np.percentile(tone[known], (0.5, 99.5))
    tone = np.where(known, (tone - low) / max(high - low, 1e-6), 0.5)
    return np.round(255.0 * np.clip(tone, 0.0, 1.0)).astype(np.uint8)

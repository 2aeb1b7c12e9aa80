"""Connected areas of changed pixels that are larger than chance makes them: the cluster extent.

Of many thousand pixels some are marked by chance, and a mark alone says nothing. Marks that touch
form a cluster, and its extent is held against that of chance [@friston1994clusters;
@nichols2003familywise]: sizes of chance clusters fall off geometrically, so that of ``C`` of them
one of ``k`` pixels or more has the probability ``C p^(k - 1)`` at most, where ``p`` is the share of
clusters that grow by one more pixel. ``k`` is chosen for a family-wise error of 5 %: of twenty
unchanged paintings one has a cluster that is called significant.

``C`` and ``p`` come from the comparison itself, in which nearly all clusters are small ones of
chance, whatever changed. Tails are heavier than geometric where the paintings were resampled, since
edges of paint and relief are marked along their length: ``p`` is not less than
:data:`CONTINUATION`. The rate of false discoveries among pixels [@benjamini1995false] was tried,
too: where predicted errors are too small in the tails, it calls pixels of most unchanged paintings
significant (``benches/python/comparisons.py``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.comparison.entries import Cluster, ClusterExtent
from impasto.comparison.measures import Measures, measured, planes_of

Numbers = NDArray[np.int64]

FAMILYWISE = 0.05
"""Probability that an unchanged painting has a cluster that counts as changed."""
CONTINUATION = {"same": 0.35, "resampled": 0.9}
"""Least share of clusters that grow by one more pixel, of the same pixels and of resampled ones.
Chosen on simulated paintings that had not changed: of 18 of the former the largest cluster had 6
pixels, of 18 of the latter 60, where 9 and 69 are now called significant."""
DENSE = 0.95
"""Where more clusters grow than these, marks are so dense that chance alone connects them."""
LEAST = 4
"""Pixels of a significant cluster at least: one chance cluster in all, and ``p`` of 0.35."""
LISTED = 64
"""Clusters that are kept, the largest ones."""


@dataclass(eq=False)
class ClusterSums:
    """Clusters of marks, gathered tile by tile, row by row of tiles.

    Marks of all three quantities count, and pixels touch by sides and corners.

    Parameters
    ----------
    columns
        Of the painting before.
    """

    columns: int

    def __post_init__(self) -> None:
        self._chance = np.zeros(2, np.int64)
        """Clusters that were counted and dropped: all of them, and those of two pixels or more."""
        self._sums: list[NDArray[np.float64]] = []
        self._boxes: list[Numbers] = []
        self._joined: list[Numbers] = []
        self._count = 0
        # Numbers of clusters, from 1, in the last row of the tiles above, of this row of tiles,
        # and in the last column of the tile to the left.
        self._above = np.zeros(self.columns + 2, np.int64)
        self._below = np.zeros(self.columns + 2, np.int64)
        self._left = np.zeros(0, np.int64)
        self._top = 0

    def add(self, part: Window, maps: dict[str, NDArray[Any]]) -> None:
        """Add the marks of a window; windows come in rows, from the left."""
        import cv2

        rows, columns = part
        if rows.start != self._top:
            self._above, self._below = self._below, np.zeros_like(self._above)
            self._top = rows.start
        if columns.start == 0:
            self._left = np.zeros(rows.stop - rows.start, np.int64)
        marks = np.ascontiguousarray(maps["changed"] > 0, np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(marks, connectivity=8)
        sums = measured(labels, count, planes_of(maps))[:, 1:]
        left, top, width, height, size = boxes[1:].T.astype(np.int64)
        inner = (left > 0) & (top > 0)
        inner &= (left + width < marks.shape[1]) & (top + height < marks.shape[0])
        dropped = inner & (size < LEAST)
        self._chance += dropped.sum(), (dropped & (size > 1)).sum()
        numbers = np.zeros(count, np.int64)
        kept = np.flatnonzero(~dropped)
        numbers[kept + 1] = self._count + 1 + np.arange(len(kept))
        self._count += len(kept)
        self._sums.append(sums[:, kept])
        box = np.stack([top + rows.start, left + columns.start, top + height + rows.start,
                        left + width + columns.start])  # fmt: skip
        self._boxes.append(box[:, kept])
        self._join(numbers[labels], columns)

    def _join(self, numbers: Numbers, columns: slice) -> None:
        """Clusters that touch across the borders of the window are one."""
        wide = slice(columns.start + 1, columns.stop + 1)
        for shift in (-1, 0, 1):
            beside = slice(wide.start + shift, wide.stop + shift)
            self._pairs(self._above[beside], numbers[0])
        padded = np.pad(self._left, 1)
        for shift in (0, 1, 2):
            self._pairs(padded[shift : shift + len(numbers)], numbers[:, 0])
        self._below[wide] = numbers[-1]
        self._left = numbers[:, -1]

    def _pairs(self, one: Numbers, other: Numbers) -> None:
        both = (one > 0) & (other > 0)
        if both.any():
            self._joined.append(np.unique(np.stack([one[both], other[both]], axis=1), axis=0))

    def clusters(
        self, compared: int, *, resampled: bool, pitch_mm: float | None
    ) -> tuple[ClusterExtent, tuple[Cluster, ...]]:
        """The extent of chance, and the clusters beyond it, the largest first.

        Parameters
        ----------
        compared
            Pixels that were compared.
        resampled
            Whether the painting after was moved by parts of pixels.
        pitch_mm
            Width of a pixel of the painting before.
        """
        sums, boxes = self._whole()
        sizes = sums[0].astype(np.int64) if sums.size else np.zeros(0, np.int64)
        total = int(self._chance[0]) + len(sizes)
        grown = int(self._chance[1]) + int((sizes > 1).sum())
        least = CONTINUATION["resampled" if resampled else "same"]
        share = max(least, grown / total if total else 0.0)
        critical = critical_extent(total, share)
        order = np.argsort(-sizes, kind="stable")
        order = order[sizes[order] >= critical]
        square = math.nan if pitch_mm is None else pitch_mm**2
        found = []
        for number in order[:LISTED].tolist():
            top, left, bottom, right = (int(value) for value in boxes[:, number])
            measures = Measures.of(sums[:, number])
            found.append(
                Cluster(
                    top=top,
                    left=left,
                    rows=bottom - top,
                    columns=right - left,
                    pixels=measures.pixels,
                    area_mm2=square * measures.pixels,
                    normal=measures.normal,
                    colour=measures.colour,
                    gloss=measures.gloss,
                    changed=measures.changed,
                )
            )
        extent = ClusterExtent(
            critical=critical,
            familywise=FAMILYWISE,
            chance=total,
            continuation=share,
            found=len(order),
            share=float(sizes[order].sum()) / max(compared, 1),
        )
        return extent, tuple(found)

    def _whole(self) -> tuple[NDArray[np.float64], Numbers]:
        """Sums and boxes of clusters, those that touch across borders joined."""
        if not self._count:
            return np.zeros((0, 0)), np.zeros((4, 0), np.int64)
        sums, boxes = np.concatenate(self._sums, axis=1), np.concatenate(self._boxes, axis=1)
        roots = _roots(self._count, self._joined)
        unique, place = np.unique(roots, return_inverse=True)
        whole = np.zeros((len(sums), len(unique)))
        for total, row in zip(whole, sums, strict=True):
            total += np.bincount(place, row, len(unique))
        around = np.empty((4, len(unique)), np.int64)
        around[:2], around[2:] = np.iinfo(np.int64).max, 0
        for axis, box in enumerate(boxes):
            (np.minimum if axis < 2 else np.maximum).at(around[axis], place, box)
        return whole, around


def critical_extent(clusters: int, continuation: float) -> float:
    """Pixels from which on a cluster is larger than chance; infinite where chance connects all.

    Parameters
    ----------
    clusters
        How many there are.
    continuation
        Share of them that grow by one more pixel, above 0.
    """
    if continuation > DENSE:
        return math.inf
    needed = math.log(max(clusters, 1) / FAMILYWISE) / -math.log(continuation)
    return float(max(LEAST, 1 + math.ceil(needed)))


def _roots(count: int, joined: list[Numbers]) -> Numbers:
    """For each number from 1 the least number that it is joined with (union-find)."""
    parent = list(range(count + 1))

    def root(number: int) -> int:
        while parent[number] != number:
            parent[number] = parent[parent[number]]
            number = parent[number]
        return number

    for pairs in joined:
        for one, other in pairs.tolist():
            first, second = sorted((root(one), root(other)))
            parent[second] = first
    touched = {number for pairs in joined for number in pairs.ravel().tolist()}
    found = np.arange(count + 1)
    for number in touched:
        found[number] = root(number)
    return found[1:]

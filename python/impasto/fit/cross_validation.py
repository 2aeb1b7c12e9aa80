"""Cross-validation [@stone1974] over photographs: those held out of a fit are predicted by it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import GeometryError
from impasto.fit.normals import fit_normals
from impasto.report import status_counts
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

FOLDS = 6
"""One photograph in six is held out of each fit."""
HELD_OUT = 24
"""Photographs that are held out over all folds, at least, or every photograph. Highlights dominate
the error, and a few photographs may show them by chance. The cost is bounded: all folds together
fit about a hundred photographs."""
FEWEST = 8
"""Photographs that cross-validation needs."""


@dataclass(frozen=True, eq=False)
class Fold:
    """Photographs that are fitted, and photographs that are held out."""

    known: Stack
    rig: Rig
    truth: NDArray[np.float32]
    unknown: str | None
    """Why no pixel of ``known`` can be estimated, if none can."""
    estimable: NDArray[np.bool_]
    """``(y, x)``: the pixels of which ``known`` determines a normal."""

    @property
    def compared(self) -> NDArray[np.float32]:
        """``truth``, NaN in the pixels that no fit can predict."""
        return np.where(self.estimable, self.truth, np.float32(np.nan))


def folds_of(part: Stack, threads: int | None, *, truth: Stack | None = None) -> list[Fold]:
    """Folds that hold out :data:`HELD_OUT` photographs, without those that no lights determine.

    ``truth``: the same photographs with what is compared, where that is not what is fitted.

    Raises
    ------
    GeometryError
        No fold is left.
    """
    count = len(part.rig)
    compared = part if truth is None else truth
    refusal: GeometryError | None = None
    folds = []
    for held in split(part.rig)[: math.ceil(FOLDS * HELD_OUT / count)]:
        known, shown = part.take(np.setdiff1d(np.arange(count), held)), compared.take(held)
        try:
            # Photometric stereo takes a millisecond and refuses what any fit would refuse.
            status = fit_normals(known, method="least-squares", threads=threads).status
        except GeometryError as error:
            words = f"{error} (of {count} photographs {len(held)} were held out of the trial)"
            refusal = refusal or GeometryError(words)
            continue
        samples = np.array([shown.linear(i) for i in range(len(held))])
        if part.mask is not None:
            samples[..., ~part.mask] = np.nan
        reasons = None if (status < Status.DARK).any() else ", ".join(status_counts(status))
        folds.append(Fold(known, shown.rig, samples, reasons, status < Status.DARK))
    if refusal is not None and not folds:
        # If the whole stack is refused too, its own message is the better one.
        fit_normals(part, method="least-squares", threads=threads)
        raise refusal
    return folds


def split(rig: Rig) -> list[NDArray[np.intp]]:
    """Split the photographs into :data:`FOLDS` subsets, each spread over all directions.

    Each photograph goes to the subset whose directions are farthest from its own. If neighbouring
    directions were held out together, a narrow highlight could fall into the gap, and the error
    would be twice that of a fit of all photographs.
    """
    places = np.concatenate([rig.directions, rig.views], axis=1)
    nearest = np.full((FOLDS, len(rig)), np.inf)
    subsets: list[list[int]] = [[] for _ in range(FOLDS)]
    for index, place in enumerate(places):
        subset = int(nearest[:, index].argmax())
        subsets[subset].append(index)
        nearest[subset] = np.minimum(nearest[subset], np.linalg.norm(places - place, axis=1))
        if len(subsets[subset]) == len(range(subset, len(rig), FOLDS)):
            # This subset is full.
            nearest[subset] = -1.0
    return [np.array(subset) for subset in subsets]


def full_scale(photographs: Iterable[NDArray[Any]]) -> float:
    """What is shown as white: as bright as nearly all samples of most photographs.

    A few wrong photographs do not change it. It follows the exposure, so that what is chosen does
    not: by a power of two exactly. Codes of what is brighter go on above white.
    """
    samples = (shown[np.isfinite(shown)] for shown in photographs)
    bright = [float(np.quantile(known, 0.999)) for known in samples if known.size]
    most = float(np.quantile(bright, 0.75)) if bright else 0.0
    return most if most > 0.0 else 1.0

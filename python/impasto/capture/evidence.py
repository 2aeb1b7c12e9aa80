"""What is kept of each photograph for the comparison with the others, and that comparison."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from operator import is_not

import numpy as np
from numpy.typing import NDArray

from impasto.align.refinement import gradient_picture
from impasto.capture.frames import Image, Picture
from impasto.capture.misfires import (
    LEAST_SHIFT_OF_ANOTHER_LAMP,
    Misfire,
    blurred,
    clipped,
    moved,
    sharpness,
    surely_still,
)
from impasto.capture.neighbours import Outliers, find_outliers
from impasto.capture.shots import Shot, ShotPlan
from impasto.rig import FRONTAL

PATCH = 160
"""Rows and columns of the part that is kept at full resolution: 81 windows for a shift; 800
photographs take 80 MB."""
NEAREST = 6
"""Photographs with which clipped pixels are compared."""
POOR = 0.1
"""Relative residual from which a prediction says nothing of edges."""
MORE_CLIPPED = 0.05
"""Share of clipped pixels beyond twice that of any neighbour: a highlight that moves with the lamp
hardly doubles between neighbours; an exposure that is too long clips everything."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is kept of one photograph.

    Attributes
    ----------
    thumbnail
        ``(cells,)``: linear light, means of blocks.
    patch
        ``(y, x)``: linear light of a part with much structure, at full resolution.
    clipped
        Share of clipped pixels.
    sharpness
        Of the patch.
    """

    thumbnail: NDArray[np.float64]
    patch: Image
    clipped: float
    sharpness: float


@dataclass(frozen=True)
class Place:
    """Top and left of the patch, the same in all photographs."""

    top: int
    left: int

    @classmethod
    def of(cls, light: Image) -> Place:
        """Where a patch has most structure."""
        import cv2

        rows, columns = (min(PATCH, side) for side in light.shape)
        energy = cv2.boxFilter(
            np.square(gradient_picture(light)), -1, (columns, rows), borderType=cv2.BORDER_CONSTANT
        )
        # The filter's anchor is the middle of the patch.
        half_rows, half_columns = rows // 2, columns // 2
        inner = np.asarray(energy)[
            half_rows : light.shape[0] - rows + half_rows + 1,
            half_columns : light.shape[1] - columns + half_columns + 1,
        ]
        top, left = np.unravel_index(int(np.argmax(inner)), inner.shape)
        return cls(int(top), int(left))

    def evidence(self, picture: Picture) -> Evidence:
        """What is kept of a photograph."""
        part = picture.light[self.top : self.top + PATCH, self.left : self.left + PATCH]
        patch = np.ascontiguousarray(part)
        return Evidence(picture.thumbnail(), patch, picture.clipped, sharpness(patch))


Judged = dict[str, tuple[tuple[Evidence, ...], Misfire | None]]
"""Whether a photograph has moved or is blurred, and with which others it was compared."""


def compare(
    plan: ShotPlan,
    kept: Mapping[str, Evidence],
    dark: float,
    reference: Image | None,
    judged: Judged,
) -> dict[str, Misfire]:
    """Compare the photographs of a capture with each other.

    Those of each view are compared, of brackets the shortest exposures, the second, and so on: one
    clips where another does not.

    Parameters
    ----------
    plan
        Of the capture.
    kept
        Evidence of the shots that are photographs, by their names.
    dark
        Mean level of the dark frames.
    reference
        The patch of a reference shot, for photographs without enough neighbours.
    judged
        What an earlier comparison found; it is brought up to date.

    Returns
    -------
    dict
        What is wrong, by the names of the shots.
    """
    views: dict[tuple[tuple[float, ...], int], list[Shot]] = defaultdict(list)
    for bracket in plan.photographs().values():
        for step, shot in enumerate(bracket):
            if shot.name in kept:
                views[shot.pose.view or FRONTAL, step].append(shot)
    found: dict[str, Misfire] = {}
    own = next((shot.pose.view or FRONTAL for shot in plan.of("reference")), None)
    for (view, _), shots in views.items():
        same = reference if view == own else None
        found |= _of_one_view(plan, shots, kept, dark, same, judged)
    return found


def _of_one_view(
    plan: ShotPlan,
    shots: list[Shot],
    kept: Mapping[str, Evidence],
    dark: float,
    reference: Image | None,
    judged: Judged,
) -> dict[str, Misfire]:
    directions = np.array([plan.light_of(shot) for shot in shots], dtype=np.float64)
    exposure = np.array([shot.exposure_s for shot in shots])
    relative = exposure / float(np.median(exposure))
    light = np.array([kept[shot.name].thumbnail for shot in shots]) - dark
    names = [shot.name for shot in shots]
    outliers = find_outliers(
        light / relative[:, None], directions, names, [shot.lamp or 0 for shot in shots]
    )
    near = _nearest(directions)
    shares = np.array([kept[name].clipped for name in names])
    usual = shares[near].max(axis=1, initial=0.0) if near.shape[1] else np.ones(len(names))
    sharp = np.array([kept[name].sharpness for name in names])
    softest = sharp[near].min(axis=1) if near.shape[1] else np.zeros(len(names))
    found: dict[str, Misfire] = {}
    for own, name in enumerate(names):
        misfire = outliers.misfires.get(own)
        if misfire is None or misfire.code in {"unlike", "strength"}:
            places = [own, *_neighbours(own, outliers), *near[own]]
            with_whom = tuple(kept[names[place]] for place in places)
            before, other = judged.get(name, ((), None))
            # A comparison takes ten milliseconds, and a retake changes few of them.
            if len(before) != len(with_whom) or any(map(is_not, before, with_whom)):
                expected = _expected(own, names, kept, relative, outliers, dark)
                patch = kept[name].patch
                still = expected is not None and surely_still(expected, patch)
                other = None if still else _moved(patch, expected, reference)
                if other is None and expected is not None and blurred(sharp[own], softest[own]):
                    usual_sharpness = min(float(softest[own]), sharpness(expected))
                    other = blurred(kept[name].sharpness, usual_sharpness)
                judged[name] = with_whom, other
            if shares[own] > 2.0 * usual[own] + MORE_CLIPPED:
                other = clipped(1.0) if shares[own] >= 1.0 else _overexposed(shares[own])
            misfire = other or misfire
        if misfire is not None:
            found[name] = misfire
    return found


def _overexposed(share: float) -> Misfire:
    return Misfire(
        "clipped",
        f"{100.0 * share:.0f} % of the pixels are overexposed, more than twice as many as under "
        "the neighbouring lamps",
        "see that the exposure is fixed; if this lamp is brighter, take a shorter one for all",
    )


def _nearest(directions: NDArray[np.float64]) -> NDArray[np.intp]:
    """``(n, few)``: places of the photographs under the nearest other lamps."""
    cosine = directions @ directions.T
    np.fill_diagonal(cosine, -2.0)
    return np.argsort(-cosine, axis=1, kind="stable")[:, : min(NEAREST, len(directions) - 1)]


def _neighbours(own: int, outliers: Outliers) -> list[int]:
    """Places of the photographs in the prediction of one."""
    if outliers.predictions is None:
        return []
    places: list[int] = np.flatnonzero(outliers.predictions.weights[0, own]).tolist()
    return places


def _expected(
    own: int,
    names: list[str],
    kept: Mapping[str, Evidence],
    relative: NDArray[np.float64],
    outliers: Outliers,
    dark: float,
) -> Image | None:
    """The patch that neighbours predict; None where their prediction is no picture in this light.

    Where it leaves more than a tenth, edges of highlights and shadows lie elsewhere.
    """
    predicted = outliers.predictions
    if predicted is None or not predicted.known[own]:
        return None
    weight = predicted.weights[0, own]
    # Of its neighbours: its own is large where it is blurred or has moved.
    if float(np.median(predicted.residual[weight != 0.0])) > POOR:
        return None
    light = sum(
        weight[j] / relative[j] * (kept[names[j]].patch.astype(np.float64) - dark)
        for j in _neighbours(own, outliers)
    )
    return np.asarray(np.maximum(light * relative[own] + dark, 0.0), np.float32)


def _moved(patch: Image, expected: Image | None, reference: Image | None) -> Misfire | None:
    """Against a picture in the same light, else against the reference shot."""
    if expected is not None:
        return moved(expected, patch)
    return None if reference is None else moved(reference, patch, LEAST_SHIFT_OF_ANOTHER_LAMP)

"""Marks in photographs: ArUco markers [@garridojurado2014automatic], boards, points given by hand.

Corners of markers are refined by lines along their edges, those of frames to the places to which
the gradients around them point best [@forstner1987fast], discs to the centroid of what differs from
their surroundings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.align.edges import square_corners
from impasto.align.layout import SIDES, Layout, marker_corner
from impasto.calibrate.target import dictionary, refined_corners
from impasto.calibrate.tones import grey_from
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

BORDER = 0.8
"""Reach of a marker's corner in cells of its code: the first code cell stays outside."""
LEAST = 4
"""Marks that determine a perspective."""
OVERTURNED = 60.0
"""Degrees by which the edges of a marker may point elsewhere than its neighbours say."""
CONTRAST = 0.5
"""Share of a disc's contrast above which a pixel is part of it."""
VISIBLE = 0.02
"""Least contrast of a disc, as a share of the photograph's white."""


@dataclass(frozen=True, eq=False)
class FoundMarks:
    """The marks of one photograph.

    Attributes
    ----------
    names
        Of the marks, as in the layout.
    pixels
        ``(n, 2)``: columns and rows, whole numbers are the middles of pixels.
    outlines
        ``(4, 2)`` pixels of each marker's corners, by the marker's name; empty without markers.
    """

    names: tuple[str, ...]
    pixels: Floats
    outlines: Mapping[str, Floats]


def find_marks(
    light: NDArray[np.float32], layout: Layout, photograph: str, *, partial: bool = False
) -> FoundMarks:
    """The marks of a layout in one photograph.

    Parameters
    ----------
    light
        ``(y, x)`` linear (``impasto.calibrate.tones.light_from``).
    layout
        Which marks.
    photograph
        Its name, for messages.
    partial
        Whether marks may be missing.

    Raises
    ------
    ArgumentError
        A marker that is missing, seen twice or mounted upside down; too few corners of a board;
        a point outside the photograph or without a mark.
    """
    if layout.target is not None:
        numbers, pixels = layout.target.find(light)
        if len(numbers) < LEAST and not partial:
            raise ArgumentError(
                f"{photograph}: {len(numbers)} corners of {layout.target.name} found, {LEAST} are "
                "the least; show all of the board, sharp and without glare"
            )
        return FoundMarks(tuple(f"corner {number}" for number in numbers), pixels, {})
    if layout.dictionary is not None:
        return _markers(light, layout, photograph, partial)
    return _given(light, layout, photograph)


def _markers(
    light: NDArray[np.float32], layout: Layout, photograph: str, partial: bool
) -> FoundMarks:
    import cv2

    assert layout.dictionary is not None
    codes = dictionary(layout.dictionary, "markers")
    detector = cv2.aruco.ArucoDetector(codes, cv2.aruco.DetectorParameters())
    corners, numbers, _ = detector.detectMarkers(grey_from(light))
    found = [] if numbers is None else np.asarray(numbers).ravel().tolist()
    wanted = sorted({int(name.split(",")[0].split()[1]) for name in layout.places})
    count = Counter(number for number in found if number in wanted)
    twice = [number for number, times in count.items() if times > 1]
    if twice:
        raise ArgumentError(
            f"{photograph}: marker {twice[0]} of {layout.dictionary} is seen {count[twice[0]]} "
            "times; cover all but one, or the reflection that shows it"
        )
    missing = [number for number in wanted if number not in count]
    if missing and not partial:
        absent = " and ".join(f"marker {number} ({SIDES[number % 4]})" for number in missing)
        others = sorted(set(found) - set(wanted))
        beside = f" (markers {', '.join(map(str, others))} are there)" if others else ""
        raise ArgumentError(
            f"{photograph}: {absent} of {layout.dictionary} not found{beside}; they must be whole, "
            "sharp, with a white border and without glare; if the camera stood still, "
            "--fixed-camera takes them from the other photographs, else give --points"
        )
    outlines = {}
    for number, quad in zip(found, corners, strict=True):
        if number in wanted:
            rough = np.asarray(quad, np.float64).reshape(4, 2)
            sides = np.linalg.norm(rough - np.roll(rough, 1, axis=0), axis=1)
            cell = float(sides.min()) / (codes.markerSize + 2)
            fitted = square_corners(light, rough, codes.markerSize + 2)
            outlines[number] = (
                refined_corners(light, rough, BORDER * cell) if fitted is None else fitted
            )
    if outlines.keys() == {0, 1, 2, 3}:
        _check_upright(outlines, photograph)
    names = tuple(
        name
        for number in sorted(outlines)
        for corner in range(4)
        if (name := marker_corner(number, corner)) in layout.places
    )
    pixels = [
        outlines[number][corner]
        for number in sorted(outlines)
        for corner in range(4)
        if marker_corner(number, corner) in layout.places
    ]
    shown = {f"marker {number}": outline for number, outline in outlines.items()}
    return FoundMarks(names, np.array(pixels).reshape(-1, 2), shown)


def _check_upright(outlines: Mapping[int, Floats], photograph: str) -> None:
    """Refuse a marker that is turned against the four, or markers in another order.

    From each marker, the one at its right (or left) must lie where its upper edge points.
    """
    middle = {number: outline.mean(axis=0) for number, outline in outlines.items()}
    for number, outline in outlines.items():
        # The neighbour on the same side of the painting: 0 and 1 above, 2 and 3 below.
        other = {0: 1, 1: 0, 2: 3, 3: 2}[number]
        along = outline[1] - outline[0]
        towards = middle[other] - middle[number]
        if number in {1, 2}:
            towards = -towards
        cross = along[0] * towards[1] - along[1] * towards[0]
        angle = float(np.degrees(np.arctan2(abs(cross), along @ towards)))
        if angle > OVERTURNED:
            said = "upside down" if angle > 180.0 - OVERTURNED else "turned to one side"
            raise ArgumentError(
                f"{photograph}: marker {number} ({SIDES[number]}) is {said}, or another marker has "
                "its place: all are mounted upright, 0 to 3 from the upper left clockwise"
            )


def _given(light: NDArray[np.float32], layout: Layout, photograph: str) -> FoundMarks:
    points = layout.points.get(photograph, layout.points.get("default"))
    if points is None:
        raise ArgumentError(
            f"points: has neither {photograph} nor default; add the pixels of its marks"
        )
    names = tuple(points)
    rough = np.array(list(points.values()), dtype=np.float64).reshape(-1, 2)
    size = np.array(light.shape[::-1])
    for name, place in zip(names, rough, strict=True):
        if not ((place > -0.5) & (place < size - 0.5)).all():
            raise ArgumentError(
                f"points: {photograph}: {name} at ({place[0]:g}, {place[1]:g}) lies outside the "
                f"{size[0]} x {size[1]} pixels"
            )
    if layout.kind == "exact":
        return FoundMarks(names, rough, {})
    if layout.kind == "corner":
        found = refined_corners(light, rough, layout.search_px)
    else:
        found = np.array([
            _disc(light, place, layout.search_px, f"points: {photograph}: {name}")
            for name, place in zip(names, rough, strict=True)
        ])  # fmt: skip
    for name, place, start in zip(names, found, rough, strict=True):
        if np.linalg.norm(place - start) > layout.search_px:
            raise ArgumentError(
                f"points: {photograph}: no mark within {layout.search_px:g} pixels of {name} at "
                f"({start[0]:g}, {start[1]:g})"
            )
    return FoundMarks(names, found, {})


def _disc(light: NDArray[np.float32], place: Floats, reach: float, where: str) -> Floats:
    """Centroid of the disc that contains or is nearest to a place.

    Pixels count by how much they differ from the surroundings, so that its soft edge is not cut.
    """
    import cv2

    left, top = (max(round(value - reach), 0) for value in place)
    window = light[top : int(place[1] + reach) + 2, left : int(place[0] + reach) + 2]
    rim = np.concatenate([window[0], window[-1], window[1:-1, 0], window[1:-1, -1]])
    ground = float(np.median(rim))
    contrast = np.abs(window - ground)
    peak = float(np.percentile(contrast, 98))
    if peak < max(VISIBLE, 4.0 * float(np.median(np.abs(rim - ground)))):
        raise ArgumentError(f"{where} at ({place[0]:g}, {place[1]:g}): no disc within {reach:g} px")
    count, labels = cv2.connectedComponents((contrast > CONTRAST * peak).astype(np.uint8))
    rows, columns = np.indices(window.shape)
    away = np.hypot(columns + left - place[0], rows + top - place[1])
    nearest = min(range(1, count), key=lambda label: float(away[labels == label].min()))
    grown = cv2.dilate((labels == nearest).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    weight = np.where(grown, contrast, 0.0)
    return np.array([
        (weight * columns).sum() / weight.sum() + left,
        (weight * rows).sum() / weight.sum() + top,
    ])  # fmt: skip

"""Mirror balls beside the painting, in the photographs of both: where they are, and crops of them.

Circles are candidates (gradient Hough transform [@kimme1975circles]); a mirror ball is one in which
nearly every lamp makes one highlight (:mod:`~impasto.calibrate.highlight`), at different places for
different lamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.geometry import Array, BallCamera
from impasto.calibrate.highlight import find_highlight, luma
from impasto.calibrate.lights import BallPhotographs
from impasto.calibrate.outline import Outline, beyond_border, strongest_circle
from impasto.errors import ArgumentError
from impasto.io.images import open_picture, photographs_below

Box: TypeAlias = tuple[int, int, int, int]
"""Top, left, height and width in pixels."""

WORKING_SIZE = 1024
"""Pixels of the longer side of the pictures in which balls are looked for."""
SMALLEST, LARGEST = 0.012, 0.25
"""Radii looked for, in longer sides of the photograph."""
ROUND = 0.6
"""Least share of a candidate's circle that is seen as edges."""
MARGIN = 1.35
"""Half a side of a crop, in radii of its ball."""
MIRRORED = 0.8
"""Least share of the lamps with a highlight."""
MIRRORED_CUT = 0.3
"""The same of a ball that a border cuts off: some highlights lie beyond the border."""
CUT = 3.0
"""Working pixels beyond a border from which a ball counts as cut off: circles are found to one."""
MOVES = 0.1
"""Least standard deviation of the places of the highlights, in radii."""


def balls_beside(
    photographs: Sequence[Path],
    references: Sequence[Path],
    boxes: Sequence[Box] | None,
    outlines: Sequence[Outline] | None = None,
) -> tuple[tuple[BallPhotographs, ...], tuple[int, int], tuple[str, ...]]:
    """The balls in photographs of a painting.

    A ball that a border cuts off is left out where another one is whole.

    Parameters
    ----------
    photographs
        One for each lamp.
    references
        Others from the same place, in which the edges of the balls are seen.
    boxes
        Top, left, height and width around each ball; None: the balls are found.
    outlines
        Of the balls in whole photographs, in place of boxes; None: they are found.

    Returns
    -------
    tuple
        Each ball, rows and columns of the whole photographs, and words on each ball left out.

    Raises
    ------
    ArgumentError
        No ball found, a box or an outline that does not lie within the photographs, photographs of
        other sizes.
    """
    size = size_of(photographs[0])
    notes: tuple[str, ...] = ()
    if outlines is not None:
        for outline in outlines:
            _check_within(outline, size)
        boxes = [_box(outline.numbers, size) for outline in outlines]
    elif boxes is None:
        boxes, notes = _found(photographs, size)
    for top, left, height, width in boxes:
        inside = top >= 0 and top + height <= size[0] and left >= 0 and left + width <= size[1]
        if not (inside and height > 0 and width > 0):
            raise ArgumentError(
                f"ball: expected TOP LEFT HEIGHT WIDTH within photographs of {size[0]} rows and "
                f"{size[1]} columns, found {top} {left} {height} {width}"
            )
    files = [*photographs, *references]
    crops: list[list[Array]] = [[] for _ in boxes]
    full = None
    for path in files:
        with open_picture(path) as picture:
            _check_size(path, picture.shape[1:], photographs[0], size)
            full = float(np.iinfo(picture.dtype).max) if picture.dtype.kind == "u" else None
            for crop, (top, left, height, width) in zip(crops, boxes, strict=True):
                codes = picture.read(slice(top, top + height), slice(left, left + width))
                crop.append(luma(codes))
    count = len(photographs)
    names = tuple(path.name for path in photographs)
    balls = tuple(
        BallPhotographs(
            np.array(crop[:count]),
            f"ball {number}",
            (float(box[1]), float(box[0])),
            np.array(crop[count:]) if references else None,
            full=full,
            names=names,
        )
        for number, (crop, box) in enumerate(zip(crops, boxes, strict=True), 1)
    )
    if outlines is not None:
        balls = tuple(
            replace(ball, outline=replace(one, x=one.x - left, y=one.y - top))
            for ball, one, (top, left, *_) in zip(balls, outlines, boxes, strict=True)
        )
    return balls, size, notes


def _check_within(outline: Outline, size: tuple[int, int]) -> None:
    x, y, radius = outline.x, outline.y, outline.radius
    if not (radius - 1.0 <= x <= size[1] - radius and radius - 1.0 <= y <= size[0] - radius):
        raise ArgumentError(
            f"circles: the ball at column {x:.0f} and row {y:.0f} with a radius of {radius:.0f} "
            f"does not lie within photographs of {size[0]} rows and {size[1]} columns"
        )


def size_of(path: Path) -> tuple[int, int]:
    """Rows and columns of a photograph."""
    with open_picture(path) as picture:
        _, rows, columns = picture.shape
    return rows, columns


def _check_size(path: Path, found: tuple[int, ...], first: Path, size: tuple[int, int]) -> None:
    if tuple(found) != size:
        raise ArgumentError(
            f"{path}: {found[1]} x {found[0]} pixels, but {first.name} has {size[1]} x {size[0]}; "
            "all photographs must be from the same place"
        )


def _found(photographs: Sequence[Path], size: tuple[int, int]) -> tuple[list[Box], tuple[str, ...]]:
    """Boxes around the mirror balls from left to right, and words on each that is left out."""
    scale = min(1.0, WORKING_SIZE / max(size))
    small = np.array([_reduced(path, scale, photographs[0], size) for path in photographs])
    mirrors = [circle for circle in _candidates(small) if _mirrors(small, circle)]
    circles: list[Array] = []
    for circle in sorted(mirrors, key=lambda one: -float(one[2])):
        # The same edge once more, or what the ball mirrors.
        if all(np.hypot(*(circle - one)[:2]) > one[2] for one in circles):
            circles.append(circle)
    if not circles:
        home = photographs[0].parent
        raise ArgumentError(
            f"path: no mirror ball found in the photographs of {home}, {len(photographs)} in all"
            f"{photographs_below(home)}: a ball is a circle with one small, bright highlight under "
            "each lamp; give its place, --ball TOP LEFT HEIGHT WIDTH (boxes= in Python), or put "
            "crops of each ball into a folder of its own"
        )
    circles.sort(key=lambda circle: float(circle[0]))
    whole = [circle for circle in circles if _beyond(circle, small.shape[1:])[0] <= CUT]
    if not whole:  # their outlines are refused, with the number of pixels that are missing
        return [_box(circle / scale, size) for circle in circles], ()
    notes = []
    for circle in circles:
        pixels, side = _beyond(circle, small.shape[1:])
        if pixels > CUT:
            x, y, radius = circle / scale
            notes.append(
                f"a ball is left out: the {side} border cuts {pixels / scale:.0f} pixels off it "
                f"(middle {x:.0f}, {y:.0f}, radius {radius:.0f}); to use it, photograph all of it"
            )
    return [_box(circle / scale, size) for circle in whole], tuple(notes)


def _beyond(circle: Array, size: tuple[int, ...]) -> tuple[float, str]:
    """How many pixels a circle reaches beyond the worst border, and its name."""
    x, y, radius = circle.tolist()
    return beyond_border(np.array([[x - radius, y - radius], [x + radius, y + radius]]), size)


def _reduced(path: Path, scale: float, first: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    import cv2

    with open_picture(path) as picture:
        _check_size(path, picture.shape[1:], first, size)
        whole = luma(picture.read())
    if scale == 1.0:
        return whole.astype(np.float32)
    small = cv2.resize(whole, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32)


def _candidates(small: NDArray[np.float32]) -> list[Array]:
    """Circles ``(3,)`` in the mean and in the brightest of all photographs.

    All that have sharp edges, and of each picture the one with the longest arc of any edges.
    """
    import cv2

    longer = max(small.shape[1:])
    least, most = (max(4, round(part * longer)) for part in (SMALLEST, LARGEST))
    found: list[Array] = []
    for picture in (small.mean(axis=0), small.max(axis=0)):
        if (longest := strongest_circle(picture.astype(np.float64))) is not None:
            found.append(longest)
        bright = max(float(np.quantile(picture, 0.995)), 1e-30)
        codes = np.rint(255.0 * np.sqrt(np.clip(picture / bright, 0.0, 1.0))).astype(np.uint8)
        circles: Any = cv2.HoughCircles(
            codes, cv2.HOUGH_GRADIENT_ALT, 1.5, least,
            param1=300, param2=ROUND, minRadius=least, maxRadius=most,
        )  # fmt: skip
        if circles is not None:
            found += list(circles.reshape(-1, circles.shape[-1])[:, :3].astype(np.float64))
    return found


def _mirrors(small: NDArray[np.float32], circle: Array) -> bool:
    """Whether a circle shows the lamps as a mirror ball does."""
    x, y, radius = circle.tolist()
    top, left = (max(0, int(at - radius)) for at in (y, x))
    part = small[:, top : int(y + radius) + 2, left : int(x + radius) + 2].astype(np.float64)
    still = part.min(axis=0) if len(part) > 3 else None
    outline = np.array([x - left, y - top, radius])
    places = []
    for picture in part:
        try:
            one = find_highlight(picture, outline, BallCamera(), "", still=still)
        except ArgumentError:
            continue
        places.append((one.x, one.y))
    least = MIRRORED if _beyond(circle, small.shape[1:])[0] <= CUT else MIRRORED_CUT
    if len(places) < max(1.0, least * len(part)):
        return False
    return len(part) < 2 or bool(np.hypot(*np.std(places, axis=0)) > MOVES * radius)


def _box(circle: Array, size: tuple[int, int]) -> Box:
    x, y, radius = circle.tolist()
    half = MARGIN * radius
    top, left = max(0, int(y - half)), max(0, int(x - half))
    bottom, right = min(size[0], int(y + half) + 1), min(size[1], int(x + half) + 1)
    return top, left, bottom - top, right - left

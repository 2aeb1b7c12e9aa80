"""Where marks lie on or around a painting, in mm: markers, boards, and points given by hand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm, one_of
from impasto.calibrate.target import USUAL, Target, dictionary, target_from
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.json_file import read_json

Floats = NDArray[np.float64]
Kind = Literal["corner", "disc", "exact"]

SIDES = ("upper left", "upper right", "lower right", "lower left")
"""Corners of a marker and of the painting, in the order of OpenCV and of the markers' numbers."""
_SIGNS = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
"""Of x and y at these corners, y up."""
_ARUCO = re.compile(r"aruco(:(?P<dictionary>\w+?))?(:(?P<side>[\d.]+)mm)?")
SEARCH = 12.0
"""Pixels around a point given by hand in which its mark is looked for."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The marks of a painting.

    Parameters
    ----------
    size_mm
        Width and height of the area that is rectified; its middle is the origin, x right, y up.
    places
        Each mark's ``(x, y)`` in mm, by its name; those of markers are called
        ``marker 0, upper left corner``. Empty for a board, whose corners are numbered.
    dictionary
        Name of the ArUco dictionary; None where no markers are looked for.
    target
        A ChArUco board in the plane of the painting; its middle is the origin.
    points
        Rough pixels of the marks in each photograph, by the photograph's name; ``"default"`` is for
        all others.
    kind
        What a point given by hand is: the ``corner`` of a frame, a ``disc`` darker or brighter than
        its surroundings, or ``exact`` (not refined).
    search_px
        Reach of its refinement, in pixels.
    """

    size_mm: tuple[float, float]
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    dictionary: str | None = None
    target: Target | None = None
    points: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    kind: Kind = "corner"
    search_px: float = SEARCH

    def mm(self, names: tuple[str, ...]) -> Floats:
        """``(n, 2)``: the places of marks."""
        if self.target is not None:
            return self.target.corners[[int(name.split()[-1]) for name in names]]
        return np.array([self.places[name] for name in names], dtype=np.float64).reshape(-1, 2)


def marker_corner(number: int, corner: int) -> str:
    """The name of a corner of a marker: ``marker 0, lower right corner``."""
    return f"marker {number}, {SIDES[corner]} corner"


def size_from(text: str, argument: str = "size") -> tuple[float, float]:
    """Width and height in mm from ``400x300``.

    Raises
    ------
    ArgumentError
        Anything but two positive numbers.
    """
    words = text.lower().removesuffix("mm").split("x")
    try:
        width, height = (float(word) for word in words)
    except ValueError:
        raise ArgumentError(
            f"{argument}: expected width and height in mm such as 400x300, found {text!r}"
        ) from None
    return length_mm(width, argument), length_mm(height, argument)


def layout_from_markers(markers: str, size_mm: tuple[float, float]) -> Layout:
    """Four markers around a painting, or a ChArUco board in its place.

    Parameters
    ----------
    markers
        ``aruco:4x4_50``: markers 0 to 3, upright, at the upper left, upper right, lower right and
        lower left corner of the painting, each touching it with one corner: that which is nearest
        to the painting. Only this corner is used. With ``aruco:4x4_50:20mm`` the sides of the
        markers are 20 mm long and parallel to those of the painting, as where all are printed on
        one sheet, and all 16 corners are used. ``charuco:7x5:30mm:22mm``: the board's middle is the
        origin.
    size_mm
        Width and height of the painting.

    Raises
    ------
    ArgumentError
        Another description.
    """
    size = (length_mm(size_mm[0], "size"), length_mm(size_mm[1], "size"))
    if markers.lower().startswith("charuco:"):
        return Layout(size, target=target_from(markers, "markers"))
    found = _ARUCO.fullmatch(markers.lower())
    if found is None:
        raise ArgumentError(
            "markers: expected aruco:4x4_50, aruco:4x4_50:20mm or charuco:7x5:30mm:22mm, found "
            f"{markers!r}"
        )
    name = found["dictionary"] or USUAL
    dictionary(name, "markers")
    corners = _SIGNS * np.array(size) / 2.0
    places: dict[str, tuple[float, float]] = {}
    if found["side"] is None:
        for number, (x, y) in enumerate(corners.tolist()):
            places[marker_corner(number, (number + 2) % 4)] = (x, y)
        return Layout(size, places, name)
    try:
        side = length_mm(float(found["side"]), "markers")
    except ValueError:
        raise ArgumentError(f"markers: expected a side in mm, found {found['side']!r}") from None
    for number, touching in enumerate(corners):
        middle = touching + _SIGNS[number] * side / 2.0
        for corner, (x, y) in enumerate((middle + _SIGNS * side / 2.0).tolist()):
            places[marker_corner(number, corner)] = (x, y)
    return Layout(size, places, name)


def read_points(path: str | Path) -> Layout:
    """Marks whose places in photographs were found roughly by hand, from a JSON file.

    ``size_mm`` is width and height of the painting. ``photographs`` maps the name of a photograph,
    or ``default``, to the pixel (column, row) of each mark. ``points_mm`` maps the name of each
    mark to x and y in mm; default: ``upper left``, ``upper right``, ``lower right`` and
    ``lower left`` are the corners of the painting. ``kind`` is ``corner`` (default), ``disc`` or
    ``exact``, ``search_px`` the reach of the refinement (default 12).

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No such file.
    """
    path = Path(path)
    content = read_json(path)
    known = {"size_mm", "points_mm", "photographs", "kind", "search_px"}
    for name in content:
        if name not in known:
            raise CorruptInputError(
                path, f"{name!r} is not known; expected {', '.join(sorted(known))}"
            )
    width, height = _pair(path, "size_mm", content.get("size_mm"))
    if min(width, height) <= 0.0:
        raise CorruptInputError(path, f"size_mm: expected sizes above 0, found {width}, {height}")
    corners = (_SIGNS * (width / 2.0, height / 2.0)).tolist()
    places: dict[str, tuple[float, float]] = {
        name: (x, y) for name, (x, y) in zip(SIDES, corners, strict=True)
    }
    if "points_mm" in content:
        places = _points(path, "points_mm", content["points_mm"])
    photographs = content.get("photographs")
    if not isinstance(photographs, dict) or not photographs:
        raise CorruptInputError(
            path, "photographs: expected the pixels of each mark, by photograph or for default"
        )
    points = {name: _points(path, f"photographs: {name}", own) for name, own in photographs.items()}
    for photograph, own in points.items():
        for name in own:
            if name not in places:
                raise CorruptInputError(
                    path, f"photographs: {photograph}: {name!r} is none of {', '.join(places)}"
                )
    kind = content.get("kind", "corner")
    search = content.get("search_px", SEARCH)
    try:
        one_of(kind, ("corner", "disc", "exact"), "kind")
        if isinstance(search, bool) or not 2.0 <= float(search) <= 1000.0:
            raise ArgumentError(f"search_px: expected 2 to 1000 pixels, found {search!r}")
    except (ArgumentError, TypeError, ValueError, OverflowError) as error:
        raise CorruptInputError(path, str(error)) from error
    return Layout((width, height), places, points=points, kind=kind, search_px=float(search))


def _points(path: Path, where: str, content: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(content, dict) or len(content) < 4:
        raise CorruptInputError(path, f"{where}: expected four points or more by name")
    return {str(name): _pair(path, f"{where}: {name}", pair) for name, pair in content.items()}


def _pair(path: Path, where: str, content: Any) -> tuple[float, float]:
    try:
        x, y = (float(number) for number in content)
        if not np.isfinite((x, y)).all():
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        found = repr(content)[:40]
        raise CorruptInputError(path, f"{where}: expected two numbers, found {found}") from None
    return x, y

"""Marks of photographs: the file of ``impasto align --points``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from impasto.align import Layout, find_marks, layout_from_markers, read_points
from impasto.align.photographs import photographs_of
from impasto.editing.photographs import TILE, Photographs
from impasto.editing.written import WrittenFile
from impasto.errors import ArgumentError, CorruptInputError

Points = dict[str, dict[str, tuple[float, float]]]

LEAST = 4
"""Marks that determine a perspective."""
INSET = 0.15
"""Where corners that nobody has placed begin, in sides of the photograph from its border."""
DIGITS = 3
"""Decimals of a pixel in the file."""


class Marks:
    """The marks of a folder of photographs.

    Parameters
    ----------
    path
        The file: read where it exists, else made by the first save.
    folder
        The photographs.
    size_mm
        Width and height of the painting, for a new file.
    markers
        Markers that are looked for in each photograph, for a new file
        (:func:`impasto.align.layout_from_markers`).
    encoding
        Tone curve of the photographs; None: 8-bit files are sRGB, others linear.

    Raises
    ------
    ArgumentError
        No photographs; a new file without a size; markers and a file, or a board.
    CorruptInputError
        No file of points.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        size_mm: tuple[float, float] | None = None,
        markers: str | None = None,
        encoding: str | None = None,
    ) -> None:
        self.photographs = Photographs(photographs_of(folder), encoding)
        self.file = WrittenFile(path)
        self.notes: dict[str, str] = {}
        if path.exists():
            if size_mm is not None or markers is not None:
                raise ArgumentError(
                    f"size: {path} exists and has a size and marks; leave --size and --markers "
                    "out, or choose another name"
                )
            self.layout = read_points(path)
            self.points = _copied(self.layout.points)
            return
        if size_mm is None:
            raise ArgumentError(f"size: {path} does not exist; a new file needs --size")
        if markers is None:
            self.layout = Layout(size_mm, _corners(size_mm))
            self.points = {"default": self._inset()}
        else:
            self.layout = layout_from_markers(markers, size_mm)
            if self.layout.target is not None:
                raise ArgumentError(
                    "markers: corners of a board are not marked by hand; use aruco markers"
                )
            self.points = self._found()

    def document(self) -> dict[str, Any]:
        """Photographs, names and places of marks, and their pixels."""
        return {
            "kind": "marks",
            "file": self.file.path.name,
            "exists": self.file.path.exists(),
            "tile": TILE,
            "photographs": self.photographs.described(),
            "size_mm": list(self.layout.size_mm),
            "points_mm": {name: list(place) for name, place in self.layout.places.items()},
            "mark_kind": self._kind,
            "search_px": self.layout.search_px,
            "points": self.points,
            "notes": self.notes,
        }

    def picture(self, number: int) -> bytes:
        """A whole photograph."""
        return self.photographs.picture(number)

    def tile(self, number: int, column: int, row: int) -> bytes:
        """A part of a photograph."""
        return self.photographs.tile(number, column, row)

    def save(self, content: dict[str, Any]) -> str:
        """Write ``content``, which is that of the file."""
        try:
            text = json.dumps(content, indent=2, allow_nan=False) + "\n"
        except (ValueError, RecursionError) as error:  # 1e999, or brackets in brackets
            raise ArgumentError(f"points: cannot be written as JSON ({error})") from error
        self.file.write(text, self._checked)
        self.layout = read_points(self.file.path)
        self.points = _copied(self.layout.points)
        return f"{self.file.path.name} written, {len(self.layout.places)} marks"

    @property
    def _kind(self) -> str:
        # The corners of markers were refined along their edges already.
        return "exact" if self.layout.dictionary is not None else self.layout.kind

    def _checked(self, path: Path) -> None:
        layout = read_points(path)
        sizes = {one["name"]: (one["columns"], one["rows"]) for one in self.photographs.described()}
        for photograph, own in layout.points.items():
            if photograph != "default" and photograph not in sizes:
                raise CorruptInputError(
                    path,
                    f"photographs: {photograph!r} is not in {self.photographs.paths[0].parent}",
                )
            within = [sizes[photograph]] if photograph in sizes else list(sizes.values())
            for name, (x, y) in own.items():
                if not any(
                    -0.5 < x < wide - 0.5 and -0.5 < y < high - 0.5 for wide, high in within
                ):
                    raise CorruptInputError(
                        path, f"photographs: {photograph}: {name} at ({x:g}, {y:g}) lies outside"
                    )

    def _inset(self) -> dict[str, tuple[float, float]]:
        """Marks in the photograph as they lie about the painting, well inside."""
        first = self.photographs.described()[0]
        wide, high = float(first["columns"] - 1), float(first["rows"] - 1)
        places = self.layout.places
        most_x = max(abs(x) for x, _ in places.values())
        most_y = max(abs(y) for _, y in places.values())
        reach = 0.5 - INSET
        return {
            name: (
                round(wide * (0.5 + reach * x / most_x), DIGITS),
                round(high * (0.5 - reach * y / most_y), DIGITS),
            )
            for name, (x, y) in places.items()
        }

    def _found(self) -> Points:
        """The markers of each photograph; where too few are seen, those of the one before."""
        points: Points = {}
        last: tuple[str, dict[str, tuple[float, float]]] | None = None
        behind: list[str] = []
        for number, path in enumerate(self.photographs.paths):
            try:
                marks = find_marks(
                    self.photographs.light(number), self.layout, path.name, partial=True
                )
            except ArgumentError as error:
                self.notes[path.name] = str(error)
                behind.append(path.name)
                continue
            pairs = zip(marks.names, marks.pixels.round(DIGITS).tolist(), strict=True)
            seen = {name: (x, y) for name, (x, y) in pairs}
            if len(seen) < LEAST:
                self.notes[path.name] = f"{len(seen)} of {len(self.layout.places)} marks found"
                behind.append(path.name)
                continue
            if len(seen) < len(self.layout.places):
                self.notes[path.name] = f"{len(seen)} of {len(self.layout.places)} marks found"
            points[path.name] = seen
            last = path.name, seen
        if last is None:
            self.notes = {"default": "no markers found: place the marks by hand"}
            return {"default": self._inset()}
        for name in behind:
            nearest = self._nearest(name, points)
            points[name] = dict(points[nearest])
            self.notes[name] += f"; these are copied from {nearest}: check them"
        return {path.name: points[path.name] for path in self.photographs.paths}

    def _nearest(self, name: str, points: Points) -> str:
        """The photograph with marks that is nearest in the order of the folder."""
        order = [path.name for path in self.photographs.paths]
        own = order.index(name)
        known = [other for other in order if other in points and other not in self.notes]
        known = known or [other for other in order if other in points]
        return min(known, key=lambda other: abs(order.index(other) - own))


def _corners(size_mm: tuple[float, float]) -> dict[str, tuple[float, float]]:
    x, y = size_mm[0] / 2.0, size_mm[1] / 2.0
    return {
        "upper left": (-x, y), "upper right": (x, y), "lower right": (x, -y), "lower left": (-x, -y)
    }  # fmt: skip


def _copied(points: Mapping[str, Mapping[str, tuple[float, float]]]) -> Points:
    return {photograph: dict(own) for photograph, own in points.items()}

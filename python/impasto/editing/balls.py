"""Outlines of mirror balls: the files of ``impasto calibrate lights --circles``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from impasto.calibrate import BallCamera, read_balls
from impasto.calibrate.circles import circles_text, read_circles
from impasto.calibrate.folder import ball_folders
from impasto.calibrate.lights import BallPhotographs, outline_of
from impasto.editing.photographs import TILE, Photographs
from impasto.editing.written import WrittenFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images import photographs_in

Circle = tuple[float, float, float]

USUAL = "circle_data.txt"
"""Name of the file in the folder of each ball, or in that of the photographs."""
WITHIN = 1.5
"""Pixels that a border may cut off: three standard deviations of an outline by hand."""
START = 0.25
"""Radius of an outline that was not found, in shorter sides of the photograph."""


class BallOutlines:
    """The balls of a folder, alone or beside the painting.

    Parameters
    ----------
    folder
        As :func:`impasto.calibrate.read_balls` takes it.
    name
        Of the file with the outlines: read where it exists; else the balls are found.
    encoding
        Tone curve of the photographs; None: 8-bit files are sRGB, others linear.

    Raises
    ------
    ArgumentError
        No photographs.
    CorruptInputError
        A file without outlines.
    """

    def __init__(self, folder: Path, name: str = USUAL, encoding: str | None = None) -> None:
        if not folder.is_dir():
            raise ArgumentError(f"path: {folder} is not a folder")
        if Path(name).name != name:
            raise ArgumentError(
                f"circles: expected the name of a file in the folder of each ball, found {name!r}"
            )
        homes = ball_folders(folder)
        self._alone = bool(homes)
        self._homes = homes or [folder]
        paths = [photographs_in(home) for home in self._homes]
        self._set_of = [number for number, own in enumerate(paths) for _ in own]
        self.photographs = Photographs([path for own in paths for path in own], encoding)
        self.files = [WrittenFile(home / name) for home in self._homes]
        self.notes: dict[str, str] = {}
        self._described = self.photographs.described()
        self._rows = []
        for number, home in enumerate(self._homes):
            sizes = {(one["columns"], one["rows"]) for one in self._of_set(number)}
            if len(sizes) > 1:
                raise ArgumentError(f"path: photographs in {home} have different sizes")
            self._rows.append(int(self._of_set(number)[0]["rows"]))
        self.circles = [
            self._read(number) if file.path.exists() else []
            for number, file in enumerate(self.files)
        ]
        if not all(self.circles):
            found = self._found(folder)
            self.circles = [own or new for own, new in zip(self.circles, found, strict=True)]

    def document(self) -> dict[str, Any]:
        """Photographs, and the circles of each set of them."""
        return {
            "kind": "balls",
            "file": self.files[0].path.name,
            "exists": all(file.path.exists() for file in self.files),
            "tile": TILE,
            "alone": self._alone,
            "photographs": [
                {**one, "set": number}
                for one, number in zip(self._described, self._set_of, strict=True)
            ],
            "sets": [
                {"name": home.name, "circles": [list(circle) for circle in circles]}
                for home, circles in zip(self._homes, self.circles, strict=True)
            ],
            "notes": self.notes,
        }

    def picture(self, number: int) -> bytes:
        """A whole photograph."""
        return self.photographs.picture(number)

    def tile(self, number: int, column: int, row: int) -> bytes:
        """A part of a photograph."""
        return self.photographs.tile(number, column, row)

    def save(self, content: dict[str, Any]) -> str:
        """Write the circles of each set: ``{"sets": [[[x, y, radius], ...], ...]}``."""
        given = _list(content.get("sets"), "sets")
        if len(given) != len(self.files):
            raise ArgumentError(f"sets: expected {len(self.files)} lists of circles")
        sets = [self._checked(own, number) for number, own in enumerate(given)]
        for number, circles in enumerate(sets):
            if self._alone and len(circles) != 1:
                raise ArgumentError(
                    f"sets: {self._homes[number].name} is the folder of one ball, found "
                    f"{len(circles)} circles"
                )
        for file, circles, rows in zip(self.files, sets, self._rows, strict=True):
            file.write(circles_text(circles, rows), partial(read_circles, rows=rows))
        self.circles = sets
        count = len(self.files)
        files = "" if count == 1 else f" in {count} folders"
        return f"{self.files[0].path.name} written{files}"

    def _of_set(self, wanted: int) -> list[dict[str, Any]]:
        pairs = zip(self._described, self._set_of, strict=True)
        return [one for one, number in pairs if number == wanted]

    def _read(self, number: int) -> list[Circle]:
        path = self.files[number].path
        outlines = read_circles(path, self._rows[number])
        if self._alone and len(outlines) > 1:
            raise CorruptInputError(path, "a folder of a ball shows one")
        return [(one.x, one.y, one.radius) for one in outlines]

    def _found(self, folder: Path) -> list[list[Circle]]:
        """What the detector finds in each set; a circle in the middle where it finds none."""
        try:
            read = read_balls(folder)
        except ArgumentError as error:
            self.notes = {home.name: str(error) for home in self._homes}
            return [[self._middle(number)] for number in range(len(self._homes))]
        if self._alone:
            return [[self._outline(ball, number)] for number, ball in enumerate(read.balls)]
        if read.notes:
            self.notes[self._homes[0].name] = "; ".join(read.notes)
        return [[self._outline(ball, 0) for ball in read.balls]]

    def _outline(self, ball: BallPhotographs, number: int) -> Circle:
        left, top = (0.0, 0.0) if self._alone or ball.corner is None else ball.corner
        try:
            one = outline_of(ball, BallCamera())
        except ArgumentError as error:
            self.notes[self._homes[number].name] = str(error)
            rows, columns = ball.pictures.shape[1:]
            return ((columns - 1) / 2 + left, (rows - 1) / 2 + top, START * min(rows, columns))
        return (one.x + left, one.y + top, one.radius)

    def _middle(self, number: int) -> Circle:
        one = self._of_set(number)[0]
        columns, rows = one["columns"], one["rows"]
        return ((columns - 1) / 2, (rows - 1) / 2, START * min(rows, columns))

    def _checked(self, circles: Any, number: int) -> list[Circle]:
        one = self._of_set(number)[0]
        columns, rows = one["columns"], one["rows"]
        found = []
        for circle in _list(circles, "circles"):
            try:
                x, y, radius = (float(number) for number in circle)
            except (TypeError, ValueError, OverflowError):
                raise ArgumentError(
                    f"circles: expected x, y and radius, found {repr(circle)[:40]}"
                ) from None
            if not np.isfinite((x, y, radius)).all() or radius <= 0.0:
                raise ArgumentError(f"circles: expected a radius above 0, found {radius:g}")
            least = radius - 0.5 - WITHIN
            if not (least <= x <= columns - 1 - least and least <= y <= rows - 1 - least):
                raise ArgumentError(
                    f"circles: the ball at column {x:.4g} and row {y:.4g} with a radius of "
                    f"{radius:.4g} does not lie within {columns} x {rows} pixels"
                )
            found.append((x, y, radius))
        return found


def _list(content: Any, name: str) -> list[Any]:
    if not isinstance(content, list) or not content:
        raise ArgumentError(f"{name}: expected a list that is not empty")
    return content

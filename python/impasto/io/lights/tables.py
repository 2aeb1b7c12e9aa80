"""Tables of numbers as text and CSV."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import FARTHEST_MM
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.lights.light_file import SHORTEST, LightFile, comma_numbers, finish, number
from impasto.io.notes import Notebook

COLUMNS = ("light_x", "light_y", "light_z")
VIEW_COLUMNS = ("view_x", "view_y", "view_z")
CAMERA_COLUMNS = ("camera_mm", "pixel_mm")
LAMP_COLUMNS = ("light_mm",)
"""Header of a table that has all; headers are not read."""


ROUNDING = 1e-12
"""Vectors whose length differs from 1 by less have length 1."""


def parse_text(text: str, path: Path, notebook: Notebook, layout: str | None) -> LightFile:
    """Tables of numbers: N x 3, 3 x N, with or without a first line that counts them."""
    rows: list[list[float]] = []
    labels: list[str] = []
    commas = 0
    for index, line in enumerate(text.splitlines(), start=1):
        tokens = re.split(r"[\s;]+", line.split("#")[0].strip())
        if tokens == [""]:
            continue
        values: list[float | None] | None = [number(token) for token in tokens]
        if values is not None and None in values:
            values = list(comma_numbers(tokens) or []) or None
            commas += values is not None
        if values is None:
            values = [number(t) for t in re.split(r"[\s,;]+", line.strip().strip(",;"))]
        if None in values:
            raise CorruptInputError(
                path, f"line {index}: expected numbers only, found {line.strip()!r}"
            )
        rows.append([v for v in values if v is not None])
        labels.append(f"line {index}")
    count = None
    if len(rows) > 1 and len(rows[0]) == 1 and len(rows[1]) != 1:
        count = rows.pop(0)[0]
        labels.pop(0)
    if commas:
        notebook.repair("comma", path, f"{commas} line(s) with decimal commas: read as points")
    vectors, transposed = _table(rows, path, layout)
    if transposed:
        labels = [f"column {i + 1}" for i in range(len(vectors))]
        notebook.say("layout", path, f"3 x {len(vectors)} numbers: one light per column")
    if count is not None and count != len(vectors):
        notebook.repair(
            "count",
            path,
            f"the first line says {count:g} lights, {len(vectors)} follow: all of them are used",
        )
    return finish(path, "text", vectors, labels, notebook, names=None)


def _table(
    rows: list[list[float]], path: Path, layout: str | None
) -> tuple[NDArray[np.float64], bool]:
    if not rows:
        raise CorruptInputError(path, "is empty: one light direction x y z a line is expected")
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        raise CorruptInputError(
            path, f"lines hold different numbers of values: {sorted(widths)}; expected x y z"
        )
    table = np.array(rows, dtype=np.float64)
    if table.shape == (3, 3):
        if layout not in {"rows", "columns"}:
            raise ArgumentError(
                f"{path}: 3 x 3 numbers can be read by row or by column; say "
                'layout="rows" (one light a line) or layout="columns"'
            )
        return (table.T, True) if layout == "columns" else (table, False)
    if table.shape[1] == 3:
        return table, False
    if table.shape[0] == 3:
        return np.ascontiguousarray(table.T), True
    raise CorruptInputError(
        path, f"expected N x 3 or 3 x N numbers, found {table.shape[0]} x {table.shape[1]}"
    )


def parse_csv(text: str, path: Path, notebook: Notebook, layout: str | None) -> LightFile:
    """CSV with or without a header, with or without a file name in the first column.

    Three numbers in a row are the direction to the light; six are that and the direction to the
    eye; eight are also the distance of the camera from the middle of the painting and the width of
    a pixel, both in mm. Nine, after a name, are also the distance of the lamp in mm; the camera is
    far away where its distance is 0 then.
    """
    first = text.lstrip().splitlines()[0] if text.strip() else ""
    delimiter = max(";\t,", key=first.count)
    records = [
        (reader_line, [cell.strip() for cell in row])
        for reader_line, row in enumerate(csv.reader(io.StringIO(text), delimiter=delimiter), 1)
        if any(cell.strip() for cell in row)
    ]
    rows: list[list[float]] = []
    names: list[str] = []
    labels: list[str] = []
    commas = 0
    for position, (line, cells) in enumerate(records):
        while cells and not cells[-1]:
            cells.pop()
        count = 9 if len(cells) > 9 else 8 if len(cells) > 7 else 6 if len(cells) > 5 else 3
        values: list[float | None] = [number(cell) for cell in cells[-count:]]
        if len(values) == count and None in values:
            repaired = comma_numbers(cells[-count:])
            if repaired is not None:
                values, commas = list(repaired), commas + 1
        if len(values) != count or None in values or len(cells) > count + 1:
            if position == 0:
                continue  # a header
            raise CorruptInputError(
                path,
                f"line {line}: expected [name{delimiter}] x y z of the light, or these and x y z "
                f"of the view, or also camera_mm and pixel_mm, or also light_mm, found {cells}",
            )
        rows.append([v for v in values if v is not None])
        labels.append(f"line {line}")
        if len(cells) == count + 1:
            names.append(cells[0])
    lamps = _lamps(rows, path)
    vectors, views, far, pitch = _lights_and_views(rows, path)
    if names and len(names) != len(vectors):
        raise CorruptInputError(path, f"{len(names)} of {len(vectors)} lines name an image")
    if commas:
        notebook.repair("comma", path, f"{commas} line(s) with decimal commas: read as points")
    if not names and len(vectors) == 3 and views is None:
        vectors = _table(vectors, path, layout or "rows")[0].tolist()
    directions = np.array(vectors, dtype=np.float64).reshape(-1, 3)
    positions = None
    if lamps is not None:
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        # A direction of length 0 stays as it is; the error names it.
        positions = directions / np.where(lengths > 0.0, lengths, 1.0) * lamps[:, None]
    return finish(
        path,
        "csv",
        directions,
        labels,
        notebook,
        names=tuple(names) or None,
        views=views,
        view_positions=None if views is None or far is None else views * far[:, None],
        positions=positions,
        pitch_mm=pitch,
    )


def _lamps(rows: list[list[float]], path: Path) -> NDArray[np.float64] | None:
    """Distances of near lamps in mm, where all rows have them."""
    if {len(row) for row in rows} != {9}:
        return None
    found = np.array([row[8] for row in rows])
    if not ((found >= 1.0 / FARTHEST_MM) & (found <= FARTHEST_MM)).all():
        raise CorruptInputError(path, "light_mm: expected distances of the lamps above 0 in mm")
    return found


def _lights_and_views(
    rows: list[list[float]], path: Path
) -> tuple[list[list[float]], NDArray[np.float64] | None, NDArray[np.float64] | None, float | None]:
    """Lights, views, distances of cameras and the width of a pixel, as far as rows have them."""
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise CorruptInputError(
            path, "some lines have a view and others do not: give all photographs one, or none"
        )
    if not widths & {6, 8, 9}:
        return rows, None, None, None
    lights, views = [row[:3] for row in rows], unit_views([row[3:6] for row in rows], path)
    if widths == {6}:
        return lights, views, None, None
    far, pitch = np.array([row[6] for row in rows]), {row[7] for row in rows}
    if widths == {9} and not far.any():
        far = np.full(len(far), np.inf)
    if not (far > 0.0).all() or len(pitch) > 1 or min(pitch) <= 0.0:
        raise CorruptInputError(
            path, "expected distances of the camera above 0 in mm, and one width of a pixel"
        )
    return lights, views, far if np.isfinite(far).all() else None, pitch.pop()


def unit_views(rows: Sequence[Sequence[float]], path: Path) -> NDArray[np.float64]:
    """Directions to the eye, ``(n, 3)`` of unit length, all in front of the painting."""
    views = np.array(rows, dtype=np.float64)
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(views, axis=1)
    if not (np.isfinite(lengths) & (lengths >= SHORTEST)).all() or (views[:, 2] <= 0.0).any():
        raise CorruptInputError(
            path, "a direction to the eye has no length or lies behind the painting (z <= 0)"
        )
    # Unit vectors keep their bits.
    lengths[np.abs(lengths - 1.0) < ROUNDING] = 1.0
    return np.asarray(views / lengths[:, None])

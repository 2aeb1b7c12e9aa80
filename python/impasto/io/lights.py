"""Light descriptions of other programs: one tolerant reader for all of them."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.notes import Note, Notebook, few
from impasto.rig import DistantLight, Light, PointLight

LIGHT_SUFFIXES = (".lp", ".txt", ".csv", ".dome", ".relight", ".json")
SHORTEST = 1e-4
"""Vectors shorter than this point nowhere (the limit of the relight reader)."""


@dataclass(frozen=True, eq=False)
class LightFile:
    """The lights of one file.

    Parameters
    ----------
    path
        The file.
    format
        ``"lp"``, ``"text"``, ``"csv"``, ``"dome"``, ``"relight"`` or ``"alicevision"``.
    names
        The image each light belongs to, exactly as written; None where the file names none.
    directions
        ``(n, 3)`` unit vectors from the surface to the light (x right, y up, z to the camera).
    lengths
        ``(n,)`` lengths of the vectors as they stood in the file.
    positions
        ``(n, 3)`` in mm where the file knows them (point lights), else None.
    intensities
        ``(n,)`` or ``(n, band)`` where the file knows them, else None.
    pitch_mm, width_mm
        Width of a pixel / of the image on the painting, where the file knows it.
    notes
        Every repair and everything odd.
    """

    path: Path
    format: str
    names: tuple[str, ...] | None
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    positions: NDArray[np.float64] | None = None
    intensities: NDArray[np.float64] | None = None
    pitch_mm: float | None = None
    width_mm: float | None = None
    notes: tuple[Note, ...] = ()

    def __len__(self) -> int:
        return len(self.directions)

    @property
    def lights(self) -> tuple[Light, ...]:
        """One :class:`PointLight` or :class:`DistantLight` for each entry."""
        if self.positions is not None:
            return tuple(PointLight((x, y, z)) for x, y, z in self.positions.tolist())
        return tuple(DistantLight((x, y, z)) for x, y, z in self.directions.tolist())


def read_lights(
    path: str | Path,
    *,
    layout: Literal["rows", "columns"] | None = None,
    strict: bool = False,
) -> LightFile:
    """Read the light directions of one session.

    Accepts ``.lp`` in every variant met in practice, numbers as N x 3 or 3 x N text, CSV,
    relight's ``.dome`` and ``.relight``, and AliceVision's JSON.

    Parameters
    ----------
    path
        The light file.
    layout
        For tables of 3 x 3 numbers only, whose meaning cannot be seen: ``"rows"`` for one light
        a row, ``"columns"`` for one light a column.
    strict
        Raise instead of repairing.

    Raises
    ------
    CorruptInputError
        A line that cannot be read, a vector without length, or (strict) anything repaired.
    ArgumentError
        An unknown kind of file, or a 3 x 3 table without ``layout``.
    """
    path = Path(path)
    notebook = Notebook(strict)
    text = read_text(path)
    suffix = path.suffix.lower()
    if suffix == ".lp":
        from impasto.io.lp import parse_lp

        return parse_lp(text, path, notebook)
    if suffix in {".dome", ".relight", ".json"}:
        return _parse_json(text, path, notebook)
    if suffix == ".csv":
        return _parse_csv(text, path, notebook, layout)
    if suffix == ".txt":
        return _parse_text(text, path, notebook, layout)
    raise ArgumentError(
        f"lights: {path} is no light file that impasto knows (one of {', '.join(LIGHT_SUFFIXES)})"
    )


def read_text(path: Path) -> str:
    """A text file of unknown origin: UTF-8 with or without BOM, UTF-16 with BOM, else Latin-1."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ArgumentError(f"{path}: cannot be read ({error.strerror})") from error
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def number(token: str) -> float | None:
    """A finite decimal number, or None."""
    try:
        value = float(token)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def comma_numbers(tokens: list[str]) -> list[float] | None:
    """Numbers written with decimal commas, only if every token parses so."""
    if any("." in token for token in tokens) or not any("," in token for token in tokens):
        return None
    values = [number(token.replace(",", ".")) for token in tokens]
    return None if None in values else [v for v in values if v is not None]


def finish(
    path: Path,
    format_: str,
    vectors: NDArray[np.float64],
    labels: list[str],
    notebook: Notebook,
    *,
    names: tuple[str, ...] | None,
    **extra: Any,
) -> LightFile:
    """Normalise the vectors, note what is odd about them, and build the result.

    ``labels`` say where each vector came from (``"line 7 (a.jpg)"``).
    """
    if len(vectors) == 0:
        raise CorruptInputError(path, "holds no lights: one line per photograph is expected")
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(vectors, axis=1)
    for label, vector, length in zip(labels, vectors.tolist(), lengths.tolist(), strict=True):
        if length < SHORTEST:
            raise CorruptInputError(
                path, f"{label}: the light direction {tuple(vector)} has no length"
            )
        if not np.isfinite(length):
            raise CorruptInputError(
                path, f"{label}: the light direction {tuple(vector)} is too long for a number"
            )
    off = np.abs(lengths - 1.0)
    if extra.get("positions") is None and bool((off > 0.01).any()):
        count = int((off > 0.01).sum())
        worst = int(off.argmax())
        hint = (
            "; numbers that long look like positions, not directions: check the file"
            if lengths.min() > 2.0
            else ""
        )
        notebook.repair(
            "length",
            path,
            f"{count} of {len(vectors)} light directions are not unit vectors (lengths "
            f"{lengths.min():.3f} to {lengths.max():.3f}, worst {labels[worst]}): "
            f"normalised{hint}",
        )
    below = [labels[i] for i in np.flatnonzero(vectors[:, 2] < 0.0)]
    if below:
        notebook.warn(
            "horizon",
            path,
            f"{len(below)} light(s) lie below the painting's horizon (z < 0): {few(below)}; kept",
        )
    if names is not None:
        folded = [name.replace("\\", "/").casefold() for name in names]
        twice = sorted({names[i] for i, name in enumerate(folded) if name in folded[:i]})
        if twice:
            notebook.warn("duplicate", path, f"lists these more than once: {few(twice)}; kept")
    return LightFile(
        path,
        format_,
        names,
        vectors / lengths[:, None],
        lengths,
        notes=tuple(notebook.notes),
        **extra,
    )


def _parse_text(text: str, path: Path, notebook: Notebook, layout: str | None) -> LightFile:
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
        notebook.say("layout", path, f"3 x {len(vectors)} numbers: one light a column")
    if count is not None and count != len(vectors):
        notebook.repair(
            "count",
            path,
            f"the first line promises {count:g} lights, {len(vectors)} follow: all used",
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


def _parse_csv(text: str, path: Path, notebook: Notebook, layout: str | None) -> LightFile:
    """CSV with or without a header, with or without a file name in the first column."""
    first = text.lstrip().splitlines()[0] if text.strip() else ""
    delimiter = max(";\t,", key=first.count)
    records = [
        (reader_line, [cell.strip() for cell in row])
        for reader_line, row in enumerate(csv.reader(io.StringIO(text), delimiter=delimiter), 1)
        if any(cell.strip() for cell in row)
    ]
    vectors: list[list[float]] = []
    names: list[str] = []
    labels: list[str] = []
    commas = 0
    for position, (line, cells) in enumerate(records):
        while cells and not cells[-1]:
            cells.pop()
        values: list[float | None] = [number(cell) for cell in cells[-3:]]
        if len(values) == 3 and None in values:
            repaired = comma_numbers(cells[-3:])
            if repaired is not None:
                values, commas = list(repaired), commas + 1
        if len(values) != 3 or None in values or len(cells) > 4:
            if position == 0:
                continue  # a header
            raise CorruptInputError(
                path, f"line {line}: expected [name{delimiter}] x y z, found {cells}"
            )
        vectors.append([v for v in values if v is not None])
        labels.append(f"line {line}")
        if len(cells) == 4:
            names.append(cells[0])
    if names and len(names) != len(vectors):
        raise CorruptInputError(path, f"{len(names)} of {len(vectors)} lines name an image")
    if commas:
        notebook.repair("comma", path, f"{commas} line(s) with decimal commas: read as points")
    if not names and len(vectors) == 3:
        vectors = _table(vectors, path, layout or "rows")[0].tolist()
    return finish(
        path,
        "csv",
        np.array(vectors, dtype=np.float64).reshape(-1, 3),
        labels,
        notebook,
        names=tuple(names) or None,
    )


def _parse_json(text: str, path: Path, notebook: Notebook) -> LightFile:
    from impasto.io.projects import parse_alicevision, parse_dome, parse_relight

    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise CorruptInputError(path, f"is no valid JSON ({error})") from error
    if not isinstance(content, dict):
        raise CorruptInputError(path, "expected a JSON object at the top")
    if isinstance(content.get("lights"), dict):
        return parse_alicevision(content, path, notebook)
    if isinstance(content.get("images"), list):
        return parse_relight(content, path, notebook)
    return parse_dome(content, path, notebook)

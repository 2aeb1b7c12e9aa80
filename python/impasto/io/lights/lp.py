"""`.lp` light files: a count, then one line ``file x y z`` for each photograph."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impasto.errors import CorruptInputError
from impasto.io.lights.light_file import LightFile, comma_numbers, finish, number
from impasto.io.notes import Notebook

_LONGEST_COUNT = 9
"""Digits: more photographs than that have never been taken."""


def parse_lp(text: str, path: Path, notebook: Notebook) -> LightFile:
    """Read the text of an ``.lp`` file.

    The last three words of a line are x, y, z and everything before them is the file name, so
    that names with blanks and absolute paths of other computers survive.
    """
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(i, line) for i, line in lines if not line.startswith("#")]
    if not lines:
        raise CorruptInputError(path, "is empty: a count and one line per photograph are expected")
    promised = _count(lines[0][1])
    if promised is None:
        notebook.repair("count", path, "the first line is not a count: every line read as a light")
    else:
        lines = lines[1:]
    names: list[str] = []
    labels: list[str] = []
    vectors: list[list[float]] = []
    commas = 0
    for index, line in lines:
        name, vector, comma = _entry(line, index, path)
        commas += comma
        if name:
            names.append(name)
        labels.append(f"line {index}" + (f" ({name})" if name else ""))
        vectors.append(vector)
    if commas:
        notebook.repair(
            "comma", path, f"{commas} line(s) have decimal commas: read as decimal points"
        )
    if names and len(names) != len(vectors):
        raise CorruptInputError(
            path, f"only {len(names)} of {len(vectors)} lines name a photograph: name all or none"
        )
    if promised is not None and promised != len(vectors):
        notebook.repair(
            "count",
            path,
            f"the first line says {promised} lights, {len(vectors)} lines follow: all of them "
            "are used",
        )
    table = np.array(vectors, dtype=np.float64).reshape(-1, 3)
    return finish(path, "lp", table, labels, notebook, names=tuple(names) or None)


def _count(line: str) -> int | None:
    tokens = line.split()
    if len(tokens) != 1 or not (tokens[0].isascii() and tokens[0].isdigit()):
        return None
    return int(tokens[0]) if len(tokens[0]) <= _LONGEST_COUNT else None


def _entry(line: str, index: int, path: Path) -> tuple[str, list[float], bool]:
    tokens = line.rsplit(None, 3)
    xyz = tokens[-3:]
    if len(xyz) == 3:
        values = [number(token) for token in xyz]
        name = tokens[0] if len(tokens) == 4 else ""
        if None not in values:
            return name, [v for v in values if v is not None], False
        repaired = comma_numbers(xyz)
        if repaired is not None:
            return name, repaired, True
    raise CorruptInputError(
        path, f"line {index}: expected FILE X Y Z with three numbers, found {line!r}"
    )

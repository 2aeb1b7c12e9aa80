"""Light descriptions of other programs: one tolerant reader for all of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

from impasto._internal.damage import damage_of
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.lights.light_file import LightFile
from impasto.io.lights.lp import parse_lp
from impasto.io.lights.projects import parse_alicevision, parse_dome, parse_relight
from impasto.io.lights.tables import parse_csv, parse_text
from impasto.io.notes import Notebook

LIGHT_SUFFIXES = (".lp", ".txt", ".csv", ".dome", ".relight", ".json")


def read_lights(
    path: str | Path,
    *,
    layout: Literal["rows", "columns"] | None = None,
    strict: bool = False,
) -> LightFile:
    """Read the light directions of one session.

    Accepts ``.lp`` in every variant met in practice, numbers as N x 3 or 3 x N text, CSV,
    relight's ``.dome`` and ``.relight``, and AliceVision's JSON. A CSV with six numbers in a row
    has the direction to the eye after that to the light, for photographs with a view each.

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
    with damage_of(path, "a light file"):
        if suffix == ".lp":
            return parse_lp(text, path, notebook)
        if suffix in {".dome", ".relight", ".json"}:
            return _parse_json(text, path, notebook)
        if suffix == ".csv":
            return parse_csv(text, path, notebook, layout)
        if suffix == ".txt":
            return parse_text(text, path, notebook, layout)
    raise ArgumentError(
        f"lights: {path} is not a light file of a known format (one of {', '.join(LIGHT_SUFFIXES)})"
    )


def _parse_json(text: str, path: Path, notebook: Notebook) -> LightFile:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise CorruptInputError(path, f"is not valid JSON ({error})") from error
    if not isinstance(content, dict):
        raise CorruptInputError(path, "expected a JSON object at the top")
    if isinstance(content.get("lights"), dict):
        return parse_alicevision(content, path, notebook)
    if isinstance(content.get("images"), list):
        return parse_relight(content, path, notebook)
    return parse_dome(content, path, notebook)

"""JSON files of unknown origin: an object, which may say of what kind and version it is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto.errors import CorruptInputError
from impasto.io.files import read_text

VERSION = 1
"""Of all kinds of files."""


def read_json(path: Path) -> dict[str, Any]:
    """The object of a JSON file.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No JSON, or no object at the top.
    """
    text = read_text(path)
    try:
        content = json.loads(text)
    except DAMAGE as error:  # brackets may be nested too deep, and numbers too long
        raise CorruptInputError(path, f"is not valid JSON ({error})") from error
    if not isinstance(content, dict):
        raise CorruptInputError(path, "expected a JSON object at the top")
    return content


def read_kind(path: Path, kind: str, what: str, source: str) -> dict[str, Any]:
    """The object of a file that names its kind and version.

    Parameters
    ----------
    path
        The file.
    kind
        What its ``"kind"`` has to be.
    what
        The same in words: ``"the file of a lens"``.
    source
        The command that writes such a file.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No JSON, another kind or another version.
    """
    content = read_json(path)
    if content.get("kind") != kind:
        raise CorruptInputError(
            path, f'is not {what} (its "kind" is not "{kind}"); {source} writes one'
        )
    if content.get("version") != VERSION:
        found = repr(content.get("version"))[:40]
        raise CorruptInputError(path, f"is of version {found}, expected {VERSION}")
    return content

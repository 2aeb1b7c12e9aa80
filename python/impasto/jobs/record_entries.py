"""Which values the entries of ``job.json`` can have, whatever version of impasto wrote it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto.encoding import Encoding
from impasto.io.results.precision import checked_precision

MOST_SIDE = 1 << 31
"""More rows, columns or observations than any job has: numbers of tiles stay numbers of loops."""
MOST_BYTES = 1 << 63
"""8 EiB, more than a file system counts."""
DEEPEST = 8
"""Levels of lists and dictionaries in an entry: options have two."""


def wrong_entry(content: Mapping[str, Any]) -> str | None:
    """The first entry that is missing, unknown, or has a value that no job writes; None: no."""
    for name, is_right in _ENTRIES.items():
        try:
            right = is_right(content[name])
        except DAMAGE:
            right = False
        if not right:
            return name
    return next((name for name in content if name not in _ENTRIES), None)


def _is_source(value: Any) -> bool:
    return value is None or _is_name(value)


def _is_name(value: Any) -> bool:
    """Whether it can be the name of a file."""
    return type(value) is str and b"\0" not in os.fsencode(value)


def _is_size(value: Any) -> bool:
    return type(value) is int and 0 < value < MOST_SIDE


def _is_shape(value: Any) -> bool:
    return type(value) is list and len(value) == 4 and all(map(_is_size, value))


def _is_options(value: Any) -> bool:
    return type(value) is dict and _is_plain(value)


def _is_plain(value: Any, depth: int = 0) -> bool:
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return depth < DEEPEST and all(_is_plain(one, depth + 1) for one in inner)
    return value is None or isinstance(value, bool | int | float | str)


def _is_curve(value: Any) -> bool:
    curve, white = value
    # An error of it is that of this entry.
    return type(curve) is str and type(white) is float and bool(Encoding(curve, white).curve)


def _is_precision(value: Any) -> bool:
    return bool(checked_precision(value))


def _are_inputs(value: Any) -> bool:
    return type(value) is list and all(map(_is_input, value))


def _is_input(value: Any) -> bool:
    size, checksums = value["bytes"], [value[key] for key in ("sha256", "crc32c") if key in value]
    return (
        _is_name(value["file"])
        and (type(size) is int and 0 <= size < MOST_BYTES)
        and (bool(checksums) and all(type(one) is str for one in checksums))
        and _is_plain(value)
    )


def _are_notes(value: Any) -> bool:
    return type(value) is list and all(
        type(note) is list and len(note) == 2 and all(type(one) is str for one in note)
        for note in value
    )


_ENTRIES: Mapping[str, Callable[[Any], bool]] = {
    "format": lambda value: type(value) is int,
    "version": lambda value: type(value) is str,
    "source": _is_source,
    "reading": _is_options,
    "encoding": _is_curve,
    "inputs": _are_inputs,
    "fit": _is_options,
    "shape": _is_shape,
    "tile": _is_size,
    "sample": _is_size,
    "precision": _is_precision,
    "notes": _are_notes,
}

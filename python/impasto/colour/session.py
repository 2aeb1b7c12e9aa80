"""Measurements of a display in a file.

The file is JSON and holds the arguments of :meth:`Display.calibrated` as they were read::

    {"white": [55.9, 61.0, 67.3],
     "primaries": [[24.9, 13.7, 1.7], [19.8, 42.4, 8.5], [11.8, 5.5, 57.9]],
     "black": [0.31, 0.33, 0.36],
     "ramp": {"codes": [0, 5, 10], "readings": [[0.33, 0.34, 0.4], [], []]}}

``"curve"`` (``"srgb"``, a gamma or three) may stand in place of ``"ramp"``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from impasto._internal.damage import damage_of
from impasto._internal.regular import check_regular
from impasto.colour.display import NAMED_PRIMARIES, Display
from impasto.errors import ArgumentError, CorruptInputError

KEYS = {"name", "white", "primaries", "black", "curve", "ramp"}


def read_display(path: str | Path) -> Display:
    """A calibrated display from a file of measurements.

    Parameters
    ----------
    path
        A JSON file with the keys ``white`` and ``primaries``, and optionally ``black``, ``name``
        and ``ramp`` (``codes`` and ``readings``) or ``curve``: see :meth:`Display.calibrated`.

    Returns
    -------
    Display
        Named by the file's ``name``, or by the file.

    Raises
    ------
    CorruptInputError
        A file that is not JSON, lacks or adds a key, or whose measurements cannot be used; the
        message says why.
    FileNotFoundError
        No such file.
    """
    source = Path(path)
    check_regular(source)
    with damage_of(source, "JSON"):
        content = json.loads(source.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise CorruptInputError(source, "expected an object with the keys white and primaries")
    missing, unknown = {"white", "primaries"} - content.keys(), content.keys() - KEYS
    if missing or unknown:
        what = f"lacks {sorted(missing)}" if missing else f"has unknown keys {sorted(unknown)}"
        raise CorruptInputError(source, f"{what}; known keys are {sorted(KEYS)}")
    ramp = content.pop("ramp", None)
    if ramp is not None:
        if not isinstance(ramp, dict) or ramp.keys() != {"codes", "readings"}:
            raise CorruptInputError(source, 'ramp: expected {"codes": [...], "readings": [...]}')
        ramp = (ramp["codes"], ramp["readings"])
    arguments: dict[str, Any] = {"name": source.stem} | content
    try:
        with damage_of(source, "measurements of a display"):
            return Display.calibrated(ramp=ramp, **arguments)
    except ArgumentError as error:
        raise CorruptInputError(source, str(error)) from error


def as_display(display: Display | str | Path) -> Display:
    """A display given as such, by standard name, or by a file of measurements (``.json``)."""
    if isinstance(display, Display):
        return display
    if isinstance(display, Path) or display.casefold().endswith(".json"):
        return read_display(display)
    try:
        return Display.named(display)
    except ArgumentError as error:
        names = ", ".join(map(repr, NAMED_PRIMARIES))
        raise ArgumentError(
            f"display: expected {names}, a file of measurements (.json) or a Display, "
            f"found {display!r}"
        ) from error

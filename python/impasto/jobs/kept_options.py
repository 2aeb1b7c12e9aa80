"""Options in the record of a job that goes on: this version must take them as those of a call."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto.effort import Effort
from impasto.errors import ArgumentError, CorruptInputError
from impasto.jobs.learning import checked_fit
from impasto.jobs.photographs import checked_reading
from impasto.jobs.record import JobRecord


def check_options(record: JobRecord, path: Path) -> None:
    """Refuse a record of this version with options that no job has.

    Parameters
    ----------
    path
        Its file, for the message.

    Raises
    ------
    CorruptInputError
        With the first such option.
    """
    for name, check in (("fit", _check_fit), ("reading", _check_reading)):
        try:
            check(getattr(record, name))
        except (ArgumentError, *DAMAGE) as error:
            problem = f"it has no {error}" if isinstance(error, KeyError) else str(error)
            raise CorruptInputError(
                path, f"has options that no job has ({name}: {problem}); fit the painting anew"
            ) from error


def _check_fit(kept: Mapping[str, Any]) -> None:
    effort = Effort(**kept["effort"])
    if checked_fit({**kept, "effort": effort}) != dict(kept):
        raise ValueError("one is missing or unknown")


def _check_reading(kept: Mapping[str, Any]) -> None:
    if checked_reading(kept) != dict(kept):
        raise ValueError("one is not given")
    for name, value in kept.items():
        if not any(fits(value) for fits in _KINDS[name]):
            raise ValueError(f"{name}: found {value!r:.60}")


def _is_text(value: Any) -> bool:
    return type(value) is str and b"\0" not in os.fsencode(value)


def _are_texts(value: Any) -> bool:
    return type(value) is list and all(map(_is_text, value))


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)


def _are_numbers(value: Any) -> bool:
    """Numbers, or rows of as many numbers each."""
    if type(value) is not list or not value:
        return False
    if all(map(_is_number, value)):
        return True
    rows = all(type(row) is list and all(map(_is_number, row)) for row in value)
    return rows and len({len(row) for row in value}) == 1


def _is_truth(value: Any) -> bool:
    return type(value) is bool


_KINDS: Mapping[str, tuple[Callable[[Any], bool], ...]] = {
    "lights": (_is_text, _are_numbers),
    "images": (_is_text,),
    "encoding": (_is_text, _is_number),
    "mask": (_is_text,),
    "saturation": (_is_number, _are_numbers),
    "white": (_is_text, _are_texts),
    "dark": (_is_text, _are_texts, _is_number, _are_numbers),
    "board_reflectance": (_is_number, _are_numbers),
    "intensities": (_is_text, _is_number, _are_numbers),
    "pattern": (_is_text, _are_texts),
    "bands": (_is_text, _are_texts),
    "pitch_mm": (_is_number,),
    "layer": (_is_text,),
    "strict": (_is_truth,),
    "max_pixels": (_is_number,),
}
"""What an option of :func:`impasto.read_stack` is in a record: of each at least one of these."""

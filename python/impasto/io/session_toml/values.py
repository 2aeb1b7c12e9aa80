"""What a value of ``session.toml`` may be: each function checks one, or raises ``ValueError``.

The messages say what was expected; the reader adds file, line and key.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from datetime import date, time
from string import Formatter
from typing import Any, TypeAlias

from impasto._internal.checks import FARTHEST_MM, is_whole

Check: TypeAlias = Callable[[Any], Any]
Vector: TypeAlias = tuple[float, float, float]

_SHA256 = re.compile(r"[0-9a-fA-F]{64}")
_LONGEST = 40
"""Characters of a wrong value that a message shows."""


def refuse(expected: str, found: Any) -> ValueError:
    """The error of a value."""
    if isinstance(found, date | time):
        shown = str(found)
    else:
        # A table or a number of any length.
        shown = repr(found) if not isinstance(found, dict) else "a table"
    shown = shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}..."
    return ValueError(f"expected {expected}, found {shown}")


def truth(value: Any) -> bool:
    """A truth value."""
    if not isinstance(value, bool):
        raise refuse("true or false", value)
    return value


def text(value: Any) -> str:
    """A text of one line."""
    if not isinstance(value, str) or not value.strip() or "\n" in value or "\r" in value:
        raise refuse("a text of one line in quotation marks", value)
    return value


def file(value: Any) -> str:
    """The name of a file or folder."""
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise refuse("the name of a file or folder in quotation marks", value)
    return value


def texts(value: Any) -> tuple[str, ...]:
    """A list of texts."""
    if not isinstance(value, list) or not value:
        raise refuse("a list of texts", value)
    return tuple(text(one) for one in value)


def number(value: Any, expected: str = "a number") -> float:
    """A finite real number."""
    try:
        found = float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        found = math.inf
    if isinstance(value, bool) or not math.isfinite(found):
        raise refuse(expected, value)
    return found


def positive(value: Any, expected: str = "a positive number") -> float:
    """A number above 0."""
    found = number(value, expected)
    if found <= 0:
        raise refuse(expected, value)
    return found


def length_mm(value: Any) -> float:
    """A length in mm."""
    expected = "a positive length in mm"
    found = positive(value, expected)
    if not 1.0 / FARTHEST_MM <= found <= FARTHEST_MM:
        raise refuse(expected, value)
    return found


def size_mm(value: Any) -> tuple[float, float]:
    """Width and height."""
    if not isinstance(value, list) or len(value) != 2:
        raise refuse("[width, height] in mm", value)
    return length_mm(value[0]), length_mm(value[1])


def whole(value: Any) -> int:
    """A whole number above 0."""
    if not is_whole(value) or value < 1:
        raise refuse("a whole number from 1 on", value)
    return int(value)


def region(value: Any) -> tuple[int, int, int, int]:
    """A part of the photographs."""
    right = isinstance(value, list) and len(value) == 4 and all(map(is_whole, value))
    if not right or min(value[:2]) < 0 or min(value[2:]) < 1:
        raise refuse("[top, left, height, width] in pixels", value)
    top, left, height, width = value
    return top, left, height, width


def encoding(value: Any) -> str:
    """A tone curve by its name, or a gamma."""
    if isinstance(value, str):
        return text(value)
    return repr(number(value, '"srgb", "linear", "auto" or a gamma such as "2.2"'))


def pattern(value: Any) -> str | tuple[str, ...]:
    """One file name with places for name and band, or one for each band."""
    found = text(value) if isinstance(value, str) else texts(value)
    for one in [found] if isinstance(found, str) else found:
        try:
            fields = [part[1:] for part in Formatter().parse(one) if part[1] is not None]
        except ValueError as error:
            raise refuse('a pattern such as "{name}_{band}.tif"', one) from error
        if ("name", "", None) not in fields or set(fields) - {
            ("name", "", None),
            ("band", "", None),
        }:
            raise refuse('{name} and at most {band}, as in "{name}_{band}.tif"', one)
    return found


def per_band(value: Any) -> float | tuple[float, ...]:
    """One positive number, or one for each band."""
    expected = "a positive number, or a list of one for each band"
    if isinstance(value, list) and value:
        return tuple(positive(one, expected) for one in value)
    return positive(value, expected)


def per_light(value: Any) -> float | tuple[float, ...]:
    """One positive number, or one for each light."""
    expected = "a positive number, or a list of one for each light"
    if isinstance(value, list) and value:
        return tuple(positive(one, expected) for one in value)
    return positive(value, expected)


def dark(value: Any) -> Any:
    """Frames, or a level."""
    expected = "a file, a folder, a list of files, or a level in codes"
    if isinstance(value, str):
        return file(value)
    if isinstance(value, list) and value:
        if isinstance(value[0], str):
            return tuple(file(one) for one in value)
        return tuple(number(one, expected) for one in value)
    return number(value, expected)


def frames(value: Any) -> str | tuple[str, ...]:
    """A file, a folder or a list of files."""
    if isinstance(value, list) and value:
        return tuple(file(one) for one in value)
    return file(value)


def strengths(value: Any) -> Any:
    """A text file, one number for all lights, or one entry for each."""
    expected = "a text file, or a list of a positive number (or one for each band) for each light"
    if isinstance(value, str):
        return file(value)
    if not isinstance(value, list) or not value:
        return positive(value, expected)
    if any(isinstance(one, list) for one in value):
        if not all(isinstance(one, list) and len(one) == len(value[0]) for one in value):
            raise refuse(f"{expected}, of the same length", value)
        return tuple(tuple(positive(band, expected) for band in one) for one in value)
    return tuple(positive(one, expected) for one in value)


def vectors(value: Any) -> dict[str, Vector]:
    """Three numbers for each photograph, by its name."""
    return {file(name): _vector(one) for name, one in _table(value).items()}


def noise(value: Any) -> tuple[float, float]:
    """Read noise and shot noise."""
    expected = "[read noise, shot noise] as shares of full scale, above 0 and below 1"
    if not isinstance(value, list) or len(value) != 2:
        raise refuse(expected, value)
    read, shot = (positive(one, expected) for one in value)
    if max(read, shot) >= 1.0:
        raise refuse(expected, value)
    return read, shot


def brackets(value: Any) -> dict[str, tuple[tuple[str, float], ...]]:
    """Files and exposure times of each bracket, by the name of its shortest exposure."""
    expected = 'two or more of ["file", seconds], each file once'
    found: dict[str, tuple[tuple[str, float], ...]] = {}
    seen: set[str] = set()
    for name, rows in _table(value).items():
        if not isinstance(rows, list) or len(rows) < 2:
            raise refuse(expected, rows)
        frames = []
        for row in rows:
            if not isinstance(row, list) or len(row) != 2:
                raise refuse(expected, row)
            frames.append((file(row[0]), positive(row[1], "an exposure time in seconds")))
        frames.sort(key=lambda frame: frame[1])
        for one, _ in frames:
            if one.casefold() in seen:
                raise ValueError(f"{one} is in brackets twice; each file belongs to one photograph")
            seen.add(one.casefold())
        if file(name) != frames[0][0]:
            raise ValueError(
                f"the bracket of {name!r} has {frames[0][0]!r} as its shortest exposure: give it "
                "that name, here and where the lights are"
            )
        found[name] = tuple(frames)
    return found


def hashes(value: Any) -> dict[str, str]:
    """The SHA-256 of each file, by its name."""
    found = {}
    for name, one in _table(value).items():
        if not isinstance(one, str) or not _SHA256.fullmatch(one):
            raise refuse(f"the 64 hexadecimal digits of a SHA-256 for {name!r}", one)
        found[file(name)] = one.lower()
    return found


def _vector(value: Any) -> Vector:
    expected = "[x, y, z]"
    if not isinstance(value, list) or len(value) != 3:
        raise refuse(expected, value)
    x, y, z = (number(one, expected) for one in value)
    return x, y, z


def _table(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not value:
        raise refuse("a section with a line for each file", value)
    for name, one in value.items():
        if isinstance(one, dict):  # a dot outside of quotation marks
            rest = next(iter(one), "")
            raise ValueError(f"names of files stand in quotation marks, found {name}.{rest}")
    return value


def names(value: Any) -> Iterable[str]:
    """The file names in a checked value of :func:`file`, :func:`frames` or :func:`dark`."""
    found = value if isinstance(value, tuple) else (value,)
    return [one for one in found if isinstance(one, str)]

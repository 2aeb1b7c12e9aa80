"""Outlines of mirror balls that somebody measured: x, y and radius, one ball a line.

The file of Xiong's data set [@xiong2014psbox] (``circle_data.txt``): pixels counted from 1, y up
from the lower border of the photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from impasto.calibrate.outline import Outline, given_outline
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text

SIGMA = 0.5
"""Pixels: standard deviation of an outline that was measured by hand."""
DIGITS = 3
"""Decimals of a pixel in a file."""


def read_circles(path: Path, rows: int) -> list[Outline]:
    """The outlines of a file, in pixels of photographs with ``rows`` rows.

    Raises
    ------
    ArgumentError
        Not found; a radius that is not above 0.
    CorruptInputError
        A line without three numbers, or no line.
    """
    if not path.is_file():
        raise ArgumentError(f"circles: {path} does not exist")
    found = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not (words := line.split()):
            continue
        try:
            x, y, radius = (float(word) for word in words)
        except ValueError:
            raise CorruptInputError(
                path, f"line {number}: expected three numbers: x, y and radius"
            ) from None
        try:
            found.append(given_outline(x - 1.0, rows - y, radius, SIGMA))
        except ArgumentError as error:
            raise CorruptInputError(path, f"line {number}: {error}") from error
    if not found:
        raise CorruptInputError(path, "expected three numbers: x, y and radius")
    return found


def circles_text(circles: Sequence[tuple[float, float, float]], rows: int) -> str:
    """What :func:`read_circles` reads as ``circles``: x, y and radius, rows down from 0."""
    return "".join(
        f"{x + 1.0:.{DIGITS}f} {rows - y:.{DIGITS}f} {radius:.{DIGITS}f}\n"
        for x, y, radius in circles
    )

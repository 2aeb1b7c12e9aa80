"""Outlines of mirror balls that somebody measured: x, y and radius of each.

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
        Not found.
    CorruptInputError
        Anything but three numbers for each ball, on one line or on several; a radius that is not
        above 0.
    """
    if not path.is_file():
        raise ArgumentError(f"circles: {path} does not exist")
    try:
        numbers = [float(word) for word in read_text(path).split()]
    except ValueError:
        numbers = []
    if not numbers or len(numbers) % 3:
        raise CorruptInputError(path, "expected three numbers for each ball: x, y and radius")
    found = []
    for ball in range(0, len(numbers), 3):
        x, y, radius = numbers[ball : ball + 3]
        try:
            found.append(given_outline(x - 1.0, rows - y, radius, SIGMA))
        except ArgumentError as error:
            raise CorruptInputError(path, f"ball {ball // 3 + 1}: {error}") from error
    return found


def circles_text(circles: Sequence[tuple[float, float, float]], rows: int) -> str:
    """What :func:`read_circles` reads as ``circles``: x, y and radius, rows down from 0."""
    return "".join(
        f"{x + 1.0:.{DIGITS}f} {rows - y:.{DIGITS}f} {radius:.{DIGITS}f}\n"
        for x, y, radius in circles
    )

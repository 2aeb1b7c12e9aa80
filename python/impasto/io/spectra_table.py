"""From the text of a table of spectra to its wavelengths, values and names."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impasto.colour.wavelengths import Floats
from impasto.errors import CorruptInputError

COMMENT = ("#", "%", "//", "!")
SEPARATORS = ("\t", ";", ",", " ")
"""In this order where several split a table equally well; a space stands for any number of them."""

NANOMETRES = (150.0, 5000.0)
MICROMETRES = (0.15, 5.0)
"""Numbers that can be wavelengths."""
LEAST = 3
"""Fewer numbers in a row are no wavelengths."""

LONGEST = 64
"""Characters of a number; patterns take their time with more."""

_POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?(\d*,\d+)([eE][+-]?\d+)?")
_MISSING = {"", "nan", "n/a", "na", "-", "--", "null", "none"}
_MARKED = (-9999.0, -999.0)
_DELETED = -1e30
"""The USGS library writes -1.23e34 for a channel that was left out."""

_AXIS = re.compile(
    r"(?:wavelength|lambda|λ|wl|refl|[rsxw])?[\s_(\[.=-]*(\d+(?:[.,]\d+)?)\s*(nm|[µμu]m)?[)\]]?",
    re.IGNORECASE,
)
"""A wavelength at the head of a column: 400, 400nm, R_400, X400."""
_DEVIATION = re.compile(
    r"\b(std|stdev|st\.?\s?dev|sigma|error|uncertainty|standard deviation)\b", re.IGNORECASE
)


@dataclass
class SpectraTable:
    """What a file says.

    Attributes
    ----------
    wavelengths
        ``(n,)`` as written; empty if the file has none.
    values
        ``(n, spectrum)`` as written, NaN where one is missing.
    names
        Of the spectra; empty if the file has none.
    axis
        Text that can name the unit of the wavelengths.
    """

    wavelengths: Floats
    values: Floats
    names: tuple[str, ...]
    axis: str


@dataclass(frozen=True)
class Row:
    """A line of the file, split."""

    line: int
    cells: list[str]
    separator: str

    @property
    def comma(self) -> bool:
        """Whether numbers can have decimal commas."""
        return self.separator != ","

    def numbers(self, first: int = 0) -> list[float] | None:
        """The cells from ``first`` on, if all are numbers or missing, and one is a number."""
        found = [_number(cell, comma=self.comma) for cell in self.cells[first:]]
        values = [value for value in found if value is not None]
        return values if len(values) == len(found) and np.isfinite(values).any() else None

    def wavelengths(self, limits: tuple[float, float]) -> tuple[int, list[float]] | None:
        """How many cells come first, and the wavelengths that all others are."""
        grid: list[float] = []  # from the last on
        for cell in reversed(self.cells):
            value = _wavelength(cell, comma=self.comma)
            if value is None or not limits[0] <= value <= limits[1] or value in grid[-1:]:
                break
            if len(grid) > 1 and (value > grid[-1]) != (grid[-1] > grid[-2]):
                break
            grid.append(value)
        return (len(self.cells) - len(grid), grid[::-1]) if len(grid) >= LEAST else None


def parse_spectra(text: str, source: Path, *, bare: bool) -> SpectraTable:
    """Wavelengths in the first column or in the first row; ``bare``: nowhere.

    Raises
    ------
    CorruptInputError
        No such table; the line is named.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith(COMMENT)
    ]
    if not lines:
        raise CorruptInputError(
            source, "is empty: a table of wavelengths and reflectances is expected"
        )
    rows = _split(lines)
    if not bare:
        # Reflectances are never as large as nanometres, but can be as large as micrometres.
        for limits in (NANOMETRES, MICROMETRES):
            if limits == MICROMETRES and _column_of_wavelengths(rows):
                break
            for index, row in enumerate(rows):
                found = row.wavelengths(limits)
                if found is not None:
                    return _by_row(rows[: index + 1], rows[index + 1 :], found, source)
    return _by_column(rows, source, bare=bare)


def _number(cell: str, *, comma: bool) -> float | None:
    """A number, NaN for a missing one, None for anything else."""
    if cell.casefold() in _MISSING:
        return float("nan")
    if len(cell) > LONGEST:
        return None
    if _POINT.fullmatch(cell):
        value = float(cell)
    elif comma and _COMMA.fullmatch(cell):
        value = float(cell.replace(",", "."))
    else:
        return None
    return float("nan") if value in _MARKED or value < _DELETED else value


def _wavelength(cell: str, *, comma: bool) -> float | None:
    found = _AXIS.fullmatch(cell) if len(cell) <= LONGEST else None
    if found is None or ("," in found[1] and not comma):
        return None
    return float(found[1].replace(",", "."))


def _along(values: Sequence[float], limits: tuple[float, float]) -> bool:
    """Whether these can be wavelengths: within the limits, rising or falling."""
    if not (limits[0] <= min(values) and max(values) <= limits[1]):
        return False
    steps = np.diff(values)
    return bool((steps > 0).all() or (steps < 0).all())


def _column_of_wavelengths(rows: Sequence[Row]) -> bool:
    numbers = [values for row in rows if (values := row.numbers()) is not None]
    column = [values[0] for values in numbers if len(values) > 1]
    return len(column) >= LEAST and any(
        _along(column, limits) for limits in (NANOMETRES, MICROMETRES)
    )


def _split(lines: Sequence[tuple[int, str]]) -> list[Row]:
    """The rows, by the separator that finds most numbers."""

    def numbers(rows: list[Row]) -> int:
        cells = [(cell, row.comma) for row in rows if len(row.cells) > 1 for cell in row.cells]
        values = [_number(cell, comma=comma) for cell, comma in cells]
        return sum(value is not None and np.isfinite(value) for value in values)

    every = [
        [Row(number, _cells(line, separator), separator) for number, line in lines]
        for separator in SEPARATORS
    ]
    return max(every, key=numbers)


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _by_row(
    before: list[Row], after: list[Row], found: tuple[int, list[float]], source: Path
) -> SpectraTable:
    """A spectrum in each row below the wavelengths."""
    lead, grid = found
    line = before[-1].line
    if not after:
        raise CorruptInputError(source, f"line {line} has wavelengths; no spectrum follows")
    # Tables often have no cell above the names.
    if lead == 0 and all(len(row.cells) == len(grid) + 1 for row in after):
        lead = 1
    spectra, names = [], []
    for row in after:
        values = row.numbers(lead)
        if values is None:
            raise _no_numbers(source, row, lead)
        spectra.append(_filled(values, len(grid), row, source))
        names.append(" ".join(cell for cell in row.cells[:lead] if cell))
    axis = " ".join(cell for row in before for cell in row.cells)
    return SpectraTable(
        np.array(grid), np.array(spectra).T, tuple(names) if all(names) else (), axis
    )


def _by_column(rows: list[Row], source: Path, *, bare: bool) -> SpectraTable:
    """A wavelength in each row, a spectrum in each column."""
    first = _first_of_numbers(rows, source, bare=bare)
    ((width, _),) = Counter(len(row.cells) for row in rows[first:]).most_common(1)
    values = []
    for row in rows[first:]:
        numbers = row.numbers()
        if numbers is None:
            raise _no_numbers(source, row, 0)
        values.append(_filled(numbers, width, row, source))
    table = np.array(values)
    before = " ".join(cell for row in rows[:first] for cell in row.cells)
    head = rows[first - 1].cells if first else []
    names = head if len(head) == width or (len(head) == width - 1 and not bare) else []
    axis = names[0] if len(names) == width else before
    names = [""] * (width - len(names)) + names if names else names
    keep = np.ones(width, bool)
    grid = np.empty(0)
    if not bare:
        grid = table[:, 0]
        if np.isnan(grid).any():
            line = rows[first + int(np.flatnonzero(np.isnan(grid))[0])].line
            raise CorruptInputError(source, f"line {line}: the wavelength is missing")
        keep = ~np.array([np.array_equal(grid, column) for column in table.T])
    deviation = np.array([_DEVIATION.search(name) is not None for name in names])
    if deviation.any():
        keep &= ~deviation
    elif keep.sum() == 2 and "standard deviation" in before.casefold():
        # Text above the table says what its columns are.
        keep[-1], names = False, []
    if not keep.any():
        raise CorruptInputError(source, "has wavelengths, but no spectrum beside them")
    chosen = tuple(name for name, kept in zip(names, keep, strict=False) if kept)
    return SpectraTable(grid, table[:, keep], chosen if all(chosen) else (), axis)


def _first_of_numbers(rows: list[Row], source: Path, *, bare: bool) -> int:
    """Where the table begins."""
    least = 1 if bare else 2
    for index, row in enumerate(rows):
        if len(row.cells) >= least and row.numbers() is not None:
            return index
    alone = sum(row.numbers() is not None for row in rows)
    raise CorruptInputError(
        source,
        "has one column of numbers: give its wavelengths, wavelengths=..."
        if alone > 1
        else "has no table of numbers: expected wavelengths in the first column or in the first "
        "row, and a spectrum in each other one",
    )


def _filled(values: list[float], width: int, row: Row, source: Path) -> list[float]:
    """The values of a row; blank cells at its end are missing ones."""
    missing = width - len(values)
    if missing < 0 or (missing > 0 and row.separator == " "):
        raise CorruptInputError(
            source, f"line {row.line}: expected {width} numbers, found {len(values)}"
        )
    return values + [float("nan")] * missing


def _no_numbers(source: Path, row: Row, lead: int) -> CorruptInputError:
    cells = row.cells[lead:]
    wrong = [cell for cell in cells if _number(cell, comma=row.comma) is None]
    found = repr(wrong[0]) if wrong else "none"
    return CorruptInputError(source, f"line {row.line}: expected numbers, found {found}")

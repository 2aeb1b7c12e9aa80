"""Tables of reflectance spectra, as spectrometers and spreadsheets write them."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.damage import damage_of
from impasto.colour.wavelengths import Floats, checked_wavelengths
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import read_text
from impasto.io.spectra_table import SpectraTable, parse_spectra
from impasto.training import Training

Unit = Literal["nm", "um"]

NANOMETRES = {"nm": 1.0, "um": 1e3}
PLAUSIBLE = (150.0, 5000.0)
"""Wavelengths of reflectance spectrometers, nm."""
VISIBLE = (400.0, 700.0)

LARGEST_FRACTION = 2.0
"""Larger values are per cent: fluorescent paints reach 1.7."""
LARGEST_PERCENT = 200.0

_MICROMETRES = re.compile(r"(?<![^\W\d_])[µμu]m\b|\bmicro(?:n|met)", re.IGNORECASE)
_OTHER_UNIT = re.compile(
    r"cm\s*\^?\s*-\s*1|cm⁻¹|1\s*/\s*cm|wavenumber|(?<!\w)å(?!\w)|angstr", re.IGNORECASE
)


def read_spectra(
    path: str | os.PathLike[str],
    *,
    wavelengths: ArrayLike | None = None,
    unit: Unit | None = None,
    percent: bool | None = None,
) -> Training:
    """Read a table of reflectance spectra, to learn from: ``fit_reflectance(..., training=)``.

    Cells are separated by commas, semicolons, tabs or spaces; numbers have decimal points or
    (but for a table separated by commas) decimal commas. The wavelengths are the first column, with
    a spectrum in each other one, or the first row, with a spectrum in each other one; they rise or
    fall. A line above, or the first columns, name the spectra.

    Lines before the table, blank lines and lines that start with ``#``, ``%``, ``//`` or ``!`` are
    skipped; so are repetitions of the column of wavelengths, columns whose name says standard
    deviation or error, and wavelengths at which no spectrum has a value (blank, ``nan``, ``-9999``,
    ``-1.23e34``). Spectra of the USGS library with wavelength, reflectance and standard deviation
    are such tables, too.

    Parameters
    ----------
    path
        The file; UTF-8 with or without byte order mark, UTF-16 or Latin-1.
    wavelengths
        ``(n,)`` in ``unit``, for a file that has none: one row per wavelength.
    unit
        ``"nm"`` or ``"um"``. Default: as the file says, else by size.
    percent
        Whether 100 (and not 1) is a perfect white. Default: by size, per cent if a value
        exceeds 2.

    Returns
    -------
    Training
        Spectra in order of the file, relative to a perfect white, with their names;
        ``name`` is the file's.

    Raises
    ------
    CorruptInputError
        No table, a cell that is no number, rows of different lengths, a gap in a spectrum;
        wavelengths out of order, that repeat, in another unit, or outside the visible. File, place
        and cure are named.
    ArgumentError
        A file that cannot be read; ``wavelengths`` that do not belong to it.
    """
    source = Path(path)
    with damage_of(source, "a table of spectra"):
        table = parse_spectra(read_text(source), source, bare=wavelengths is not None)
    if wavelengths is not None:
        given = np.asarray(wavelengths, dtype=np.float64)
        if given.shape != (len(table.values),):
            raise ArgumentError(
                f"wavelengths: {source} has {len(table.values)} rows, found shape {given.shape}"
            )
        table.wavelengths = given
    grid = _nanometres(table, source, unit)
    values = _fractions(table, source, percent)
    grid, values = _complete(grid, values, table, source)
    if grid[0] > grid[-1]:
        grid, values = grid[::-1], values[::-1]
    for index in np.flatnonzero(np.diff(grid) <= 0):
        raise CorruptInputError(
            source,
            f"wavelengths must rise or fall all the way and not repeat, found {grid[index]:g} nm "
            f"beside {grid[index + 1]:g} nm: sort the table, or keep one of the two",
        )
    if grid[0] > VISIBLE[1] or grid[-1] < VISIBLE[0] or len(grid) < 2:
        raise CorruptInputError(
            source,
            f"holds {grid[0]:g} to {grid[-1]:g} nm in {len(grid)} steps: spectra of paints for "
            "colours need several wavelengths between 400 and 700 nm",
        )
    spectra = np.ascontiguousarray(values.T)
    return Training(checked_wavelengths(grid), spectra, source.name, table.names)


def _nanometres(table: SpectraTable, source: Path, unit: Unit | None) -> Floats:
    """The wavelengths in nm."""
    if unit is not None and unit not in NANOMETRES:
        raise ArgumentError(f"unit: expected 'nm' or 'um', found {unit!r}")
    grid = np.asarray(table.wavelengths, dtype=np.float64)
    if unit is None and _OTHER_UNIT.search(table.axis):
        raise CorruptInputError(
            source, f"wavelengths are in another unit ({table.axis.strip()}): convert them to nm"
        )
    if unit is None:
        says_um = _MICROMETRES.search(table.axis) is not None
        unit = "um" if says_um or grid.max() < 30.0 else "nm"
    found = grid * NANOMETRES[unit]
    if found.min() < PLAUSIBLE[0] or found.max() > PLAUSIBLE[1]:
        raise CorruptInputError(
            source,
            f"wavelengths from {grid.min():g} to {grid.max():g} are neither nm nor um: say "
            'unit="nm" or unit="um", or convert them',
        )
    return found


def _fractions(table: SpectraTable, source: Path, percent: bool | None) -> Floats:
    """Reflectances relative to a perfect white."""
    largest = float(np.nanmax(table.values, initial=-np.inf))
    if percent is None:
        percent = largest > LARGEST_FRACTION
    if largest > (LARGEST_PERCENT if percent else np.inf):
        raise CorruptInputError(
            source,
            f"reflectances reach {largest:g}: expected fractions (a perfect white is 1) or per "
            "cent (100): divide them by what white has",
        )
    return table.values / (100.0 if percent else 1.0)


def _complete(
    grid: Floats, values: Floats, table: SpectraTable, source: Path
) -> tuple[Floats, Floats]:
    """Without the wavelengths at which nothing was measured."""
    some = np.isfinite(values).any(axis=1)
    grid, values = grid[some], values[some]
    if not some.any():
        raise CorruptInputError(source, "holds no value: every cell is blank or marked as missing")
    for row, column in np.argwhere(~np.isfinite(values)):
        name = table.names[column] if table.names else f"spectrum {column + 1}"
        raise CorruptInputError(
            source,
            f"{name} has no value at {grid[row]:g} nm: fill it, or leave out the spectrum or the "
            "wavelength",
        )
    return grid, values

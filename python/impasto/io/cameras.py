"""Camera files: a CSV table of sensitivities."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import damage_of
from impasto._internal.regular import check_regular
from impasto.bands import Camera
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_bytes

LIGHT = "illuminant"
"""The column with the light of the photographs."""
SIGMA = "sigma "
"""Begins the name of a column with the standard deviations of a band."""


def read_camera(path: str | os.PathLike[str], *, illuminant: Any = None) -> Camera:
    """A camera from a CSV file: wavelengths, one column per band, and the light.

    The first line names the columns: ``wavelength`` (nm), the bands in the order of the stack, and
    optionally ``illuminant``, the power of the light under which the photographs were taken.
    ``sigma red`` is the standard deviation of a band ``red``: such columns are no bands.

    Parameters
    ----------
    path
        The file.
    illuminant
        The light, where the file has no such column (or to overrule it): a name such as ``"A"``, or
        a temperature in kelvin.

    Raises
    ------
    CorruptInputError
        No header, a cell that is no number, wavelengths out of order.
    ArgumentError
        No light, neither in the file nor as an argument, or one that nobody knows.
    """
    from impasto.colour import spectrum

    source = Path(path)
    check_regular(source)
    with damage_of(source, "a table of text"):
        lines = io.StringIO(source.read_text(encoding="utf-8-sig"))
        rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    names = [cell.strip() for cell in rows[0]] if rows else []
    if len(names) < 2 or not names[0].casefold().startswith("wavelength"):
        raise CorruptInputError(source, "expected a first line such as wavelength,red,green,blue")
    table = _table(source, rows[1:], len(names))
    columns = dict(zip(names[1:], table[1:], strict=True))
    light = columns.pop(LIGHT, None)
    for name in [name for name in columns if name.removeprefix(SIGMA) in columns]:
        if name.startswith(SIGMA):
            del columns[name]
    if illuminant is None and light is None:
        raise ArgumentError(
            f"illuminant: {source} has no column {LIGHT!r}; give the light of the photographs "
            "with illuminant="
        )
    if isinstance(illuminant, str | int | float):
        # Checked before the columns: an error of the argument is not one of the file.
        spectrum(illuminant, (540.0, 560.0))
    try:
        chosen = light if illuminant is None else illuminant
        return Camera(table[0], np.array(list(columns.values())), chosen, list(columns))
    except ArgumentError as error:
        raise CorruptInputError(source, str(error)) from error


def write_camera(
    path: str | os.PathLike[str],
    camera: Camera,
    *,
    sigma: NDArray[np.float64] | None = None,
    light: bool = True,
) -> None:
    """Write a file for :func:`read_camera`, with the light at the wavelengths of the camera.

    Parameters
    ----------
    path
        The file, replaced atomically.
    camera
        What is written.
    sigma
        ``(band, n)`` standard deviations of the sensitivities.
    light
        Whether the light is written; without it, who reads the file must know it.
    """
    from impasto.colour import spectrum

    own = camera.illuminant
    columns = [camera.wavelengths, *camera.sensitivities]
    names = ["wavelength", *camera.bands]
    if sigma is not None:
        columns += list(sigma)
        names += [f"{SIGMA}{band}" for band in camera.bands]
    if light:
        power = own if isinstance(own, np.ndarray) else spectrum(own, camera.wavelengths)
        columns.append(power)
        names.append(LIGHT)
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(names)
    for row in zip(*columns, strict=True):
        table.writerow([f"{value:.10g}" for value in row])
    atomic_bytes(Path(path), out.getvalue().encode("utf-8"))


def _table(source: Path, rows: list[list[str]], width: int) -> Any:
    """``(column, row)`` float64."""
    values = []
    for line, row in enumerate(rows, start=2):
        try:
            values.append([float(cell) for cell in row])
        except ValueError:
            raise CorruptInputError(source, f"line {line}: expected numbers, found {row}") from None
        if len(row) != width:
            raise CorruptInputError(source, f"line {line}: expected {width} cells, found {row}")
    if len(values) < 2:
        raise CorruptInputError(source, "expected at least two wavelengths")
    return np.array(values, dtype=np.float64).T.copy()

"""Files of measured tone curves: JSON with codes and light as shares of full scale."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from impasto._internal.damage import damage_of
from impasto.encoding import curve_of_points
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images.write import write_json
from impasto.io.json_file import VERSION, read_kind

KIND = "impasto tone curve"
SUFFIX = ".json"
"""Where a tone curve is named, a name that ends so is that of a file."""


def write_tone_curve(
    path: str | Path, codes: ArrayLike, light: ArrayLike, about: Mapping[str, Any] | None = None
) -> None:
    """Write a tone curve (replaced atomically).

    Parameters
    ----------
    path
        A name that ends in ``.json``.
    codes, light
        ``(n,)`` points of the curve as shares of full scale, from 0 to 1, rising.
    about
        More entries, such as errors, which are kept but not read.

    Raises
    ------
    ArgumentError
        Another name, or points that are no curve.
    """
    if Path(path).suffix.lower() != SUFFIX:
        raise ArgumentError(f"path: expected a name ending in {SUFFIX}, found {Path(path).name}")
    curve = curve_of_points(codes, light)
    pairs = [pair.split(",") for pair in curve.partition(":")[2].split()]
    points = {"codes": [float(c) for c, _ in pairs], "light": [float(v) for _, v in pairs]}
    write_json(path, {"kind": KIND, "version": VERSION, **points, **(about or {})})


def read_tone_curve(path: str | Path) -> str:
    """The curve of a file, as :class:`impasto.Encoding` takes it.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No such file, or points that are no curve.
    """
    path = Path(path)
    what = "the file of a tone curve"
    content = read_kind(path, KIND, what, "impasto calibrate linearity")
    with damage_of(path, what):
        try:
            return curve_of_points(
                [float(code) for code in content["codes"]],
                [float(value) for value in content["light"]],
            )
        except ArgumentError as error:
            raise CorruptInputError(path, str(error)) from error


def named_curve(encoding: str | Path) -> str:
    """A curve by its name, or that of a file."""
    text = str(encoding)
    return read_tone_curve(text) if text.lower().endswith(SUFFIX) else text

"""Several files per photograph, one for each filter, by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from impasto.io.images import natural_key

_BAND = re.compile(r"(?P<name>.+)(?P<mark>[_\-. ])(?P<band>[^_\-. ]+)")
_WAVELENGTH = re.compile(r"\d{3,4}(nm)?", re.I)
_COLOURS = ("red", "green", "blue", "r", "g", "b")
_OTHERS = frozenset(
    {"uv", "ir", "nir", "clear", "white", "violet", "cyan", "yellow", "amber", "orange", "magenta"}
)
_LETTERED = re.compile(r"(f|filter|band)\d{1,2}", re.I)


@dataclass(frozen=True)
class FilterWheel:
    """File names with a place for the band.

    Parameters
    ----------
    pattern
        As :func:`impasto.read_stack` takes it.
    bands
        In their order: red, green, blue; others as their names are sorted.
    names
        The photographs, in natural order.
    """

    pattern: str
    bands: tuple[str, ...]
    names: tuple[str, ...]


def find_filter_wheel(photographs: Sequence[Path]) -> FilterWheel | None:
    """The pattern of the names, if each photograph has a file for each of two bands or more.

    A band is a wavelength (``450``, ``450nm``), a colour (``red``, ``r``, ``ir``) or a number with
    ``f``, ``filter`` or ``band``, at the end of the name behind ``_``, ``-``, ``.`` or a space.
    """
    found: dict[str, set[str]] = {}
    marks, endings = set(), set()
    for path in photographs:
        match = _BAND.fullmatch(path.stem)
        if match is None or not _is_band(match["band"]):
            return None
        found.setdefault(match["name"], set()).add(match["band"])
        marks.add(match["mark"])
        endings.add(path.suffix)
    bands = {band for some in found.values() for band in some}
    whole = all(some == bands for some in found.values())
    if not whole or len(bands) < 2 or len(marks) != 1 or len(endings) != 1:
        return None
    # 450 and 550 alone may as well be the numbers of 2 photographs.
    if len(found) < 2:
        return None
    pattern = f"{{name}}{marks.pop()}{{band}}{endings.pop()}"
    return FilterWheel(
        pattern, tuple(sorted(bands, key=_order)), tuple(sorted(found, key=natural_key))
    )


def _is_band(word: str) -> bool:
    lower = word.lower()
    known = lower in _COLOURS or lower in _OTHERS
    return known or bool(_WAVELENGTH.fullmatch(word) or _LETTERED.fullmatch(word))


def _order(band: str) -> tuple[int, object]:
    lower = band.lower()
    first = _COLOURS.index(lower) if lower in _COLOURS else len(_COLOURS)
    return first, natural_key(band)

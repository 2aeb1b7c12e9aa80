"""Numbers of a study's rows as parts of sentences: differences of settings and their ranges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from study.candidates import Row
from study.tables import of_knob, preset_rows


def named(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    """Rows of defaults and presets by name and data set."""
    found: dict[str, dict[str, Row]] = {}
    for name, row in preset_rows(rows):
        found.setdefault(name, {})[row["data"]] = row
    return found


def by_data(rows: Sequence[Row], knob: str, setting: str) -> dict[str, Row]:
    """Rows of a setting; none where it was not measured."""
    return {row["data"]: row for row in of_knob(rows, knob) if row["setting"] == setting}


def levels(rows: Sequence[Row], knob: str, setting: str, what: str) -> dict[str, float]:
    """An error of a setting by data set.

    Raises
    ------
    KeyError
        It was not measured on any.
    """
    found = by_data(rows, knob, setting)
    if not found:
        raise KeyError(setting)
    return {data: row["error"][what] for data, row in found.items()}


def differences(one: dict[str, Row], other: dict[str, Row], what: str) -> list[float]:
    """``one`` minus ``other`` on every data set where both have the error."""
    pairs = [(one[d]["error"][what], other[d]["error"][what]) for d in one if d in other]
    return [a - b for a, b in pairs if a is not None and b is not None]


def ratio(one: dict[str, Row], other: dict[str, Row]) -> float:
    """Ratio of times, geometric mean over the data sets that both were measured on.

    Raises
    ------
    ValueError
        There are none.
    """
    logs = [np.log(one[d]["cost"]["cpu"] / other[d]["cost"]["cpu"]) for d in one if d in other]
    if not logs:
        raise ValueError
    return float(np.exp(np.mean(logs)))


def span(values: Sequence[float], unit: str, digits: int = 1) -> str:
    """The range of some changes, with signs."""
    # Rounded first, so that zero has no sign.
    low, high = (
        f"{round(value, digits) + 0.0:+.{digits}f}".replace(f"+{0:.{digits}f}", f"{0:.{digits}f}")
        for value in (min(values), max(values))
    )
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def between(values: Sequence[float], unit: str, digits: int = 0) -> str:
    """The range of some sizes, without plus signs."""
    return span(values, unit, digits).replace("+", "")


def share(values: Sequence[float]) -> str:
    """The range of some shares, in per cent."""
    return between([100.0 * value for value in values], "%")

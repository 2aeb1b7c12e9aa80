"""Candidates for presets: settings over all data sets, and which of them become presets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from impasto.study.pareto_front import knee, pareto_front

Row: TypeAlias = dict[str, Any]

ERROR = "relative"
"""The error of Pareto fronts: root mean square error of relighting."""
JUDGED = (("relative", "psnr", "colour"), ("normal", "normal_p95"))
"""Errors by which presets are chosen; held-out photographs and normals count equally. Neither can
stand for the other: highlights dominate the photographs, which hardly show errors of normals."""
BEST = 1.01
"""``reference`` is within one per cent of the best."""
NEAR_BEST = 1.03
"""``standard`` is the cheapest within three per cent of the best."""
FLAGGED = 0.01
"""Share of pixels that ``standard`` and ``reference`` may flag above the least share."""
ROUNDS = 2
"""Least rounds of reweighting. With a single round the error of the width of a highlight with a
clipped tip is four times as large (hard case 3), which photographs with clipped highlights hardly
show."""
DOUBTED = 0.05
"""The same for ``draft``."""
DRAFT = 1 / 8
"""Share of the time of ``standard`` that ``draft`` may take, if any candidate is so fast."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A setting over all data sets.

    Attributes
    ----------
    setting, options
        Which.
    seconds
        Geometric mean of CPU seconds per megapixel.
    error, shown
        :func:`combined_error` of all that is judged, and of held-out photographs alone.
    flagged
        Mean share of the pixels that are flagged.
    """

    setting: str
    options: Row
    seconds: float
    error: float
    shown: float = 0.0
    flagged: float = 0.0


def candidates_of(rows: Iterable[Row]) -> list[Candidate]:
    """Settings of some rows that were measured on every data set that any of them was on."""
    by_setting: dict[str, dict[str, Row]] = {}
    for row in rows:
        by_setting.setdefault(row["setting"], {})[row["data"]] = row
    everywhere = set().union(*by_setting.values()) if by_setting else set()
    return [
        Candidate(
            setting,
            next(iter(found.values()))["options"],
            _mean([row["cost"]["cpu"] for row in found.values()]),
            combined_error(found.values()),
            combined_error(found.values(), JUDGED[:1]),
            float(np.mean([row["error"]["flagged"] for row in found.values()])),
        )
        for setting, found in by_setting.items()
        if found.keys() == everywhere
    ]


def combined_error(rows: Iterable[Row], kinds: Sequence[Sequence[str]] = JUDGED) -> float:
    """Errors of a setting on all data sets as one number, on a ratio scale.

    The geometric mean of the kinds, each the geometric mean of its errors on the data sets where
    they are known: a relative change of all errors of either kind has the same effect.
    """
    rows = list(rows)
    means = []
    for names in kinds:
        known = [_size(row["error"], name) for row in rows for name in names]
        values = [value for value in known if value is not None]
        if values:
            means.append(_mean(values))
    return _mean(means)


def _size(error: Row, name: str) -> float | None:
    """An error; decibels are converted to the root mean square of differences."""
    value: float | None = error[name]
    return 10.0 ** (-value / 20.0) if name == "psnr" and value is not None else value


def _mean(values: Sequence[float]) -> float:
    return float(np.exp(np.log(values).mean()))


def chosen(candidates: Sequence[Candidate]) -> dict[str, Candidate]:
    """``draft``, ``standard`` and ``reference`` among some candidates.

    Of those with two or more rounds of reweighting that flag at most one pixel in a hundred more
    than the least, ``reference`` is the cheapest within 1 % of the least error, ``standard`` the
    cheapest within 3 %. ``draft`` is the best of all that take at most an eighth of the time of
    ``standard`` and flag at most one pixel in twenty more than the least; where nothing is so fast,
    the knee of what is faster. Each is on the Pareto front of those that it is taken from.

    Raises
    ------
    ValueError
        There are none, or none with two rounds of reweighting flags few pixels.
    """
    line = _front(sparing(candidates))
    if not line:
        raise ValueError("candidates: none of them could be standard")
    reference, standard = (
        next(candidate for candidate in line if candidate.error <= near * line[-1].error)
        for near in (BEST, NEAR_BEST)
    )
    every = _front(_flagging(candidates, DOUBTED))
    line = [candidate for candidate in every if candidate.seconds <= standard.seconds]
    fast = [candidate for candidate in line if candidate.seconds <= DRAFT * standard.seconds]
    draft = fast[-1] if fast else line[knee(_points(line))]
    return {"draft": draft, "standard": standard, "reference": reference}


def sparing(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those that ``standard`` and ``reference`` are taken from."""
    few = _flagging(candidates, FLAGGED)
    return [candidate for candidate in few if candidate.options["effort"]["rounds"] >= ROUNDS]


def _flagging(candidates: Sequence[Candidate], share: float) -> list[Candidate]:
    """Those that flag at most so many pixels more than the fewest."""
    least = min(candidate.flagged for candidate in candidates)
    return [candidate for candidate in candidates if candidate.flagged <= least + share]


def _front(some: Sequence[Candidate]) -> list[Candidate]:
    return [some[i] for i in pareto_front(_points(some))]


def _points(some: Sequence[Candidate]) -> list[tuple[float, float]]:
    return [(candidate.seconds, candidate.error) for candidate in some]

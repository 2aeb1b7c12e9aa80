"""The mean degree of adaptation of observers, its spread, and its confidence interval.

Observers are a sample of all people: the interval is Student's [@student1908mean] over their means,
not over single choices, which are alike within an observer.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from impasto._internal.checks import number
from impasto._internal.student import quantile
from impasto.errors import ArgumentError
from impasto.matching.log import MatchingLog, read_log
from impasto.matching.models import ModelMatch, matches
from impasto.matching.picture import matching_picture
from impasto.pictures import Picture

SHARED = ("illuminant", "reference", "mode", "display")
"""Settings that all sessions of an analysis have in common."""
MOST_PATCHES = 256
PAPER = 0.56
"""The mean of the paper's fourteen observers."""


@dataclass(frozen=True)
class Matching:
    """What observers chose.

    Attributes
    ----------
    degree
        Mean over the observers' means.
    interval
        Its confidence interval; NaN with a single choice.
    confidence
        Of the interval: 0.95.
    between
        Standard deviation of the observers' means; NaN with one observer.
    within
        Standard deviation of an observer's choices about the own mean; NaN with one choice each.
    over
        ``"observers"``, or ``"choices"`` where there is one observer: the interval is then about
        this one alone.
    observers
        Mean degree of each.
    choices
        ``(observer, painting, degree)`` of every choice.
    paintings
        Mean over observers for each painting.
    models
        CAT16, von Kries and CIE 1994 against the observers.
    illuminant, reference
        Of the experiment.
    unfinished
        Sessions with trials that are left, by observer and painting.
    """

    degree: float
    interval: tuple[float, float]
    confidence: float
    between: float
    within: float
    over: str
    observers: dict[str, float]
    choices: tuple[tuple[str, str, float], ...]
    paintings: dict[str, float]
    models: tuple[ModelMatch, ...]
    illuminant: str
    reference: str
    unfinished: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; what is not known is None."""
        found: dict[str, Any] = _plain(asdict(self))
        return found

    def to_json(self) -> str:
        """:meth:`to_dict` as text."""
        return json.dumps(self.to_dict(), indent=2, sort_keys=True) + "\n"

    def picture(self) -> Picture:
        """``(y, x, 3)`` uint8: choices of every observer, their mean with its interval, models."""
        return matching_picture(
            self.choices, self.observers, self.degree, self.interval, self.models,
            f"{self.illuminant} to {self.reference}",
        )  # fmt: skip

    def __str__(self) -> str:
        low, high = self.interval
        lines = [
            f"d = {self.degree:.3f}, {100 * self.confidence:.0f} % interval {_said(low)} to "
            f"{_said(high)} over {self.over}; the paper's observers: {PAPER}",
            f"observers: {len(self.observers)}, choices: {len(self.choices)}; standard deviation "
            f"between observers {_said(self.between)}, within one {_said(self.within)}",
        ]
        if len(self.paintings) > 1:
            each = ", ".join(f"{name} {mean:.3f}" for name, mean in self.paintings.items())
            lines.append(f"by painting: {each}")
        lines += ["", f"{'model':32}{'d, white':>10}{'d, colours':>12}{'dE00 to it':>12}"
                  f"{'dE00 to mean':>14}"]  # fmt: skip
        for one in self.models:
            mark = "  within the interval" if one.within else ""
            lines.append(
                f"{one.name:32}{one.white_degree:>10.2f}{one.degree:>12.2f}{one.delta_e:>12.2f}"
                f"{one.chosen_delta_e:>14.2f}{mark}"
            )
        if self.unfinished:
            lines += ["", "unfinished: " + ", ".join(self.unfinished)]
        return "\n".join(lines)


def analyse(
    logs: Sequence[MatchingLog | str | os.PathLike[str]], *, confidence: float = 0.95
) -> Matching:
    """Analyse sessions of one experiment.

    Parameters
    ----------
    logs
        Sessions or their files; an observer may have several, and there may be several paintings.
    confidence
        Of the interval.

    Returns
    -------
    Matching
        Mean, spread, interval and models.

    Raises
    ------
    ArgumentError
        No choice at all; sessions of other lights, displays or modes.
    CorruptInputError
        A damaged file.
    """
    level = number(confidence, "confidence", "a number above 0 and below 1")
    if not 0.0 < level < 1.0:
        raise ArgumentError(f"confidence: expected above 0 and below 1, found {confidence!r}")
    given = [one if isinstance(one, MatchingLog) else read_log(os.fspath(one)) for one in logs]
    choices = tuple(
        (log.observer, log.painting, one.degree) for log in given for one in log.choices
    )
    if not choices:
        raise ArgumentError("logs: expected sessions with choices, found none")
    for name in SHARED:
        values = sorted({str(log.settings[name]) for log in given})
        if len(values) > 1:
            raise ArgumentError(
                f"logs: {name} differs ({', '.join(values)}); analyse sessions of one experiment"
            )
    observers = {
        name: _mean([d for who, _, d in choices if who == name])
        for name in sorted({who for who, *_ in choices})
    }
    paintings = {
        name: _mean(
            [
                _mean([d for who, what, d in choices if (who, what) == (one, name)])
                for one in sorted({who for who, what, _ in choices if what == name})
            ]
        )
        for name in sorted({what for _, what, _ in choices})
    }
    over = "observers" if len(observers) > 1 else "choices"
    sample = list(observers.values()) if over == "observers" else [d for *_, d in choices]
    mean = _mean(sample)
    interval = _interval(sample, level)
    settings = given[0].settings
    xyz = np.concatenate([np.array(log.settings["xyz"], np.float64) for log in given], axis=1)
    xyz = np.unique(xyz, axis=1)
    every = np.linspace(0, xyz.shape[1] - 1, min(xyz.shape[1], MOST_PATCHES)).astype(int)
    return Matching(
        degree=mean,
        interval=interval,
        confidence=level,
        between=_deviation(list(observers.values())),
        within=_within(choices, observers),
        over=over,
        observers=observers,
        choices=choices,
        paintings=paintings,
        models=matches(
            xyz[:, every],
            settings["illuminant"],
            settings["reference"],
            settings["mode"],
            mean,
            interval,
        ),
        illuminant=str(settings["illuminant"]),
        reference=str(settings["reference"]),
        unfinished=tuple(
            f"{log.observer} ({log.painting}): {len(log.choices)} of {log.trials}"
            for log in given
            if len(log.choices) < log.trials
        ),
    )


def _said(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "unknown"


def _interval(sample: Sequence[float], confidence: float) -> tuple[float, float]:
    """Student's interval of a mean."""
    if len(sample) < 2:
        return math.nan, math.nan
    factor = quantile(0.5 * (1.0 - confidence), len(sample) - 1)
    half = factor * _deviation(sample) / math.sqrt(len(sample))
    mean = _mean(sample)
    return mean - half, mean + half


def _within(choices: Sequence[tuple[str, str, float]], observers: dict[str, float]) -> float:
    """Pooled standard deviation of choices about the means of their observers."""
    freedom = len(choices) - len(observers)
    if freedom < 1:
        return math.nan
    return math.sqrt(sum((d - observers[who]) ** 2 for who, _, d in choices) / freedom)


def _deviation(values: Sequence[float]) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""The cost of a fit as a ratio to a reference fit, timed until it is certain.

A processor's speed changes: where neighbours share caches and clocks, the same fit takes a tenth
more or less from one second to the next and a third more for minutes, and no number of repetitions
recovers the least time. What is stable is the ratio of two fits timed at the same moment. So a
fixed reference fit is timed right before and right after every other fit. The cost of a fit is the
mean of the middle half of its logarithmic ratios (a trimmed mean), and it is timed again until the
error of that mean is small. At the end the ratios are multiplied by the reference fit's own
seconds, the median over the whole study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

CERTAIN = 0.0125
"""Relative standard error below which a cost is certain. The ratio of two costs, compared between
two runs, has twice this error: a tenth is three to four deviations (:func:`uncertain`)."""
MOST = 2
"""Largest number of timings of a fit, in units of ``repeats``."""
MORE = 6
"""The same for a fit so short that it runs several times per timing: its timings scatter most and
cost least."""


@dataclass(frozen=True, slots=True)
class Timing:
    """One timing of a fit.

    Attributes
    ----------
    cpu, wall
        Seconds per megapixel of one photograph's size, of all threads together and on the clock.
    reference_cpu, reference_wall
        Seconds of the reference fit, in the mean of right before and right after.
    runs
        Runs of the fit in this timing.
    """

    cpu: float
    wall: float
    reference_cpu: float
    reference_wall: float
    runs: int = 1


def pace(timings: Sequence[Timing], kind: str) -> tuple[float, float]:
    """A fit's megapixel in units of the reference fit, and the relative standard error of that.

    Parameters
    ----------
    timings
        Of one fit; the error of a single one is not known (NaN).
    kind
        ``"cpu"`` or ``"wall"``.

    Notes
    -----
    Mean of the middle half of the logarithms; its error is that of a trimmed mean, from the
    deviation of all with the outer ones set to the innermost of them (Tukey & McLaughlin 1963).
    """
    logs = np.sort([np.log(getattr(t, kind) / getattr(t, f"reference_{kind}")) for t in timings])
    cut = len(logs) // 4
    inner = logs[cut : len(logs) - cut]
    if len(logs) == 1:
        return float(np.exp(inner[0])), float("nan")
    spread = np.clip(logs, inner[0], inner[-1]).std(ddof=1)
    return float(np.exp(inner.mean())), float(spread * np.sqrt(len(logs)) / len(inner))


def uncertain(timings: Sequence[Timing], repeats: int) -> bool:
    """Whether a fit needs another timing: fewer than ``repeats``, or its cost is not certain.

    This stopping rule underestimates the error: by less than a third, for fits of milliseconds by
    less than half.
    """
    if len(timings) < max(repeats, 2):
        return len(timings) < repeats
    most = MORE if min(timing.runs for timing in timings) > 1 else MOST
    return len(timings) < most * repeats and pace(timings, "cpu")[1] > CERTAIN


def unit(timings: Sequence[Timing]) -> dict[str, float]:
    """Seconds of the reference fit, by kind, in the median of all timings of a study."""
    return {
        kind: float(np.median([getattr(timing, f"reference_{kind}") for timing in timings]))
        for kind in ("cpu", "wall")
    }


def steadiness(timings: Sequence[Timing]) -> dict[str, Any]:
    """The reference fit in a record: its seconds and their variation."""
    low, high = np.percentile([timing.reference_cpu for timing in timings], (5.0, 95.0))
    return unit(timings) | {"p95 over p5": float(high / low), "timings": len(timings)}

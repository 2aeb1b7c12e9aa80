"""What a fit costs, so that another run finds the same: beside a yardstick, until that is sure.

A processor's seconds are not all of one length. Where neighbours share caches and clocks the same
fit takes a tenth more or less from one second to the next, a third more for minutes, and no number
of turns brings back the least. What lasts is how many times as long as another a fit takes at the
same moment. So a fixed fit, the yardstick, is timed right before and right after every other; the
cost of a fit is a ratio, the mean of the middle half of its logarithms, and is measured again
until the error of that mean is small. Seconds come back at the end, once for all: those of the
yardstick, in the median of the whole study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SURE = 0.0125
"""Relative standard error of a cost that is sure. The ratio of two costs, each of two runs, is off
by twice as much: a tenth is four deviations, or three (:func:`unsure`)."""
MOST = 2
"""Times ``repeats``: turns of a fit that is never sure."""
MORE = 6
"""The same of one so short that it runs several times a turn: what else uses the caches makes its
turns differ most, and they cost least."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn of a fit.

    Attributes
    ----------
    cpu, wall
        Seconds per megapixel of one photograph's size, of all threads together and on the clock.
    yard_cpu, yard_wall
        Seconds of the yardstick, in the mean of right before and right after.
    runs
        Times that the fit ran in it.
    """

    cpu: float
    wall: float
    yard_cpu: float
    yard_wall: float
    runs: int = 1


def pace(turns: Sequence[Turn], kind: str) -> tuple[float, float]:
    """How often the yardstick goes into a fit's megapixel, and the relative standard error of that.

    Parameters
    ----------
    turns
        Of one fit; the error of a single one is not known (NaN).
    kind
        ``"cpu"`` or ``"wall"``.

    Notes
    -----
    Mean of the middle half of the logarithms; its error is that of a trimmed mean, from the
    deviation of all with the outer ones set to the innermost of them (Tukey & McLaughlin 1963).
    """
    logs = np.sort([np.log(getattr(t, kind) / getattr(t, f"yard_{kind}")) for t in turns])
    cut = len(logs) // 4
    inner = logs[cut : len(logs) - cut]
    if len(logs) == 1:
        return float(np.exp(inner[0])), float("nan")
    spread = np.clip(logs, inner[0], inner[-1]).std(ddof=1)
    return float(np.exp(inner.mean())), float(spread * np.sqrt(len(logs)) / len(inner))


def unsure(turns: Sequence[Turn], repeats: int) -> bool:
    """Whether a fit wants another turn: it had fewer than ``repeats``, or its cost is not sure.

    An end that waits for the error to seem small finds it smaller than it is: by less than a third,
    of fits of milliseconds by less than half.
    """
    if len(turns) < max(repeats, 2):
        return len(turns) < repeats
    most = MORE if min(turn.runs for turn in turns) > 1 else MOST
    return len(turns) < most * repeats and pace(turns, "cpu")[1] > SURE


def unit(turns: Sequence[Turn]) -> dict[str, float]:
    """Seconds of the yardstick, by kind, in the median of all turns of a study."""
    return {
        kind: float(np.median([getattr(turn, f"yard_{kind}") for turn in turns]))
        for kind in ("cpu", "wall")
    }


def steadiness(turns: Sequence[Turn]) -> dict[str, Any]:
    """The yardstick in a record: its seconds, and how they went up and down."""
    low, high = np.percentile([turn.yard_cpu for turn in turns], (5.0, 95.0))
    return unit(turns) | {"p95 over p5": float(high / low), "turns": len(turns)}

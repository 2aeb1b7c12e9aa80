"""Trials as a table, and their numbers as words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from impasto.effort import Effort
from impasto.study.trials import Setting, Trial

HEADINGS = ("setting", "time", "error", "front")


def text(trials: Sequence[Trial], front: Collection[Trial]) -> str:
    """A table for a terminal: one line per trial, a star for those on the front."""
    lines = [HEADINGS, *(_cells(trial, trial in front) for trial in trials)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def markdown(trials: Sequence[Trial], front: Collection[Trial]) -> str:
    """The same as Markdown."""
    lines: list[Sequence[str]] = [HEADINGS, (":--", "--:", "--:", ":-:")]
    for trial in trials:
        setting, *others = _cells(trial, trial in front)
        lines.append((f"`{setting}`", *others))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def call(options: Setting) -> str:
    """The call of :func:`impasto.fit_sbrdf` with these options, as Python."""
    arguments = "".join(f", {name}={_argument(value)}" for name, value in options.items())
    return f"fit_sbrdf(stack{arguments})"


def percent(share: float) -> str:
    """``5.2 %``."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def duration(seconds: float) -> str:
    """``1.2 s``, ``3.4 min``, ``2.1 h``."""
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    unit, length = ("min", 60.0) if seconds < 5400.0 else ("h", 3600.0)
    return f"{seconds / length:.{1 if seconds < 10.0 * length else 0}f} {unit}"


def _cells(trial: Trial, on_front: bool) -> tuple[str, ...]:
    star = "*" if on_front else ""
    return call(trial.options), duration(trial.seconds), f"{100 * trial.error:.3g} %", star


def _argument(value: Any) -> str:
    """An effort shows only what differs from the default."""
    if not isinstance(value, Effort):
        return repr(value)
    usual = Effort().to_dict()
    own = {name: number for name, number in value.to_dict().items() if number != usual[name]}
    return f"Effort({', '.join(f'{name}={number!r}' for name, number in own.items())})"

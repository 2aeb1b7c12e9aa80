"""Which fit to ask for: the best for an error or for a time, tried on a small part of the stack."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from impasto._internal.checks import number
from impasto.errors import ArgumentError
from impasto.stack import Stack, checked_stack
from impasto.study.table import call, duration, percent
from impasto.study.trials import Setting, Trial, has_many_views, ordered_by_work, tried

SETTINGS: tuple[Setting, ...] = (
    {"joint": False},
    {"pooling": "painting", "effort": "standard"},
    {"pooling": "pixel", "effort": "draft"},
    {"pooling": "pixel", "effort": "standard"},
    {"pooling": "pixel", "effort": "reference"},
)
"""What is tried: the settings that have names, in order of work."""

VIEW_SETTINGS: tuple[Setting, ...] = ({"model": "lafortune"},)
"""What is tried in addition where the photographs have more than one view."""

NEAR_BEST = 1.03
"""Without a limit the fastest fit is suggested whose error is within three per cent of the least:
the rule by which the effort ``"standard"`` was chosen."""


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What :func:`impasto.suggest_effort` found.

    Attributes
    ----------
    options
        Options of the fit: ``fit_sbrdf(stack, **suggestion.options)``.
    seconds, error
        Its predicted time and error.
    met
        Whether a fit meets the limits.
    tried
        Every trial, the fastest first.
    """

    options: dict[str, Any]
    seconds: float
    error: float
    met: bool
    tried: tuple[Trial, ...]

    def __str__(self) -> str:
        met = "" if self.met else ", which is the nearest to what was asked for"
        black = ", no better than black," if self.error >= 1.0 else ""
        return (
            f"{call(self.options)} will take {duration(self.seconds)} here and "
            f"relight{black} with an error of {percent(self.error)}{met}."
        )


def suggest_effort(
    stack: Stack,
    *,
    error: float | None = None,
    seconds: float | None = None,
    threads: int | None = None,
) -> Suggestion:
    """Find the fastest fit that meets an error, or the most accurate that meets a time.

    One pooled lobe and lobes per pixel, with every preset of the effort, are tried on about four
    thousand pixels of this stack. One photograph in six is held out of each fit: the error is that
    of the held-out photographs, the time is measured on this machine and scaled to the whole
    stack. At least 24 photographs, or all of them, are held out over several folds.

    Parameters
    ----------
    stack
        At least eight photographs.
    error
        Largest root mean square error of relighting, as a share of the photographs' root mean
        square: 0.05 is five per cent. It includes the noise of the photographs. Pixels outside the
        mask do not count; pixels that the fit cannot estimate do.
    seconds
        Longest wall-clock time.
    threads
        Threads of the fit; None means every allowed core.

    Returns
    -------
    Suggestion
        With both ``error`` and ``seconds``: the fastest that meets both. If nothing meets them,
        the nearest, with ``met`` False. ``print`` shows it as a sentence.

    Raises
    ------
    ArgumentError
        Neither error nor seconds; one that is not a finite number above 0; an error of 1 or more
        (a black picture has that); fewer than eight photographs; or no pixel of the trial can be
        estimated, because all samples are black, clipped or missing.
    GeometryError
        In no fold can the remaining lights determine normals.
    """
    check_limits(error, seconds)
    if error is None and seconds is None:
        raise ArgumentError("error: give the largest error (error=) or the longest time (seconds=)")
    many = has_many_views(checked_stack(stack))
    settings = VIEW_SETTINGS + SETTINGS if many else SETTINGS
    trials = ordered_by_work(tried(stack, settings, threads=threads))
    return chosen(trials, error=error, seconds=seconds)


def check_limits(error: float | None, seconds: float | None) -> None:
    """Refuse an error or a time that no fit could have."""
    for name, value in (("error", error), ("seconds", seconds)):
        if value is not None:
            wanted = number(value, name, "a number above 0")
            if not (math.isfinite(wanted) and wanted > 0.0):
                kind = "a finite number" if wanted == math.inf else "a number"
                raise ArgumentError(f"{name}: expected {kind} above 0, found {value!r}")
    if error is not None and error >= 1.0:
        raise ArgumentError(
            "error: expected a share below 1 (0.05 is five per cent; black meets 1), "
            f"found {error!r}"
        )


def chosen(trials: Sequence[Trial], *, error: float | None, seconds: float | None) -> Suggestion:
    """The fastest trial that meets an error, the most accurate that meets a time, or the nearest.

    With neither: the fastest whose error is at most :data:`NEAR_BEST` times the least.
    """
    ordered = tuple(sorted(trials, key=lambda trial: trial.seconds))
    if error is None and seconds is None:
        least = min(trial.error for trial in ordered)
        best = next(trial for trial in ordered if trial.error <= NEAR_BEST * least)
        return Suggestion(best.options, best.seconds, best.error, True, ordered)
    good = [t for t in ordered if error is None or t.error <= error]
    fast = [t for t in ordered if seconds is None or t.seconds <= seconds]
    both = [t for t in good if t in fast]
    if both:
        best = min(both, key=lambda t: t.error) if error is None else both[0]
    elif fast and error is not None:
        best = min(fast, key=lambda t: t.error)
    else:
        best = ordered[0]
    return Suggestion(best.options, best.seconds, best.error, bool(both), ordered)

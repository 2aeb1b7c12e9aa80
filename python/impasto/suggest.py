"""Which fit to ask for: tried on a little of the stack, for an error or for a time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto.checks import number
from impasto.effort import resolved
from impasto.errors import ArgumentError, GeometryError
from impasto.fit.border import RigArguments, checked_stack
from impasto.fit.sbrdf import fit_sbrdf
from impasto.relighting import full_scale, relative_error
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.thinning import painted, thinned, thinned_to

LADDER: tuple[dict[str, Any], ...] = (
    {"joint": False},
    {"effort": "standard"},
    {"pooling": "pixel", "effort": "draft"},
    {"pooling": "pixel", "effort": "standard"},
    {"pooling": "pixel", "effort": "reference"},
)
"""What is tried where all photographs have one view: what somebody gets by name."""

VIEWS: tuple[dict[str, Any], ...] = ({"model": "lafortune"},)
"""What is tried besides where they have many."""

PIXELS = 4096
"""Pixels of the trial, about."""
HELD = 6
"""One photograph in so many is held out."""
QUIET = 0.3
"""Seconds that the runs of one trial take together, at least; the least of them counts: the first
of all waits for threads and memory, any may wait for other programs."""
FEWEST = 8
"""Photographs that a trial needs: fewer cannot spare one."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One setting, tried.

    Attributes
    ----------
    options
        For :func:`impasto.fit_sbrdf`.
    seconds
        What it will take for the whole stack, on the clock.
    error
        Root mean square error of photographs that were held out, over their root mean square.
    """

    options: dict[str, Any]
    seconds: float
    error: float


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What :func:`suggest_effort` found.

    Attributes
    ----------
    options
        For :func:`impasto.fit_sbrdf`: ``fit_sbrdf(stack, **suggestion.options)``.
    seconds, error
        What to expect of it.
    met
        Whether what was asked for can be had.
    tried
        Every trial, the fastest first.
    """

    options: dict[str, Any]
    seconds: float
    error: float
    met: bool
    tried: tuple[Trial, ...]

    def __str__(self) -> str:
        words = ", ".join(f"{name}={value!r}" for name, value in self.options.items())
        met = "" if self.met else ", which is the nearest to what was asked for"
        return (
            f"fit_sbrdf(stack, {words}) will take {_duration(self.seconds)} here and relight with "
            f"an error of {_percent(self.error)}{met}."
        )


def suggest_effort(
    stack: Stack,
    *,
    error: float | None = None,
    seconds: float | None = None,
    threads: int | None = None,
) -> Suggestion:
    """Find the cheapest fit that meets an error, or the best that meets a time.

    Every preset, of one lobe per painting and of pixels' own, is tried on some four thousand
    pixels of this stack, with one photograph in six held out: what it costs on this machine, and
    how far the held-out photographs are from what it expects.

    Parameters
    ----------
    stack
        The photographs; at least eight.
    error
        Largest root mean square error of relighting, as a share of the photographs' root mean
        square: 0.05 is five per cent. Noise of the photographs is part of it; pixels outside the
        mask are not, pixels that the fit does not know are.
    seconds
        Longest time on the clock.
    threads
        Of the fit that is to come; None means every allowed core.

    Returns
    -------
    Suggestion
        With both ``error`` and ``seconds``: the cheapest that meets both. Where nothing meets
        them, the nearest, and ``met`` is False. ``print`` shows it in a sentence.

    Raises
    ------
    ArgumentError
        Neither error nor seconds, one that is not above 0, fewer than eight photographs, or
        nothing but black or missing samples.
    GeometryError
        Lights that cannot determine normals without those that are held out.
    """
    for name, value in (("error", error), ("seconds", seconds)):
        if value is not None:
            asked = number(value, name, "a number above 0")
            if not (math.isfinite(asked) and asked > 0.0):
                raise ArgumentError(f"{name}: expected a number above 0, found {value!r}")
    if error is None and seconds is None:
        raise ArgumentError("error: say the largest error, or in seconds= the longest time")
    checked_stack(stack)
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(f"stack: a trial needs {FEWEST} photographs, found {count}")
    trials = _trials(stack, threads)
    tried = tuple(sorted(trials, key=lambda trial: trial.seconds))
    good = [t for t in tried if error is None or t.error <= error]
    fast = [t for t in tried if seconds is None or t.seconds <= seconds]
    both = [t for t in good if t in fast]
    if both:
        best = min(both, key=lambda t: t.error) if error is None else both[0]
    elif fast and error is not None:
        best = min(fast, key=lambda t: t.error)
    else:
        best = tried[0]
    return Suggestion(best.options, best.seconds, best.error, bool(both), tried)


def _trials(stack: Stack, threads: int | None) -> list[Trial]:
    part = thinned_to(stack, PIXELS)
    held = np.arange(HELD // 2, len(stack.rig), HELD)
    train = np.setdiff1d(np.arange(len(stack.rig)), held)
    shown = part.take(held)
    truth = np.array([shown.linear(i) for i in range(len(held))])
    if part.mask is not None:
        truth[..., ~part.mask] = np.nan
    known = part.take(train)
    if not (np.isfinite(truth) & (truth > 0.0)).any():
        raise ArgumentError("stack: a trial needs photographs that show something, found none")
    many = _core.views_differ(RigArguments.of(stack.rig))
    ladder = VIEWS + LADDER if many else LADDER
    # Time grows with the pixels and, nearly, with the photographs.
    more = len(stack.rig) / len(train)
    try:
        return [
            _trial(known, shown.rig, truth, options, stack, more, threads) for options in ladder
        ]
    except GeometryError as refusal:
        raise GeometryError(
            f"{refusal} (of {len(stack.rig)} photographs {len(held)} were held out of the trial)"
        ) from refusal


def _trial(
    known: Stack,
    rig: Rig,
    truth: NDArray[np.float32],
    options: dict[str, Any],
    stack: Stack,
    more: float,
    threads: int | None,
) -> Trial:
    pixels = painted(stack)
    fitted, took = _expected(known, options, pixels, threads)
    error = relative_error(fitted.predict(rig), truth, full_scale(known))
    return Trial(options, took * more, error)


def _expected(
    known: Stack, options: dict[str, Any], pixels: int, threads: int | None
) -> tuple[Any, float]:
    """A fit of few pixels, and the seconds that so many will take."""

    def timed(stack: Stack, **options: Any) -> tuple[Any, float]:
        least, spent = math.inf, 0.0
        while spent < QUIET:
            start = time.perf_counter()
            fitted = fit_sbrdf(stack, threads=threads, **options)
            took = time.perf_counter() - start
            least, spent = min(least, took), spent + took
        return fitted, least

    few = painted(known)
    if options.get("model") == "lafortune":
        fitted, took = timed(known, **options)
        return fitted, took * pixels / few
    if options.get("pooling") == "pixel":
        fitted, took = timed(known, **options)
        return fitted, took * _searched(pixels) / _searched(few)
    # The painting's lobe is looked for among so many pixels at most; the rest is what every pixel
    # takes, and what no pixel takes. Three fits, of more or fewer pixels, tell them apart.
    effort = resolved(options.get("effort", "standard"))
    part = thinned(known, 2)
    fewer = max(painted(part), 1)
    fitted, took = timed(known, **options | {"effort": replace(effort, pixels=few)})
    _, unsearched = timed(known, **options | {"effort": replace(effort, pixels=fewer)})
    _, least = timed(part, **options | {"effort": replace(effort, pixels=fewer)})
    more = max(few - fewer, 1)
    search = max(took - unsearched, 0.0) / more
    each = max(unsearched - least, 0.0) / more
    once = max(took - few * (search + each), 0.0)
    return fitted, once + min(pixels, effort.pixels) * search + pixels * each


def _searched(pixels: int) -> float:
    """Searches where pixels have lobes of their own.

    What is typical of a painting is asked first, by the same search, of one in so many pixels that
    they are no more than a certain number.
    """
    return pixels * (1.0 + 1.0 / math.ceil(pixels / _core.TYPICAL_PIXELS))


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"

"""Cross-validation [@stone1974] of fit settings over photographs, on a small part of a stack.

Held-out photographs give the error of a setting, a clock its time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from impasto import _core
from impasto._internal.border import RigArguments
from impasto.effort import resolved
from impasto.errors import ArgumentError
from impasto.fit.cross_validation import FEWEST, Fold, folds_of
from impasto.fit.sbrdf import fit_sbrdf
from impasto.fit.subsample import pixel_count, subsampled, subsampled_to
from impasto.stack import Stack, checked_stack
from impasto.study.relative_error import full_scale, relative_error

PIXELS = 4096
"""Approximate number of pixels in a trial. They are spread over the picture: as many pixels in one
block would see fewer materials, and their error would say less about the whole."""
TIMED_SECONDS = 0.3
"""Total seconds of the timed runs of one trial, at least; the fastest run counts. The first run
starts threads and allocates memory, and any run may be slowed by other programs."""
EMPTY_EDGE = 256
"""Edge in pixels of the empty picture that measures the cost of pixels outside the mask."""

Setting: TypeAlias = dict[str, Any]
"""Options of :func:`impasto.fit_sbrdf`."""
Advance: TypeAlias = Callable[[int, int], None]
"""Called after every setting: (done, total)."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One setting, tried.

    Attributes
    ----------
    options
        Options of :func:`impasto.fit_sbrdf`.
    seconds
        Predicted wall-clock time of the whole stack.
    error
        Root mean square error of held-out photographs over their root mean square.
    """

    options: Setting
    seconds: float
    error: float


def tried(
    stack: Stack,
    settings: Sequence[Setting],
    *,
    threads: int | None,
    advance: Advance | None = None,
) -> list[Trial]:
    """Try each setting on about :data:`PIXELS` pixels of a stack.

    Parameters
    ----------
    stack
        At least :data:`FEWEST` photographs.
    settings
        What to try, in the order of the result.
    threads
        Threads of the fits; None: every allowed core.
    advance
        Called after each setting.

    Raises
    ------
    ArgumentError
        Too few photographs, or no pixel of the trial can be estimated.
    GeometryError
        The lights that remain cannot determine normals, in any fold.
    """
    checked_stack(stack)
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(f"stack: a trial needs {FEWEST} photographs, found {count}")
    folds = folds_of(subsampled_to(stack, PIXELS), threads)
    if not any((np.isfinite(fold.truth) & (fold.truth > 0.0)).any() for fold in folds):
        raise ArgumentError("stack: a trial needs photographs that show something, found none")
    if all(fold.unknown is not None for fold in folds):
        raise ArgumentError(
            f"stack: a trial needs pixels that can be estimated, found {folds[0].unknown} and "
            "nothing else; impasto doctor tells what is wrong with the photographs"
        )
    trials = []
    for done, options in enumerate(settings, start=1):
        trials.append(_trial(folds, options, stack, threads))
        if advance is not None:
            advance(done, len(settings))
    return trials


def has_many_views(stack: Stack) -> bool:
    """Whether the photographs were taken from more than one direction."""
    return bool(_core.views_differ(RigArguments.of(stack.rig)))


def ordered_by_work(trials: list[Trial]) -> list[Trial]:
    """Times that do not decrease as the work grows, for settings listed in order of work.

    On a busy machine a timing may be too long. A setting that does a part of what a later one of
    the same kind does takes at most as long.
    """
    least: dict[str | None, float] = {}
    found = []
    for trial in reversed(trials):
        kind = trial.options.get("pooling", trial.options.get("model"))
        least[kind] = min(trial.seconds, least.get(kind, math.inf))
        found.append(replace(trial, seconds=least[kind]))
    return found[::-1]


def _trial(folds: list[Fold], options: Setting, stack: Stack, threads: int | None) -> Trial:
    """The first fold is timed; all folds are compared."""
    first, *others = folds
    fitted, took = _predicted(first.known, options, pixel_count(stack), threads)
    took += _outside_mask(stack, first.known, options, threads)
    fits = [fitted, *(fit_sbrdf(fold.known, threads=threads, **options) for fold in others)]
    shown = [fit.predict(fold.rig) for fit, fold in zip(fits, folds, strict=True)]
    truth = np.concatenate([fold.truth for fold in folds])
    error = relative_error(np.concatenate(shown), truth, full_scale(stack))
    # Time grows with the pixels and almost linearly with the photographs.
    return Trial(options, took * len(stack.rig) / len(first.known.rig), error)


def _predicted(
    known: Stack, options: Setting, pixels: int, threads: int | None
) -> tuple[Any, float]:
    """A fit of the trial's pixels, and the predicted seconds for ``pixels`` of them."""
    few = pixel_count(known)
    if options.get("model") == "lafortune":
        fitted, took = _timed(known, options, threads)
        return fitted, took * pixels / few
    if options.get("pooling") == "pixel":
        fitted, took = _timed(known, options, threads)
        if resolved(options.get("effort", "standard")).start != "multistart":
            return fitted, took * pixels / few
        return fitted, took * _searches(pixels) / _searches(few)
    # The pooled lobe is fitted to at most ``effort.pixels`` pixels, every pixel has a cost of its
    # own, and there is a constant. Three fits with different numbers of pixels separate the three.
    effort = resolved(options.get("effort", "standard"))
    part = subsampled(known, 2)
    fewer = max(pixel_count(part), 1)
    all_, some = (options | {"effort": replace(effort, pixels=count)} for count in (few, fewer))
    fitted, took = _timed(known, all_, threads)
    _, unsearched = _timed(known, some, threads)
    _, least = _timed(part, some, threads)
    more = max(few - fewer, 1)
    search = max(took - unsearched, 0.0) / more
    each = max(unsearched - least, 0.0) / more
    once = max(took - few * (search + each), 0.0)
    return fitted, once + min(pixels, effort.pixels) * search + pixels * each


def _timed(stack: Stack, options: Setting, threads: int | None) -> tuple[Any, float]:
    """A fit, and the least of the seconds of some runs."""
    least, spent = math.inf, 0.0
    while spent < TIMED_SECONDS:
        start = time.perf_counter()
        fitted = fit_sbrdf(stack, threads=threads, **options)
        took = time.perf_counter() - start
        least, spent = min(least, took), spent + took
    return fitted, least


def _outside_mask(stack: Stack, known: Stack, options: Setting, threads: int | None) -> float:
    """Seconds for the pixels outside the mask, where the trial has far fewer of them.

    They have a place in every result map. In a picture that is mostly mask they take longer than
    the fit.
    """
    inside, few = pixel_count(stack), pixel_count(known)
    (height, width), (trial_height, trial_width) = stack.shape[2:], known.shape[2:]
    left = height * width - trial_height * trial_width * inside / few
    if left <= inside:
        return 0.0
    blank = np.zeros((*known.shape[:2], EMPTY_EDGE, EMPTY_EDGE), known.samples.dtype)
    empty = known._replace(samples=blank, mask=np.zeros((EMPTY_EDGE, EMPTY_EDGE), np.bool_))
    _, took = _timed(empty, options, threads)
    return took * left / EMPTY_EDGE**2


def _searches(pixels: int) -> float:
    """Searches of a fit with lobes per pixel.

    The painting's typical lobes are found first, by the same search, from at most
    ``TYPICAL_PIXELS`` pixels on a regular grid.
    """
    return pixels * (1.0 + 1.0 / math.ceil(pixels / _core.TYPICAL_PIXELS))

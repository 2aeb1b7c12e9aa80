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
from impasto.fit.border import RigArguments
from impasto.fit.normals import fit_normals
from impasto.fit.sbrdf import fit_sbrdf
from impasto.relighting import full_scale, relative_error
from impasto.report import status_counts
from impasto.rig import Rig
from impasto.stack import Stack, checked_stack
from impasto.status import Status
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
"""Pixels of the trial, about. They lie apart, and so see more places than as many in blocks, whose
errors say less of the whole, though a pyramid has no neighbours there to start from."""
HELD = 6
"""One photograph in so many is held out."""
SHOWN = 24
"""Photographs that are held out in turns, at least, or all of them: highlights make so much of an
error that those which a few photographs happen to show say little of the others. What the turns
fit together grows with no stack: some hundred photographs of so many pixels."""
QUIET = 0.3
"""Seconds that the runs of one trial take together, at least; the least of them counts: the first
of all waits for threads and memory, any may wait for other programs."""
BARE = 256
"""Pixels of the edge of an empty picture that tells what a pixel outside the mask takes."""
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
        black = ", no better than black," if self.error >= 1.0 else ""
        return (
            f"fit_sbrdf(stack, {words}) will take {_duration(self.seconds)} here and "
            f"relight{black} with an error of {_percent(self.error)}{met}."
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
    how far the held-out photographs are from what it expects. Where these are fewer than 24, others
    are held out in turns, until they are as many or every photograph has been; however large the
    stack, the turns together fit some hundred photographs more. What is held out together was lit
    (and seen) from directions that lie apart, as far as hands of one size allow.

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
        Neither error nor seconds, one that is not above 0 or not finite, an error of 1 or more
        (black meets it), fewer than eight photographs, or such that no pixel of the trial can be
        estimated: nothing but black, clipped or missing samples.
    GeometryError
        Lights that cannot determine normals without those that are held out, in whichever turn.
    """
    for name, value in (("error", error), ("seconds", seconds)):
        if value is not None:
            asked = number(value, name, "a number above 0")
            if not (math.isfinite(asked) and asked > 0.0):
                kind = "a finite number" if asked == math.inf else "a number"
                raise ArgumentError(f"{name}: expected {kind} above 0, found {value!r}")
    if error is not None and error >= 1.0:
        raise ArgumentError(
            "error: expected a share below 1 (0.05 is five per cent; black meets 1), "
            f"found {error!r}"
        )
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
    turns = _turns(part, threads)
    if not any((np.isfinite(turn.truth) & (turn.truth > 0.0)).any() for turn in turns):
        raise ArgumentError("stack: a trial needs photographs that show something, found none")
    if all(turn.unknown is not None for turn in turns):
        raise ArgumentError(
            f"stack: a trial needs pixels that can be estimated, found {turns[0].unknown} and "
            "nothing else; impasto doctor tells what is wrong with the photographs"
        )
    many = _core.views_differ(RigArguments.of(stack.rig))
    ladder = VIEWS + LADDER if many else LADDER
    return _in_order([_trial(turns, options, stack, threads) for options in ladder])


def _in_order(trials: list[Trial]) -> list[Trial]:
    """What does a part of what another does takes no longer, whatever else the machine did then.

    On a busy machine the same question had two answers.
    """
    least: dict[str | None, float] = {}
    found = []
    for trial in reversed(trials):
        kind = trial.options.get("pooling", trial.options.get("model"))
        least[kind] = min(trial.seconds, least.get(kind, math.inf))
        found.append(replace(trial, seconds=least[kind]))
    return found[::-1]


@dataclass(frozen=True, eq=False)
class _Turn:
    """Photographs that are fitted, and those held out of the fit."""

    known: Stack
    rig: Rig
    truth: NDArray[np.float32]
    unknown: str | None
    """Why no pixel of ``known`` can be estimated, if none can."""


def _turns(part: Stack, threads: int | None) -> list[_Turn]:
    """As many as hold enough photographs out, each once; none whose fit no lights determine."""
    count = len(part.rig)
    refusal: GeometryError | None = None
    found = []
    for held in _hands(part.rig)[: math.ceil(HELD * SHOWN / count)]:
        known, shown = part.take(np.setdiff1d(np.arange(count), held)), part.take(held)
        try:
            # Photometric stereo, in a millisecond, refuses what any fit would.
            status = fit_normals(known, method="least-squares", threads=threads).status
        except GeometryError as error:
            words = f"{error} (of {count} photographs {len(held)} were held out of the trial)"
            refusal = refusal or GeometryError(words)
            continue
        truth = np.array([shown.linear(i) for i in range(len(held))])
        if part.mask is not None:
            truth[..., ~part.mask] = np.nan
        reasons = None if (status < Status.DARK).any() else ", ".join(status_counts(status))
        found.append(_Turn(known, shown.rig, truth, reasons))
    if refusal is not None and not found:
        # Where it is not for those held out, the refusal of all of them says so.
        fit_normals(part, method="least-squares", threads=threads)
        raise refusal
    return found


def _hands(rig: Rig) -> list[NDArray[np.intp]]:
    """Photographs dealt into hands, each to where the directions like its own are farthest.

    A photograph that is held out together with its neighbours lies in a hole that no fit of the
    whole stack will have; a narrow highlight may fall into it, and the error that is foretold is
    twice what comes.
    """
    places = np.concatenate([rig.directions, rig.views], axis=1)
    near = np.full((HELD, len(rig)), np.inf)
    hands: list[list[int]] = [[] for _ in range(HELD)]
    for index, place in enumerate(places):
        hand = int(near[:, index].argmax())
        hands[hand].append(index)
        near[hand] = np.minimum(near[hand], np.linalg.norm(places - place, axis=1))
        if len(hands[hand]) == len(range(hand, len(rig), HELD)):
            # It is full.
            near[hand] = -1.0
    return [np.array(hand) for hand in hands]


def _trial(turns: list[_Turn], options: dict[str, Any], stack: Stack, threads: int | None) -> Trial:
    """The first turn is timed; all of them are compared."""
    first, *others = turns
    fitted, took = _expected(first.known, options, painted(stack), threads)
    took += _bare(stack, first.known, options, threads)
    fits = [fitted, *(fit_sbrdf(turn.known, threads=threads, **options) for turn in others)]
    shown = [fit.predict(turn.rig) for fit, turn in zip(fits, turns, strict=True)]
    truth = np.concatenate([turn.truth for turn in turns])
    error = relative_error(np.concatenate(shown), truth, full_scale(stack))
    # Time grows with the pixels and, nearly, with the photographs.
    return Trial(options, took * len(stack.rig) / len(first.known.rig), error)


def _expected(
    known: Stack, options: dict[str, Any], pixels: int, threads: int | None
) -> tuple[Any, float]:
    """A fit of few pixels, and the seconds that so many will take."""
    few = painted(known)
    if options.get("model") == "lafortune":
        fitted, took = _timed(known, options, threads)
        return fitted, took * pixels / few
    if options.get("pooling") == "pixel":
        fitted, took = _timed(known, options, threads)
        if resolved(options.get("effort", "standard")).start == "pyramid":
            return fitted, took * pixels / few
        return fitted, took * _searched(pixels) / _searched(few)
    # The painting's lobe is looked for among so many pixels at most; the rest is what every pixel
    # takes, and what no pixel takes. Three fits, of more or fewer pixels, tell them apart.
    effort = resolved(options.get("effort", "standard"))
    part = thinned(known, 2)
    fewer = max(painted(part), 1)
    all_, some = (options | {"effort": replace(effort, pixels=count)} for count in (few, fewer))
    fitted, took = _timed(known, all_, threads)
    _, unsearched = _timed(known, some, threads)
    _, least = _timed(part, some, threads)
    more = max(few - fewer, 1)
    search = max(took - unsearched, 0.0) / more
    each = max(unsearched - least, 0.0) / more
    once = max(took - few * (search + each), 0.0)
    return fitted, once + min(pixels, effort.pixels) * search + pixels * each


def _timed(stack: Stack, options: dict[str, Any], threads: int | None) -> tuple[Any, float]:
    """A fit, and the least of the seconds that some runs of it took."""
    least, spent = math.inf, 0.0
    while spent < QUIET:
        start = time.perf_counter()
        fitted = fit_sbrdf(stack, threads=threads, **options)
        took = time.perf_counter() - start
        least, spent = min(least, took), spent + took
    return fitted, least


def _bare(stack: Stack, known: Stack, options: dict[str, Any], threads: int | None) -> float:
    """Seconds that pixels outside the mask take, where the trial has far fewer of them.

    They have a place in every map; of a picture that is mostly mask these take longer than the fit.
    """
    there, few = painted(stack), painted(known)
    (height, width), (tall, wide) = stack.shape[2:], known.shape[2:]
    left = height * width - tall * wide * there / few
    if left <= there:
        return 0.0
    blank = np.zeros((*known.shape[:2], BARE, BARE), known.samples.dtype)
    empty = known._replace(samples=blank, mask=np.zeros((BARE, BARE), np.bool_))
    _, took = _timed(empty, options, threads)
    return took * left / BARE**2


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
    unit, length = ("min", 60.0) if seconds < 5400.0 else ("h", 3600.0)
    return f"{seconds / length:.{1 if seconds < 10.0 * length else 0}f} {unit}"

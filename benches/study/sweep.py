"""Every setting on every data set, in turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.simulate.fields import check_seed
from impasto.simulate.planning import Truth
from impasto.stack import Stack
from study import subsets
from study.cramer_rao import Bound, bound_of, strengths_off, widths_off
from study.data_sets import FULL, QUICK, PaintingData, Sizes, available, digests
from study.excess_cost import LeastCosts, least_costs_of, summary
from study.held_out_error import lobes_of
from study.journal import TERMS, Journal, alone, check_folder, run_info
from study.memory import per_megapixel
from study.pigments import PigmentData
from study.reference_fit import ReferenceFit
from study.repeatability import check_alike
from study.settings import VIEWS, Setting, named, settings

MEMORY_MEASURED = ("own model", VIEWS)
"""Data sets on which memory is measured for presets; on others it is the same per sample."""

Advance = Callable[[int, int, str], None]
"""Called before every run: (done, total, name of the run)."""


def run(
    out: str | Path,
    *,
    data: str | Path | None = None,
    quick: bool = False,
    knobs: Sequence[str] | None = None,
    sizes: Sizes | None = None,
    seed: int = 0,
    threads: int | None = None,
    repeats: int = 2,
    like: dict[str, Any] | None = None,
    advance: Advance = lambda done, total, name: None,
) -> dict[str, Any]:
    """Measure whatever is not yet measured in a folder.

    A setting is fitted to every painting of a data set once, for its errors, which are of all
    their pixels together; it is timed on the first of them. Errors depend on nothing but data, seed
    and code: two runs give the same, bit for bit. Costs are timed beside a reference fit until they
    are certain or were timed often enough (``study.timing``; ``doubt`` says how certain): two runs
    agree in their ratios, on a busy machine too. Fits take turns, in another order every time, so
    that whatever else the machine does meets all alike.
    Memory is measured in processes of their own (not by the quick study): a script guards its call
    by ``if __name__ == "__main__"``.

    Parameters
    ----------
    out
        Folder of the journal; a study that was interrupted goes on there. On another machine, with
        other threads, repeats or data everything is timed anew: times are never mixed.
    data
        Folder of real photographs, measured materials and spectra; None: simulated data only.
    quick
        Few settings on small data, every fit in ``repeats`` timings and no more.
    knobs
        Only settings of these; None: of all.
    sizes
        In pixels; default: as ``quick`` says.
    seed
        Of paintings, noise and random choices.
    threads
        None means every allowed core.
    repeats
        Timings of every fit, at least; a fit of milliseconds runs for 0.04 s in each. Where two or
        more leave its cost uncertain, up to twice as many, and six times as many of fits of
        milliseconds. In the quick study just as many.
    like
        ``run`` of a recorded study that this one is to be compared with.
    advance
        Called before every timing, ``(done, total, name)``. ``done`` counts the timings that every
        fit takes; where it is ``total``, costs that are uncertain are timed further.

    Returns
    -------
    dict
        ``run`` (machine, commit, seed, sizes, reference fit), ``missing`` (data sets and why),
        ``skipped`` (peers that are not installed and what is measured by them, pixels or
        photographs of which there are too few), ``failed`` (fits that ended in an error; tried
        again by the next run), ``rows``.

    Raises
    ------
    ArgumentError
        A folder of other files, that holds another study or in which one is at work; no folder of
        data, a knob that does not exist (the quick study has no ``size``), a number that makes no
        sense, or a study that is not ``like`` the recorded one. No fit has been run then.
    """
    if isinstance(repeats, bool) or not (isinstance(repeats, int) and repeats >= 1):
        raise ArgumentError(f"repeats: expected a whole number from 1, found {repeats!r}")
    check_seed(seed)
    chosen = _chosen(knobs, quick=quick)
    out, data = Path(out), None if data is None else Path(data)
    check_folder(out)
    sizes = sizes or (QUICK if quick else FULL)
    made, missing = available(sizes, seed, data)
    info = run_info() | {"seed": seed, "quick": quick, "sizes": asdict(sizes)}
    info |= {"threads": threads, "repeats": repeats, "data": digests(data)}
    if like is not None:
        check_alike(like, info)
    jobs = {name: [setting for setting in chosen if name in setting.on] for name in made}
    places = [(name, setting) for name, here in jobs.items() for setting in here]
    left = places
    with alone(out):
        journal = Journal(out, {"run": info, "missing": missing}, TERMS)
        beside = ReferenceFit(threads)
        runners = {
            name: _Runner(made[name], seed, threads, beside, memory=not quick) for name in made
        }
        for turn in count():
            left = [p for p in left if journal.wants(_key(*p), repeats, surely=not quick)]
            if not left:
                break
            # No fit always follows the same one: every turn but the first has its own order.
            order = np.random.default_rng(turn).permutation(len(left)) if turn else range(len(left))
            for name, setting in [left[number] for number in order]:
                key = _key(name, setting)
                taken = sum(min(journal.timings(_key(*place)), repeats) for place in places)
                advance(taken, repeats * len(places), f"{name}: {setting.name}")
                run = key | runners[name].measured(setting, first=journal.timings(key) == 0)
                journal.add(run)
                if "failed" in run:
                    left.remove((name, setting))
        advance(repeats * len(places), repeats * len(places), "")
    return journal.found()


def _chosen(knobs: Sequence[str] | None, *, quick: bool) -> list[Setting]:
    every = settings(quick=quick)
    known = list(dict.fromkeys(setting.knob for setting in every))
    if isinstance(knobs, str) or not set(knobs or ()) <= set(known):
        raise ArgumentError(
            f"knobs: expected a list of some of {', '.join(known)}; found {knobs!r}"
        )
    return [setting for setting in every if knobs is None or setting.knob in knobs]


def _key(data: str, setting: Setting) -> dict[str, str]:
    return {"data": data, "knob": setting.knob, "setting": setting.name}


Taken: TypeAlias = tuple[PaintingData | PigmentData, Any]
"""Pixels of a painting or of pigments, and the photographs of them that are fitted."""


class _Runner:
    """Runs settings on one data set, which is made when it is first needed."""

    def __init__(
        self,
        make: Callable[[], tuple[Any, ...]],
        seed: int,
        threads: int | None,
        reference: ReferenceFit,
        *,
        memory: bool,
    ) -> None:
        self._paintings = cache(make)
        self._seed, self._threads, self._memory = seed, threads, memory
        self._reference = reference
        self._timed: dict[tuple[str, str], Taken] = {}
        # Most settings are fitted to the same photographs.
        self._bounds: dict[tuple[int, bytes], Bound] = {}
        self._leasts: dict[bytes, LeastCosts] = {}

    def _take(self, setting: Setting, *, first: bool) -> list[Taken]:
        """Stacks that a setting is fitted to: of all paintings, or of the first when only timed."""
        key = (setting.knob, setting.name)
        if key in self._timed and not first:
            return [self._timed[key]]
        parts = setting.part(self._paintings())[: None if first else 1]
        taken = [
            (part, setting.prepare(part.stack, self._seed + number))
            for number, part in enumerate(parts)
        ]
        self._timed[key] = taken[0]
        return taken

    def measured(self, setting: Setting, *, first: bool) -> dict[str, Any]:
        """A row of the record at the first run of a setting, later one more timing."""
        try:
            taken = self._take(setting, first=first)
            (part, stack), *others = taken
            fitted, timing = self._reference.beside(
                lambda: setting.fit(stack, self._threads), part.megapixels
            )
            if not first:
                return {"again": asdict(timing)}
            # Fits that are not timed may use every core: the results are the same bits.
            fits = [fitted, *(setting.fit(stack, None) for _, stack in others)]
            row: dict[str, Any] = {"number": setting.number, "options": setting.options}
            row |= self._bounded(fits, taken)
            if setting.search:
                row["excess"] = self._excess(fits, [stack for _, stack in taken])
            if self._memory and part.name in MEMORY_MEASURED and named(setting):
                row["memory"] = per_megapixel(setting.fit, stack, self._threads)
            row |= {"share": part.share, "lobes": lobes_of(fits)}
            error = asdict(setting.judge(fits, tuple(part for part, _ in taken)))
            known = {name: value for name, value in error.items() if value is not None}
            if wrong := [name for name, value in known.items() if not np.isfinite(value)]:
                raise ValueError(f"no numbers: {', '.join(wrong)}")
            return row | {"timing": asdict(timing), "error": error}
        except subsets.TooFewError as error:
            return {"skipped": str(error)}
        except Exception as error:
            if (setting.peer or setting.search) and isinstance(error, ImportError):
                return {"skipped": str(error)}
            # No fit of ours should fail here. The study goes on and reports it.
            return {"failed": f"{type(error).__name__}: {error}"}

    def _bounded(self, fits: Sequence[Any], taken: Sequence[Taken]) -> dict[str, float]:
        """Cramér-Rao bounds and errors of gloss in units of them, where the truth is known."""
        known = [(part.truth, stack) for part, stack in taken if part.truth is not None]
        if not known:
            return {}
        truths = [truth for truth, _ in known]
        bounds = [self._bound(truth, stack.rig) for truth, stack in known]
        if not all(bound.normal.size for bound in bounds):
            # A very small painting has no pixel on the grid of bounds.
            return {}
        row = {"bound": float(np.mean([bound.normal for bound in bounds]))}
        gammas: list[Any] = [getattr(fit, "gamma", None) for fit in fits]
        if all(np.ndim(gamma) == 3 for gamma in gammas):
            row["width"] = widths_off([gamma[0] for gamma in gammas], truths, bounds)
        lobes: list[Any] = [getattr(fit, "specular", None) for fit in fits]
        if all(np.ndim(strength) == 4 for strength in lobes):
            betas = [strength[0].mean(axis=0) for strength in lobes]
            row["strength"] = strengths_off(betas, truths, bounds)
        # Infinite if half of the pixels have no lobe; JSON has no such number.
        return {name: value for name, value in row.items() if np.isfinite(value)}

    def _excess(self, fits: Sequence[Any], stacks: Sequence[Stack]) -> dict[str, float]:
        """Final cost of searches above the least cost."""
        pairs = zip(fits, stacks, strict=True)
        return summary(self._least(stack).excess(fitted) for fitted, stack in pairs)

    def _least(self, stack: Stack) -> LeastCosts:
        key = stack.samples.tobytes()
        if key not in self._leasts:
            self._leasts[key] = least_costs_of(stack)
        return self._leasts[key]

    def _bound(self, truth: Truth, rig: Rig) -> Bound:
        key = (id(truth), rig.directions.tobytes())
        if key not in self._bounds:
            self._bounds[key] = bound_of(truth, rig)
        return self._bounds[key]

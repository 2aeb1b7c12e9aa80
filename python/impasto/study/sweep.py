"""Every setting on every data set, what is not yet known first to last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from impasto.errors import ArgumentError
from impasto.simulate.fields import check_seed
from impasto.study import parts
from impasto.study.bound import normal_bound
from impasto.study.measure import compared, lobes_of, timed
from impasto.study.record import TERMS, Journal, run_info
from impasto.study.settings import Setting, settings
from impasto.study.specimens import FULL, QUICK, Sizes, Specimen, digests, specimens

Advance = Callable[[int, int, str], None]
"""Told before every run: (done, total, what comes)."""


def run(
    out: Path,
    *,
    data: Path | None = None,
    quick: bool = False,
    knobs: Sequence[str] | None = None,
    sizes: Sizes | None = None,
    seed: int = 0,
    threads: int | None = None,
    repeats: int = 2,
    advance: Advance = lambda done, total, name: None,
) -> dict[str, Any]:
    """Measure whatever is not yet measured in a folder.

    Errors depend on nothing but data, seed and code: two runs give the same, bit for bit. Costs
    are the least of ``repeats`` runs.

    Parameters
    ----------
    out
        Folder of the journal; a study that was interrupted goes on there. On another machine, with
        other threads, repeats or data everything is timed anew: times are never mixed.
    data
        Folder of real photographs and of measured materials; None: simulated data only.
    quick
        Few settings on small data, in less than two minutes.
    knobs
        Only settings of these; None: of all.
    sizes
        In pixels; default: as ``quick`` says.
    seed
        Of paintings, noise and random choices.
    threads
        None means every allowed core.
    repeats
        How often every fit is timed at least; fits of milliseconds are timed more often, for 0.4 s
        per repeat but the first.
    advance
        Called before every run.

    Returns
    -------
    dict
        ``run`` (machine, commit, seed, sizes), ``missing`` (data sets and why), ``skipped``
        (peers that are not installed, pixels that there are none of), ``failed`` (fits that ended
        in an error; tried again by the next run), ``rows``.

    Raises
    ------
    ArgumentError
        A folder that holds another study, no folder of data, or a number that makes no sense.
    """
    if not (isinstance(repeats, int) and repeats >= 1):
        raise ArgumentError(f"repeats: expected at least 1, found {repeats!r}")
    check_seed(seed)
    sizes = sizes or (QUICK if quick else FULL)
    made, missing = specimens(sizes, seed, data)
    info = run_info() | {"seed": seed, "quick": quick, "sizes": asdict(sizes)}
    info |= {"threads": threads, "repeats": repeats, "data": digests(data)}
    journal = Journal(out, {"run": info, "missing": missing}, TERMS)
    chosen = [s for s in settings(quick=quick) if knobs is None or s.knob in knobs]
    jobs = [(name, setting) for name in made for setting in chosen if name in setting.on]
    specimen: Specimen | None = None
    for done, (name, setting) in enumerate(jobs):
        advance(done, len(jobs), f"{name}: {setting.name}")
        if "failed" not in journal.runs.get((name, setting.knob, setting.name), {"failed": ""}):
            continue
        if specimen is None or specimen.name != name:
            specimen = made[name]()
        journal.add(_measured(setting, specimen, seed, threads, repeats))
    advance(len(jobs), len(jobs), "")
    return journal.found()


def _measured(
    setting: Setting, specimen: Specimen, seed: int, threads: int | None, repeats: int
) -> dict[str, Any]:
    row: dict[str, Any] = {
        "data": specimen.name,
        "knob": setting.knob,
        "setting": setting.name,
        "number": setting.number,
        "options": setting.options,
    }
    try:
        part = setting.part(specimen)
        stack = setting.prepare(part.stack, seed)
        fitted, cost = timed(lambda: setting.fit(stack, threads), part.megapixels, repeats)
        if setting.knob == "lights" and part.truth is not None:
            row["bound"] = normal_bound(part.truth, stack.rig)
        row |= {"share": part.share, "lobes": lobes_of(fitted)}
        return row | {"cost": asdict(cost), "error": asdict(compared(fitted, part))}
    except parts.NoPixelsError as error:
        return row | {"skipped": str(error)}
    except Exception as error:
        if setting.peer and isinstance(error, ImportError):
            return row | {"skipped": str(error)}
        # Whatever a fit of ours refuses here it should have made: the others go on, and it shows.
        return row | {"failed": f"{type(error).__name__}: {error}"}

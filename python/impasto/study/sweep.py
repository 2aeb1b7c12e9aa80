"""Every setting on every data set, what is not yet known first to last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from impasto.errors import ArgumentError, GeometryError
from impasto.simulate.fields import check_seed
from impasto.study.bound import normal_bound
from impasto.study.measure import compared, timed
from impasto.study.record import Journal, run_info
from impasto.study.settings import Setting, settings
from impasto.study.specimens import FULL, QUICK, Sizes, Specimen, specimens
from impasto.suggest import every, thinned

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
        Folder of the journal; a study that was interrupted goes on there.
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
        How often every fit is timed.
    advance
        Called before every run.

    Returns
    -------
    dict
        ``run`` (machine, commit, seed, sizes), ``missing`` (data sets and why), ``skipped``
        (settings and why), ``rows``.

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
    terms = ("commit", "impasto", "simd", "seed", "quick", "sizes")
    journal = Journal(out, {"run": info | {"threads": threads}, "missing": missing}, terms)
    chosen = [s for s in settings(quick=quick) if knobs is None or s.knob in knobs]
    jobs = [(name, setting) for name in made for setting in chosen if name in setting.on]
    specimen: Specimen | None = None
    for done, (name, setting) in enumerate(jobs):
        advance(done, len(jobs), f"{name}: {setting.name}")
        if (name, setting.knob, setting.name) in journal.runs:
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
    part = strided(specimen, setting.stride)
    stack = setting.prepare(part.stack, seed)
    try:
        fitted, cost = timed(lambda: setting.fit(stack, threads), part.megapixels, repeats)
    except (ImportError, GeometryError) as error:
        # A peer that is not installed; lights that are too few.
        return row | {"skipped": str(error)}
    if setting.knob == "lights" and part.truth is not None:
        row["bound"] = normal_bound(part.truth, stack.rig)
    return row | {"cost": asdict(cost), "error": asdict(compared(fitted, part))}


def strided(specimen: Specimen, stride: int) -> Specimen:
    """Every so many pixels of a specimen along both axes."""
    if stride == 1:
        return specimen
    normal = specimen.normal
    window = every(specimen.stack.shape[2:], stride)
    return replace(
        specimen,
        stack=thinned(specimen.stack, stride),
        held=specimen.held[window],
        normal=None if normal is None else normal[window],
    )

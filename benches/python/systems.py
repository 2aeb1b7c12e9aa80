"""The papers' procedures beside impasto's own, on their own photographs.

    python benches/python/systems.py [--size N] [--seeds N] [--write]

Simulated paintings under satin varnish, photographed by each paper's camera and lights with noise,
12 bits and clipping, are measured as the paper has it and as impasto does, and compared with what
they were made from. ``forms``: the gloss with the factor of eq. 10 / eq. 6 as printed and as eq. 9
/ eq. 1 has it, from all angles and from the peak region. ``highlights``: Snel's system with
overexposed highlights reconstructed and left out. ``--write`` records benches/results/systems.json
and sets the tables of docs/systems.md. Lower is better everywhere.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

from impasto import simulate, systems

PAPERS = {
    "tominaga-rgb-camera": "9 lights, RGB",
    "tominaga-six-band-adaptation": "16 lights, six bands",
}

FORMS = {
    "as printed": {"extraction": "printed"},
    "as in the model": {"extraction": "papers"},
}
REGIONS = {"all angles": False, "the peak": True}

SNEL = "snel-lafortune"
SMALL = 64
"""Pixels of a side of Snel's paintings: 770 photographs."""


def measured(name: str, capture: simulate.Capture) -> dict[str, float]:
    """One procedure against the truth; beta and gamma in percent, with sign."""
    system = systems.get(name)
    sbrdf, reflectance = system.measure(capture.stack, capture.truth.camera)
    score = simulate.score(capture.truth, sbrdf, reflectance)
    return {
        "normal deg": score.normal_mean,
        "normal p95": score.normal_p95,
        "spectral RMSE": score.reflectance_rmse,
        "dE00 D65": score.colour_mean["D65"],
        "dE00 A": score.colour_mean["A"],
        "beta %": 100.0 * score.beta,
        "gamma %": 100.0 * score.gamma,
    }


def summary(each: list[dict[str, float]]) -> dict[str, float]:
    """Means over the paintings; of beta and gamma the worst."""
    found = {}
    for key in each[0]:
        values = [one[key] for one in each]
        worst = max(values, key=abs)
        found[key] = worst if key in {"beta %", "gamma %"} else float(np.mean(values))
    return found


def rows(captures: dict[str, list[simulate.Capture]]) -> list[dict[str, Any]]:
    """The papers' procedures and impasto's."""
    table = []
    for rig, words in PAPERS.items():
        for name in (rig, "impasto"):
            each = [measured(name, capture) for capture in captures[rig]]
            table.append({"photographs": words, "measured by": name} | summary(each))
    return table


def forms(captures: dict[str, list[simulate.Capture]]) -> list[dict[str, Any]]:
    """The gloss of each paper's normals and colours, by both factors and regions."""
    table = []
    for rig, words in PAPERS.items():
        start = [(c, systems.get(rig).fit_normals(c.stack)) for c in captures[rig]]
        for form, options in FORMS.items():
            for region, peak in REGIONS.items():
                system = replace(systems.get(rig), peak=peak, **options)
                each = []
                for capture, normals in start:
                    found = system.fit_sbrdf(capture.stack, normals)
                    score = simulate.score(capture.truth, found)
                    relative = {"beta %": 100.0 * score.beta, "gamma %": 100.0 * score.gamma}
                    each.append({"beta": found.beta, "gamma mrad": 1e3 * found.gamma} | relative)
                own = system == systems.get(rig)
                head = {"photographs": words, "factor": form, "angles": region}
                table.append(head | {"named": "yes" if own else ""} | summary(each))
    return table


def highlights(seeds: range) -> list[dict[str, Any]]:
    """Snel's system: reconstructed and censored, under two varnishes.

    ``all %`` and ``clipped %``: root mean square error of the predicted photographs, of all samples
    and of those that were clipped, against photographs without noise and clipping, in per cent of
    the same samples' root mean square.
    """
    table = []
    for varnish in ("satin", "gloss"):
        paintings = [simulate.painting(seed, (SMALL, SMALL), varnish=varnish) for seed in seeds]
        shots = []
        for painting in paintings:
            options = simulate.cameras.CAMERA_OPTIONS[SNEL]
            capture = simulate.capture(painting, SNEL, **options)
            clean = simulate.capture(painting, SNEL, noise=False, bits=None, exposure=1e-2)
            shots.append((capture, clean.stack))
        for name in ("reconstructed", "censored"):
            each = []
            for capture, clean in shots:
                sbrdf, _ = replace(systems.get(SNEL), highlights=name).measure(capture.stack)
                score = simulate.score(capture.truth, sbrdf)
                each.append(
                    {"normal deg": score.normal_mean, "normal p95": score.normal_p95}
                    | predicted(capture, clean, sbrdf)
                )
            table.append({"varnish": varnish, "highlights": name} | summary(each))
    return table


def predicted(capture: simulate.Capture, clean: Any, sbrdf: Any) -> dict[str, float]:
    """Errors of the photographs that the fit expects."""
    sums = np.zeros((2, 2))
    clipped = 0.0
    for index in range(len(clean.rig)):
        true = clean.linear(index).astype(np.float64)
        error = sbrdf.predict(clean.rig.take([index]))[0] - true
        over = np.isinf(capture.stack.linear(index))
        clipped += float(over.any(axis=0).mean()) / len(clean.rig)
        for row, part in enumerate((np.ones_like(over), over)):
            sums[row] += (error[part] ** 2).sum(), (true[part] ** 2).sum()
    every, there = (100.0 * float(np.sqrt(top / bottom)) for top, bottom in sums)
    return {"share clipped %": 100.0 * clipped, "all %": every, "clipped %": there}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=192, help="pixels of a side")
    parser.add_argument("--seeds", type=int, default=3, help="paintings per row")
    parser.add_argument("--write", action="store_true", help="record the results")
    options = parser.parse_args()
    seeds, size = range(options.seeds), (options.size, options.size)
    captures = {
        rig: [simulate.default_capture(rig, seed=seed, size=size) for seed in seeds]
        for rig in PAPERS
    }
    tables = {
        "rows": rows(captures),
        "forms": forms(captures),
        "highlights": highlights(seeds),
    }
    for title, table in tables.items():
        show(title, table)
    if options.write:
        command = "python benches/python/systems.py"
        run = run_info(f"{command} --size {options.size} --seeds {options.seeds} --write")
        write("systems.json", {"run": run} | tables)
        set_tables(ROOT / "docs" / "systems.md")


if __name__ == "__main__":
    main()

"""The papers' procedures beside impasto's own, on their own photographs.

    python benches/python/systems.py [--size N] [--seeds N] [--write]

Simulated paintings under satin varnish, photographed by each paper's camera and lights with noise,
12 bits and clipping, are measured as the paper has it and as impasto does, and compared with what
they were made from. ``--write`` records benches/results/systems.json and sets the table of
docs/systems.md. Lower is better everywhere.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

from impasto import simulate, systems

PAPERS = {
    "tominaga-rgb-camera": "9 lights, RGB",
    "tominaga-six-band-adaptation": "16 lights, six bands",
}


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


def rows(seeds: range, size: int) -> list[dict[str, Any]]:
    """Means over the paintings; of beta and gamma the worst."""
    table = []
    for rig, words in PAPERS.items():
        captures = [simulate.default_capture(rig, seed=seed, size=(size, size)) for seed in seeds]
        for name in (rig, "impasto"):
            each = [measured(name, capture) for capture in captures]
            row: dict[str, Any] = {"photographs": words, "measured by": name}
            for key in each[0]:
                values = [one[key] for one in each]
                worst = max(values, key=abs)
                row[key] = worst if key.endswith("%") else float(np.mean(values))
            table.append(row)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=192, help="pixels of a side")
    parser.add_argument("--seeds", type=int, default=3, help="paintings per row")
    parser.add_argument("--write", action="store_true", help="record the results")
    options = parser.parse_args()
    table = rows(range(options.seeds), options.size)
    show("systems", table)
    if options.write:
        command = "python benches/python/systems.py"
        run = run_info(f"{command} --size {options.size} --seeds {options.seeds} --write")
        write("systems.json", {"run": run, "rows": table})
        set_tables(ROOT / "docs" / "systems.md")


if __name__ == "__main__":
    main()

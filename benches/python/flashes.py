"""How many normals gross outliers mislead, such as a flash or an insect: Lafortune lobes.

    python benches/python/flashes.py [--record]

Three simulated paintings of 12 x 14 pixels with patches of varnish, photographed with all 770 pairs
of light and view of the third paper, or with every seventh. In every pixel some photographs, other
ones in each, show a flash. A normal is misled where its error exceeds both 0.1 degrees and three
times that without flashes. ``--record`` writes benches/results/flashes.json and sets the table of
docs/models.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto import simulate
from impasto.simulate.score import normal_error

SIZE = (12, 14)
SEEDS = (7, 8, 9)
CASES = (
    # Photographs (every so many of 770), the light of a flash, flashes in each pixel.
    (1, 5.0, 10),
    (7, 5.0, 3),
    (7, 5.0, 5),
    (7, 5.0, 7),
    (7, 2.0, 3),
    (1, 2.0, 3),
)
"""Paint is 0.1 to 0.6, highlights reach 2."""


def errors(samples: np.ndarray, rig: impasto.Rig, normal: Any) -> np.ndarray:
    """Degrees, of every pixel."""
    fit = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig), model="lafortune", threads=1)
    return np.asarray(normal_error(fit.normal, normal))


def misled(seed: int, cases: list[tuple[int, float, int]]) -> list[int]:
    """Normals that flashes mislead, for cases of the same photographs."""
    capture = simulate.capture(simulate.painting(seed, SIZE, varnish="patches"), "snel-lafortune")
    every = cases[0][0]
    some = capture.stack.take(range(0, 770, every))
    clean = np.array([some.linear(i) for i in range(len(some.rig))], np.float32)
    before = errors(clean, some.rig, capture.truth.normal)
    found = []
    for _, light, count in cases:
        rng = np.random.default_rng(count)
        spoiled = clean.copy()
        for y, x in np.ndindex(SIZE):
            spoiled[rng.choice(len(clean), count, replace=False), :, y, x] = light
        after = errors(spoiled, some.rig, capture.truth.normal)
        # A normal that is lost is misled, too.
        found.append(int((~(after <= np.maximum(3.0 * before, 0.1))).sum()))
    return found


def rows() -> list[dict[str, Any]]:
    """A row for each case: the paintings with fewest and most misled normals."""
    counts: dict[tuple[int, float, int], list[int]] = {case: [] for case in CASES}
    for every in (1, 7):
        cases = [case for case in CASES if case[0] == every]
        for seed in SEEDS:
            for case, count in zip(cases, misled(seed, cases), strict=True):
                counts[case].append(count)
    return [
        {
            "photographs": len(range(0, 770, every)),
            "light": light,
            "flashes": count,
            "least": min(counts[every, light, count]),
            "most": max(counts[every, light, count]),
            "normals": SIZE[0] * SIZE[1],
        }
        for every, light, count in CASES
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    table = rows()
    show("Normals that flashes mislead", table)
    if options.record:
        run = run_info("python benches/python/flashes.py --record")
        write("flashes.json", {"run": run, "rows": table})
        set_tables(ROOT / "docs" / "models.md")


if __name__ == "__main__":
    main()

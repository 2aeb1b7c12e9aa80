"""How far estimated strengths of lamps are off: ``impasto.fit_strengths(gauge="free")``.

    python benches/python/strength_errors.py [--record]

Six simulated paintings of 48 x 48 pixels with a satin varnish, in three bands with the noise of a
sensor, under spirals of 24, 12 and 8 lamps. Their strengths are all the same, or scatter by 0.3
(standard deviation of the logarithm). The worst factor of each painting, over the median of all
lamps, less the true one. ``--record`` writes benches/results/strength_errors.json and sets the
table of docs/models.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from gloss_errors import spiral
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto import simulate

SIZE = (48, 48)
SEEDS = range(1, 7)
LAMPS = (24, 12, 8)
SCATTER = 0.3


def worst(seed: int, lamps: int, scatter: float) -> float:
    """The largest error of a factor, in per cent."""
    rng = np.random.default_rng(seed)
    strength = np.exp(scatter * rng.standard_normal(lamps))
    rig = impasto.Rig(
        [
            impasto.DistantLight(tuple(direction), intensity=float(one))
            for direction, one in zip(spiral(lamps).directions.tolist(), strength, strict=True)
        ]
    )
    painting = simulate.painting(seed, SIZE, varnish="satin")
    stack = simulate.capture(painting, rig, "rgb", seed=seed).stack
    even = stack._replace(rig=spiral(lamps))
    found = impasto.fit_strengths(even, gauge="free", threads=1).factor
    ratio = (found / np.median(found)) / (strength / np.median(strength))
    # The overall strength is nobody's error.
    return float(100.0 * np.abs(ratio / np.median(ratio) - 1.0).max())


def rows() -> list[dict[str, Any]]:
    """A row for each number of lamps, with strengths that scatter and that do not."""
    found = []
    for lamps in LAMPS:
        row: dict[str, Any] = {"lamps": lamps}
        for name, scatter in (("scattered", SCATTER), ("even", 0.0)):
            errors = [worst(seed, lamps, scatter) for seed in SEEDS]
            row |= {f"{name} least": min(errors), f"{name} most": max(errors)}
        found.append(row)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    table = rows()
    show("Worst factor of a painting, %", table)
    if options.record:
        run = run_info("python benches/python/strength_errors.py --record")
        write("strength_errors.json", {"run": run, "rows": table})
        set_tables(ROOT / "docs" / "models.md")


if __name__ == "__main__":
    main()

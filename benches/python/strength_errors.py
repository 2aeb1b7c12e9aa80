"""How far estimated strengths of lamps are off: ``impasto.fit_strengths(gauge="free")``.

    python benches/python/strength_errors.py [--data DIR] [--record]

Six simulated paintings of 48 x 48 pixels with a satin varnish, in three bands with the noise of a
sensor, under spirals of 24, 12 and 8 lamps. Their strengths are all the same, or scatter by 0.3
(standard deviation of the logarithm). The worst factor of each painting, over the median of all
lamps, less the true one. *Rounds*: by how much the rounds of medians that follow bundle adjustment
lower the trimmed error of photographs held out, on these paintings and on photographs of a gilded
icon (every stride-th row and column). ``--record`` writes benches/results/strength_errors.json and
sets the tables of docs/models.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from gloss_errors import spiral
from pages import set_tables
from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto import simulate
from impasto.fit import strengths
from impasto.fit.subsample import subsampled

SIZE = (48, 48)
SEEDS = range(1, 7)
LAMPS = (24, 12, 8)
SCATTER = 0.3


class Recorded(strengths._Search):
    """A search that keeps what the rounds of medians changed."""

    falls: list[float] = []  # noqa: RUF012  # one list for all searches

    def _judged(self, *given: Any) -> Any:
        found = super()._judged(*given)
        self._pair = [*getattr(self, "_pair", []), found]
        if len(self._pair) == 2:  # before the rounds, after them
            before, after = self._pair
            self.falls.append(100.0 * after.errors.than(before.errors).fall)
            self._pair = []
        return found


def simulated(seed: int, lamps: int, scatter: float) -> tuple[impasto.Stack, np.ndarray]:
    """Photographs whose lamps are said to be alike, and their strengths."""
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
    return stack._replace(rig=spiral(lamps)), strength


def worst(seed: int, lamps: int, scatter: float) -> float:
    """The largest error of a factor, in per cent."""
    stack, strength = simulated(seed, lamps, scatter)
    found = impasto.fit_strengths(stack, gauge="free", threads=1).factor
    ratio = (found / np.median(found)) / (strength / np.median(strength))
    # The overall strength is nobody's error.
    return float(100.0 * np.abs(ratio / np.median(ratio) - 1.0).max())


def by_rounds(name: str, gauge: str, stacks: list[impasto.Stack]) -> dict[str, Any]:
    """What rounds of medians are worth to some photographs, in per cent of the trimmed error."""
    before = len(Recorded.falls)
    for stack in stacks:
        impasto.fit_strengths(stack, gauge=gauge, threads=1)
    falls = Recorded.falls[before:]
    numbers = {"searches": len(falls), "least": min(falls), "most": max(falls)}
    return {"photographs": name, "gauge": gauge, **numbers}


def rounds(data: Path) -> list[dict[str, Any]]:
    """A row for either gauge, of the paintings and of the icon."""
    kept, strengths._Search = strengths._Search, Recorded  # type: ignore[misc]
    try:
        paintings = [simulated(seed, lamps, SCATTER)[0] for seed in (1, 2) for lamps in LAMPS]
        icon = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
        stacks = {
            "gilded icon, 72 lamps": [subsampled(icon, stride) for stride in (3, 7)],
            "simulated paintings, 8 to 24 lamps": paintings,
        }
        return [
            by_rounds(name, gauge, some)
            for name, some in stacks.items()
            for gauge in ("held", "free")
        ]
    finally:
        strengths._Search = kept  # type: ignore[misc]


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
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    helped = rounds(options.data)
    show("Trimmed error less by rounds of medians, %", helped)
    table = rows()
    show("Worst factor of a painting, %", table)
    if options.record:
        run = run_info("python benches/python/strength_errors.py --record")
        write("strength_errors.json", {"run": run, "rows": table, "rounds": helped})
        set_tables(ROOT / "docs" / "models.md")


if __name__ == "__main__":
    main()

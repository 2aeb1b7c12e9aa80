"""Whether `suggest_effort` predicts errors and times, on stacks that no setting was tuned on.

    python benches/python/suggestions.py [--data DIR] [--stacks 20] [--record]

Twenty simulated paintings and the icon. Their seeds, varnishes, reliefs, sizes and lights are
neither those of the study nor of the twenty (seeds from 1000) by which
`impasto.study.trials.HELD_OUT` was chosen. One photograph in five is held out from the suggestion
and from the fit. The requested error is the geometric mean of the least and the largest error of
the trials, and so is the requested time: neither the first nor the last setting meets both. The
suggested fit is then run on the whole stack. A request is met within 15 %; `ratio` is result /
prediction, 1 is best; `took` is the time of the suggestion itself in seconds.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from record import data_folder, run_info, show, write

import impasto
from impasto import simulate
from impasto.study.relative_error import full_scale, relative_error
from study.data_sets import dome

FIRST_SEED, HELD, SLACK, ROUNDS = 2000, 5, 1.15, 3
VARNISHES = ("patches", "satin", "gloss", "matte")
ICON = 160
"""Pixels of the icon's edge."""


def stacks(count: int, data: Path) -> Iterator[tuple[str, impasto.Stack]]:
    """Names and photographs."""
    for number in range(count):
        rng = np.random.default_rng(FIRST_SEED + number)
        edge, lights = int(rng.integers(64, 129)), int(rng.integers(24, 73))
        varnish: Any = VARNISHES[number % len(VARNISHES)]
        scene = simulate.painting(
            FIRST_SEED + number, (edge, edge), varnish=varnish, relief=float(rng.uniform(0.5, 2.0))
        )
        photographs = simulate.capture(
            scene, impasto.Rig(dome(lights)), "rgb", shadows=bool(number % 3 == 0),
            seed=FIRST_SEED + number,
        )  # fmt: skip
        yield f"{number + 1}: {edge} pixels, {lights} lights, {varnish}", photographs.stack
    if (data / "icon_rti" / "dirs.lp").is_file():
        yield "icon", window(impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb"))


def window(stack: impasto.Stack) -> impasto.Stack:
    """The middle."""
    top, left = ((size - ICON) // 2 for size in stack.shape[2:])
    return impasto.Stack(
        stack.samples[:, :, top : top + ICON, left : left + ICON], lights=stack.rig,
        bands=stack.bands, saturation=stack.saturation, scale=stack.scale, black=stack.black,
        encoding=stack.encoding,
    )  # fmt: skip


def checked(
    stack: impasto.Stack, requests: tuple[str, ...] = ("error", "seconds")
) -> dict[str, float | bool]:
    """Requested and reached error and time, whether they are met, ratios to the predictions."""
    held = np.arange(HELD // 2, len(stack.rig), HELD)
    known = stack.take(np.setdiff1d(np.arange(len(stack.rig)), held))
    shown = stack.take(held)
    truth = np.array([shown.linear(i) for i in range(len(held))])
    start = time.perf_counter()
    tried = impasto.suggest_effort(known, error=1e-9).tried
    took = time.perf_counter() - start

    def middle(values: list[float]) -> float:
        return math.sqrt(min(values) * max(values))

    requested = {
        "error": middle([trial.error for trial in tried]),
        "seconds": middle([trial.seconds for trial in tried]),
    }
    row: dict[str, float | bool] = {"took": took}
    for what in requests:
        value = requested[what]
        suggestion = impasto.suggest_effort(known, **{what: value})
        seconds = []
        for _ in range(ROUNDS if what == "seconds" else 1):
            start = time.perf_counter()
            fitted = impasto.fit_sbrdf(known, **suggestion.options)
            seconds.append(time.perf_counter() - start)
        reached = min(seconds)
        if what == "error":
            reached = relative_error(fitted.predict(shown.rig), truth, full_scale(stack))
        predicted = suggestion.error if what == "error" else suggestion.seconds
        row |= {
            f"{what} requested": value,
            f"{what} reached": reached,
            f"{what} met": bool(reached <= SLACK * value),
            f"{what} ratio": reached / predicted,
        }
    return row


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """How many are met, and how near the predictions are."""
    found = []
    for what in ("error", "seconds"):
        ratios = sorted(row[f"{what} ratio"] for row in rows)
        found.append(
            {
                "requested": what,
                "met": f"{sum(row[f'{what} met'] for row in rows)} of {len(rows)}",
                "least": ratios[0],
                "median": ratios[len(ratios) // 2],
                "largest": ratios[-1],
            }
        )
    return found


def sentences(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Which were not met, and what suggestions took, for documentation."""
    missed = {
        what: [row["stack"].split(": ")[-1] for row in rows if not row[f"{what} met"]]
        for what in ("error", "seconds")
    }
    said = [f"{what} on {'; '.join(names)}" for what, names in missed.items() if names]
    took = sorted(row["took"] for row in rows)
    return {
        "missed": f"Not met: {'. '.join(said)}." if said else "It was met everywhere.",
        "took": f"The suggestion itself took {took[0]:.1f} to {took[-1]:.1f} s.",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--stacks", type=int, default=20)
    parser.add_argument("--record", action="store_true", help="benches/results/suggestions.json")
    options = parser.parse_args()
    rows = []
    for name, stack in stacks(options.stacks, options.data):
        rows.append({"stack": name} | checked(stack))
        print(rows[-1], flush=True)
    show("suggest_effort", rows)
    show("all of them", summary(rows))
    if options.record:
        info = run_info("python benches/python/suggestions.py --record")
        write(
            "suggestions.json",
            {"run": info, "rows": rows, "summary": summary(rows), "sentences": sentences(rows)},
        )


if __name__ == "__main__":
    main()

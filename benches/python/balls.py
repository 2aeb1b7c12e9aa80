"""Lamps from mirror balls: published data and simulated balls.

    python benches/python/balls.py [--data DIR] [--record]

Directions of the data set two_balls (12 lamps) against the published ones, and of simulated balls
(``tests/oracles/mirror_ball.py``, seed 5) against the truth. Positions of eight near lamps from
two simulated balls 600 pixels apart, at distances of 1, 1.5 and 3 times that, as shares of the
distance, and their directions from the middle between the balls. ``--record`` writes
benches/results/balls.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, data_folder, run_info, show, write

from impasto.calibrate import (
    BallCamera,
    BallPhotographs,
    lamp_positions,
    lights_from_balls,
    read_balls,
)

sys.path.insert(0, str(ROOT / "tests"))

from oracles import mirror_ball

SEED = 5
NOISE = 0.001


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def row(case: str, off: np.ndarray, said: np.ndarray | None) -> dict[str, Any]:
    predicted = None if said is None else float(np.degrees(np.sqrt(np.square(said).mean())))
    return {"case": case, "mean": float(off.mean()), "worst": float(off.max()), "said": predicted}


def published(data: Path) -> list[dict[str, Any]]:
    folder = data / "two_balls"
    each = [np.loadtxt(folder / f"LightProbe-{k}" / "light_directions.txt").T for k in (1, 2)]
    both = np.loadtxt(folder / "light_directions.txt").T
    given = read_balls(folder, circles="circle_data.txt").balls
    median = lights_from_balls(given, rule="median")
    rows = [
        row("two_balls, published rule and circles, each ball",
            degrees(median.single, np.array(each)), None)
    ]  # fmt: skip
    for name, balls in (("circles given", given), ("outlines found", read_balls(folder).balls)):
        found = lights_from_balls(balls)
        rows.append(row(f"two_balls, {name}, each ball", degrees(found.single, each), None))
        rows.append(
            row(f"two_balls, {name}, both balls", degrees(found.directions, both), found.sigma)
        )
        print(f"two_balls, {name}: {found.verdict}")
    return rows


def simulated() -> list[dict[str, Any]]:
    noise, rows = np.random.default_rng(SEED), []
    for radius in (50.0, 100.0, 200.0):
        size = (int(2.6 * radius), int(2.8 * radius))
        turn, sine = noise.uniform(0, 2 * np.pi, 8), noise.uniform(0.2, 0.8, 8)
        truth = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1 - sine**2)], axis=1)
        ball = np.array([0.063 * radius, -0.046 * radius, 0.0])
        glow = 0.04 * radius
        pictures = [
            mirror_ball.photograph(ball, radius, [1e7 * lamp], size, glow=glow) for lamp in truth
        ]
        codes = np.clip(np.array(pictures) + noise.normal(0, NOISE, (8, *size)), 0, 1)
        found = lights_from_balls([BallPhotographs(codes, "ball", full=1.0)])
        off = degrees(found.directions, truth)
        rows.append(row(f"simulated ball, radius {radius:.0f} pixels", off, found.sigma))
    return rows


def positions() -> list[dict[str, Any]]:
    """Crops of two balls on a plane, 600 pixels apart."""
    noise, rows = np.random.default_rng(SEED), []
    turn, sine = noise.uniform(0, 2 * np.pi, 8), noise.uniform(0.2, 0.7, 8)
    towards = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1 - sine**2)], axis=1)
    for radius in (50.0, 100.0):
        side = int(2.6 * radius)
        for times in (1.0, 1.5, 3.0):
            lamps = 600.0 * times * towards
            balls = []
            for number, x in enumerate((-300.0, 300.0), 1):
                offset = np.array([0.063 * radius, -0.046 * radius, radius])
                crop = [
                    mirror_ball.photograph(
                        offset, radius, [lamp - (x, 0.0, 0.0)], (side, side), glow=0.04 * radius
                    )
                    for lamp in lamps
                ]
                codes = np.clip(np.array(crop) + noise.normal(0, NOISE, (8, side, side)), 0, 1)
                corner = (x - (side - 1) / 2, -(side - 1) / 2)
                balls.append(BallPhotographs(codes, f"ball {number}", corner, full=1.0))
            found = lights_from_balls(balls).from_middle(BallCamera())
            places = lamp_positions(found, 2.0 * radius)
            far = np.linalg.norm(lamps, axis=1)
            off = np.linalg.norm(places.mm - lamps, axis=1) / far
            rows.append(
                {
                    "radius": round(radius),
                    "times": times,
                    "mean": 100.0 * float(off.mean()),
                    "worst": 100.0 * float(off.max()),
                    "said": 100.0 * float(np.sqrt(np.square(places.sigma / far).mean())),
                    "degrees": float(degrees(found.directions, towards).max()),
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true", help="write benches/results/balls.json")
    options = parser.parse_args()
    found = published(options.data) + simulated()
    show("directions from mirror balls, degrees", found)
    near = positions()
    show("positions from two balls, % of the distance", near)
    if options.record:
        head = {"run": run_info("python benches/python/balls.py --record"), "seed": SEED}
        print(f"\nwrote {write('balls.json', head | {'rows': found, 'positions': near})}")


if __name__ == "__main__":
    main()

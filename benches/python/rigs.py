"""What refining a rig is worth: normals of simulated paintings, photographs held out.

    python benches/python/rigs.py [--data DIR] [--seeds N] [--only PART] [--jobs N] [--record]

Simulated: paintings of 96 x 96 pixels under 48 lamps, a spiral from 74 to 12 degrees, photographed
with a camera and lamps at finite distances (in halves of the side) and strengths drawn evenly from
0.5 to 1.5, coded as sRGB in 8 bits. Their rig is given as distant, frontal and even, and refined by
``impasto.refine_rig``. "known" is the error of the normals with the rig as it was simulated.
Strengths of new lamps: domes of known strengths without painting, every sixth lamp left out.
Photographs: the icon and the object between the two balls, six folds; "agreement" is the mean
angle between normals fitted to the even and to the odd photographs. ``--record`` writes
benches/results/rigs.json, ``--only`` its part alone. All predictions are those of the model,
without interpolated residuals: rigs are compared. Distances of None are infinite.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from record import RESULTS, data_folder, run_info, show, write

import impasto
from impasto import simulate
from impasto._internal.thin_plate import over_directions, thin_plate
from impasto.fit.subsample import subsampled
from impasto.simulate.score import normal_error

SIZE, LAMPS, FOLDS = 96, 48, 6
VARNISHES = ("gloss", "satin", "matte")
FAR = np.inf
SCENES: list[tuple[float, float, float]] = [
    *((distance, FAR, 0.0) for distance in (FAR, 10.0, 5.0, 3.0, 2.0)),
    (FAR, 4.0, 0.0),
    (FAR, 2.0, 0.0),
    (FAR, FAR, 0.5),
    (3.0, 4.0, 0.5),
    (2.0, 2.0, 0.5),
]
"""Distance of the camera, distance of the lamps, and how far strengths are from 1."""
PHOTOGRAPHS = {"icon": ("icon_rti/dirs.lp", 7)}
"""Light file, and the stride of the sample."""


def dome(count: int, high: float = 0.96, low: float = 0.2) -> np.ndarray:
    """``(count, 3)`` directions on a spiral of equal steps in z."""
    z = np.linspace(high, low, count)
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def scene(
    seed: int, varnish: str, camera: float, lamps: float, uneven: float
) -> tuple[simulate.Capture, impasto.Rig]:
    """Photographs with their true rig, and the rig as a light file would give it."""
    painting = simulate.painting(seed, (SIZE, SIZE), varnish=varnish, pitch_mm=102.4 / SIZE)
    half = 0.5 * SIZE * painting.pitch_mm
    directions = dome(LAMPS)
    strength = np.random.default_rng(seed + 100).uniform(1.0 - uneven, 1.0 + uneven, LAMPS)
    lights = [
        impasto.DistantLight(tuple(d), float(s))
        if np.isinf(lamps)
        else impasto.PointLight(tuple(lamps * half * d), float(s))
        for d, s in zip(directions, strength, strict=True)
    ]
    view = None if np.isinf(camera) else impasto.PointView((0.0, 0.0, camera * half))
    rig = impasto.Rig(lights, views=view, pitch_mm=painting.pitch_mm)
    capture = simulate.capture(painting, rig, "rgb", encoding="srgb", bits=8, exposure=0.5)
    given = [impasto.DistantLight(tuple(d), 0.5) for d in directions]
    return capture, impasto.Rig(given, pitch_mm=painting.pitch_mm)


def simulated(case: tuple[int, str, float, float, float]) -> dict[str, Any]:
    """Errors of the normals of one painting, degrees, by rig."""
    seed, varnish, camera, lamps, uneven = case
    capture, given = scene(*case)
    stack, normal = capture.stack, capture.truth.normal
    blind = stack._replace(rig=given)
    start = time.process_time()
    refined = impasto.refine_rig(blind, threads=1)
    seconds = time.process_time() - start
    errors, means = {}, {}
    for name, rig in (("known", stack.rig), ("given", given), ("refined", refined)):
        found = impasto.fit_sbrdf(stack._replace(rig=rig), pooling="pixel", threads=1)
        fine = found.estimated
        mean = found.normal[:, fine].mean(axis=1, dtype=np.float64)
        means[name] = mean / np.linalg.norm(mean)
        errors[name] = float(np.nanmean(normal_error(found.normal, normal)))

    def between(one: str, other: str) -> float:
        return float(np.degrees(np.arccos(min(1.0, means[one] @ means[other]))))

    report = refined.refinement
    assert report is not None
    return {
        "varnish": varnish,
        "seed": seed,
        "camera": _finite(camera),
        "lamps": _finite(lamps),
        "uneven": uneven,
        **errors,
        "ratio": errors["refined"] / errors["known"],
        "camera found": _finite(report.camera.found) if report.camera.accepted else None,
        "lamps found": _finite(report.lamps.found) if report.lamps.accepted else None,
        "strengths": report.strengths.accepted,
        "open": report.open[0],
        "mean normal moved": between("given", "refined"),
        "mean normal off": between("known", "refined"),
        "gain dB": report.gain,
        "seconds": seconds,
    }


def _finite(distance: float) -> float | None:
    """Infinite distances as JSON has them."""
    return None if np.isinf(distance) else distance


def interpolated() -> list[dict[str, Any]]:
    """Root mean square error of the logarithm of strengths of lamps left out."""
    rows = []
    ring = np.concatenate([_ring(n, e) for n, e in ((4, 75), (8, 60), (12, 45), (16, 25), (20, 8))])
    for name, lamps in (("spiral 96", dome(96, 0.97, 0.05)), ("rings 60", ring)):
        for what, log in _strengths(lamps):
            errors: dict[str, list[np.ndarray]] = {"none": [], "over x, y": [], "stereographic": []}
            for fold in range(FOLDS):
                held = np.arange(len(lamps)) % FOLDS == fold
                seen, known, true = lamps[~held], log[~held], log[held]
                flat = thin_plate(seen[:, :2], known, lamps[held, :2])
                shown = {
                    "none": np.full(held.sum(), np.median(known)),
                    "over x, y": np.clip(flat, known.min(), known.max()),
                    "stereographic": over_directions(seen, known, lamps[held]),
                }
                for way, value in shown.items():
                    errors[way].append(value - true)
            rms = {k: float(np.sqrt(np.mean(np.concatenate(v) ** 2))) for k, v in errors.items()}
            rows.append({"dome": name, "strengths": what, **rms})
    return rows


def _ring(count: int, elevation: float) -> np.ndarray:
    turn, up = np.arange(count) * 2.0 * np.pi / count + 0.1 * elevation, np.radians(elevation)
    flat = np.cos(up) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.column_stack([flat, np.full(count, np.sin(up))])


def _strengths(lamps: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    yield "displaced dome", -2.0 * np.log(np.linalg.norm(lamps - (0.15, -0.1, 0.1), axis=1))
    yield "low lamps shaded", -0.3 * np.exp(-lamps[:, 2] / 0.12)
    turn = np.arctan2(lamps[:, 1], lamps[:, 0])
    yield "three arms", 0.2 * np.cos(3.0 * turn) * np.sqrt(1.0 - lamps[:, 2] ** 2)
    yield "scatter of 0.1", np.random.default_rng(1).normal(0.0, 0.1, len(lamps))


def photographs(name: str, stack: impasto.Stack) -> list[dict[str, Any]]:
    """Photographs held out, dB on coded values, and agreement of normals, by rig."""
    count = stack.shape[0]
    linear = np.array([np.nan_to_num(stack.linear(i), posinf=1.0) for i in range(count)])
    truth = np.rint(stack.encode(linear))
    scores: dict[str, list[np.ndarray]] = {}
    for fold in range(FOLDS):
        held = np.arange(fold, count, FOLDS)
        seen, new = stack.take(np.setdiff1d(np.arange(count), held)), stack.take(held).rig
        for way, (rig, lit) in _rigs(seen, new).items():
            surface = impasto.fit_sbrdf(seen._replace(rig=rig), pooling="pixel", threads=1)
            shown = stack.encode(np.nan_to_num(surface.predict(lit, fidelity="model")))
            error = (shown - truth[held]) ** 2
            if stack.mask is not None:
                error = error[:, :, stack.mask]
            mean = error.reshape(len(held), -1).mean(axis=1)
            scores.setdefault(way, []).append(10.0 * np.log10(stack.encoding.white**2 / mean))
    rows = []
    first: Any = None
    for way, (rig, _) in _rigs(stack, stack.rig).items():
        halves = [
            impasto.fit_sbrdf(stack._replace(rig=rig).take(range(half, count, 2)), pooling="pixel")
            for half in (0, 1)
        ]
        whole = impasto.fit_sbrdf(stack._replace(rig=rig), pooling="pixel")
        fine = whole.estimated & halves[0].estimated & halves[1].estimated
        between = normal_error(halves[0].normal, halves[1].normal)
        mean = whole.normal[:, fine].mean(axis=1, dtype=np.float64)
        mean /= np.linalg.norm(mean)
        first = mean if first is None else first
        each = np.concatenate(scores[way])
        rows.append(
            {
                "photographs": name,
                "rig": way,
                "mean dB": float(each.mean()),
                "worst dB": float(each.min()),
                "agreement": float(between[fine].mean()),
                "mean normal moved": float(np.degrees(np.arccos(min(1.0, mean @ first)))),
                "refinement": None if rig.refinement is None else str(rig.refinement),
            }
        )
    return rows


def _rigs(seen: impasto.Stack, new: impasto.Rig) -> dict[str, tuple[impasto.Rig, impasto.Rig]]:
    """The rig of photographs and that of new ones, by how the former was estimated."""
    lamps = impasto.fit_strengths(seen, threads=1)
    free = impasto.fit_strengths(seen, gauge="free", threads=1)
    refined = impasto.refine_rig(seen, threads=1)
    return {
        "as given": (seen.rig, new),
        "strengths, gauge free": (free.rig, free.at(new)),
        "strengths": (lamps.rig, lamps.at(new)),
        "refined": (refined, refined.at(new)),
    }


def two_balls(data: Path) -> impasto.Stack:
    """The object that stands between the two balls."""
    folder = data / "two_balls"
    return impasto.read_stack(
        folder / "Objects", lights=folder / "light_directions.txt", encoding="linear"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--seeds", type=int, default=1, help="paintings of each kind")
    parser.add_argument("--only", choices=("simulated", "interpolated", "photographs"))
    parser.add_argument("--jobs", type=int, default=1, help="simulated paintings at a time")
    parser.add_argument("--record", action="store_true", help="write benches/results/rigs.json")
    options = parser.parse_args()
    recorded = RESULTS / "rigs.json"
    parts = json.loads(recorded.read_text("utf-8")) if options.only and recorded.exists() else {}
    content: dict[str, Any] = {
        "run": run_info("python benches/python/rigs.py --record"),
        "seed": f"paintings 1 to {options.seeds}, strengths 100 more",
    }
    if options.only in (None, "interpolated"):
        content["interpolated"] = interpolated()
        show("strengths of lamps left out, rms error of the logarithm", content["interpolated"])
    if options.only in (None, "photographs"):
        content["photographs"] = []
        for name, (path, stride) in PHOTOGRAPHS.items():
            whole = impasto.read_stack(options.data / path, encoding="srgb")
            content["photographs"] += photographs(name, subsampled(whole, stride))
        balls = subsampled(two_balls(options.data), 5)
        content["photographs"] += photographs("two_balls", balls)
        show("photographs held out", content["photographs"])
    if options.only in (None, "simulated"):
        cases = [
            (seed, varnish, *one)
            for varnish in VARNISHES
            for one in SCENES
            for seed in range(1, options.seeds + 1)
        ]
        with ProcessPoolExecutor(options.jobs) as pool:
            rows = []
            for row in pool.map(simulated, cases):
                rows.append(row)
                print(row, flush=True)
        content["simulated"] = rows
        show("simulated paintings: mean error of normals, degrees", rows)
    if options.record:
        print(f"\nwrote {write('rigs.json', parts | content)}")


if __name__ == "__main__":
    main()

"""Lobes of every pixel: what they do for normals, and how long they take beside SciPy.

    python benches/python/lobes.py [--data DIR] [--record]

Normals, under 48 lights all around: a simulated painting with the relief's cast shadows and a
twentieth of the light coming from everywhere, and a hundred measured materials (materials.py).
Angles to the truth for each method of ``fit_normals`` and for ``fit_sbrdf``. Time: processor
seconds per million pixels and photographs on one thread against ``scipy.optimize.least_squares``
(trf, bounds, numerical derivatives, double precision) on the same model with two tinted lobes,
every unknown a parameter of its own, from one start; impasto's figure includes the search from all
of its starts.
``--record`` writes benches/results/lobes.json.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import materials
import numpy as np
from record import data_folder, run_info, show, write
from scipy.optimize import least_squares

import impasto
from impasto import simulate

SIZE = (96, 128)
SEED = 7
SCIPY_PIXELS = 12
METHODS = (
    "least-squares", "threshold", "rank", "trimmed", "l1", "huber", "cauchy", "tukey", "robust",
)  # fmt: skip


def rig(count: int = 48) -> impasto.Rig:
    """Lights on a spiral, 15 to 75 degrees from the zenith."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    z = np.linspace(np.cos(np.radians(15.0)), np.cos(np.radians(75.0)), count)
    side = np.sqrt(1.0 - z**2)
    return impasto.Rig(np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1))


def photographs() -> tuple[impasto.Stack, np.ndarray]:
    """A painting with shadows and ambient light, and its normals."""
    painting = simulate.painting(seed=SEED, size=SIZE)
    capture = simulate.capture(painting, rig(), "rgb", shadows=True, bits=None, clip=False)
    lit = np.asarray(capture.stack.samples) + 0.05 * np.asarray(capture.truth.diffuse)
    return impasto.Stack(lit.astype(np.float32), lights=rig()), np.asarray(capture.truth.normal)


def normals(stack: impasto.Stack, truth: np.ndarray) -> list[dict[str, Any]]:
    """Angles to the truth, degrees."""
    found = {method: impasto.fit_normals(stack, method=method).normal for method in METHODS}
    found["fit_sbrdf, painting"] = impasto.fit_sbrdf(stack, pooling="painting").normal
    found["fit_sbrdf, pixel"] = impasto.fit_sbrdf(stack, pooling="pixel").normal
    return [{"method": name, **summary(angles(normal, truth))} for name, normal in found.items()]


def measured(data: Path) -> list[dict[str, Any]]:
    """The same on measured materials: the painting's one lobe has no meaning there."""
    samples, truth = materials.photographs(data, rig().directions)
    stack = impasto.Stack(samples, lights=rig(), saturation=1.0)
    found = {method: impasto.fit_normals(stack, method=method).normal for method in METHODS}
    found["fit_sbrdf, pixel"] = impasto.fit_sbrdf(stack, pooling="pixel").normal
    each = {name: angles(normal, truth) for name, normal in found.items()}
    best = {name: np.nanmean(angle, axis=1) for name, angle in each.items()}
    return [
        {
            "method": name,
            **summary(angle),
            "worse than robust on": int((best[name] > best["robust"]).sum()),
        }
        for name, angle in each.items()
    ]


def angles(normal: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """``(y, x)`` degrees."""
    across = np.linalg.norm(np.cross(normal, truth, axis=0), axis=0)
    return np.degrees(np.arctan2(across, (normal * truth).sum(axis=0)))


def summary(angle: np.ndarray) -> dict[str, float]:
    """Of the pixels that are estimated."""
    known = angle[np.isfinite(angle)]
    return {
        "median deg": float(np.median(known)),
        "mean deg": float(known.mean()),
        "p95 deg": float(np.percentile(known, 95)),
    }


def scipy_seconds(stack: impasto.Stack) -> float:
    """Processor seconds per pixel."""
    lights = stack.rig.directions
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    stereo = impasto.fit_normals(stack).normal
    bands = stack.shape[1]
    pixels = np.linspace(0, stereo[0].size - 1, SCIPY_PIXELS).astype(int)

    def shown(p: np.ndarray, start: np.ndarray) -> np.ndarray:
        across = np.cross([0.0, 1.0, 0.0], start)
        normal = start + p[0] * across + p[1] * np.cross(start, across)
        normal = normal / np.linalg.norm(normal)
        phi = np.arccos(np.clip(half @ normal, -1.0, 1.0))
        lobes = np.exp(-np.exp(p[2:4])[:, None] * phi**2)
        colours = p[4:].reshape(4, bands)
        columns = [np.maximum(lights @ normal, 0.0), *lobes, np.ones(len(lights))]
        return np.stack(columns, axis=1) @ colours

    before = time.process_time()
    for pixel in pixels:
        y, x = np.unravel_index(pixel, SIZE)
        samples = np.asarray(stack.samples[:, :, y, x], np.float64)
        start = np.asarray(stereo[:, y, x], np.float64)
        root = 1.0 / np.sqrt(np.maximum(samples, 0.1 * samples.mean()))
        mean = samples.mean(axis=0)
        first = np.concatenate([[0.0, 0.0, 4.7, 2.9], mean, 0.1 * mean, 0.1 * mean, 0.01 * mean])
        lower = np.concatenate([np.full(4, -10.0), np.zeros(4 * bands)])
        least_squares(
            lambda p, root=root, samples=samples, start=start: (
                root * (samples - shown(p, start))
            ).ravel(),
            first,
            bounds=(lower, np.inf),
            xtol=1e-6,
            ftol=1e-6,
            gtol=1e-6,
        )
    return (time.process_time() - before) / len(pixels)


def times(stack: impasto.Stack) -> list[dict[str, Any]]:
    """Either side, on the same photographs."""
    stereo = impasto.fit_normals(stack)
    before = time.process_time()
    impasto.fit_sbrdf(stack, pooling="pixel", normals=stereo, threads=1)
    ours = (time.process_time() - before) / stereo.status.size
    theirs = scipy_seconds(stack)
    million = 1e6 / stack.shape[0]
    return [
        {"fit": "impasto", "seconds per million": ours * million, "ratio": 1.0},
        {"fit": "SciPy", "seconds per million": theirs * million, "ratio": theirs / ours},
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true", help="write benches/results/lobes.json")
    options = parser.parse_args()
    stack, truth = photographs()
    painting, seconds = normals(stack, truth), times(stack)
    show("normals of a simulated painting with shadows and ambient light", painting)
    show("processor seconds per million pixels and photographs, one thread", seconds)
    # Without the folder of real data the rest is measured all the same.
    there = (options.data / "brdf").is_dir()
    hundred = measured(options.data) if there else []
    if there:
        show("normals of a hundred measured materials", hundred)
    if options.record:
        run = {"run": run_info("python benches/python/lobes.py --record"), "seed": SEED}
        tables = {"normals": painting, "materials": hundred, "times": seconds}
        print(f"\nwrote {write('lobes.json', run | tables)}")


if __name__ == "__main__":
    main()

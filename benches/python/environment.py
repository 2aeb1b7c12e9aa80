"""Environment light against brute force in float64, and what it costs.

    python benches/python/environment.py [--record]

Maps of 128 x 64 texels: the gallery, and a sun that gives half of the light. Normals have slopes
of deviation 0.15. Errors in per cent of the light where it is above 1e-3 of the largest, median and
99th percentile. The scalar scheme is the third paper's, the cosine in the middle of the lobe. Times
are processor seconds of one thread with the gallery's 512 x 256 texels. ``--record`` writes
benches/results/environment.json and sets the tables of docs/environment.md.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto import Environment, Scene, Surface
from impasto.surface import Lobe

sys.path.insert(1, str(ROOT / "tests"))

from oracles import environment as oracle

PIXELS = 1500
RGB_FROM_XYZ = impasto.colour.Display.named("srgb").linear_from_xyz
EXPONENTS = (5.0, 20.0, 50.0, 200.0)
WIDTHS = (0.05, 0.15, 0.35)
VIEWS = (0, 30, 60)


def skies() -> dict[str, np.ndarray]:
    """Radiance ``(3, 64, 128)``."""
    room = np.asarray(Environment.named("gallery").radiance, np.float64)
    small = room.reshape(3, 64, 4, 128, 4).mean(axis=(2, 4))
    sun = 0.2 + 0.8 * np.linspace(1.0, 0.0, 64)[None, :, None] * np.ones((3, 1, 128))
    sun[:, 18, 74] = 1500.0
    return {"gallery": small, "sun": sun}


def normals(count: int, seed: int = 0) -> np.ndarray:
    """``(p, 3)``, in the precision of maps."""
    slopes = np.random.default_rng(seed).normal(0.0, 0.15, (2, count))
    found = np.concatenate([slopes, np.ones((1, count))])
    return (found / np.linalg.norm(found, axis=0)).T.astype(np.float32).astype(np.float64)


def shown(surface: Surface, room: Environment, view: Any = None) -> np.ndarray:
    """Linear RGB ``(p, 3)`` of a painting of one row."""
    image = impasto.render(surface, Scene(environment=room, view=view), threads=1)
    return (RGB_FROM_XYZ @ image.xyz.reshape(3, -1)).T


def painting(facets: np.ndarray, *lobes: Lobe, white: float = 0.0, **options: Any) -> Surface:
    diffuse = np.full((3, 1, len(facets)), white, np.float32)
    return Surface(facets.T[:, None].astype(np.float32), diffuse, lobes, **options)


def errors(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    bright = expected > 1e-3 * expected.max()
    share = 100.0 * np.abs(found - expected)[bright] / expected[bright]
    return float(np.median(share)), float(np.percentile(share, 99))


def harmonics(facets: np.ndarray, sky: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Irradiance by spherical harmonics of degree 2 of the clipped map (Ramamoorthi 2001)."""

    def basis(d: np.ndarray) -> np.ndarray:
        x, y, z = d.T
        return np.stack(
            [
                0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x,
                1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1),
                1.092548 * x * z, 0.546274 * (x * x - y * y),
            ],
            axis=1,
        )  # fmt: skip

    weights = np.pi * np.array([1.0] + [2.0 / 3.0] * 3 + [0.25] * 5)
    towards, light = sky
    return np.asarray((basis(facets) * weights) @ (basis(towards).T @ light))


def rows() -> dict[str, list[dict[str, Any]]]:
    facets = normals(PIXELS)
    found: dict[str, list[dict[str, Any]]] = {"diffuse": [], "glossy": [], "lobes": []}
    for name, radiance in skies().items():
        sky = oracle.texels(radiance)
        room, scalar = Environment(radiance), Environment(radiance, scheme="scalar")
        truth = oracle.irradiance(facets, sky)
        median, p99 = errors(shown(painting(facets, white=1.0), room), truth)
        sh_median, sh_p99 = errors(harmonics(facets, sky), truth)
        row = {"map": name, "median": median, "p99": p99}
        found["diffuse"].append(row | {"SH median": sh_median, "SH p99": sh_p99})
        for gamma in WIDTHS:
            truth = oracle.torrance_sparrow(facets, (0, 0, 1), gamma, sky)
            one = errors(shown(painting(facets, Lobe(1.0, (gamma,))), room), truth)
            per = np.full((1, PIXELS), gamma, np.float32)
            many = errors(shown(painting(facets, Lobe(1.0, (per,))), room), truth)
            row = {"map": name, "gamma": gamma, "median": one[0], "p99": one[1]}
            found["glossy"].append(row | {"pixel median": many[0], "pixel p99": many[1]})
        for exponent in EXPONENTS:
            for degrees in VIEWS:
                tilt = np.radians(degrees)
                view = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
                lobe = Lobe(1.0, (-1.0, 1.0, exponent))
                # A near eye so far away that its direction is one.
                surface = painting(facets, lobe, model="lafortune", pitch_mm=1e-9)
                eye = impasto.PointView(tuple(1e3 * view))
                truth = oracle.lafortune(facets, view, -1.0, 1.0, exponent, sky)
                ours = errors(shown(surface, room, eye), truth)
                paper = errors(shown(surface, scalar, eye), truth)
                found["lobes"].append(
                    {"map": name, "exponent": exponent, "view": degrees}
                    | {"median": ours[0], "p99": ours[1]}
                    | {"scalar median": paper[0], "scalar p99": paper[1]}
                )
    return found


def seconds(work: Callable[[], Any], rounds: int = 3) -> float:
    """The least processor time of some rounds."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def times() -> list[dict[str, Any]]:
    gallery = Environment.named("gallery")
    side = 1024
    facets = normals(side * side).T.reshape(3, side, side).astype(np.float32)
    diffuse = np.full((3, side, side), 0.5, np.float32)
    rng = np.random.default_rng(1)
    gamma = np.exp(rng.uniform(np.log(0.06), np.log(0.3), (side, side))).astype(np.float32)
    exponent = np.exp(rng.uniform(np.log(5), np.log(200), (side, side))).astype(np.float32)

    def of(height: int, kind: str) -> Surface:
        normal, colour = facets[:, :height], diffuse[:, :height]
        lobes: dict[str, tuple[Lobe, ...]] = {
            "diffuse": (),
            "Torrance-Sparrow, one gamma": (Lobe(0.5, (0.15,)),),
            "Torrance-Sparrow, a gamma per pixel": (Lobe(0.5, (gamma[:height],)),),
            "Lafortune, an exponent per pixel": (Lobe(0.5, (-1.0, 1.0, exponent[:height])),),
        }
        model: Any = "lafortune" if kind.startswith("Laf") else "torrance-sparrow"
        return Surface(normal, colour, lobes[kind], model)

    scene = Scene(environment=gallery)
    found = []
    for kind in (
        "diffuse", "Torrance-Sparrow, one gamma", "Torrance-Sparrow, a gamma per pixel",
        "Lafortune, an exponent per pixel",
    ):  # fmt: skip
        lafortune = kind.startswith("Laf")
        if kind == "diffuse" or lafortune:

            def build(lobes: bool = lafortune) -> None:
                room = Environment.named("gallery")
                room.prefiltered(lobes=lobes, threads=1)

            prepared = seconds(build)
        whole, half = of(side, kind), of(side // 2, kind)
        impasto.render(half, scene, threads=1)
        both = [
            seconds(lambda s=surface: impasto.render(s, scene, threads=1))
            for surface in (whole, half)
        ]
        per_pixel = (both[0] - both[1]) / (side * side / 2)
        tables = max(both[0] - per_pixel * side * side, 0.0)
        found.append(
            {
                "part": kind,
                "once": prepared if kind == "diffuse" or lafortune else None,
                "picture": tables,
                "Mpx/s": 1e-6 / per_pixel,
            }
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--record", action="store_true", help="write the result")
    options = parser.parse_args()
    # What is built is timed.
    os.environ["IMPASTO_CACHE"] = "off"
    found = rows()
    found["times"] = times()
    for title, part in found.items():
        show(title, part)
    if options.record:
        run = run_info("python benches/python/environment.py --record")
        print(f"wrote {write('environment.json', {'run': run, 'seed': 0} | found)}")
        set_tables(ROOT / "docs" / "environment.md")


if __name__ == "__main__":
    main()

"""Every method of photometric stereo on simulated samples, and on a real cat.

    python benches/python/stereo_methods.py [--data DIR] [--write]

*Matte*: 21 stacks without outliers, 9 to 96 lights, 0.5 to 2 % of noise. The mean error over that
of least squares, which is the best there is. *Outliers*: 54 stacks of 9, 16 or 48 lights; of the
samples of every pixel 10, 20 or 30 % are highlights, shadows or both, at random or under
neighbouring lights. The mean error over that of the best method in this case. *Glossy*: nine
spheres under 48 lights, of GGX facets of three widths and three strengths; mean error in degrees.
*Cat*: twelve photographs of a matte object whose lamps differ in strength; the share of adjacent
pixels whose normals are more than 10 degrees apart. *Sigma*: the 68 % quantile of the angle over
1.51 sigma, which is 1 if sigma is true. ``--write`` records benches/results/stereo.json and sets
the tables of docs/accuracy.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pages import set_tables
from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto.fit.normals import Method

PIXELS = 400
SEED = 0
METHODS = get_args(Method)
PER_SIGMA = 1.5096
"""68.3 % quantile of the length of two normal deviates."""


@dataclass(frozen=True)
class Samples:
    """``(obs, pixel)`` samples, ``(obs, 3)`` lights and ``(pixel, 3)`` normals."""

    name: str
    samples: np.ndarray
    lights: np.ndarray
    normals: np.ndarray

    @property
    def stack(self) -> impasto.Stack:
        return impasto.Stack(self.samples[:, None].astype(np.float32), lights=self.lights)

    def errors(self, fit: impasto.Normals) -> np.ndarray:
        """Angles, rad; a pixel without a normal is a right angle off."""
        found = fit.normal[:, 0].T.astype(np.float64)
        across = np.linalg.norm(np.cross(found, self.normals), axis=1)
        angle = np.arctan2(across, (found * self.normals).sum(axis=1))
        return np.where(np.isfinite(angle), angle, np.pi / 2)


def dome(count: int, rng: np.random.Generator) -> np.ndarray:
    """Lights on all sides, 25 to 80 degrees above the painting."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0)) + rng.uniform(0.0, 6.0)
    z = np.linspace(*np.sin(np.radians([25.0, 80.0])), count)
    rng.shuffle(z)
    ground = np.sqrt(1.0 - z**2)
    return np.stack([ground * np.cos(turn), ground * np.sin(turn), z], axis=1)


def surface(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Normals and albedo ``(pixel, 1)``."""
    normals = np.concatenate([rng.normal(0.0, 0.25, (PIXELS, 2)), np.ones((PIXELS, 1))], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, rng.uniform(0.2, 0.8, (PIXELS, 1))


def matte(rng: np.random.Generator) -> Iterator[Samples]:
    for count, noise in product((9, 12, 16, 24, 32, 48, 96), (0.005, 0.01, 0.02)):
        lights, (normals, albedo) = dome(count, rng), surface(rng)
        clean = normals @ lights.T
        noisy = albedo * (clean + rng.normal(0.0, noise, clean.shape))
        yield Samples(f"matte, {count} lights, {noise:.1%}", noisy.T, lights, normals)


def chosen(score: np.ndarray, count: int) -> np.ndarray:
    """The ``count`` samples of the largest score of every pixel."""
    picked = np.zeros(score.shape, bool)
    np.put_along_axis(picked, np.argsort(-score, axis=1)[:, :count], True, axis=1)
    return picked


def outliers(rng: np.random.Generator) -> Iterator[Samples]:
    kinds = ("highlights", "shadows", "both")
    for count, share, kind, near in product((9, 16, 48), (0.1, 0.2, 0.3), kinds, (False, True)):
        lights, (normals, albedo) = dome(count, rng), surface(rng)
        clean = np.maximum(normals @ lights.T, 0.0)
        samples = albedo * (clean + rng.normal(0.0, 0.01, clean.shape))
        mirror = 2.0 * normals[:, 2:] * normals - [0.0, 0.0, 1.0]
        side = rng.normal(size=(PIXELS, 3)) * [1.0, 1.0, 0.0]
        bright, dark = mirror @ lights.T, side @ lights.T
        if not near:
            bright, dark = rng.random(clean.shape), rng.random(clean.shape)
        several = max(1, round(share * count))
        first = {"highlights": several, "shadows": 0, "both": (several + 1) // 2}[kind]
        lit = chosen(bright, first)
        shaded = chosen(np.where(lit, -9.0, dark), several - first)
        samples = samples + np.where(lit, albedo * rng.uniform(0.3, 3.0, clean.shape), 0.0)
        samples = np.where(shaded, rng.uniform(0.0, 0.4, clean.shape) * samples, samples)
        where = "neighbouring" if near else "random"
        name = f"{share:.0%} {kind}, {where}, {count} lights"
        yield Samples(name, samples.T, lights, normals)


def glossy(rng: np.random.Generator) -> Iterator[Samples]:
    """Spheres of GGX facets (Walter et al. 2007) over a Lambert part, seen from above."""
    lights = dome(48, rng)
    y, x = np.mgrid[-1:1:50j, -1:1:50j]
    inside = x**2 + y**2 < 0.8
    normals = np.stack([x[inside], y[inside], np.sqrt(1.0 - (x**2 + y**2)[inside])], axis=1)
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    lit, seen, tilt = np.maximum(normals @ lights.T, 0.0), normals[:, 2:], normals @ half.T
    for width, strength in product((0.08, 0.2, 0.4), (0.04, 0.3, 0.9)):
        facets = width**2 / (tilt**2 * (width**2 - 1.0) + 1.0) ** 2
        shading = [c * (1.0 - width / 2) + width / 2 for c in (lit, seen)]
        specular = strength * facets / (4.0 * shading[0] * shading[1])
        samples = lit * (0.3 * (1.0 - strength) + specular)
        samples = samples + rng.normal(0.0, 0.002, samples.shape)
        yield Samples(f"GGX, {width:g}, {strength:g}", samples.T, lights, normals)


def mean_errors(cases: list[Samples], method: Method) -> np.ndarray:
    """``(case,)`` rad."""
    fits = [(one, impasto.fit_normals(one.stack, method=method)) for one in cases]
    return np.array([one.errors(fit).mean() for one, fit in fits])


def against(cases: list[Samples], best: tuple[Method, ...]) -> dict[str, np.ndarray]:
    """Mean errors of every method over the smallest of some, ``(case,)``."""
    means = {method: mean_errors(cases, method) for method in METHODS}
    least = np.min([means[method] for method in best], axis=0)
    return {method: mean / least for method, mean in means.items()}


def seams(data: Path, methods: tuple[Method, ...] = METHODS) -> dict[str, float]:
    """Share of the cat's neighbouring pixels that are more than 10 degrees apart, by method."""
    folder = data / "two_balls"
    stack = impasto.read_stack(
        folder / "Objects", lights=folder / "light_directions.txt", encoding="linear"
    )
    mean = np.mean([stack.linear(k).mean(axis=0) for k in range(stack.shape[0])], axis=0)
    shares = {}
    for method in methods:
        normal = impasto.fit_normals(stack, method=method).normal
        there = (mean > 0.05) & np.isfinite(normal).all(axis=0)
        far = []
        for axis in (0, 1):
            here, beyond = np.s_[1:], np.s_[:-1]
            index = [(..., one, *[slice(None)] * (1 - axis)) for one in (here, beyond)]
            cosine = (normal[index[0]] * normal[index[1]]).sum(axis=0)
            far.append((cosine < np.cos(np.radians(10.0)))[there[index[0]] & there[index[1]]])
        shares[method] = 100.0 * float(np.concatenate(far).mean())
    return shares


def true_sigma(cases: list[Samples]) -> np.ndarray:
    """68 % quantile of error over sigma, ``(case,)``."""
    fits = [impasto.fit_normals(one.stack) for one in cases]
    return np.array(
        [
            np.nanquantile(one.errors(fit) / (PER_SIGMA * fit.sigma[0]), 0.683)
            for one, fit in zip(cases, fits, strict=True)
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    rng = np.random.default_rng(SEED)
    plain, spoiled, shiny = list(matte(rng)), list(outliers(rng)), list(glossy(rng))
    clean, off = against(plain, ("least-squares",)), against(spoiled, METHODS)
    cat = seams(options.data) if (options.data / "two_balls").is_dir() else {}
    rows: list[dict[str, Any]] = [
        {
            "method": method,
            "matte": float(clean[method].mean()),
            "matte, worst": float(clean[method].max()),
            "outliers": float(np.exp(np.log(off[method]).mean())),
            "outliers, worst": float(off[method].max()),
            "above 1.2": int((off[method] > 1.2).sum()),
            "glossy": float(np.degrees(mean_errors(shiny, method).mean())),
            "cat": cat.get(method),
        }
        for method in METHODS
    ]
    sigma = [
        {"samples": name, "least": float(found.min()), "largest": float(found.max())}
        for name, found in (
            ("matte", true_sigma(plain)),
            ("outliers", true_sigma(spoiled)),
            ("glossy", true_sigma(shiny)),
        )
    ]
    show("Mean errors relative to the best; % of the cat's neighbours", rows)
    show("68 % quantile of error / (1.51 sigma)", sigma)
    worst = [
        {"samples": one.name, "ratio": float(ratio)}
        for one, ratio in zip(spoiled, off["robust"], strict=True)
        if ratio > 1.2
    ]
    if worst:
        show("Where the default is more than 1.2 times as far off as the best", worst)
    if options.write:
        run = run_info("python benches/python/stereo_methods.py --write")
        write("stereo.json", {"run": run, "seed": SEED, "rows": rows, "sigma": sigma})
        set_tables(ROOT / "docs" / "accuracy.md")


if __name__ == "__main__":
    main()

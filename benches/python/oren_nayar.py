"""What a rough diffuse part (Oren and Nayar) would be worth to the fits.

    python benches/python/oren_nayar.py [--data DIR] [--cache DIR] [--record]

One roughness for the painting, the standard deviation of the slopes of V-shaped facets. Twice, what
the factor of Oren and Nayar's qualitative model adds to Lambert's law is computed from the fit,
taken off the samples, and the fit is repeated; predictions get it back. Photographs held out (every
sixth of the icon and the cat between two balls, four folds; the 12 of path-traced scenes) say
which roughness is best. "rough sphere" is simulated with a roughness of 0.4, to see that one is
found. ``--record`` writes benches/results/oren_nayar.json and sets the table of docs/models.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pages import set_tables
from path_traced import Shown
from path_traced_scenes import CACHE, SCENES, traced
from record import ROOT, data_folder, run_info, show, write
from rigs import two_balls

import impasto
from impasto.fit.choice import decibels
from impasto.fit.subsample import subsampled

ROUGHNESS = (0.0, 0.1, 0.2, 0.3, 0.4)
TRUE = 0.4
FOLDS = 4
PIXEL: dict[str, Any] = {"pooling": "pixel", "residuals": False, "refine": False, "threads": 1}
TRACED: dict[str, dict[str, Any]] = {
    "sphere-diffuse": {"lobes": 1, "ambient": False},
    "bumpy-diffuse": {"lobes": 1, "ambient": False},
    "relief-diffuse": {"lobes": 1, "ambient": True},
}
Array = NDArray[np.float32]


def factor(normal: Array, lights: NDArray[np.float64], roughness: float) -> Array:
    """``(obs, y, x)``: Oren and Nayar (1994), eq. 30, over Lambert's law, seen from the front."""
    s = roughness**2
    a, b = 1.0 - 0.5 * s / (s + 0.33), 0.45 * s / (s + 0.09)
    normal = np.nan_to_num(normal)
    found = []
    for light in lights:
        lit = np.clip(np.tensordot(light, normal, 1), 0.0, 1.0)
        seen = np.clip(normal[2], 0.0, 1.0)
        # The light and the eye, projected onto the surface: cos of the angle between, times sines.
        between = light[2] - lit * seen
        found.append(a + b * np.maximum(between, 0.0) / np.maximum(np.maximum(lit, seen), 0.05))
    return np.array(found, np.float32)


def rough_part(result: Any, rig: impasto.Rig, roughness: float) -> Array:
    """What roughness adds to the samples of a fit."""
    matte = impasto.Surface(result.normal, result.diffuse, pitch_mm=result.pitch_mm)
    lambert = np.nan_to_num(matte.predict(rig, threads=1))
    return np.asarray(lambert * (factor(result.normal, rig.directions, roughness) - 1.0)[:, None])


def fitted(stack: impasto.Stack, roughness: float, options: dict[str, Any]) -> Any:
    """A fit with a rough diffuse part."""
    result = impasto.fit_sbrdf(stack, **PIXEL, **options)
    if not roughness:
        return result
    linear = np.array([stack.linear(index) for index in range(len(stack.rig))])
    for _ in range(2):
        samples = np.maximum(linear - rough_part(result, stack.rig, roughness), 0.0)
        smooth = stack._replace(samples=samples, scale=1.0, black=0.0, saturation=None)
        result = impasto.fit_sbrdf(smooth, **PIXEL, **options)
    return result


def held_out(
    folds: list[tuple[impasto.Stack, impasto.Rig, Array]], options: dict[str, Any]
) -> Iterator[float]:
    """Mean dB for each roughness."""
    for roughness in ROUGHNESS:
        every = []
        for known, rig, truth in folds:
            result = fitted(known, roughness, options)
            shown = result.predict(rig, threads=1) + rough_part(result, rig, roughness)
            every.append(decibels(shown, truth))
        yield float(np.concatenate(every).mean())


def split(stack: impasto.Stack) -> list[tuple[impasto.Stack, impasto.Rig, Array]]:
    """Folds of every sixth photograph."""
    count = len(stack.rig)
    parts = []
    for first in range(FOLDS):
        held = np.arange(first, count, 6)
        truth = np.array([stack.linear(index) for index in held])
        known = stack.take(np.setdiff1d(np.arange(count), held))
        parts.append((known, stack.rig.take(held), truth))
    return parts


def rough_sphere() -> Shown:
    """The sphere of the path-traced scenes, with a roughness."""
    one = traced(SCENES["sphere-diffuse"], CACHE_IN_USE[0])
    samples, held = (
        (shots * np.maximum(factor(one.normal, lights, TRUE), 0.0)[:, None]).astype(np.float32)
        for shots, lights in ((one.samples, one.lights), (one.held, one.held_lights))
    )
    return Shown.of(replace(one, samples=samples, held=held))


CACHE_IN_USE = [CACHE]


def cases(data: Path) -> Iterator[tuple[str, Callable[[], list[Any]], dict[str, Any]]]:
    """Names, folds and options of the fits."""

    def of(shown: Shown) -> list[Any]:
        held = shown.stack.encoding.decode(shown.held).astype(np.float32)
        held[..., ~shown.truth.mask] = np.nan
        return [(shown.stack, shown.new, held)]

    def scene(name: str) -> list[Any]:
        return of(Shown.of(traced(SCENES[name], CACHE_IN_USE[0])))

    yield "rough sphere", lambda: of(rough_sphere()), TRACED["sphere-diffuse"]
    for name, options in TRACED.items():
        yield name, lambda name=name: scene(name), options
    icon = data / "icon_rti" / "dirs.lp"
    lobes = {"lobes": 2, "ambient": True}
    yield "icon", lambda: split(subsampled(impasto.read_stack(icon, encoding="srgb"), 3)), lobes
    few = {"lobes": 1, "ambient": False}
    yield "cat", lambda: split(subsampled(two_balls(data), 5)), few


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of path-traced scenes")
    parser.add_argument("--record", action="store_true", help="write the result")
    options = parser.parse_args()
    CACHE_IN_USE[0] = options.cache
    rows = []
    for name, folds, how in cases(options.data):
        found = dict(zip((f"{one:g}" for one in ROUGHNESS), held_out(folds(), how), strict=True))
        best = max(found, key=found.__getitem__)
        rows.append({"stack": name, **found, "best": best, "gain": found[best] - found["0"]})
        print(rows[-1], flush=True)
    show("dB of photographs held out, by roughness", rows)
    if options.record:
        run = run_info("python benches/python/oren_nayar.py --record")
        content = {"run": run, "seed": "none", "rows": rows}
        print(f"wrote {write('oren_nayar.json', content)}")
        set_tables(ROOT / "docs" / "models.md")


if __name__ == "__main__":
    main()

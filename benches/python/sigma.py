"""Whether the predicted errors of normals are as large as the errors.

    pip install mitsuba
    python benches/python/sigma.py [--cache DIR] [--data DIR] [--record]

For each data set the 68 % quantile of the angle between found and true normal over 1.51 ``sigma``:
1 where the prediction is true, above 1 where errors are larger (1.51 makes an angle of two axes of
one ``sigma`` each a 68 % quantile of 1). *Noise alone*: photographs of surfaces that are fitted
lobes, with shot noise. *Paintings* are those of ``impasto.simulate``, *materials* those of
``materials.py``, *panels* and *objects* those of ``path_traced.py``; all without residuals, with
the rig told and the diffuse part (varnished or not) that is theirs, or the other. ``--record``
writes benches/results/sigma.json and sets the table of docs/numerics.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import materials
import numpy as np
from numpy.typing import NDArray
from pages import set_tables
from path_traced import ANGLE, Shown
from path_traced_scenes import CACHE, SCENES, traced
from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto import simulate
from impasto.simulate.score import normal_error

PAINTINGS = (
    ("satin", 9),
    ("satin", 24),
    ("satin", 49),
    ("gloss", 24),
    ("gloss", 49),
    ("patches", 24),
)
NOISES = ((9, 0.004), (16, 0.004), (49, 0.004), (49, 0.02))
"""Numbers of lights, and noise of white relative to white."""
FEW = 16
"""Lights of the sets that nothing was adjusted to."""
COATED = "plastic"
"""Scenes with this in their name lie under a varnish."""


@dataclass(frozen=True, eq=False)
class Case:
    """Photographs ``stack`` of known normals ``(3, y, x)``; where ``mask`` is, they count."""

    kind: str
    name: str
    stack: impasto.Stack
    normal: NDArray[Any]
    mask: NDArray[np.bool_]
    coated: bool = False

    def quantiles(self) -> dict[str, float]:
        """The quantile of every fit."""
        fits = {
            "stereo": impasto.fit_normals(self.stack),
            **{
                way: impasto.fit_sbrdf(self.stack, pooling=way, coated=self.coated, residuals=False)
                for way in ("painting", "pixel")
            },
        }
        return {
            way: float(
                np.nanquantile(
                    (np.radians(normal_error(found.normal, self.normal)) / (ANGLE * found.sigma))[
                        self.mask
                    ],
                    0.68,
                )
            )
            for way, found in fits.items()
        }


def dome(count: int) -> NDArray[np.float64]:
    """Directions on a spiral down to 15 degrees."""
    turn, z = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0)), np.linspace(0.97, 0.25, count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


def cases(cache: Path, data: Path) -> Iterator[Case]:
    """All data sets."""
    yield from noise_alone(data)
    for varnish, lights in PAINTINGS:
        painting = simulate.painting(seed=7, size=(48, 48), varnish=varnish)
        taken = simulate.capture(painting, impasto.Rig(dome(lights)), "rgb")
        normal = np.asarray(taken.truth.normal, np.float64)
        every = np.ones(normal.shape[1:], np.bool_)
        yield Case("paintings", f"{varnish}, {lights} lights", taken.stack, normal, every)
    for lights in (16, 49):
        yield measured(data, lights)
    for name, scene in SCENES.items():
        shown = Shown.of(traced(scene, cache))
        kind = "panels" if scene.slope else "objects"
        truth = shown.truth
        case = Case(kind, name, shown.stack, truth.normal, truth.mask, coated=COATED in name)
        yield case
        yield replace(case, kind=f"{kind}, wrong diffuse part", coated=not case.coated)
        green = impasto.Stack(
            shown.stack.samples[:, 1:2],
            lights=shown.stack.rig,
            mask=truth.mask,
            saturation=1.0,
            encoding=shown.stack.encoding,
        )
        yield replace(case, kind=f"{kind}, one band", stack=green)
        some = np.linspace(0, len(shown.stack.rig) - 1, FEW).round().astype(int)
        yield replace(case, kind=f"{kind}, {FEW} lights", stack=shown.stack.take(some))


def measured(data: Path, lights: int) -> Case:
    """The measured materials."""
    samples, normal = materials.photographs(data, dome(lights))
    stack = impasto.Stack(samples, lights=dome(lights), saturation=1.0)
    shape = samples.shape[2:]
    truth = np.broadcast_to(normal, (3, *shape))
    return Case("materials", f"{lights} lights", stack, truth, np.ones(shape, np.bool_))


def noise_alone(data: Path) -> Iterator[Case]:
    """Lobes fitted to the measured materials, photographed."""
    model = impasto.fit_sbrdf(measured(data, 49).stack, pooling="pixel", lobes=1, residuals=False)
    rng = np.random.default_rng(3)
    for lights, noise in NOISES:
        clean = model.predict(impasto.Rig(dome(lights))).astype(np.float64)
        known = np.isfinite(clean).all(axis=(0, 1)) & np.isfinite(model.sigma)
        clean = np.where(known, clean, 0.1)
        clean /= np.quantile(clean, 0.99)
        shot = noise * np.sqrt(np.maximum(clean, 0.1))
        samples = np.clip(clean + shot * rng.normal(size=clean.shape), 0.0, 1.0)
        stack = impasto.Stack(samples.astype(np.float32), lights=dome(lights), saturation=1.0)
        yield Case("noise alone", f"{lights} lights, {noise:g}", stack, model.normal, known)


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Geometric mean, least and largest quantile of each kind."""

    def text(found: NDArray[np.float64]) -> str:
        mean = np.exp(np.log(found).mean())
        return f"{mean:.2f} ({found.min():.2f} to {found.max():.2f})"

    table = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        part = [row for row in rows if row["kind"] == kind]
        columns = {
            way: np.array([row[way] for row in part]) for way in ("stereo", "painting", "pixel")
        }
        table.append(
            {"data": kind, "sets": len(part)} | {way: text(each) for way, each in columns.items()}
        )
    return table


def main() -> None:
    """Measure and print; with ``--record`` write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    rows = []
    for case in cases(options.cache, options.data):
        rows.append({"kind": case.kind, "name": case.name, **case.quantiles()})
        print(rows[-1], flush=True)
    content = {
        "run": run_info("python benches/python/sigma.py --record"),
        "rows": rows,
        "summary": summary(rows),
    }
    show("68 % quantile of error / (1.51 sigma)", content["summary"])
    if options.record:
        write("sigma.json", content)
        set_tables(ROOT / "docs" / "numerics.md")


if __name__ == "__main__":
    main()

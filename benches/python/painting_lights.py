"""Lamps from photographs of a painting alone: simulated reliefs, a real object and a real icon.

    python benches/python/painting_lights.py [--data DIR] [--record]

Matte and glossy reliefs (``tests/oracles/matte_relief.py``), simulated paintings with their own
gloss under near lamps, and the icon (72 lamps), each against the lamps that are known. The object
of the data set two_balls is no panel: its factors are compared with the published directions after
the best rotation. ``--record`` writes benches/results/painting_lights.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto import simulate
from impasto.calibrate import lights_from_panel, linear_photograph, patches_of
from impasto.calibrate.uncalibrated.equal_strengths import equal_strengths
from impasto.calibrate.uncalibrated.factorisation import factorise
from impasto.io import read_lights
from impasto.io.images import list_images

sys.path.insert(0, str(ROOT / "tests"))

from oracles import known_lamps, matte_relief


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def row(case: str, pictures: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    """What is found of ``(lamp, band, y, x)``, or why nothing is."""
    names = tuple(f"{number}" for number in range(len(pictures)))
    try:
        found = lights_from_panel(patches_of(pictures, names))
    except impasto.GeometryError as error:
        words = str(error).removeprefix("lights: ").split(": ")[0].split(" (")[0]
        return {"case": case, "lamps": len(truth), "known": "–", "mean": None, "worst": None,
                "said": None, "words": words}  # fmt: skip
    off = degrees(found.directions[found.known], truth[found.known])
    said = float(np.degrees(np.sqrt(np.nanmean(np.square(found.sigma)))))
    return {"case": case, "lamps": len(truth), "known": str(int(found.known.sum())),
            "mean": float(off.mean()), "worst": float(off.max()), "said": said,
            "words": "–"}  # fmt: skip


def reliefs() -> list[dict[str, Any]]:
    rows = []
    for case, count, options in (
        ("matte relief, lamps at 5 widths", 24, {}),
        ("matte relief, ten lamps", 10, {}),
        ("matte relief, slopes of 2 degrees", 24, {"slope": 0.03}),
        ("matte relief, lamps at 3 widths", 24, {"inverse_distance": 1 / 3}),
        ("matte relief, lamps that differ by 2 %", 24, {"uneven": 0.02}),
        ("matte relief, lamps that differ by 10 %", 24, {"uneven": 0.1}),
        ("glossy relief", 48, {"gloss": 0.5}),
        ("glossy relief, few lamps", 16, {"gloss": 0.5}),
        ("rough gloss all over", 48, {"gloss": 0.5, "width": 0.5}),
        ("matte relief, lamps far away", 24, {"inverse_distance": 0.0}),
    ):
        directions = matte_relief.lamps(count, seed=3)
        uneven = options.pop("uneven", 0.0)
        spread = np.random.default_rng(4).normal(size=count)
        settings: dict[str, Any] = {"inverse_distance": 0.2, "size": 256} | options
        pictures = matte_relief.photographs(
            directions, strengths=np.exp(uneven * spread), **settings
        )
        rows.append(row(case, pictures[:, None], directions))
    return rows


def paintings() -> list[dict[str, Any]]:
    rows = []
    for count in (16, 48):
        azimuth = 2.399963 * np.arange(count)
        z = np.linspace(np.sin(0.35), np.sin(1.2), count)
        across = np.sqrt(1.0 - z * z)
        directions = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
        rig = impasto.Rig(
            [impasto.PointLight(tuple(place)) for place in 400.0 * directions], pitch_mm=0.2
        )
        painting = simulate.painting(seed=2, size=(256, 256))
        stack = simulate.capture(painting, rig, "rgb").stack
        pictures = np.array([stack.linear(number) for number in range(count)])
        rows.append(row("simulated painting with varnish", pictures, directions))
    return rows


def icon(data: Path) -> dict[str, Any]:
    file = read_lights(data / "icon_rti" / "dirs.lp")
    paths = {path.name: path for path in list_images(data / "icon_rti")}
    assert file.names is not None
    names = [Path(name).name for name in file.names]
    pictures = np.array([linear_photograph(paths[name]) for name in names])
    return row("icon, gilded and varnished", pictures, file.directions)


def real_object(data: Path) -> dict[str, Any]:
    """Factors and equal strengths alone, after the best rotation or reflection."""
    samples, truth = known_lamps.even_samples(data, 8000)
    factors = factorise(samples)
    form = equal_strengths(factors.lamps, factors.clean)
    assert form is not None
    lamps = factors.lamps @ form.matrix
    left, _, right = np.linalg.svd(lamps.T @ truth)
    off = degrees(lamps @ left @ right, truth)
    return {"case": "object of two_balls, strengths known, up to a rotation", "lamps": len(truth),
            "known": str(int((form.weights > 0).sum())), "mean": float(off.mean()),
            "worst": float(off.max()), "said": None, "words": "–"}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true", help="write painting_lights.json")
    options = parser.parse_args()
    rows = [*reliefs(), *paintings(), real_object(options.data), icon(options.data)]
    show("lamps from photographs of a painting alone, degrees", rows)
    if options.record:
        head = {"run": run_info("python benches/python/painting_lights.py --record")}
        print(f"\nwrote {write('painting_lights.json', head | {'rows': rows})}")


if __name__ == "__main__":
    main()

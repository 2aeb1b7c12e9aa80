"""How near the fits come to the truth of surfaces that another renderer photographed.

    pip install mitsuba
    python benches/python/path_traced.py [--cache DIR] [--only TEXT] [--part PART] [--record]

Objects and painted panels are path-traced by Mitsuba 3 under 49 lights (``path_traced_scenes.py``),
exposed so that half a percent of the samples are clipped, and coded as sRGB in 8 bits. Errors of
normals are in degrees, over the pixels that lie within the surface; "sigma" is the 68 % quantile of
the angle over 1.51 times the predicted error, 1 where the prediction is true. "dB" is the PSNR of
12 photographs under other lights, on codes. Parts: ``fits``; ``rigs``, what a near camera, near
lamps and uneven strengths do to panels, untold, told, and refined by ``impasto.refine_rig``.
``--record`` writes benches/results/path_traced.json and sets the tables of docs/accuracy.md.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pages import set_tables
from path_traced_scenes import CACHE, SCENES, Traced, traced
from record import RESULTS, ROOT, run_info, show, write

import impasto
from impasto.fit.choice import psnr
from impasto.simulate.score import normal_error
from study.peers import WEIGHTS, fitted, hemispherical

CLIPPED = 0.005
"""Share of the samples that are clipped."""
ANGLE = float(np.sqrt(-2.0 * np.log(0.32)))
"""68 % of the angles are within this many standard deviations of an axis."""
UNEVEN = 0.4
"""Strengths are drawn evenly from 1 minus this to 1 plus this."""
UNTOLD = "-uneven"
SEED = 5
PEERS = {"HSH, 4 terms": fitted(lambda light: hemispherical(light)[:, :4]), **WEIGHTS}
FITS: dict[str, Callable[[impasto.Stack], Any]] = {
    "least squares": lambda stack: impasto.fit_normals(stack, method="least-squares"),
    "stereo": impasto.fit_normals,
    "painting": lambda stack: impasto.fit_sbrdf(stack, pooling="painting"),
    "pixel": lambda stack: impasto.fit_sbrdf(stack, pooling="pixel"),
    "auto": impasto.fit_sbrdf,
}


@dataclass(frozen=True, eq=False)
class Shown:
    """A stack as a camera would give it, and coded photographs ``(held, band, y, x)`` to predict.

    ``new`` is the rig of those photographs.
    """

    truth: Traced
    stack: impasto.Stack
    held: NDArray[np.float32]
    new: impasto.Rig

    @classmethod
    def of(
        cls, one: Traced, *, camera: bool = True, lamps: bool = True, uneven: bool = False
    ) -> Shown:
        """Photographs with a rig whose near camera and lamps are told or not."""
        exposure = 1.0 / float(np.quantile(one.samples[..., one.mask], 1.0 - CLIPPED))
        strengths = np.full(len(one.lights), exposure)
        if uneven:
            draw = np.random.default_rng(SEED).uniform(1.0 - UNEVEN, 1.0 + UNEVEN, len(strengths))
            strengths = strengths * draw
        curve = impasto.Encoding("srgb", white=255.0)
        codes = np.rint(curve.encode(one.samples * strengths[:, None, None, None]))
        held = np.rint(curve.encode(one.held * exposure))
        known: dict[str, Any] = {"near_camera": camera, "near_lamps": lamps, "strength": exposure}
        stack = impasto.Stack(
            np.asarray(curve.decode(codes), np.float32),
            lights=one.rig(one.lights, **known),
            mask=one.mask,
            saturation=1.0,
            encoding=curve,
        )
        return cls(one, stack, held.astype(np.float32), one.rig(one.held_lights, **known))

    def decibels(self, coded: NDArray[Any]) -> float:
        """Mean PSNR over the photographs held out; what is not a number is black."""
        inside = self.truth.mask
        return float(psnr(np.nan_to_num(coded)[..., inside], self.held[..., inside]).mean())

    def predicted(self, surface: Any, rig: impasto.Rig | None = None, **options: Any) -> float:
        """The same of a fit."""
        return self.decibels(self.stack.encode(surface.predict(rig or self.new, **options)))


def scores(shown: Shown, found: Any) -> dict[str, float]:
    """Errors of normals."""
    error = normal_error(found.normal, shown.truth.normal)[shown.truth.mask]
    ratio = np.radians(error) / (ANGLE * found.sigma[shown.truth.mask])
    return {
        "mean": float(np.nanmean(error)),
        "median": float(np.nanmedian(error)),
        "sigma": float(np.nanquantile(ratio, 0.68)),
        "missing": float(np.isnan(error).mean()),
    }


def fit_rows(one: Traced) -> Iterator[dict[str, Any]]:
    """One row for each fit and each peer, with the rig as it was."""
    shown = Shown.of(one)
    name, stack = one.scene.name, shown.stack
    for way, fit in FITS.items():
        start = time.perf_counter()
        found = fit(stack)
        seconds = time.perf_counter() - start
        row: dict[str, Any] = {"scene": name, "fit": way, **scores(shown, found)}
        row |= {"dB": None, "seconds": seconds, "chosen": None}
        if way in ("painting", "pixel", "auto"):
            row["dB"] = shown.predicted(found)
        if way == "auto":
            row["chosen"] = f"{found.chosen.best}{', residuals' if found.residuals else ''}"
            row["dB of the model"] = shown.predicted(found, fidelity="model")
        yield row
    coded = np.rint(stack.encode(stack.samples)).reshape(len(stack.rig), -1)
    for way, weights in PEERS.items():
        photographs = weights(stack.rig.directions, shown.new.directions) @ coded
        decibels = shown.decibels(np.clip(photographs, 0.0, 255.0).reshape(shown.held.shape))
        yield {"scene": name, "fit": way, "dB": decibels}


def rig_rows(one: Traced) -> Iterator[dict[str, Any]]:
    """What is told of the rig of a panel, and what is found."""
    uneven = (False, True) if one.scene.camera is None and one.scene.lamps is None else (False,)
    if not one.scene.slope:
        return
    for strengths in uneven:
        name = one.scene.name + (UNTOLD if strengths else "")
        blind = Shown.of(one, camera=False, lamps=False, uneven=strengths)
        start = time.perf_counter()
        refined = impasto.refine_rig(blind.stack)
        seconds = time.perf_counter() - start
        true = Shown.of(one)
        rigs = {
            "given": (blind.stack.rig, blind.new),
            "refined": (refined, refined.at(one.held_lights)),
            "known": (true.stack.rig, true.new),
        }
        row: dict[str, Any] = {"scene": name}
        for way, (rig, new) in rigs.items():
            stack = (true if way == "known" else blind).stack._replace(rig=rig)
            row[f"{way} stereo"] = scores(blind, impasto.fit_normals(stack))["mean"]
            found = impasto.fit_sbrdf(stack, pooling="pixel")
            row[way] = scores(blind, found)["mean"]
            # Strengths drawn at random say nothing about those of new lamps.
            row[f"{way} dB"] = None if strengths else blind.predicted(found, new)
        report = refined.refinement
        assert report is not None
        for what, part in (("camera", report.camera), ("lamps", report.lamps)):
            row[what] = getattr(one.scene, what)
            row[f"{what} found"] = float(part.found) if np.isfinite(part.found) else None
            row[f"{what} accepted"] = part.accepted
        yield {
            **row,
            "strengths accepted": report.strengths.accepted,
            "gain dB": report.gain,
            "seconds": seconds,
            "report": str(report),
        }


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over objects and over panels, by fit."""
    table = []
    for way in (*FITS, *PEERS):
        line: dict[str, Any] = {"fit": way}
        for kind in ("objects", "panels"):
            own = [
                row
                for row in rows
                if row["fit"] == way and row["scene"].startswith("panel") == (kind == "panels")
            ]
            for column in ("mean", "median", "sigma", "dB", "seconds"):
                known = [row[column] for row in own if row.get(column) is not None]
                line[f"{kind} {column}"] = float(np.mean(known)) if known else None
        table.append(line)
    return table


def scene_table(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for each scene: errors of normals, predicted errors, and dB of new lights."""
    table: dict[str, dict[str, Any]] = {}
    for row in rows:
        line = table.setdefault(row["scene"], {"scene": row["scene"]})
        line[f"{row['fit']} dB"] = row["dB"]
        if row["fit"] in FITS:
            line |= {row["fit"]: row["mean"], f"{row['fit']} sigma": row["sigma"]}
    return list(table.values())


def rig_table(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same rows with the distances that were accepted, None: as given."""
    return [
        {
            **row,
            "camera": row["camera found"] if row["camera accepted"] else None,
            "lamps": row["lamps found"] if row["lamps accepted"] else None,
            "strengths": "estimated" if row["strengths accepted"] else "as given",
        }
        for row in rows
    ]


def _place(scene: str) -> int:
    return list(SCENES).index(scene.removesuffix(UNTOLD))


PARTS: dict[str, Callable[[Traced], Iterator[dict[str, Any]]]] = {
    "fits": fit_rows,
    "rigs": rig_rows,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of rendered scenes")
    parser.add_argument("--only", default="", help="scenes whose name contains this")
    parser.add_argument("--part", choices=PARTS, help="only this part")
    parser.add_argument(
        "--record",
        action="store_true",
        help="write benches/results/path_traced.json; scenes that are not run keep their rows",
    )
    options = parser.parse_args()
    recorded = RESULTS / "path_traced.json"
    before = json.loads(recorded.read_text("utf-8")) if recorded.exists() else {}
    run = run_info("python benches/python/path_traced.py --record")
    content: dict[str, Any] = {"run": run, "seed": SEED}
    scenes = [scene for scene in SCENES.values() if options.only in scene.name]
    for part, rows_of in PARTS.items():
        rows: list[dict[str, Any]] = []
        if options.part in (None, part):
            for scene in scenes:
                for row in rows_of(traced(scene, options.cache)):
                    rows.append(row)
                    print(json.dumps(row), flush=True)
        # Scenes that were not run keep their rows.
        new = {row["scene"] for row in rows}
        known = [*(row for row in before.get(part, []) if row["scene"] not in new), *rows]
        content[part] = sorted(known, key=lambda row: _place(row["scene"]))
    content["scenes"] = scene_table(content["fits"])
    content["refined"] = rig_table(content["rigs"])
    content["summary"] = summary(content["fits"])
    if options.record:
        print(f"\nwrote {write('path_traced.json', content)}")
        set_tables(ROOT / "docs" / "accuracy.md")
    show("means over the scenes", content["summary"])


if __name__ == "__main__":
    main()

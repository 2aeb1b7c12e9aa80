"""How near the fits come to the truth of surfaces that another renderer photographed.

    pip install mitsuba
    python benches/python/path_traced.py [--cache DIR] [--only TEXT] [--part PART] [--record]

Objects and painted panels are path-traced by Mitsuba 3 under 49 lights (``path_traced_scenes.py``),
exposed so that half a percent of the samples are clipped, and coded as sRGB in 8 bits. Errors of
normals are in degrees, over the pixels that lie within the surface; "sigma" is the 68 % quantile of
the angle over 1.51 times the predicted error, 1 where the prediction is true. "dB" is the PSNR of
12 photographs under other lights, on codes. Parts: ``objects``; ``rigs``, what a near camera, near
lamps and uneven strengths do to panels, untold, told, and refined by ``impasto.refine_rig``.
``--record`` writes benches/results/path_traced.json.
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
from path_traced_scenes import CACHE, SCENES, Traced, traced
from record import RESULTS, run_info, show, write

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

    ``known`` says which rig the fit is told of: the true one, or directions alone.
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
        told = {"near_camera": camera, "near_lamps": lamps, "strength": exposure}
        stack = impasto.Stack(
            np.asarray(curve.decode(codes), np.float32),
            lights=one.rig(one.lights, **told),
            mask=one.mask,
            saturation=1.0,
            encoding=curve,
        )
        return cls(one, stack, held.astype(np.float32), one.rig(one.held_lights, **told))

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


def fit_rows(name: str, shown: Shown) -> Iterator[dict[str, Any]]:
    """One row for each fit and each peer."""
    stack = shown.stack
    for way, fit in FITS.items():
        start = time.perf_counter()
        found = fit(stack)
        row = {"scene": name, "fit": way, **scores(shown, found), "dB": None, "chosen": ""}
        row["seconds"] = time.perf_counter() - start
        if way in ("painting", "pixel", "auto"):
            row["dB"] = shown.predicted(found)
        if way == "auto":
            row["chosen"] = f"{found.chosen.best}{', residuals' if found.residuals else ''}"
            row["model dB"] = shown.predicted(found, fidelity="model")
        yield row
    coded = np.rint(stack.encode(stack.samples)).reshape(len(stack.rig), -1)
    for way, weights in PEERS.items():
        photographs = weights(stack.rig.directions, shown.new.directions) @ coded
        decibels = shown.decibels(np.clip(photographs, 0.0, 255.0).reshape(shown.held.shape))
        yield {"scene": name, "fit": way, "dB": decibels}


def rig_rows(one: Traced) -> Iterator[dict[str, Any]]:
    """What is told of the rig of a panel, and what is found."""
    uneven = (False, True) if one.scene.camera is None and one.scene.lamps is None else (False,)
    for strengths in uneven:
        name = one.scene.name + ("-uneven" if strengths else "")
        blind = Shown.of(one, camera=False, lamps=False, uneven=strengths)
        start = time.perf_counter()
        refined = impasto.refine_rig(blind.stack)
        seconds = time.perf_counter() - start
        true = Shown.of(one)
        rigs = {
            "given": (blind.stack.rig, blind.new),
            "refined": (refined, refined.at(blind.new)),
            "known": (true.stack.rig, true.new),
        }
        row: dict[str, Any] = {"scene": name}
        for way, (rig, new) in rigs.items():
            stack = (true if way == "known" else blind).stack._replace(rig=rig)
            row[f"{way} stereo"] = scores(blind, impasto.fit_normals(stack))["mean"]
            found = impasto.fit_sbrdf(stack, pooling="pixel")
            row[way], row[f"{way} dB"] = scores(blind, found)["mean"], blind.predicted(found, new)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of rendered scenes")
    parser.add_argument("--only", default="", help="scenes whose name contains this")
    parser.add_argument("--part", choices=("objects", "rigs"), help="only this part")
    parser.add_argument("--record", action="store_true", help="write benches/results")
    options = parser.parse_args()
    if options.record and options.only:
        parser.error("--record records all scenes: leave --only out")
    recorded = RESULTS / "path_traced.json"
    parts = json.loads(recorded.read_text("utf-8")) if options.part and recorded.exists() else {}
    scenes = [scene for scene in SCENES.values() if options.only in scene.name]
    content: dict[str, Any] = {
        "run": run_info("python benches/python/path_traced.py --record"),
        "seed": SEED,
    }
    if options.part in (None, "objects"):
        rows: list[dict[str, Any]] = []
        for scene in scenes:
            one = traced(scene, options.cache)
            for row in fit_rows(scene.name, Shown.of(one)):
                rows.append(row)
                print(json.dumps(row), flush=True)
        content["fits"] = rows
    if options.part in (None, "rigs"):
        rows = []
        for scene in scenes:
            if scene.slope:
                for row in rig_rows(traced(scene, options.cache)):
                    rows.append(row)
                    print(json.dumps(row), flush=True)
        content["rigs"] = rows
        if rows:
            show("rigs", [{k: v for k, v in row.items() if k != "report"} for row in rows])
    if options.record:
        print(f"\nwrote {write('path_traced.json', parts | content)}")


if __name__ == "__main__":
    main()

"""How well each method shows a real icon under light that it was not fitted to.

    python benches/python/relighting.py [--fold K] [--data DIR] [--write]

Six-fold cross-validation on 72 photographs of a gilded, varnished icon: fold k holds out
photographs k, k + 6, ... A photograph's score is its PSNR on the coded 8-bit sRGB values, all
pixels and bands; the table gives the mean over photographs. Higher is better. A pixel that
impasto does not estimate counts as black. Lamps' strengths are estimated from the photographs that
are fitted, and interpolated in the directions of those held out. ``--write`` records
benches/results/relighting.json and the residual picture beside it.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from record import RESULTS, data_folder, run_info, show, write

import impasto
from impasto.io import write_jpeg
from impasto.pictures import contact_sheet, ramp_panel
from study.peers import WEIGHTS, robust_lambert

FOLDS = 6
OURS = "impasto, one lobe per painting"
PIXEL = "impasto, own lobes per pixel"
LAMPS = "impasto, own lobes per pixel, lamps' strengths estimated"
DEFAULT = "impasto, the default call"
ROBUST = "Lambert, robust on linear light"
STORED = {
    "Lambert": "9",
    "PTM": "18",
    "HSH": "27",
    ROBUST: "6",
    OURS: "6",
    PIXEL: "17",
    LAMPS: "17",
    DEFAULT: "89",
}
"""Numbers kept per pixel of three bands; a normal and an albedo per band count as 6, two lobes as 8
and the ambient part as 3, 24 components of residuals per band as 72."""
PICTURED = {
    OURS: "one lobe per painting",
    PIXEL: "own lobes per pixel",
    LAMPS: "the same, lamps estimated",
    DEFAULT: "the default call",
    "RBF, thin plate": "RBF, thin plate",
    "Lambert": "Lambert",
}


def psnr(predicted: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """``(obs,)`` dB on codes 0 .. 255."""
    error = np.clip(predicted, 0.0, 255.0) - truth
    return np.asarray(10.0 * np.log10(255.0**2 / (error**2).mean(axis=(1, 2, 3))))


def predictions(stack: impasto.Stack, train: np.ndarray, held: np.ndarray) -> Any:
    """(method, seconds, coded photographs ``(held, band, y, x)``), one method after the other."""
    lights = stack.rig.directions
    linear = np.array([stack.linear(i) for i in train])
    coded = np.rint(stack.encode(linear)).reshape(len(train), -1)
    size = (len(held), *stack.shape[1:])
    for method, weights in WEIGHTS.items():
        start = time.perf_counter()
        shown = (weights(lights[train], lights[held]) @ coded).reshape(size)
        yield method, time.perf_counter() - start, shown
    start = time.perf_counter()
    shown = stack.encode(robust_lambert(lights[train], lights[held], linear))
    yield ROBUST, time.perf_counter() - start, shown
    start = time.perf_counter()
    sbrdf = impasto.fit_sbrdf(stack.take(train), pooling="painting")
    shown = stack.encode(np.nan_to_num(sbrdf.predict(stack.take(held).rig), nan=0.0))
    yield OURS, time.perf_counter() - start, shown
    start = time.perf_counter()
    lobes = impasto.fit_sbrdf(stack.take(train), pooling="pixel")
    shown = stack.encode(np.nan_to_num(lobes.predict(stack.take(held).rig), nan=0.0))
    yield PIXEL, time.perf_counter() - start, shown
    start = time.perf_counter()
    lamps = impasto.fit_strengths(stack.take(train))
    lobes = impasto.fit_sbrdf(lamps.stack, pooling="pixel")
    lit = lobes.predict(lamps.at(stack.take(held).rig))
    shown = stack.encode(np.nan_to_num(lit, nan=0.0))
    yield LAMPS, time.perf_counter() - start, shown
    start = time.perf_counter()
    sbrdf = impasto.fit_sbrdf(stack.take(train))
    shown = stack.encode(np.nan_to_num(sbrdf.predict(stack.take(held).rig), nan=0.0))
    yield DEFAULT, time.perf_counter() - start, shown


def study(
    stack: impasto.Stack, folds: list[int]
) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Scores of every method, and mean absolute residuals ``(y, x)`` in codes."""
    scores: dict[str, list[np.ndarray]] = defaultdict(list)
    seconds: dict[str, float] = defaultdict(float)
    residuals: dict[str, np.ndarray] = {}
    count = stack.shape[0]
    for fold in folds:
        held = np.arange(fold, count, FOLDS)
        train = np.setdiff1d(np.arange(count), held)
        truth = np.rint(stack.encode(np.array([stack.linear(i) for i in held])))
        for method, took, shown in predictions(stack, train, held):
            scores[method].append(psnr(shown, truth))
            seconds[method] += took
            if method in PICTURED:
                error = np.abs(np.clip(shown, 0.0, 255.0) - truth).mean(axis=(0, 1)) / len(folds)
                residuals[method] = residuals.get(method, 0.0) + error
    rows = []
    for method, parts in scores.items():
        each = np.concatenate(parts)
        rows.append(
            {
                "method": method,
                "numbers per pixel": STORED.get(method, "every photograph"),
                "mean dB": float(each.mean()),
                "worst dB": float(each.min()),
                "best dB": float(each.max()),
                "seconds per fold": seconds[method] / len(folds),
            }
        )
    return sorted(rows, key=lambda row: row["mean dB"]), residuals


def picture(residuals: dict[str, np.ndarray], rows: list[dict[str, Any]]) -> np.ndarray:
    """Residuals side by side on one scale."""
    score = {row["method"]: row["mean dB"] for row in rows}
    top = float(np.percentile(np.concatenate([r.ravel() for r in residuals.values()]), 99))
    panels = [
        ramp_panel(residuals[m], name, unit=f"{score[m]:.1f} dB, 8-bit codes", low=0.0, high=top)
        for m, name in PICTURED.items()
    ]
    return contact_sheet(
        panels,
        title="Relighting photographs that were held out",
        subtitle="mean absolute residual per pixel over 72 photographs, six-fold cross-validation",
        columns=len(panels),
        width=400,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--fold", type=int, choices=range(FOLDS), help="only one of the folds")
    parser.add_argument("--write", action="store_true", help="record benches/results/relighting.*")
    options = parser.parse_args()
    if options.write and options.fold is not None:
        parser.error("--write records all folds: leave --fold out")
    stack = impasto.read_stack(options.data / "icon_rti" / "dirs.lp", encoding="srgb")
    folds = list(range(FOLDS)) if options.fold is None else [options.fold]
    rows, residuals = study(stack, folds)
    show("held-out photographs of the icon, PSNR on coded values", rows)
    if options.write:
        command = "python benches/python/relighting.py --write"
        # Nothing is drawn at random: no seed.
        write(
            "relighting.json",
            {"run": run_info(command), "seed": None, "folds": FOLDS} | {"rows": rows},
        )
        sheet = picture(residuals, rows)
        write_jpeg(RESULTS / "relighting.jpg", sheet, quality=88)


if __name__ == "__main__":
    main()

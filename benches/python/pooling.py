"""One lobe for the painting against lobes of every pixel's own: before and after.

    python benches/python/pooling.py [--size N] [--data DIR] [--write]

Two subjects: a simulated painting with patches of three varnishes, cracks, twice the relief and
cast shadows under 48 lights in 8-bit sRGB, and the icon's 72 photographs. Photographs k = 0, 6, ...
are held out, both fits see the others and foretell them; for the simulated painting the normals are
compared with the truth as well. ``--write`` records benches/results/pooling.json and the maps
of both beside it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lobes import rig
from record import RESULTS, data_folder, run_info, show, write
from relighting import FOLDS, psnr

import impasto
from impasto import simulate
from impasto.io import write_jpeg
from impasto.pictures import Panel, colour_panel, contact_sheet, normal_panel, ramp_panel
from impasto.simulate.score import normal_error

FITS = {"painting": "one lobe", "pixel": "own lobes"}
SEED = 7


@dataclass(frozen=True, eq=False)
class Subject:
    """Photographs, and what is known of the surface."""

    name: str
    stack: impasto.Stack
    normal: np.ndarray | None = None


def simulated(size: int) -> Subject:
    painting = simulate.painting(SEED, (size, size), varnish="patches", craquelure=True, relief=2.0)
    capture = simulate.capture(painting, rig(), "rgb", shadows=True, encoding="srgb", bits=8)
    return Subject("simulated", capture.stack, capture.truth.normal)


def icon(data: Path) -> Subject:
    return Subject("icon", impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb"))


def angles(angle: np.ndarray | None) -> dict[str, float | None]:
    """Of the normals to the truth, degrees; None where that is not known."""
    names = ("normal deg, median", "normal deg, mean", "normal deg, p95")
    if angle is None:
        return dict.fromkeys(names)
    known = angle[np.isfinite(angle)]
    measures = np.median(known), known.mean(), np.percentile(known, 95)
    return dict(zip(names, map(float, measures), strict=True))


def compared(subject: Subject) -> tuple[list[dict[str, Any]], list[Panel]]:
    """A row per fit, and the maps of both."""
    stack = subject.stack
    count = stack.shape[0]
    held = np.arange(0, count, FOLDS)
    train = np.setdiff1d(np.arange(count), held)
    truth = np.rint(stack.encode(np.array([stack.linear(i) for i in held])))
    rows: list[dict[str, Any]] = []
    maps: list[tuple[np.ndarray, ...]] = []
    for pooling, name in FITS.items():
        found = impasto.fit_sbrdf(stack.take(train), pooling=pooling)
        shown = stack.encode(np.nan_to_num(found.predict(stack.take(held).rig), nan=0.0))
        row = {"subject": subject.name, "fit": name, "mean dB": float(psnr(shown, truth).mean())}
        residual = np.abs(np.clip(shown, 0.0, 255.0) - truth).mean(axis=(0, 1))
        maps.append((found.normal, residual))
        angle = None if subject.normal is None else normal_error(found.normal, subject.normal)
        if angle is not None:
            maps[-1] += (angle,)
        rows.append(row | angles(angle))
    middle = stack.linear(int(held[len(held) // 2]))
    first = [
        colour_panel(middle, "Held-out photograph", note=subject.name),
        ramp_panel(found.lobes.astype(np.float32), "Lobes per pixel", low=0.0, high=2.0),
    ]
    scales = (("Residual", "8-bit codes"), ("Error of normals", "degrees"))
    tops = [
        float(np.nanpercentile(np.stack(pair), 98)) for pair in list(zip(*maps, strict=True))[1:]
    ]
    panels = []
    for panel, name, (normal, *rest) in zip(first, FITS.values(), maps, strict=True):
        panels += [panel, normal_panel(normal, f"Normals, {name}")]
        for plane, top, (what, unit) in zip(rest, tops, scales, strict=False):
            panels.append(ramp_panel(plane, f"{what}, {name}", unit=unit, low=0.0, high=top))
    return rows, panels


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=256, help="of the simulated painting")
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--write", action="store_true", help="record benches/results/pooling.*")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for subject in (icon(options.data), simulated(options.size)):
        found, panels = compared(subject)
        show(f"{subject.name}: every sixth photograph held out", found)
        rows += found
        if options.write:
            sheet = contact_sheet(
                panels,
                title="One lobe for the painting, or lobes of every pixel's own",
                subtitle="every sixth photograph held out; residuals are means over those",
                columns=len(panels) // 2,
                width=400,
            )
            write_jpeg(RESULTS / f"pooling-{subject.name}.jpg", sheet, quality=88)
    if options.write:
        run = {"run": run_info("python benches/python/pooling.py --write"), "seed": SEED}
        write("pooling.json", run | {"size": options.size, "rows": rows})


if __name__ == "__main__":
    main()

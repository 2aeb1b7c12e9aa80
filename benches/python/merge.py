"""What is left at the seams of a merged painting, and how far it is from the truth.

    python benches/python/merge.py [--record]

A simulated painting is photographed in 2 x 3 overlapping frames, each with an exposure, a white
balance, a lean of the panel, a rotation, a distance and a shift by parts of a pixel of its own
(``tests/overlapping_frames.py``). Every frame is fitted alone, and all are merged. The truth is the
painting of the simulation through the same lens, in the system of the first frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from record import run_info, show, write

import impasto
from impasto.merge.report import COLOUR

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from overlapping_frames import Scene, scene, two_by_three

SIZE, FRAME = (230, 320), (140, 140)
LAMPS = 24


def degrees(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Angles between normals ``(3, y, x)``."""
    across = np.linalg.norm(np.cross(one, other, axis=0), axis=0)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(one * other, axis=0))))


def differences(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """DE00 between linear sRGB colours ``(3, y, x)``."""
    matrix = impasto.colour.Display.named("srgb").xyz_from_linear
    labs = [
        impasto.colour.lab_from_xyz(np.einsum("ij,jyx->iyx", matrix, np.maximum(planes, 0.0)))
        for planes in (one, other)
    ]
    return impasto.colour.delta_e(*labs)


def case(name: str, taken: Scene, **options: Any) -> tuple[dict[str, Any], impasto.MergeReport]:
    """Fit every frame alone, merge, and compare."""
    start = time.process_time()
    fits = [impasto.fit_sbrdf(stack, **options) for stack in taken.stacks]
    fitted = time.process_time() - start
    start = time.process_time()
    merged = impasto.merge(fits, white=0)
    spent = time.process_time() - start
    assert isinstance(merged.sbrdf, impasto.Sbrdf)
    normal, diffuse = taken.truth(merged.report)
    angle = degrees(merged.sbrdf.normal.astype(float), normal)
    colour = differences(merged.sbrdf.diffuse.astype(float), diffuse)
    alone = [
        degrees(fit.normal.astype(float), taken.truth_of(index)[0])
        for index, fit in enumerate(fits)
    ]
    seams = merged.report.seams
    pixels = int(merged.sbrdf.estimated.sum())
    row = {
        "case": name,
        "seams": len(seams),
        "colour_before": max(seam.colour_before for seam in seams),
        "colour": max(seam.colour for seam in seams),
        "degrees_before": max(seam.degrees_before for seam in seams),
        "degrees": max(seam.degrees for seam in seams),
        "shift": max(seam.shift for seam in seams),
        "pixel_degrees": max(seam.pixel_degrees for seam in seams),
        "normal_error": float(np.nanmedian(angle)),
        "normal_error_frames": float(np.nanmedian(alone)),
        "colour_error": float(np.nanmedian(colour)),
        "seconds": spent,
        "fit_seconds": fitted,
        "microseconds_per_pixel": 1e6 * spent / pixels,
    }
    return row, merged.report


def sentences(rows: list[dict[str, Any]]) -> dict[str, str]:
    """What the numbers say of the bound on colours, for documentation."""
    worst = max(rows, key=lambda row: row["colour"])
    over = 100.0 * (worst["colour"] / COLOUR - 1.0)
    bound = (
        f"the bound, {COLOUR:.3f}, is missed by {over:.2f} % of it, and the report warns"
        if over > 0.0
        else f"no seam misses the bound, {COLOUR:.3f}"
    )
    return {
        "bound": (
            f"At the worst seam of all, of {worst['case']}, colours differ by "
            f"{worst['colour']:.3f} dE00: {bound}."
        )
    }


def main() -> None:
    """Run all cases and show them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    record = parser.parse_args().record
    shots = two_by_three(SIZE, FRAME)
    rows, every = [], []
    taken = scene(SIZE, FRAME, shots, lights=LAMPS)
    sharp = scene(SIZE, FRAME, shots, lights=LAMPS, lens=0.5)
    for name, one, options in (
        ("one lobe", taken, {"pooling": "painting"}),
        ("one lobe, sharper lens", sharp, {"pooling": "painting"}),
        ("lobes per pixel", taken, {"pooling": "pixel", "lobes": 1}),
    ):
        row, report = case(name, one, **options)
        print(f"{name}\n{report}\n", flush=True)
        rows.append(row)
        every.append({"case": name, **report.to_dict()})
    show("Merged from 2 x 3 frames", rows)
    if record:
        print(
            write(
                "merge.json",
                {
                    "run": run_info("python benches/python/merge.py --record"),
                    "rows": rows,
                    "sentences": sentences(rows),
                    "reports": every,
                },
            )
        )


if __name__ == "__main__":
    main()

"""What a white board and positions of lamps are worth: normals and albedo under near lamps.

    python benches/python/boards.py [--record]

A matte relief under nine lamps at 45 degrees (``tests/oracles/near_lamps.py``, plain numpy), whose
strengths differ by 10 %, through a lens whose corners are darker by 20 %; no noise, codes of 16
bits. Distances of the lamps in picture widths, slopes of the relief as root mean squares. Errors
are means over the picture. The albedo without a correction has no scale and is left out.
``--record`` writes benches/results/boards.json and sets the tables of docs/calibrate.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write

import impasto
from impasto.calibrate import board_strengths
from impasto.io import LightFile, write_lights

sys.path.insert(0, str(ROOT / "tests"))

from oracles import near_lamps

SIZE = 128
DISTANCES = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
SLOPES = (1.7, 8.5, 16.4)
CASES = ("nothing", "board, directions", "board, positions", "strengths, positions")


def fitted(made: near_lamps.Scene) -> dict[str, tuple[float, float]]:
    """Errors of normals (degrees) and albedo (share) of each case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = near_lamps.photographs(folder, made)
        lengths = np.linalg.norm(made.lamps, axis=1)
        directions = made.lamps / lengths[:, None]
        write_lights(folder / "lamps.lp", directions, names)
        dome = LightFile(
            folder / "lamps.dome", "dome", None, directions, lengths,
            positions=made.lamps, width_mm=float(made.x.shape[1]),
        )  # fmt: skip
        write_lights(folder / "lamps.dome", dome)
        dark = folder / "dark.tif"
        board_strengths(folder / "white", folder / "lamps.dome", dark=dark).save(
            folder / "strengths.txt"
        )
        options: dict[str, dict[str, Any]] = {
            "nothing": {"lights": "lamps.lp"},
            "board, directions": {"lights": "lamps.lp", "white": folder / "white"},
            "board, positions": {"lights": "lamps.dome", "white": folder / "white"},
            "strengths, positions": {
                "lights": "lamps.dome", "intensities": folder / "strengths.txt",
            },
        }  # fmt: skip
        found = {}
        for case in CASES:
            given = options[case]
            stack = impasto.read_stack(
                folder / "painting", dark=dark, **{**given, "lights": folder / given["lights"]}
            )
            normals = impasto.fit_normals(stack)
            albedo = normals.albedo.reshape(-1, *made.x.shape)[0]
            found[case] = near_lamps.errors(made, normals.normal, albedo)
    return found


def rows() -> list[dict[str, Any]]:
    """One row for each slope and distance."""
    table = []
    for slope in SLOPES:
        for distance in DISTANCES:
            found = fitted(near_lamps.scene(SIZE, distance, slope))
            row: dict[str, Any] = {"slope": f"{slope:g}°", "distance": f"{distance:g}"}
            for case, (angle, albedo) in found.items():
                row[f"{case}: normal"] = angle
                if case != "nothing":
                    row[f"{case}: albedo"] = 100.0 * albedo
            table.append(row)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--record", action="store_true", help="write benches/results/boards.json")
    options = parser.parse_args()
    found = rows()
    show("errors of normals (degrees) and albedo (%) under near lamps", found)
    if options.record:
        head = {"run": run_info("python benches/python/boards.py --record")}
        print(f"\nwrote {write('boards.json', head | {'rows': found})}")
        set_tables(ROOT / "docs" / "calibrate.md")


if __name__ == "__main__":
    main()

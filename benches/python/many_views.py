"""Memory and time of an alignment of hundreds of moving views.

    python benches/python/many_views.py [--record]

Twelve simulated views of a relief (``relief_scene.py`` of tests/oracles), copied to 77 and to 770
photographs of 360 x 300 pixels with exact marks; each alignment with depth is a process of its own,
whose largest resident memory the system tells. ``--record`` writes benches/results/many_views.json.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from record import ROOT, run_info, show, write

from impasto.align import align, read_points
from impasto.calibrate import Lens, read_lens
from impasto.io import write_lights, write_tiff16

sys.path.insert(0, str(ROOT / "tests"))

from oracles import flat_scene, relief, relief_scene

SIZE, FOCAL, PAINTING = (360, 300), 430.0, (100.0, 80.0)
COUNTS = (77, 770)
VIEWS = 12


def folder_of(where: Path, count: int) -> Path:
    """Photographs, light file, marks and lens."""
    marks = flat_scene.grid_of(3, 3, 40.0)
    names = [f"mark {number}" for number in range(len(marks))]
    surface = relief_scene.bumps(*PAINTING, -1.49, 2.44, 36.0, 14.0, seed=2)
    noise = relief.smooth_noise(512, 4.0, 3).astype(np.float32)

    def albedo(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        at = (x / 0.3 + 256).astype(np.float32), (y / 0.3 + 256).astype(np.float32)
        waves = cv2.remap(noise, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
        return np.exp(0.35 * waves - 1.0)

    made = []
    for number in range(VIEWS):
        camera = flat_scene.Camera(
            SIZE, FOCAL, tilt=(0, 30, 45, 60)[number % 4], azimuth=77 * number, distance=165
        )
        light = relief_scene.photograph(camera, surface, albedo, (0.0, 0.6, 0.8), 1)
        codes = np.rint(65535 * np.clip(0.8 * light, 0, 1)).astype(np.uint16)[None]
        made.append((codes, dict(zip(names, camera.pixel(marks).tolist(), strict=True))))
    folder = where / "photographs"
    folder.mkdir()
    files = [f"p{number:03}.tif" for number in range(count)]
    for number, name in enumerate(files):
        write_tiff16(folder / name, made[number % VIEWS][0])
    write_lights(folder / "lamps.lp", np.tile([0.0, 0.6, 0.8], (count, 1)), files)
    content = {
        "size_mm": PAINTING, "kind": "exact",
        "points_mm": dict(zip(names, marks.tolist(), strict=True)),
        "photographs": {name: made[number % VIEWS][1] for number, name in enumerate(files)},
    }  # fmt: skip
    (where / "points.json").write_text(json.dumps(content), encoding="utf-8")
    matrix = np.array([[FOCAL, 0, 179.5], [0, FOCAL, 149.5], [0, 0, 1.0]])
    Lens(
        "brown", SIZE, matrix, np.zeros(5), np.zeros(4), np.zeros(5), 0.03, 10, 400
    ).save(where / "lens.json")  # fmt: skip
    return folder


def one(where: Path) -> None:
    """Align, and print seconds and the largest resident memory in MB."""
    began = time.perf_counter()
    align(
        where / "photographs", where / "aligned", read_points(where / "points.json"),
        lens=read_lens(where / "lens.json"), depth=True,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(json.dumps({"seconds": seconds, "memory_mb": megabytes}))


def measured(count: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        where = Path(name)
        folder = folder_of(where, count)
        size = sum(path.stat().st_size for path in folder.glob("*.tif")) / 2**20
        pixels = count * SIZE[0] * SIZE[1] * 2 / 2**20
        done = subprocess.run(
            [sys.executable, __file__, "--one", name], check=True, capture_output=True, text=True
        )
        found = json.loads(done.stdout.splitlines()[-1])
    return {"photographs": count, "files_mb": size, "decoded_mb": pixels, **found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--record", action="store_true", help="write benches/results/")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        one(options.one)
        return
    rows = [measured(count) for count in COUNTS]
    show("alignment of moving views with depth", rows)
    if options.record:
        content = {"run": run_info("python benches/python/many_views.py --record"), "rows": rows}
        print(f"\nwrote {write('many_views.json', content)}")


if __name__ == "__main__":
    main()

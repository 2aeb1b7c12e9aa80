"""What a picture and a height of a stored result cost: part by part, against the whole in memory.

    python benches/python/stores.py [--size 4096] [--store FOLDER] [--record]
    python benches/python/stores.py --heights [--record]

A job fits size x size pixels (one lobe, tiles of 512) into a store, unless there is one. Each way
then runs in a process of its own on one thread; memory is the highest resident size, with the
program. Both pictures have the same pixels, which is checked, and heights are compared.

``--heights``: simulated relief with noise, gaps and cliffs, integrated by tiles and as a whole.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from record import run_info, show, write
from sources import highest

import impasto
from impasto.fit.stored.height import height_rows
from impasto.io.results.zarr_store import levels_of
from impasto.jobs.levels import write_levels

SCENE = impasto.Scene([impasto.DistantLight((0.3, 0.2, 0.9))])
DETAIL = np.s_[1000:1512, 1000:1512]
SIZE = (1200, 1700)
WAYS = {
    "picture, part by part": "parts",
    "picture, loaded": "whole",
    "detail of 512 x 512": "detail",
    "overview": "overview",
    "smaller scales, from half the scale on": "scales",
    "height, tile by tile": "height",
    "height, loaded": "whole height",
}


def photographs(folder: Path, size: int) -> impasto.Stack:
    """Six photographs of 12 bits, waves and noise, in a memory map."""
    rng = np.random.default_rng(0)
    lights = [(0.5, 0.0, 0.8), (0.0, 0.5, 0.8), (-0.5, 0.0, 0.8), (0.0, -0.5, 0.8), (0, 0, 1)]
    lights.append((0.6, 0.6, 0.5))
    directions = np.array(lights) / np.linalg.norm(lights, axis=1, keepdims=True)
    path = folder / "samples.npy"
    samples = np.lib.format.open_memmap(path, "w+", np.uint16, (len(lights), 3, size, size))
    x = np.arange(size) / 7.0
    for top in range(0, size, 256):
        y = np.arange(top, min(top + 256, size))[:, None] / 11.0
        normal = np.stack([0.2 * np.sin(x) + 0 * y, 0.2 * np.cos(y) + 0 * x, 1 + 0 * x + 0 * y])
        normal /= np.linalg.norm(normal, axis=0)
        for light, direction in enumerate(directions):
            half = direction + np.array([0.0, 0.0, 1.0])
            half /= np.linalg.norm(half)
            facing, gloss = (
                np.maximum(np.tensordot(one, normal, 1), 0.0) for one in (direction, half)
            )
            for band, albedo in enumerate((0.5, 0.4, 0.3)):
                codes = 2500.0 * (albedo * facing + 0.3 * gloss**40)
                codes += rng.normal(0.0, 4.0, codes.shape)
                samples[light, band, top : top + 256] = np.clip(codes, 0, 4095)
    samples.flush()
    del samples
    rig = impasto.Rig(directions, pitch_mm=0.1)
    mapped = np.load(path, mmap_mode="r")
    return impasto.Stack(mapped, lights=rig, scale=1 / 4095, saturation=4095)


def made(folder: Path, size: int) -> Path:
    """The store."""
    return impasto.run(
        photographs(folder, size),
        folder / "painting.zarr",
        tile=512,
        sample=5,
        memory="600MB",
        pooling="painting",
        residuals=False,
        refine=False,
        effort="draft",
    )


def done(way: str, store: Path, out: Path) -> dict[str, Any]:
    """CPU seconds and bytes of one way, in this process."""
    start = time.process_time()
    stored = impasto.open_sbrdf(store)
    if way == "parts":
        stored.render(SCENE, out, threads=1)
    elif way == "whole":
        impasto.load_sbrdf(store).render(SCENE, threads=1).save(out)
    elif way == "detail":
        impasto.render(stored[DETAIL], SCENE, threads=1).save(out)
    elif way == "overview":
        impasto.render(stored.level(stored.factors[-1]), SCENE, threads=1).save(out)
    elif way == "scales":
        with tempfile.TemporaryDirectory(dir=out.parent) as scratch:
            # Half the scale is made of tiles while these are in memory.
            half = Path("levels") / "2"
            shutil.copytree(store / half, scratch / half, copy_function=os.link)
            write_levels(Path(scratch), stored, levels_of(store)[2], "single")
    elif way == "height":
        stored.height(out, threads=1)
    else:
        height = impasto.integrate_normals(impasto.load_sbrdf(store).normal, 0.1, threads=1)
        tifffile.imwrite(out, height, compression="zlib")
    return {"s": time.process_time() - start, "bytes": highest()}


def large(store: Path, folder: Path) -> dict[str, Any]:
    """Every way, and how much pictures and heights differ."""
    rows, files = [], {}
    for title, way in WAYS.items():
        files[way] = folder / f"{way}.tif"
        command = [sys.executable, __file__, "--one", way, str(store), str(files[way])]
        found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        rows.append({"what": title, "s": found["s"], "MB": found["bytes"] / 1e6})
    same = np.array_equal(*(tifffile.imread(files[way]) for way in ("parts", "whole")))
    if not same:
        raise SystemExit("the picture part by part has other pixels than the whole")
    heights = [tifffile.imread(files[way]) for way in ("height", "whole height")]
    off = float((heights[0] - heights[1]).std() / heights[1].std())
    print(f"heights differ by {off:.2g} of their deviation")
    return {"rows": rows, "height": off}


def relief() -> np.ndarray:
    """Strokes, a bulge and slow waves, in pixels."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    bulge = 10.0 * np.exp(-((x - 510.0) ** 2 + (y - 720.0) ** 2) / 60.0**2)
    slow = 20.0 * np.sin(x / 300.0 + y / 500.0) + 40.0 * (x / SIZE[1] - 0.5) ** 2
    return np.asarray(0.3 * np.sin(x / 3.3) * np.cos(y / 4.1) + bulge + slow)


def normals(height: np.ndarray, degrees: float = 0.0) -> np.ndarray:
    """Unit normals with noise, float32."""
    down, right = np.gradient(height)
    found = np.stack([-right, down, np.ones_like(right)])
    found /= np.linalg.norm(found, axis=0)
    found += np.random.default_rng(1).normal(0.0, np.radians(degrees), found.shape)
    return np.asarray(found, np.float32)


def cases() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Normals and heights without what makes them hard."""
    truth = relief()
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    gaps = normals(truth, 2.0)
    gaps[:, 300:500, 200:450] = np.nan
    gaps[:, np.random.default_rng(2).random(SIZE) < 0.02] = np.nan
    cliff = truth + 15.0 * (np.hypot(x - 800.0, y - 500.0) < 300.0)
    waves = np.stack([0.3 * np.sin(x / 7.0), 0.3 * np.cos(x / 7.0 + y / 7.0), np.ones(SIZE)])
    return {
        "a surface": (normals(truth), truth),
        "noise of 1 degree": (normals(truth, 1.0), truth),
        "noise of 5 degrees": (normals(truth, 5.0), truth),
        "noise of 2 degrees, gaps": (gaps, truth),
        "cliffs of 15 pixels": (normals(cliff), cliff),
        "slopes of no surface": (waves.astype(np.float32), np.zeros(SIZE)),
    }


def heights() -> list[dict[str, Any]]:
    """By tiles against the whole."""
    rows = []
    for name, (normal, truth) in cases().items():
        whole = impasto.integrate_normals(normal)

        def read(rows: slice, columns: slice, normal: np.ndarray = normal) -> np.ndarray:
            return normal[:, rows, columns]

        found = np.concatenate([band[0] for band in height_rows(read, SIZE, 1.0)])
        difference = found - whole
        known = truth.any()
        rows.append(
            {
                "normals": name,
                "difference": float(difference.std()),
                "largest": float(abs(difference).max()),
                "whole": float((whole - truth).std()) if known else None,
                "tiles": float((found - truth).std()) if known else None,
            }
        )
    return rows


def main() -> None:
    """Measure, show and, with ``--record``, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--store", type=Path)
    parser.add_argument("--heights", action="store_true")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        way, store, out = chosen.one
        print(json.dumps(done(way, Path(store), Path(out))))
        return
    if chosen.heights:
        rows = heights()
        show("heights by tiles against the whole, pixels", rows)
        if chosen.record:
            command = "python benches/python/stores.py --heights"
            write("large_heights.json", {"run": run_info(command), "rows": rows})
        return
    with tempfile.TemporaryDirectory() as scratch:
        store = made(Path(scratch), chosen.size) if chosen.store is None else chosen.store
        found = large(store, Path(scratch))
    show(f"{chosen.size} x {chosen.size} pixels in a store", found["rows"])
    if chosen.record:
        command = f"python benches/python/stores.py --size {chosen.size}"
        write("stores.json", {"run": run_info(command), **found})


if __name__ == "__main__":
    main()

"""What exports lose, and how RTI files of ours compare with another program's on a real icon.

    python benches/python/exports.py [--data DIR] [--write]

``losses``: CIEDE2000 between what each written file shows and what impasto shows, over twelve
lights and views, for a fitted icon (own lobes per pixel; one lobe for the painting) and for a
simulated painting with spectra. ``icon``: photographs that were held out of the fit (every sixth of
72, as relight's results on the same photographs have them) against what files show under their
lights: mean PSNR on coded values, the size of the files, seconds. relight's files are read by
``impasto.io.read_relightable``; its seconds are from the record beside them, on another machine.
``--write`` records benches/results/exports.json and a picture beside it.

    python benches/python/exports.py --tiles [--write]

How much memory exports of stores take beyond that of the process (Linux), with stores of two sizes
that are taken for large ones; ``--write`` records benches/results/export_tiles.json.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from record import RESULTS, data_folder, run_info, show, write

import impasto
from impasto import export, simulate
from impasto.export.openlime import shown_by as shown_by_openlime
from impasto.io import read_relightable, read_stack, write_jpeg
from impasto.io.rti import RelightableImage
from impasto.pictures import Panel, contact_sheet

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
SEED = 0
SIZE = (192, 256)
PICTURED = 12
"""The photograph that relight's own pictures show."""
RELIGHT_SECONDS = {"ptm18": 0.7, "hsh27": 0.9, "rbf27": 1.0}
SUFFIXES = {"ptm": ".ptm", "hsh": ".rti", "gltf": ".glb", "height": ".tif", "normal-map": ".png"}
SRGB = impasto.Encoding("srgb", 255.0)
Predict = Callable[[np.ndarray], np.ndarray]


def losses(results: dict[str, Any], folder: Path) -> list[dict[str, Any]]:
    """One row per format."""
    rows = []
    for name in export.FORMATS:
        row: dict[str, Any] = {"format": name}
        for label, result in results.items():
            out = folder / f"{label}-{name}{SUFFIXES.get(name, '')}"
            start = time.perf_counter()
            report = export.to(name, result, out)
            seconds = time.perf_counter() - start
            for key in ("p50", "p95", "p99", "oblique_p95"):
                value = getattr(report, key)
                row[f"{label} {key}"] = "-" if value is None else f"{value:.2f}"
            row[f"{label} MB"] = round(sum(size for _, size in report.files) / 1e6, 2)
            row[f"{label} s"] = round(seconds, 1)
        rows.append(row)
    return rows


def psnr(shown: np.ndarray, photographs: np.ndarray) -> float:
    """Mean over photographs, on codes from 0 to 255."""
    error = SRGB.encode(np.clip(shown, 0.0, 1.0)) - photographs
    return float(np.mean(10.0 * np.log10(255.0**2 / np.square(error).mean(axis=(1, 2, 3)))))


def size(path: Path) -> float:
    files = path.rglob("*") if path.is_dir() else [path]
    planes = {".jpg", ".png", ".json", ".rti", ".ptm", ".npz"}
    kept = [f for f in files if f.suffix in planes and not f.name.startswith(("lit_", "normals"))]
    return round(sum(f.stat().st_size for f in kept if not f.name.endswith("loss.json")) / 1e6, 2)


def by_rti(image: RelightableImage) -> Predict:
    def predict(lights: np.ndarray) -> np.ndarray:
        return np.concatenate([image.linear(one) for one in lights])

    return predict


def by_openlime(folder: Path, shape: tuple[int, int]) -> Predict:
    shown = shown_by_openlime(folder)
    every = np.arange(shape[0] * shape[1])

    def predict(lights: np.ndarray) -> np.ndarray:
        pictures = [shown(tuple(one.tolist()), None, every) for one in lights]
        return np.stack([one.reshape(3, *shape) for one in pictures])

    return predict


def icon(data: Path, folder: Path) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Rows, and pictures of one held-out photograph."""
    stack = read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    held = list(range(0, len(stack.rig), 6))
    fold = stack.take([k for k in range(len(stack.rig)) if k not in held])
    at = np.array([stack.rig.lights[k].direction for k in held])
    photographs = SRGB.encode(stack.take(held).samples)
    rows: list[dict[str, Any]] = []
    pictures = {"the photograph": photographs[held.index(PICTURED)]}

    def row(name: str, predict: Predict, path: Path, seconds: float) -> None:
        shown = predict(at)
        rows.append(
            {
                "file": name,
                "mean dB": round(psnr(shown, photographs), 1),
                "MB": size(path),
                "seconds": round(seconds, 1),
            }
        )
        pictures[name] = SRGB.encode(np.clip(shown[held.index(PICTURED)], 0.0, 1.0))

    peer = data / "peer_relight"
    names = {"ptm18": "relight, PTM", "hsh27": "relight, HSH", "rbf27": "relight, RBF of 27 planes"}
    for folder_name, name in names.items():
        path = peer / folder_name
        row(name, by_rti(read_relightable(path)), path, RELIGHT_SECONDS[folder_name])
    start = time.perf_counter()
    sbrdf = impasto.fit_sbrdf(fold, pooling="pixel")
    fitted = time.perf_counter() - start
    sbrdf.save(folder / "icon.npz")
    for kind, name, out in (
        ("ptm", "impasto, PTM", folder / "icon.ptm"),
        ("hsh", "impasto, HSH", folder / "icon.rti"),
        ("relight", "impasto, relight folder (HSH)", folder / "icon-relight"),
    ):
        start = time.perf_counter()
        export.to(kind, sbrdf, out)  # type: ignore[arg-type]
        seconds = fitted + time.perf_counter() - start
        row(name, by_rti(read_relightable(out)), out, seconds)
    start = time.perf_counter()
    out = folder / "icon-openlime"
    export.to("openlime", sbrdf, out)
    seconds = fitted + time.perf_counter() - start
    for extra in ("rti", "spectra"):
        for file in (out / extra).glob("*"):
            file.unlink()
    row("impasto, OpenLIME's BRDF layer", by_openlime(out, sbrdf.shape), out, seconds)
    row("impasto itself", lambda lights: sbrdf.predict(lights), folder / "icon.npz", fitted)
    return rows, pictures


def tiled(folder: Path) -> list[dict[str, Any]]:
    """A row per store and format; every export is a process of its own."""
    from impasto.export import formats, iiif
    from killed_jobs import stack

    # A quarter of a megapixel is large: whole pictures and levels are then as small as for 1 Gpx.
    formats.LOADED = iiif.LOADED = 2**18
    rows = []
    photographs = stack((600, 1500))
    for times in (1, 6):
        store = folder / f"{times}.impasto.zarr"
        samples = np.concatenate([photographs.samples] * times, axis=2)
        about = {"saturation": photographs.saturation, "scale": photographs.scale}
        painting = impasto.Stack(samples, lights=photographs.rig, **about)
        impasto.run(painting, store, pooling="none", tile=256)
        for name, kind in export.FORMATS.items():
            if kind.tiled is None:
                continue
            out = folder / f"{times}-{name}{'.tif' if kind.suffix else ''}"
            receive, send = multiprocessing.Pipe(duplex=False)
            child = multiprocessing.get_context("fork").Process(
                target=_measured, args=(name, store, out, send)
            )
            child.start()
            rows.append({"format": name, "Mpx": round(0.9 * times, 1), **receive.recv()})
            child.join()
    return rows


def _measured(name: Any, store: Path, out: Path, send: Any) -> None:
    stored = impasto.open_sbrdf(store)
    # What is imported and remembered is no part of it.
    export.to("iiif", stored[:64, :64], out.with_name(f"first-{out.name}"))
    Path("/proc/self/clear_refs").write_text("5")
    before, start = _most_kb(), time.process_time()
    report = export.to(name, stored, out)
    spent = time.process_time() - start
    send.send(
        {
            "MB of memory": round((_most_kb() - before) / 1024, 1),
            "processor s": round(spent, 1),
            "files": len(report.files),
            "MB": round(sum(size for _, size in report.files) / 1e6, 2),
        }
    )


def _most_kb() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--tiles", action="store_true")
    options = parser.parse_args()
    if options.tiles:
        with tempfile.TemporaryDirectory() as name:
            rows = tiled(Path(name))
        show("exports of stores, tile by tile", rows)
        if options.write:
            run = run_info("python benches/python/exports.py --tiles --write")
            write("export_tiles.json", {"run": run, "rows": rows})
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows, pictures = icon(options.data, folder)
        show("icon, held-out photographs", rows)
        stack = read_stack(options.data / "icon_rti" / "dirs.lp", encoding="srgb")
        results = {
            "pixel": impasto.fit_sbrdf(stack, pooling="pixel"),
            "painting": impasto.fit_sbrdf(stack, pooling="painting"),
            "simulated": simulate.painting(SEED, SIZE),
        }
        table = losses(results, folder)
        show("losses", table)
    if options.write:
        run = run_info("python benches/python/exports.py --write")
        write("exports.json", {"run": run, "seed": SEED, "icon": rows, "losses": table})
        panels = [
            Panel(name, np.rint(np.moveaxis(one, 0, -1)).astype(np.uint8))
            for name, one in pictures.items()
        ]
        title = "A photograph that no file has seen"
        sheet = contact_sheet(panels, title=title, subtitle="gilded icon, light 12", columns=3)
        write_jpeg(RESULTS / "exports.jpg", sheet, quality=88)


if __name__ == "__main__":
    main()

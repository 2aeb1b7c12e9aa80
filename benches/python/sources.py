"""What a window of large photographs costs: only its tiles, against the whole and a crop of it.

    python benches/python/sources.py [--size 8192] [--window 512] [--record]

Four photographs of size x size pixels in three bands are read for one window in their middle, by
``read_stack(region=)`` and by the library of the format alone, which decodes each whole and crops
it (tifffile, OpenEXR, OpenCV, numpy). The four are one file under four names; noise keeps it from
compressing well. Each way runs in a process of its own on one thread: CPU seconds are the best of
three, memory is the highest resident size above that before the first reading. Both ways find the
same samples, which is checked.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from record import run_info, show, write

import impasto

COUNT = 4
REPEATS = 3
LIGHTS = ((0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5))


def tiff(path: Path, codes: np.ndarray, **options: Any) -> None:
    """A TIFF with codes ``(y, x, band)``."""
    import tifffile

    tifffile.imwrite(path, codes, photometric="rgb", **options)


def lzw(path: Path, codes: np.ndarray) -> None:
    """A TIFF as Photoshop saves it: strips, LZW, horizontal differences."""
    import cv2

    flags = [cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_ROWSPERSTRIP, 64]
    cv2.imwrite(str(path), codes[..., ::-1], [*flags, cv2.IMWRITE_TIFF_PREDICTOR, 2])


def exr(path: Path, codes: np.ndarray, tile: int = 0) -> None:
    """Half floats in ZIP blocks of 16 rows, or in tiles."""
    import OpenEXR

    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION}
    header["type"] = OpenEXR.tiledimage if tile else OpenEXR.scanlineimage
    if tile:
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize = header["tiles"].ySize = tile
    bands = np.moveaxis(codes, -1, 0)
    channels = {
        name: (plane / 65535.0).astype(np.float16) for name, plane in zip("RGB", bands, strict=True)
    }
    OpenEXR.File(header, channels).write(str(path))


def by_opencv(path: Path, codes: np.ndarray) -> None:
    """JPEG of 8 bits or PNG of 16."""
    import cv2

    deep = path.suffix == ".png"
    picture = codes[..., ::-1] if deep else (codes[..., ::-1] >> 8).astype(np.uint8)
    cv2.imwrite(str(path), picture)


def npy(path: Path, codes: np.ndarray) -> None:
    """An array ``(band, y, x)``."""
    np.save(path, np.ascontiguousarray(np.moveaxis(codes, -1, 0)))


FORMATS: dict[str, tuple[str, Callable[[Path, np.ndarray], None]]] = {
    "TIFF, tiles of 512, not compressed": (".tif", lambda p, c: tiff(p, c, tile=(512, 512))),
    "TIFF, tiles of 512, deflate": (
        ".tif",
        lambda p, c: tiff(p, c, tile=(512, 512), compression="zlib", predictor=True),
    ),
    "TIFF, one strip, not compressed": (".tif", tiff),
    "TIFF, strips of 64 rows, deflate": (
        ".tif",
        lambda p, c: tiff(p, c, rowsperstrip=64, compression="zlib"),
    ),
    "TIFF, strips of 64 rows, LZW": (".tif", lzw),
    "OpenEXR, tiles of 512, ZIP, half": (".exr", lambda p, c: exr(p, c, 512)),
    "OpenEXR, blocks of 16 rows, ZIP, half": (".exr", exr),
    "PNG, 16 bits": (".png", by_opencv),
    "JPEG": (".jpg", by_opencv),
    "array (.npy)": (".npy", npy),
}


def whole(path: Path) -> np.ndarray:
    """``(band, y, x)`` by the format's own library."""
    if path.suffix == ".npy":
        found = np.load(path)
    elif path.suffix == ".exr":
        import OpenEXR

        with OpenEXR.File(str(path), separate_channels=True) as file:
            found = np.stack([file.channels()[name].pixels for name in "RGB"])
    elif path.suffix == ".tif" and "LZW" not in path.parent.name:
        import tifffile

        found = np.moveaxis(tifffile.imread(path), -1, 0)
    else:
        import cv2

        found = np.moveaxis(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1], -1, 0)
    return found


def read(way: str, folder: Path, window: int) -> np.ndarray:
    """``(obs, band, y, x)`` of the window in the middle."""
    paths = sorted(path for path in folder.iterdir() if path.suffix != ".lp")
    with impasto.io.open_source(paths[0]) as source:
        top, left = ((size - window) // 2 for size in source.shape[1:])
    if way == "whole":
        part = (slice(top, top + window), slice(left, left + window))
        return np.stack([whole(path)[:, *part] for path in paths])
    if paths[0].suffix == ".npy":
        rows, columns = slice(top, top + window), slice(left, left + window)
        found = []
        for path in paths:
            with impasto.io.open_source(path) as source:
                found.append(source.read(rows, columns))
        return np.stack(found)
    region = (top, left, window, window)
    return impasto.read_stack(folder / "a.lp", region=region, encoding="linear").samples


def measured(way: str, folder: Path, window: int) -> dict[str, Any]:
    """CPU seconds, bytes and a hash of the samples, in this process."""
    # Everything is imported before.
    small = np.zeros((8, 8, 3), np.uint16)
    suffix, make = next(value for key, value in FORMATS.items() if key == folder.name)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / folder.name / f"a{suffix}"
        path.parent.mkdir()
        make(path, small)
        whole(path)
        impasto.io.open_source(path).close()
    before = highest()
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        found = read(way, folder, window)
        seconds.append(time.process_time() - start)
        digest = hashlib.sha256(np.ascontiguousarray(found)).hexdigest()
    return {"s": min(seconds), "bytes": highest() - before, "sha256": digest}


def highest() -> float:
    """Highest resident size of this program so far, bytes (Linux)."""
    # The system's ru_maxrss begins with that of the process that started this one.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024.0 * int(status.partition("VmHWM:")[2].split()[0])


def photograph(size: int) -> np.ndarray:
    """A ramp with noise of 11 bits: ``(y, x, band)``."""
    rng = np.random.default_rng(0)
    ramp = (np.add.outer(np.arange(size), np.arange(size)) % 4096 * 12).astype(np.uint16)
    return np.stack([ramp + rng.integers(0, 2048, ramp.shape, np.uint16) for _ in range(3)], -1)


def prepared(folder: Path, kind: str, codes: np.ndarray) -> None:
    """One file under four names, with its lights."""
    folder.mkdir()
    suffix, make = FORMATS[kind]
    first = folder / f"0{suffix}"
    make(first, codes)
    lines = []
    for index, (x, y) in enumerate(LIGHTS):
        if index:
            os.link(first, folder / f"{index}{suffix}")
        lines.append(f"{index}{suffix} {x} {y} {0.5**0.5}\n")
    (folder / "a.lp").write_text(f"{COUNT}\n{''.join(lines)}", encoding="utf-8")


def row(kind: str, size: int, window: int, codes: np.ndarray) -> dict[str, Any]:
    """Both ways of one format."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / kind
        prepared(folder, kind, codes)
        found = {}
        for way in ("whole", "window"):
            command = [sys.executable, __file__, "--size", str(size), "--window", str(window)]
            done = subprocess.run(
                [*command, "--one", way, str(folder)],
                capture_output=True, text=True, check=True,
                env=os.environ | {"TIFFFILE_NUM_THREADS": "1"},
            )  # fmt: skip
            found[way] = json.loads(done.stdout)
    if found["whole"]["sha256"] != found["window"]["sha256"]:
        raise SystemExit(f"{kind}: the window differs from the crop of the whole")
    return {
        "file": kind,
        "whole s": found["whole"]["s"],
        "window s": found["window"]["s"],
        "times faster": found["whole"]["s"] / found["window"]["s"],
        "whole MB": found["whole"]["bytes"] / 1e6,
        "window MB": found["window"]["bytes"] / 1e6,
    }


def main() -> None:
    """Measure, show and, with ``--record``, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=8192)
    parser.add_argument("--window", type=int, default=512)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--one", nargs=2, metavar=("WAY", "FOLDER"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        print(json.dumps(measured(chosen.one[0], Path(chosen.one[1]), chosen.window)))
        return
    codes = photograph(chosen.size)
    rows = [row(kind, chosen.size, chosen.window, codes) for kind in FORMATS]
    show(f"{chosen.window} x {chosen.window} of four {chosen.size} x {chosen.size}", rows)
    if chosen.record:
        info = run_info("python benches/python/sources.py --record")
        write("sources.json", {**info, "size": chosen.size, "window": chosen.window, "rows": rows})


if __name__ == "__main__":
    main()

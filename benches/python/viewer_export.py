"""A page of a painting of tens of megapixels, written tile by tile, opened and compared.

    python benches/python/viewer_export.py [--rounds 3] [--write]

A simulated relief of 7400 x 5000 pixels, no part of which is like another, is fitted by a job.
``impasto export web`` writes its page: seconds, processor time, the most memory, files and bytes.
Chromium without a graphics card opens the page from the disk and from a server of this machine, the
whole painting and a detail of single pixels, each time with a new profile. Then tiles of every
scale that the store has, in the middle and at the edges, are compared with ``impasto.render`` of
the same window of the store, in two lights: the largest difference in codes. ``--write`` records
benches/results/viewer_export.json.
"""

from __future__ import annotations

import argparse
import base64
import functools
import http.server
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from record import run_info, show, write

import impasto
from impasto.surface import Surface

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import chromium

ROWS, COLUMNS = 5000, 7400
TILE = 1024
PAGE = 256
"""Rows and columns of a tile of the page."""
WINDOW = (1300, 800)
LAMPS = ((90.0, 45.0), (200.0, 12.0))
"""Azimuth and elevation in degrees."""
RESIDENT = re.compile(r"VmHWM:\s+(\d+) kB\nVmRSS")
PROGRAM = "from impasto.cli import main; raise SystemExit(main())"


def directions(angles: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Unit vectors to lamps."""
    azimuth, elevation = np.radians(np.array(angles)).T
    across = np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], axis=1)


def relief(first: int, last: int) -> Surface:
    """Rows of the painting: waves whose lengths change over it, and a varnish."""
    y, x = np.mgrid[first:last, :COLUMNS].astype(np.float32)
    u, v = x / COLUMNS, y / ROWS
    strokes = np.sin(900 * u * (1 + 0.4 * v)), np.cos(700 * v * (1 + 0.5 * u))
    normal = np.stack([0.25 * strokes[0], 0.25 * strokes[1], np.ones_like(u)])
    normal /= np.linalg.norm(normal, axis=0)
    weave = 0.15 * np.sin(x / 3.1 + 40 * v * v) * np.sin(y / 2.7 - 30 * u * u)
    places = np.stack([u, v, 1 - 0.5 * (u + v)])
    diffuse = 0.08 + 0.6 * places * (0.8 + weave)
    return Surface.torrance_sparrow(normal, diffuse.astype(np.float32), 2.0, 0.2)


def fitted(folder: Path) -> Path:
    """The store of a job that fits photographs of it under eight lamps."""
    lamps = directions([(45.0 * n, 40.0 + 15.0 * (n % 2)) for n in range(8)])
    noise = np.random.default_rng(3)
    shape = (8, 3, ROWS, COLUMNS)
    samples = np.lib.format.open_memmap(folder / "samples.npy", "w+", np.float16, shape)
    for first in range(0, ROWS, 250):
        part = relief(first, first + 250).predict(lamps)
        part += noise.normal(0.0, 1e-3, part.shape).astype(np.float32)
        samples[..., first : first + 250, :] = part
    stack = impasto.Stack(samples, lights=impasto.Rig(lamps, pitch_mm=0.05))
    out = folder / "painting.impasto.zarr"
    impasto.run(stack, out, tile=TILE, pooling="none", memory="2GiB")
    (folder / "samples.npy").unlink()
    return out


def exported(store: Path, out: Path) -> dict[str, float]:
    """What the command takes and makes."""
    words = [sys.executable, "-c", PROGRAM, "export", "web", str(store), "--out", str(out)]
    start, most = time.perf_counter(), 0
    with subprocess.Popen([*words, "--quiet"]) as process:
        # Not what wait says: a process that was just made counts the memory of its parent.
        while process.poll() is None:
            found = RESIDENT.search(Path(f"/proc/{process.pid}/status").read_text())
            most = max(most, int(found[1])) if found else most
            time.sleep(0.05)
    if process.returncode:
        raise RuntimeError(f"impasto export web ended with {process.returncode}")
    took = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    sizes = [one.stat().st_size for one in out.rglob("*") if one.is_file()]
    return {
        "seconds": took,
        "processor s": used.ru_utime + used.ru_stime,
        "MB of memory": most * 1024 / 1e6,
        "files": len(sizes),
        "MB": sum(sizes) / 1e6,
    }


class Silent(http.server.SimpleHTTPRequestHandler):
    """Files of a folder, without a line for each."""

    def log_message(self, *_: Any) -> None:
        """Nothing."""


def opened(address: str, folder: Path) -> dict[str, float]:
    """Milliseconds from the request of the page to its first picture, and to all that is seen."""
    found = {}
    with chromium.Chromium(folder, size=WINDOW) as browser:
        browser.open("data:text/html,<p>warm", ready="document.readyState === 'complete'")
        for name, view in (("whole", ""), ("detail", f"#view={COLUMNS / 3},{ROWS / 3},1")):
            browser.open(f"{address}{view}")
            shown = browser.value("document.documentElement.dataset.shown")
            found[f"{name}: first ms"] = float(shown)
            found[f"{name}: complete ms"] = float(browser.value("performance.now()"))
    return found


def compared(store: Path, address: str, folder: Path) -> list[dict[str, Any]]:
    """For each scale of the store: tiles that are compared, and how far codes are off."""
    stored, rows = impasto.open_sbrdf(store), []
    with chromium.Chromium(folder, size=WINDOW) as browser:
        browser.open(address)
        scales = browser.value("window.impasto.viewer.doc.scales")
        for number, scale in enumerate(scales):
            factor, size = scale["factor"], (scale["height"], scale["width"])
            if factor > max(stored.factors):
                break
            last = [-(-one // PAGE) - 1 for one in size]
            places = {(0, 0), (0, last[1]), (last[0], 0), (last[0], last[1])}
            places |= {(last[0] // 2, last[1] // 2), (last[0] // 3, last[1] // 2)}
            worst = []
            for row, column in sorted(places):
                part = tuple(
                    slice(PAGE * at, min(PAGE * (at + 1), whole))
                    for at, whole in zip((row, column), size, strict=True)
                )
                painting = (
                    stored.visible(*part) if factor == 1 else stored.level_part(factor, *part)
                )
                for azimuth, elevation in LAMPS:
                    lamp = impasto.DistantLight(directions([(azimuth, elevation)])[0])
                    scene = impasto.Scene([lamp])
                    expected = impasto.render(painting, scene, fidelity="model").display
                    codes = tile(browser, f"{number}/{row}-{column}", azimuth, elevation)
                    codes = codes.reshape(*expected.shape[:2], 4)[..., :3]
                    assert expected.std() > 5, "a picture that shows something"
                    worst.append(int(np.abs(codes.astype(int) - expected).max()))
            rows.append(
                {"factor": factor, "columns": size[1], "rows": size[0],
                 "tiles": len(places), "most codes off": max(worst)}
            )  # fmt: skip
    return rows


def tile(
    browser: chromium.Chromium, name: str, azimuth: float, elevation: float
) -> NDArray[np.uint8]:
    """The codes of a tile in the light of a lamp."""
    text = browser.value(
        f"(async () => {{ const {{ viewer }} = window.impasto, name = {json.dumps(name)};"
        "const buffer = await viewer.tiles.get(name), { width, height } = viewer.sizeOf(name);"
        "if (!viewer.renderer.has(name)) viewer.renderer.upload(name, buffer, width, height);"
        f"viewer.renderer.setState({{ ...viewer.first, azimuth: {azimuth},"
        f" elevation: {elevation} }}); viewer.stale = true;"
        "let text = ''; for (const code of viewer.renderer.codes(name))"
        " text += String.fromCharCode(code); return btoa(text); })()"
    )
    return np.frombuffer(base64.b64decode(text), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        store = fitted(folder)
        site = folder / "site"
        made = exported(store, site)
        server = http.server.ThreadingHTTPServer(
            ("127.0.0.1", 0), functools.partial(Silent, directory=str(site))
        )
        threading.Thread(target=server.serve_forever, daemon=True).start()
        addresses = {
            "disk": (site / "index.html").as_uri(),
            "server": f"http://127.0.0.1:{server.server_port}/index.html",
        }
        rounds = {
            place: [
                opened(address, folder / f"{place}{number}") for number in range(options.rounds)
            ]
            for place, address in addresses.items()
        }
        scales = compared(store, addresses["disk"], folder / "compared")
        server.shutdown()
    export = [{"Mpx": ROWS * COLUMNS / 1e6} | {key: round(made[key], 1) for key in made}]
    start = [
        {
            "from": place,
            "what": what,
            "least": round(min(one[what] for one in found)),
            "median": round(statistics.median(one[what] for one in found)),
        }
        for place, found in rounds.items()
        for what in found[0]
    ]
    show("impasto export web", export)
    show(f"the page, {options.rounds} rounds", start)
    show("codes beside impasto.render", scales)
    if options.write:
        run = run_info("python benches/python/viewer_export.py --write")
        load = os.getloadavg()[0]
        write(
            "viewer_export.json",
            {"run": run, "load": load, "export": export, "start": start, "scales": scales},
        )


if __name__ == "__main__":
    main()

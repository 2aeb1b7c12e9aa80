"""How soon the viewer shows a painting, and how often a second it shows a moving light.

``python benches/python/viewer.py`` opens the page of ``impasto view`` in Chromium without a
graphics card (Debian's, its software renderer) and prints one line per surface: milliseconds from
the request of the page to the first picture, and frames per second of a moving light at full scale,
each frame waited for, and the processor time of a frame: that does not depend on what else the
machine does. The same for a room that turns, and the milliseconds of its tables at rest. The
surfaces have 1024 x 1024 pixels, all of which are lit in every frame.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import chromium
from impasto.surface import Surface
from impasto.viewer import Contents, ViewServer

SIDE = 1024
FRAMES = 30
TURNS = 6
MOVE = f"""
(() => {{
  const {{ viewer }} = window.impasto, {{ gl }} = viewer.renderer, one = new Uint8Array(4);
  const names = viewer.seen(0), start = performance.now();
  for (let frame = 0; frame < {FRAMES}; frame++) {{
    Object.assign(viewer.state, {{ azimuth: 12 * frame, elevation: 45 }});
    viewer.stale = true;
    viewer.draw(0);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one);
  }}
  return [names.length, 1000 * {FRAMES} / (performance.now() - start)];
}})()
"""


TURN = f"""
(async () => {{
  const {{ viewer }} = window.impasto, {{ gl }} = viewer.renderer, one = new Uint8Array(4);
  viewer.set({{ ...viewer.first, environment: "gallery", view: viewer.state.view }});
  await viewer.environment();
  const frame = dragging => {{
    viewer.dragging = dragging;
    viewer.stale = true;
    viewer.state.rotation += 3;
    viewer.draw(0);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one);
  }};
  frame(true);
  let start = performance.now();
  for (let i = 0; i < {TURNS}; i++) frame(true);
  const rate = 1000 * {TURNS} / (performance.now() - start);
  frame(false);
  start = performance.now();
  frame(false);
  return [rate, performance.now() - start];
}})()
"""


def surfaces() -> dict[str, Surface]:
    random = np.random.default_rng(0)
    lean = random.normal(0.0, 0.1, (2, SIDE, SIDE)).astype(np.float32)
    normal = np.concatenate([lean, np.ones((1, SIDE, SIDE), np.float32)])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.9, (3, SIDE, SIDE)).astype(np.float32)
    gamma = random.uniform(0.05, 0.4, (2, SIDE, SIDE)).astype(np.float32)
    beta = random.uniform(0.0, 2.0, (2, 3, SIDE, SIDE)).astype(np.float32)
    lobes = [random.uniform(*ends, (3, SIDE, SIDE)) for ends in ((-1.1, -0.8), (0.8, 1.1), (2, 99))]
    strength = random.uniform(0.0, 0.3, (3, 3, SIDE, SIDE))
    return {
        "matte": Surface(normal, diffuse),
        "one Torrance-Sparrow lobe": Surface.torrance_sparrow(normal, diffuse, 2.0, 0.15),
        "two of every pixel, coloured": Surface.torrance_sparrow(normal, diffuse, beta, gamma),
        "three Lafortune lobes, coloured": Surface.lafortune(normal, diffuse, strength, *lobes),
    }


def processor_seconds(parent: int) -> float:
    """Time that the browser's processes have used, from the tables of Linux."""
    ticks, parents = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(folder.name)] = int(fields[1])
        ticks[int(folder.name)] = int(fields[11]) + int(fields[12])

    def below(process: int) -> bool:
        while process > 1 and process != parent:
            process = parents.get(process, 0)
        return process == parent

    return sum(t for process, t in ticks.items() if below(process)) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    for name, surface in surfaces().items():
        server = ViewServer(Contents(surface))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            size = (SIDE + 400, SIDE + 120)
            with chromium.Chromium(Path(folder), size=size) as browser:
                browser.open(f"{server.url}#view={SIDE // 2},{SIDE // 2},1")
                first = browser.value("document.documentElement.dataset.shown")
                before = processor_seconds(browser._process.pid)
                tiles, rate = browser.value(MOVE)
                used = 1e3 * (processor_seconds(browser._process.pid) - before) / FRAMES
                turning, resting = browser.value(TURN)
        server.shutdown()
        print(
            f"{name:33} first picture {first:>5} ms, {rate:5.1f} frames/s, "
            f"{used:4.0f} ms of processor time, {tiles} tiles; a room that turns "
            f"{turning:4.1f} frames/s, at rest {resting:5.0f} ms"
        )


if __name__ == "__main__":
    main()

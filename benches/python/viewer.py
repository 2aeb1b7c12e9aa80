"""How soon the viewer shows a painting, and how often a second it shows a moving light.

``python benches/python/viewer.py`` opens the page of ``impasto view`` in Chromium without a
graphics card (Debian's, its software renderer) and prints for each surface: milliseconds from
the request of the page to the first picture; frames per second of a moving light with all pixels,
each frame waited for, and the processor time of a frame, which does not depend on what else the
machine does; frames per second while the light is dragged, with as many pixels as the page chooses,
and how soon all are there again. Then a room: milliseconds of its tables, the longest task that
blocks the page (tasks below 50 ms are none), frames while it turns. The surfaces have 1024 x 1024
pixels, all of which are seen. ``--write`` records benches/results/viewer_frames.json.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from record import run_info, show, write

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import chromium
from impasto.surface import Surface
from impasto.viewer import Contents, ViewServer

SIDE = 1024
FRAMES = 30
TURNING = 4000
"""Milliseconds."""
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
  return 1000 * {FRAMES} / (performance.now() - start);
}})()
"""


DRAG = """
(async () => {
  const { viewer } = window.impasto, frame = () => new Promise(requestAnimationFrame);
  const drag = async seconds => {
    const start = performance.now();
    let frames = 0;
    for (; performance.now() - start < 1000 * seconds; frames++) {
      viewer.lightAt(0.6 * Math.cos(frames / 9), 0.6 * Math.sin(frames / 9));
      await frame();
    }
    return frames / (performance.now() - start) * 1000;
  };
  await drag(2);
  const rate = await drag(3), share = viewer.canvas.width / viewer.size.width;
  const rested = performance.now();
  while (viewer.moves || viewer.canvas.width < viewer.size.width) await frame();
  return [rate, share, performance.now() - rested];
})()
"""


ROOM = f"""
(async () => {{
  const {{ viewer }} = window.impasto, frame = () => new Promise(requestAnimationFrame);
  const tasks = [];
  new PerformanceObserver(list => tasks.push(...list.getEntries().map(one => one.duration)))
    .observe({{ type: "longtask" }});
  const settled = async () => {{
    const start = performance.now();
    while (!viewer.renderer.prefilter?.shown || viewer.renderer.prefilter.busy) await frame();
    return performance.now() - start;
  }};
  viewer.set({{ ...viewer.first, environment: "gallery", view: viewer.state.view }});
  await viewer.environment();
  const first = await settled(), opening = Math.max(0, ...tasks.splice(0));
  let pictures = 0, frames = 0;
  const start = performance.now(), {{ step }} = viewer.renderer.prefilter;
  viewer.renderer.prefilter.step = function () {{
    const whole = step.call(this);
    pictures += whole;
    return whole;
  }};
  for (; performance.now() - start < {TURNING}; frames++) {{
    viewer.rotate(3);
    await frame();
  }}
  const passed = (performance.now() - start) / 1000;
  await new Promise(done => setTimeout(done, 100));
  const rest = await settled();
  await new Promise(done => setTimeout(done, 100));
  return [first, opening, frames / passed, pictures / passed, Math.max(0, ...tasks), rest];
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


def measured(name: str, surface: Surface) -> dict[str, Any]:
    """A row of the table."""
    server = ViewServer(Contents(surface))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        size = (SIDE + 400, SIDE + 120)
        with chromium.Chromium(Path(folder), size=size) as browser:
            browser.open(f"{server.url}#view={SIDE // 2},{SIDE // 2},1")
            first = browser.value("document.documentElement.dataset.shown")
            before = processor_seconds(browser._process.pid)
            rate = browser.value(MOVE)
            used = 1e3 * (processor_seconds(browser._process.pid) - before) / FRAMES
            dragged, share, rested = browser.value(DRAG)
            tables, opening, turning, pictures, longest, rest = browser.value(ROOM)
    server.shutdown()
    found = {
        "first ms": float(first),
        "all pixels fps": rate,
        "processor ms": used,
        "dragged fps": dragged,
        "share": share,
        "rested ms": rested,
        "tables ms": tables,
        "opening task ms": opening,
        "turning fps": turning,
        "new tables fps": pictures,
        "turning task ms": longest,
        "turned rested ms": rest,
    }
    digits = {"share": 2} | dict.fromkeys((one for one in found if one.endswith("fps")), 1)
    return {"surface": name} | {
        key: round(value, digits[key]) if key in digits else round(value)
        for key, value in found.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("surface", nargs="*", help="names of surfaces; default: all")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    chosen = options.surface or list(surfaces())
    loads = [os.getloadavg()[0]]
    rows = [measured(name, one) for name, one in surfaces().items() if name in chosen]
    loads.append(os.getloadavg()[0])
    show(f"{SIDE} x {SIDE} pixels; processes that wanted a core: {loads}", rows)
    if options.write:
        run = run_info("python benches/python/viewer.py --write")
        write("viewer_frames.json", {"run": run, "load": loads, "frames": rows})


if __name__ == "__main__":
    main()

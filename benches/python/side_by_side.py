"""Megapixels per second of four renderers in one run: impasto, software Vulkan, Mitsuba, numpy.

    pip install mitsuba
    DRJIT_LIBLLVM_PATH=... python benches/python/side_by_side.py [--record]

1024 x 1024 pixels from the front under one distant light, from float32 maps to sRGB codes of 8
bits, on two threads. The renderers take turns; the least time of all rounds counts.

* ``impasto``: ``impasto.render`` with all that is there.
* ``software Vulkan``: ``impasto.gpu.Renderer`` on Mesa's llvmpipe, the surface uploaded before.
* ``Mitsuba``: ``llvm_ad_rgb``, one ray per pixel, the scene loaded and the kernels compiled before;
  ``diffuse``, or the papers' models as BSDFs of ``tests/oracles/mitsuba_models.py``.
  Mitsuba 3.9.1 needs libLLVM 19 or newer (Debian: libllvm19), which that variable names.
* ``roughplastic``: what Mitsuba has nearest to a varnish, a Beckmann coat of one roughness; another
  model, whose picture is not compared.
* ``numpy``: float32, the equations as one writes them, on one thread; ``tuned numpy``: without new
  arrays, codes looked up, in bands of rows that stay in the cache, on two threads
  (``side_by_side_peers.py``).

Pictures of the same model must agree to one code. Where other programs take processor time, the
milliseconds of all cores together are the better comparison; they are recorded, too. ``--record``
writes benches/results/side_by_side.json and sets the table of docs/rendering.md.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

import numpy as np
from pages import set_tables
from record import ROOT, run_info, show, write
from side_by_side_peers import Codes, Frame, Maps, TunedNumpy, mitsuba, mitsuba_frame, numpy_frame

import impasto
from impasto import DistantLight, Scene, Surface, gpu
from impasto.surface import Lobe

SIDE = 1024
THREADS = 2
ROUNDS = 40
BAND = 128
SEED = 0
LIGHT = (0.5, 0.3, 0.8)
EXPOSURE = 0.8
LOBES = 4
NAMES = ("impasto", "software Vulkan", "Mitsuba", "roughplastic", "numpy", "tuned numpy")


def paintings() -> dict[str, Maps]:
    """The same relief and colours with more and more lobes, from pixel to pixel."""
    rng = np.random.default_rng(SEED)
    size = (SIDE, SIDE)
    normal = rng.normal(0.0, 0.1, (3, *size))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    ground = {"normal": normal, "diffuse": rng.uniform(0.0, 0.5, (3, *size))}
    coats = {
        "beta": rng.uniform(0.5, 4.0, (LOBES, *size)),
        "gamma": rng.uniform(0.05, 0.3, (LOBES, *size)),
    }
    psi = rng.uniform(-0.3, 0.3, (LOBES, *size))
    lobes = {
        "strength": rng.uniform(0.0, 0.1, (LOBES, *size)),
        "cxy": np.sin(psi) - np.cos(psi),
        "cz": np.sin(psi) + np.cos(psi),
        "exponent": rng.uniform(3.0, 30.0, (LOBES, *size)),
    }
    first = {name: planes[:1] for name, planes in coats.items()}
    made = {
        "diffuse": ground,
        "Torrance-Sparrow": ground | first,
        f"{LOBES} Torrance-Sparrow lobes": ground | coats,
        f"{LOBES} Lafortune lobes": ground | lobes,
    }
    return {
        name: {key: np.ascontiguousarray(plane, np.float32) for key, plane in maps.items()}
        for name, maps in made.items()
    }


def surface(maps: Maps) -> Surface:
    """The maps as impasto takes them."""
    ground = maps["normal"], maps["diffuse"]
    if "beta" in maps:
        return Surface.torrance_sparrow(*ground, maps["beta"], maps["gamma"])
    if "exponent" in maps:
        names = ("strength", "cxy", "cz", "exponent")
        lobes = zip(*(maps[name] for name in names), strict=True)
        return Surface(*ground, tuple(Lobe(s, tuple(shape)) for s, *shape in lobes), "lafortune")
    return Surface(*ground)


def contenders(maps: Maps, models: Any, adapter: str) -> dict[str, Frame]:
    """What makes a picture anew, by name."""
    painting = surface(maps)
    scene = Scene([DistantLight(LIGHT)], exposure=EXPOSURE)
    card = gpu.Renderer(painting, adapter=adapter, threads=THREADS)

    def ours() -> Codes:
        return impasto.render(painting, scene, fidelity="model", threads=THREADS).display

    def vulkan() -> Codes:
        return card.frame(scene).display

    found: dict[str, Frame] = {"impasto": ours, "software Vulkan": vulkan}
    if models is not None:
        found["Mitsuba"] = mitsuba_frame(models, maps, LIGHT, EXPOSURE)
        if "beta" in maps and len(maps["beta"]) == 1:
            found["roughplastic"] = mitsuba_frame(models, maps, LIGHT, EXPOSURE, "roughplastic")
    found["numpy"] = numpy_frame(maps, LIGHT, EXPOSURE)
    found["tuned numpy"] = TunedNumpy(maps, LIGHT, EXPOSURE, rows=BAND, threads=THREADS)
    return found


def seconds(frames: dict[str, Frame]) -> dict[str, list[tuple[float, float]]]:
    """Seconds of every round, by the clock and of all cores, the contenders taking turns."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in frames}
    for frame in frames.values():
        frame(), frame()  # kernels are compiled, memory is there
    for _ in range(ROUNDS):
        for name, frame in frames.items():
            start, used = time.perf_counter(), time.process_time()
            frame()
            both = time.perf_counter() - start, time.process_time() - used
            found[name].append(both)
    return found


def apart(frames: dict[str, Frame]) -> dict[str, int]:
    """The largest difference in codes from impasto's picture; other models are left out."""
    own = frames["impasto"]().astype(int)
    assert own.std() > 10.0
    found = {
        name: int(np.abs(frame().astype(int) - own).max())
        for name, frame in frames.items()
        if name not in {"impasto", "roughplastic"}
    }
    if wrong := {name: codes for name, codes in found.items() if codes > 1}:
        raise SystemExit(f"pictures of the same scene differ by more than a code: {wrong}")
    return found


def rows_of(name: str, frames: dict[str, Frame]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A line of the table of rates, and one of the time of all cores."""
    codes = apart(frames)
    taken = seconds(frames)
    least = {which: min(clock for clock, _ in times) for which, times in taken.items()}
    cores = {which: min(used for _, used in times) for which, times in taken.items()}
    pixels = SIDE * SIDE / 1e6
    row: dict[str, Any] = {"surface": name}
    processor: dict[str, Any] = {"surface": name}
    for which in NAMES:
        row[which] = pixels / least[which] if which in least else None
        processor[which] = 1e3 * cores[which] if which in cores else None
    for which in NAMES[1:]:
        row[f"over {which}"] = least[which] / least["impasto"] if which in least else None
        processor[f"over {which}"] = cores[which] / cores["impasto"] if which in cores else None
    row["impasto, median"] = pixels / statistics.median(clock for clock, _ in taken["impasto"])
    row["codes apart"] = max(codes.values())
    return row, processor


def main() -> None:
    """Measure, show and, with ``--record``, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--adapter", default="llvmpipe", help="a part of the name of a card")
    parser.add_argument("--without-mitsuba", action="store_true")
    options = parser.parse_args()
    models, versions = (None, {}) if options.without_mitsuba else mitsuba(THREADS)
    pairs = [
        rows_of(name, contenders(maps, models, options.adapter))
        for name, maps in paintings().items()
    ]
    rows, processor = ([pair[i] for pair in pairs] for i in range(2))
    show(f"Mpx/s, {SIDE} x {SIDE}", rows)
    show("ms of all cores", processor)
    if options.record:
        info = run_info("python benches/python/side_by_side.py --record")
        card = next(one for one in gpu.adapters() if options.adapter in one.name)
        peers = {**versions, "vulkan": f"{card.name}, {card.driver}"}
        settings = {"side": SIDE, "threads": THREADS, "rounds": ROUNDS, "seed": SEED}
        write(
            "side_by_side.json",
            {"run": info, **settings, "peers": peers, "rows": rows, "processor": processor},
        )
        set_tables(ROOT / "docs" / "rendering.md")


if __name__ == "__main__":
    main()

"""What a picture costs that is wanted as display codes: time and memory, against all its forms.

    python benches/python/outputs.py [--size 2048] [--record]

A painting of six coefficients with one Torrance-Sparrow lobe under one distant light, from the
front. ``all`` makes XYZ, linear light and codes, as every rendering did; ``codes`` makes codes in
one pass; ``xyz`` makes XYZ alone. Each runs in a process of its own, on one thread and on two.
Memory is the highest resident size above that before the first rendering; time is the best of nine.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
from record import run_info, show, write

import impasto

WAVELENGTHS = np.arange(400.0, 701.0, 10.0)
BASIS = np.exp(-0.5 * ((WAVELENGTHS - np.linspace(410, 690, 6)[:, None]) / 35) ** 2)
FORMS = ("all", "codes", "xyz")
REPEATS = 9


def made(form: str, size: int, threads: int) -> dict[str, float]:
    """Seconds and bytes of one form, in this process."""
    rng = np.random.default_rng(0)
    normal = rng.normal(0.0, 0.1, (3, size, size)).astype(np.float32)
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    coefficients = rng.random((6, size, size), np.float32) * np.float32(0.5)
    spectra: Any = SimpleNamespace(coefficients=coefficients, basis=BASIS, wavelengths=WAVELENGTHS)
    surface = impasto.Surface.torrance_sparrow(normal, coefficients, 2.0, 0.1)
    small = impasto.Surface.torrance_sparrow(normal[:, :9, :9], coefficients[:, :9, :9], 2.0, 0.1)
    scene = impasto.Scene([(0.0, 0.7, 0.7)])
    few: Any = SimpleNamespace(
        coefficients=coefficients[:, :9, :9], basis=BASIS, wavelengths=WAVELENGTHS
    )
    # Tables of colours are read once.
    impasto.render(small, scene, reflectance=few)

    def picture() -> None:
        output: Any = "display" if form == "codes" else "light"
        image = impasto.render(surface, scene, reflectance=spectra, output=output, threads=threads)
        if form == "all":
            assert image.linear.shape == (3, size, size)
        if form != "xyz":
            assert image.display.shape == (size, size, 3)

    before = highest()
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        picture()
        seconds.append(time.perf_counter() - start)
    return {"s": min(seconds), "bytes": highest() - before}


def highest() -> float:
    """Highest resident size of this process so far, bytes (Linux counts kibibytes)."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    """Measure, show and, with ``--record``, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=2048)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--one", nargs=2, metavar=("FORM", "THREADS"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        print(json.dumps(made(chosen.one[0], chosen.size, int(chosen.one[1]))))
        return
    rows = []
    for threads in (1, 2):
        for form in FORMS:
            command = [sys.executable, __file__, "--size", str(chosen.size), "--one", form]
            done = subprocess.run(
                [*command, str(threads)], capture_output=True, text=True, check=True
            )
            found = json.loads(done.stdout)
            rows.append(
                {
                    "form": form,
                    "threads": threads,
                    "ms": 1e3 * found["s"],
                    "Mpx/s": chosen.size**2 / found["s"] / 1e6,
                    "MB above the maps": found["bytes"] / 1e6,
                }
            )
    show(f"A picture of {chosen.size} x {chosen.size}", rows)
    if chosen.record:
        info = run_info("python benches/python/outputs.py --record")
        write("outputs.json", {**info, "size": chosen.size, "rows": rows})


if __name__ == "__main__":
    main()

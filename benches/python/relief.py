"""What cast shadows and interreflections are worth to the default fit on deep reliefs.

    python benches/python/relief.py [--cache DIR] [--record]

Path-traced objects (``path_traced_scenes.py``), by the default call without and with its relief:
errors of normals in degrees, dB of 12 photographs under other lights, CPU seconds. ``--record``
writes benches/results/relief.json and sets the table of docs/models.md.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from pages import set_tables
from path_traced import Shown, scores
from path_traced_scenes import CACHE, SCENES, traced
from record import ROOT, run_info, show, write

import impasto

OBJECTS = (
    "relief-diffuse", "relief-painted-diffuse", "relief-painted-plastic.1", "relief-plastic.3",
    "relief-gold", "bust-diffuse", "bust-plastic.1", "vase-principled", "bumpy-diffuse",
    "sphere-diffuse",
)  # fmt: skip


def row(name: str, cache: Path) -> dict[str, Any]:
    """An object without and with its relief."""
    shown = Shown.of(traced(SCENES[name], cache))
    found: dict[str, Any] = {"object": name}
    for way, relief in (("alone", False), ("with", None)):
        start = time.process_time()
        fit = impasto.fit_sbrdf(shown.stack, relief=relief, threads=1)
        found[f"{way} s"] = time.process_time() - start
        found[f"{way} deg"] = scores(shown, fit)["mean"]
        found[f"{way} dB"] = shown.predicted(fit)
        found[f"{way} model dB"] = shown.predicted(fit, fidelity="model")
    kept = fit.relief
    light = "" if kept is None else "shadows" + " and interreflection" * kept.interreflection
    return found | {"kept": light or "nothing"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of path-traced scenes")
    parser.add_argument("--record", action="store_true", help="write the result")
    options = parser.parse_args()
    rows = [row(name, options.cache) for name in OBJECTS]
    show("errors in degrees and dB of new lights, without and with the relief", rows)
    if options.record:
        run = run_info("python benches/python/relief.py --record")
        print(f"wrote {write('relief.json', {'run': run, 'seed': 'none', 'rows': rows})}")
        set_tables(ROOT / "docs" / "models.md")


if __name__ == "__main__":
    main()

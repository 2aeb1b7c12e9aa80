"""The session of the third paper, rehearsed: moving views, depth and Lafortune lobes.

    python benches/python/rehearsal_snel.py [--size 128] [--views 616] [--record]

``impasto rehearse snel-lafortune``: errors against the truth, and time and memory of its commands.
``--record`` writes benches/results/rehearsal_snel.json, and the sheet as a picture beside it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
from record import RESULTS, run_info, show, write

ERRORS = {
    "flat_rms_px": "places, had the relief been taken for flat, rms, pixels",
    "aligned_rms_px": "places in aligned photographs, rms, pixels",
    "aligned_p95_px": "places in aligned photographs, 95 % below, pixels",
    "depth_rms_mm": "heights, rms, mm",
    "depth_worst_mm": "heights, largest, mm",
    "normal_mean_degrees": "normals, mean, degrees",
    "normal_p95_degrees": "normals, 95 % below, degrees",
    "mirror_delta_e_mean": "pictures near the mirror direction, mean CIEDE2000",
    "mirror_delta_e_p95": "pictures near the mirror direction, 95 % below",
    "other_delta_e_mean": "pictures at other pairs, mean CIEDE2000",
    "other_delta_e_p95": "pictures at other pairs, 95 % below",
}


def rehearsed(size: int, views: int | None, folder: Path) -> dict[str, Any]:
    """The record of one rehearsal."""
    words = ["rehearse", "snel-lafortune", "--out", str(folder), "--size", str(size), "--quiet"]
    some = [] if views is None else ["--views", str(views)]
    subprocess.run([sys.executable, "-m", "impasto", *words, *some], check=True)
    found: dict[str, Any] = json.loads((folder / "rehearsal.json").read_text())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--views", type=int, default=616)
    parser.add_argument("--record", action="store_true", help="write rehearsal_snel.json and .jpg")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = rehearsed(options.size, options.views, Path(folder) / "session")
        sheet = cv2.imread(str(Path(folder) / "session" / "rehearsal.png"))
    own = found["errors"]
    errors = [{"what": words, "error": own[key]} for key, words in ERRORS.items()]
    lobes = [
        {"varnish": kind, "found": own[f"lobes_{kind}"], "true": own[f"lobes_{kind}_true"]}
        for kind in ("matte", "satin", "gloss")
    ]
    commands = [
        {
            "command": " ".join(
                word for word in one["command"].split()[:3] if not word.startswith("painting")
            ),
            "seconds": one["seconds"],
            "memory_mib": one["peak_mib"],
        }
        for one in found["commands"]
    ]
    show("errors", errors)
    show("lobes", lobes)
    show("commands", commands)
    if options.record:
        head = {"run": run_info("python benches/python/rehearsal_snel.py --record")}
        settings = {name: found[name] for name in ("size", "seed", "views", "left_out")}
        content = head | settings | {"errors": errors, "lobes": lobes, "commands": commands}
        print(f"\nwrote {write('rehearsal_snel.json', content)}")
        cv2.imwrite(str(RESULTS / "rehearsal_snel.jpg"), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()

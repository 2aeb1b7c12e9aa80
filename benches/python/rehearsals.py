"""Sessions of the papers, rehearsed: from raw photographs to the relit picture, against the truth.

    python benches/python/rehearsals.py [SYSTEM ...] [--size 256] [--record]

``impasto rehearse`` for each system whose camera stands (``rehearsal_snel.py`` has the other):
errors, also without a camera (the painting's own pixels under the true lamps, with the same noise),
and time and memory of its commands. ``--record`` writes benches/results/rehearsals.json, and the
sheet of the first as a picture beside it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, get_args

import cv2
from record import RESULTS, run_info, show, write

import impasto
from impasto import simulate
from impasto.cli.rehearse import MOVING, Rehearsed
from impasto.rehearsal.outcome import outcome
from impasto.rehearsal.photographs import BITS, CAMERA, EXPOSURE, LAMPS
from impasto.rig import PointView, Rig

ERRORS = {
    "lamps_mean_degrees": "directions of lamps, mean, degrees",
    "lamps_worst_degrees": "directions of lamps, worst, degrees",
    "normal_mean_degrees": "normals, mean, degrees",
    "normal_p95_degrees": "normals, 95 % below, degrees",
    "beta_relative": "strength of the gloss, relative",
    "gamma_relative": "width of the gloss, relative",
    "diffuse_delta_e_mean": "diffuse colour under D65, mean CIEDE2000",
    "diffuse_delta_e_p95": "diffuse colour under D65, 95 % below",
    "relit_delta_e_mean": "picture in another light, mean CIEDE2000",
    "relit_delta_e_p95": "picture in another light, 95 % below",
}


def rehearsed(system: str, size: int, folder: Path) -> dict[str, Any]:
    """The record of one rehearsal."""
    command = [sys.executable, "-m", "impasto", "rehearse", system, "--out", str(folder)]
    subprocess.run([*command, "--size", str(size), "--quiet"], check=True)
    found: dict[str, Any] = json.loads((folder / "rehearsal.json").read_text())
    return found


def without_a_camera(system: str, size: int) -> dict[str, Any]:
    """The same errors from photographs that need no alignment and no calibration."""
    painting = simulate.painting(0, (size, size))
    width = size * painting.pitch_mm
    rig = Rig(
        simulate.rig(system, distance_mm=LAMPS * width, pitch_mm=painting.pitch_mm),
        views=PointView((0.0, 0.0, CAMERA * width)),
    )
    seen = simulate.capture(
        painting, rig, simulate.camera(system), exposure=EXPOSURE, bits=BITS, shadows=True
    )
    sbrdf = impasto.fit_sbrdf(seen.stack)
    reflectance = impasto.fit_reflectance(seen.stack, sbrdf, seen.truth.camera)
    found = outcome(seen.truth, sbrdf, reflectance, rig.directions).numbers()
    return {key: None if key.startswith("lamps") else value for key, value in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "systems", nargs="*", default=[one for one in get_args(Rehearsed) if one != MOVING]
    )
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--record", action="store_true", help="write rehearsals.json and .jpg")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [rehearsed(one, options.size, Path(folder) / one) for one in options.systems]
        sheet = cv2.imread(str(Path(folder) / options.systems[0] / "rehearsal.png"))
    alone = {system: without_a_camera(system, options.size) for system in options.systems}
    errors = [
        {"what": words}
        | {one["system"]: one["errors"][key] for one in found}
        | {f"{system} alone": one[key] for system, one in alone.items()}
        for key, words in ERRORS.items()
    ]
    commands = [
        {"step": first["purpose"]}
        | {f"{one['system']} s": one["commands"][number]["seconds"] for one in found}
        | {f"{one['system']} MiB": one["commands"][number]["peak_mib"] for one in found}
        for number, first in enumerate(found[0]["commands"])
    ]
    show("errors", errors)
    show("commands", commands)
    if options.record:
        head = {"run": run_info("python benches/python/rehearsals.py --record")}
        content = head | {"size": options.size, "errors": errors, "commands": commands}
        print(f"\nwrote {write('rehearsals.json', content)}")
        cv2.imwrite(str(RESULTS / "rehearsal.jpg"), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()

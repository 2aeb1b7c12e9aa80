"""The fits of this version beside those of another one, on the same arrays.

    python benches/python/versions.py OTHER [--only ROW] [--repeats 2] [--record]

``OTHER`` is the folder that holds the package ``impasto`` of the other version with its compiled
core, ``python/`` of a checkout in which ``make build`` was run. Each call runs on one thread in a
process of its own, in turn with that of the other version; times are processor seconds, the least
of the repeats. With ``--only`` a record keeps its other rows. ``error`` is the relative root mean
square error of photographs that were held out (free of noise), ``degrees`` the mean error of
normals; simulated paintings of the study.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, run_info, show, write

import impasto
from impasto import simulate
from study.data_sets import FEWEST_VIEWS, HELD, dome

WORKER = Path(__file__).with_name("version_calls.py")


def photographs(
    folder: Path, name: str, size: int, rig: impasto.Rig, camera: str, every: int, model: Any
) -> Path:
    """Write photographs of a simulated painting; every n-th is held out, without noise."""
    held = np.arange(every // 2, len(rig), every)
    train = np.setdiff1d(np.arange(len(rig)), held)
    relief = 1.0 if model == "lafortune" else 1.5
    painting = simulate.painting(0, (size, size), varnish="patches", relief=relief)
    taken = simulate.capture(painting, rig.take(train), camera, model=model)
    clean = simulate.capture(
        painting, rig.take(held), camera, model=model, noise=False, bits=None, clip=False
    ).stack
    stack, path = taken.stack, folder / f"{name}.npz"
    arrays: dict[str, Any] = {
        "samples": stack.samples, "scale": stack.scale, "saturation": stack.saturation,
        "lights": np.array(stack.rig.directions), "normal": taken.truth.normal,
        "held": np.array([clean.linear(one) for one in range(len(held))]),
        "held_lights": np.array(clean.rig.directions), "limit": 1.0 / taken.truth.exposure,
    }  # fmt: skip
    if model == "lafortune":
        arrays |= {"views": np.array(stack.rig.views), "held_views": np.array(clean.rig.views)}
    np.savez(path, **arrays)
    return path


def domed(size: int) -> Callable[[Path, str], Path]:
    """48 photographs in three bands, and twelve that are held out."""
    return lambda folder, name: photographs(
        folder, name, size, impasto.Rig(dome()), "rgb", HELD, "torrance-sparrow"
    )


def six_bands(size: int) -> Callable[[Path, str], Path]:
    """16 photographs in six bands, and four that are held out."""
    return lambda folder, name: photographs(
        folder, name, size, impasto.Rig(dome(20)), "six-band", HELD, "torrance-sparrow"
    )


def ball_joint(size: int) -> Callable[[Path, str], Path]:
    """700 of 770 photographs, each with a view of its own."""
    rig = simulate.rig("snel-lafortune")
    return lambda folder, name: photographs(
        folder, name, size, rig, "rgb", FEWEST_VIEWS, "lafortune"
    )


@dataclass(frozen=True)
class Row:
    """A row of the table: photographs, and a call of this version and of the other."""

    data: Callable[[Path, str], Path]
    options: dict[str, Any]
    other: dict[str, Any] | None = None


PIXEL = {"pooling": "pixel", "refine": False}
PAINTING = {"pooling": "painting", "refine": False}
ROWS = {
    "own lobes, standard": Row(domed(512), PIXEL),
    "own lobes, draft": Row(domed(512), PIXEL | {"effort": "draft"}),
    "own lobes, reference": Row(domed(512), PIXEL | {"effort": "reference"}),
    "one lobe": Row(domed(1024), PAINTING),
    "default, against own lobes": Row(domed(1024), {}, PIXEL),
    "default, 16 lights x six bands": Row(six_bands(1024), {}, {}),
    "Lafortune, 700 views": Row(ball_joint(48), {"model": "lafortune", "refine": False}),
    "normals, least squares": Row(domed(1024), {"call": "normals", "method": "least-squares"}),
    "normals, robust": Row(domed(1024), {"call": "normals"}),
}


def called(modules: Path, data: Path, options: dict[str, Any]) -> dict[str, float]:
    """Time and errors of one call."""
    one = {"OPENBLAS_NUM_THREADS": "1", "IMPASTO_NUM_THREADS": "1", "PYTHONPATH": str(modules)}
    done = subprocess.run(
        [sys.executable, str(WORKER), str(data), json.dumps(options)],
        capture_output=True, text=True, check=False, env=os.environ | one,
    )  # fmt: skip
    if done.returncode:
        sys.exit(f"{modules}: {options}\n{done.stderr}")
    return dict(json.loads(done.stdout))


def compared(other: Path, name: str, row: Row, repeats: int, folder: Path) -> dict[str, Any]:
    """A row of the table."""
    data = row.data(folder, "data")
    calls = {
        "now": (ROOT / "python", row.options),
        "then": (other, row.options if row.other is None else row.other),
    }
    found: dict[str, list[dict[str, float]]] = {which: [] for which in calls}
    for _ in range(repeats):
        for which, (modules, options) in calls.items():
            found[which].append(called(modules, data, options))
    now, then = (found[which][0] for which in calls)
    seconds = {which: min(one["seconds"] for one in found[which]) for which in calls}
    with np.load(data) as arrays:
        pixels = arrays["normal"][0].size
    return {
        "call": name, "Mpx": pixels / 1e6, "then s": seconds["then"], "now s": seconds["now"],
        "now / then": seconds["now"] / seconds["then"],
        "then degrees": then["degrees"], "now degrees": now["degrees"],
        "then error": then.get("error"), "now error": now.get("error"),
    }  # fmt: skip


def commit_of(modules: Path) -> str:
    """The commit of the other version's checkout."""
    done = subprocess.run(
        ["git", "log", "-1", "--format=%h"], cwd=modules, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path)
    parser.add_argument("--only", choices=ROWS)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    rows = []
    for name, row in ROWS.items():
        if options.only in (None, name):
            with tempfile.TemporaryDirectory() as folder:
                rows.append(
                    compared(options.other.resolve(), name, row, options.repeats, Path(folder))
                )
            show("Processor seconds, one thread", rows[-1:])
    if options.record:
        command = f"python benches/python/versions.py OTHER --repeats {options.repeats} --record"
        run = run_info(command) | {"then": commit_of(options.other)}
        if options.only:
            run, rows = with_rows_of_before(run, rows)
        write("versions.json", {"run": run, "rows": rows})


def with_rows_of_before(
    run: dict[str, Any], rows: list[dict[str, Any]]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The record with some rows anew, each with its commit."""
    record = json.loads((ROOT / "benches" / "results" / "versions.json").read_text())
    anew = {row["call"]: row | {"commit": run["commit"]} for row in rows}
    return record["run"], [anew.get(row["call"], row) for row in record["rows"]]


if __name__ == "__main__":
    main()

"""How often a comparison marks what did not change, and what it finds of what did.

    python benches/python/comparisons.py [--record]

Simulated paintings are photographed twice, from the same or from another place, with noise of their
own; or the varnish of one is taken off in a patch between the two. Shares are of all compared
pixels, at the default ``alpha`` of 0.001; registrations are held against where the simulation took
the photographs (``tests/overlapping_frames.py``, ``tests/cleaned_painting.py``).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from record import run_info, show, write

import impasto
from impasto import simulate
from impasto.comparison import Changed

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from cleaned_painting import cleaned_painting, fitted
from overlapping_frames import Shot, scene

SIZE = (110, 140)
SHOTS = {
    "shifted by parts of a pixel": Shot(91.37, 65.71),
    "rotated by 0.6°, scaled by 1.02, leaning by 1.3°": Shot(
        88.2, 67.3, angle=0.01, scale=1.02, tilt=(0.01, -0.02, 0.0)
    ),
    "rotated by 11°, scaled by 0.85": Shot(90.1, 66.2, angle=0.2, scale=0.85),
}


def row_of(name: str, found: impasto.Comparison, spent: float, **more: Any) -> dict[str, Any]:
    """A row of the table, in percent."""
    shares = {f"{one.name}_share": 100.0 * one.significant for one in found.quantities}
    shares = {
        key: share if found.quantity(key.removesuffix("_share")).tested else "-"
        for key, share in shares.items()
    }
    return {
        "case": name,
        **shares,
        "normal_least": found.quantity("normal").detectable,
        "colour_least": found.quantity("colour").detectable,
        "microseconds_per_pixel": 1e6 * spent / (found.shape[0] * found.shape[1]),
        **more,
    }


def compared(*pair: impasto.Sbrdf, **options: Any) -> tuple[impasto.Comparison, float]:
    """The comparison and its processor time."""
    start = time.process_time()
    found = impasto.compare(*pair, **options)
    return found, time.process_time() - start


def misplaced(found: impasto.Comparison, shot: Shot, first: Shot) -> float:
    """The largest distance in pixels between where a corner lies and where it was found."""
    height, width = found.shape
    x, y = np.meshgrid([0.0, width - 1.0], [0.0, height - 1.0])
    place = found.registration
    own = np.einsum("ij,jyx->iyx", place.linear, [x, y]) + np.reshape(place.offset, (2, 1, 1))
    right, down = x - (width - 1) / 2, y - (height - 1) / 2
    cos, sin = shot.scale * np.cos(shot.angle), shot.scale * np.sin(shot.angle)
    true = [
        shot.x + cos * right + sin * down - first.x + (width - 1) / 2,
        shot.y - sin * right + cos * down - first.y + (height - 1) / 2,
    ]
    return float(np.linalg.norm(own - np.array(true), axis=0).max())


def twice() -> list[dict[str, Any]]:
    """Same place, six bands: one lobe for the painting, and lobes per pixel."""
    painting = simulate.painting(3, SIZE, varnish="gloss", yellowing=0.7)
    stacks = [simulate.capture(painting, seed=seed).stack for seed in (1, 2)]
    rows = []
    for name, pooling in (("one lobe", "painting"), ("lobes per pixel", "pixel")):
        fits = [impasto.fit_sbrdf(stack, pooling=pooling) for stack in stacks]
        camera = simulate.camera("six-band")
        found, spent = compared(*fits, align="same", camera=camera, exposure_sigma=0.0)
        rows.append(row_of(f"photographed twice, {name}", found, spent))
    return rows


def moved() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Another place, three bands."""
    first = Shot(91.0, 66.0)
    taken = scene((132, 182), SIZE, (first, *SHOTS.values()), lights=9, fine=2)
    fits = [impasto.fit_sbrdf(stack, pooling="painting") for stack in taken.stacks]
    rows, places = [], []
    for (name, shot), fit in zip(SHOTS.items(), fits[1:], strict=True):
        found, spent = compared(fits[0], fit)
        rows.append(row_of(name, found, spent))
        places.append(
            {
                "case": name,
                "error": misplaced(found, shot, first),
                "predicted": found.registration.sigma,
            }
        )
    return rows, places


def cleaned() -> list[dict[str, Any]]:
    """The varnish taken off in a patch: marks in it and outside."""
    patch = np.zeros(SIZE, np.bool_)
    patch[30:80, 40:100] = True
    one = cleaned_painting(SIZE, patch)
    fits = fitted(one.before, 1), fitted(one.after, 2)
    found, _ = compared(*fits, align="same")
    assert found.maps is not None
    rows = []
    for name, inside in (("in the patch", patch), ("outside of it", ~patch)):
        marks = {
            f"{flag.name.lower()}_share": 100.0
            * float((found.maps.changed[inside] & flag > 0).mean())
            for flag in Changed
            if flag.name
        }
        true = float(np.median(one.delta_e[inside]))
        error = float(np.median(np.abs(found.maps.delta_e - one.delta_e)[inside]))
        rows.append({"case": name, **marks, "true": true, "error": error})
    return rows


def main() -> None:
    """Run all cases and show them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    record = parser.parse_args().record
    rows = twice()
    more, places = moved()
    rows += more
    patches = cleaned()
    show("Nothing changed: pixels that are marked, percent", rows)
    show("Registration, pixels", places)
    show("Varnish taken off in a patch: pixels that are marked, percent", patches)
    if record:
        run = run_info("python benches/python/comparisons.py --record")
        print(write("comparisons.json", {"run": run, "rows": rows, "places": places,
                                         "patches": patches}))  # fmt: skip


if __name__ == "__main__":
    main()

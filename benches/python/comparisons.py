"""How often a comparison marks what did not change, and what it finds of what did.

    python benches/python/comparisons.py [--record]

Simulated paintings are photographed twice, from the same or from another place, with noise of their
own; or the varnish of one is taken off in a patch between the two. Shares are of all compared
pixels, at the default ``alpha`` of 0.001; registrations are held against where the simulation took
the photographs (``tests/overlapping_frames.py``, ``tests/cleaned_painting.py``).

``unchanged``: two ways to tell changed areas from chance, on other paintings that had not changed,
and that were not used to choose the constants of ``comparison/clusters.py``: the extent of clusters
[@nichols2003familywise], and the false discovery rate of pixels by the procedure of Benjamini and
Hochberg. That one rejects something where, at any threshold, more than ``threshold / 0.05`` of the
pixels are marked; thresholds of 1e-3 to 1e-6 are tried. Both promise one false alarm in twenty.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
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
PITCH_MM = 0.2
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
    segments = np.arange(SIZE[1])[None] // 50 + np.zeros((SIZE[0], 1), np.int64)
    for name, options in KINDS.items():
        more = {"segments": segments} if "segment" in name else {}
        fits = [impasto.fit_sbrdf(stack, **options, **more) for stack in stacks]
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


KINDS: dict[str, dict[str, Any]] = {
    "one lobe": {"pooling": "painting"},
    "lobes per pixel": {"pooling": "pixel"},
    "a lobe per segment": {"pooling": "segment"},
    "Lafortune lobes": {"model": "lafortune", "lobes": 1},
}
THRESHOLDS = (1e-3, 1e-4, 1e-5, 1e-6)
RATE = 0.05


def unchanged() -> list[dict[str, Any]]:
    """How many paintings have a false alarm, by kind of fit, and moved between photographs."""
    pairs: dict[str, list[tuple[tuple[impasto.Sbrdf, impasto.Sbrdf], dict[str, Any]]]] = {}
    size = (90, 110)
    segments = np.arange(size[1])[None] // 40 + np.zeros((size[0], 1), np.int64)
    same = {"align": "same", "camera": simulate.camera("six-band")}
    for seed in range(200, 208):
        varnish = ("gloss", "satin", None)[seed % 3]
        painting = simulate.painting(seed, size, varnish=varnish, yellowing=0.5)
        stacks = [simulate.capture(painting, seed=seed + again).stack for again in (1, 2)]
        for kind, options in KINDS.items():
            more = {"segments": segments} if "segment" in kind else {}
            fits = [impasto.fit_sbrdf(stack, **options, **more) for stack in stacks]
            pairs.setdefault(kind, []).append(((fits[0], fits[1]), same))
    rng = np.random.default_rng(8)
    for seed in range(31, 36):
        shots = [Shot(70.0, 56.0)]
        for angle, scale in ((0.0, 1.0), (0.01, 1.02), (0.15, 0.9)):
            x, y = rng.uniform(-1.0, 1.0, 2)
            shots.append(Shot(70.0 + x, 56.0 + y, angle=angle, scale=scale, tilt=(angle, -0.01, 0)))
        taken = scene((112, 140), (88, 96), tuple(shots), lights=9, fine=2, seed=seed)
        first, *others = (impasto.fit_sbrdf(one, pooling="painting") for one in taken.stacks)
        pairs.setdefault("moved, one lobe", []).extend(((first, other), {}) for other in others)
    rows = []
    for kind, every in pairs.items():
        clusters, discoveries, largest, critical = 0, 0, [], []
        for fits, options in every:
            found = [impasto.compare(*fits, alpha=level, **options) for level in THRESHOLDS]
            clusters += found[0].extent.found > 0
            critical.append(found[0].extent.critical)
            largest.append(_largest(found[0]))
            discoveries += any(
                one.tested and one.significant > level / RATE
                for level, comparison in zip(THRESHOLDS, found, strict=True)
                for one in comparison.quantities
            )
        rows.append(
            {
                "case": kind,
                "pairs": len(every),
                "clusters": clusters,
                "discoveries": discoveries,
                "largest": max(largest),
                "critical": float(np.median(critical)),
            }
        )
    return rows


def _largest(found: impasto.Comparison) -> int:
    """Pixels of the largest cluster, whether significant or not."""
    from scipy import ndimage

    assert found.maps is not None
    labels, _ = ndimage.label(found.maps.changed > 0, np.ones((3, 3)))
    return int(np.bincount(labels.ravel())[1:].max(initial=0))


def cleaned() -> list[dict[str, Any]]:
    """The varnish taken off in a patch: marks in it and outside."""
    patch = np.zeros(SIZE, np.bool_)
    patch[30:80, 40:100] = True
    one = cleaned_painting(SIZE, patch)
    fits = [
        replace(fit, rig=impasto.Rig(fit.rig, pitch_mm=PITCH_MM))
        for fit in (fitted(one.before, 1), fitted(one.after, 2))
    ]
    found, _ = compared(*fits, align="same")
    print(found)
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
    areas = unchanged()
    show("Nothing changed: pixels that are marked, percent", rows)
    show("Registration, pixels", places)
    show("Varnish taken off in a patch: pixels that are marked, percent", patches)
    show("Nothing changed: pairs of paintings with a false alarm", areas)
    if record:
        run = run_info("python benches/python/comparisons.py --record")
        print(write("comparisons.json", {"run": run, "rows": rows, "places": places,
                                         "patches": patches, "unchanged": areas}))  # fmt: skip


if __name__ == "__main__":
    main()

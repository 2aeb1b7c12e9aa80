"""What lamps' strengths are worth: the icon under light that was held out.

    python benches/python/lamps.py [--data DIR] [--record]

The six folds and the score of relighting.py, at every third pixel of every third row. The icon's
light file says nothing of strengths; ``impasto.fit_strengths`` estimates them from the photographs
that are fitted. "fitted" uses them in the fit only and shows the held-out photographs under lamps
of strength 1; "fitted and shown" gives these lamps the strengths that lamps in their directions
had. "refined" is the shortest call, which refines the rig by itself and is asked for directions;
without that, ``refine=False``. Interpolation by radial basis functions sees strengths in the
photographs themselves. ``--record`` writes benches/results/lamps.json.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from record import data_folder, run_info, show, write
from relighting import FOLDS, psnr

import impasto
from study.peers import WEIGHTS

STEP = 3
PEER = "RBF, thin plate"


def icon(data: Path) -> impasto.Stack:
    """Every third pixel of every third row."""
    whole = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    return impasto.Stack(
        np.ascontiguousarray(whole.samples[:, :, ::STEP, ::STEP]),
        lights=whole.rig,
        scale=whole.scale,
        black=whole.black,
        saturation=whole.saturation,
        encoding=whole.encoding,
    )


def coded(stack: impasto.Stack, linear: np.ndarray) -> np.ndarray:
    """Whole codes; pixels that are not estimated are black."""
    return np.rint(stack.encode(np.nan_to_num(linear, nan=0.0)))


def rows(
    stack: impasto.Stack, train: np.ndarray, held: np.ndarray
) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Method, lamps, coded photographs held out, and those fitted."""
    seen, rig = stack.take(train), stack.take(held).rig
    lights = stack.rig.directions
    own = np.array([stack.linear(i) for i in train])
    photographs = np.rint(stack.encode(own)).reshape(len(train), -1)
    weights = WEIGHTS[PEER](lights[train], lights[held])
    size = (len(held), *stack.shape[1:])
    yield PEER, "seen", (weights @ photographs).reshape(size), photographs.reshape(own.shape)
    lamps = impasto.fit_strengths(seen)
    known = {"as given": (seen, [rig]), "fitted": (lamps.stack, [rig, lamps.at(rig)])}
    default = "impasto, the default"
    methods: dict[str, dict[str, Any]] = {
        default: {"refine": False},
        "impasto, one lobe per painting": {"pooling": "painting"},
    }
    for count, name in enumerate(("one lobe", "up to two lobes", "up to three lobes"), start=1):
        methods[f"impasto, {name} per pixel"] = {"pooling": "pixel", "lobes": count}
    for method, options in methods.items():
        for source, (photos, rigs) in known.items():
            surface = impasto.fit_sbrdf(photos, **options)
            inside = coded(stack, surface.predict())
            for name, lit in zip((source, f"{source} and shown"), rigs, strict=False):
                yield method, name, coded(stack, surface.predict(lit)), inside
    surface = impasto.fit_sbrdf(seen)
    inside = coded(stack, surface.predict())
    yield default, "refined", coded(stack, surface.predict(lights[held])), inside


def study(stack: impasto.Stack) -> list[dict[str, Any]]:
    """Scores, best last."""
    scores: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    fitted: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    truth = np.rint(stack.encode(np.array([stack.linear(i) for i in range(stack.shape[0])])))
    for fold in range(FOLDS):
        held = np.arange(fold, stack.shape[0], FOLDS)
        train = np.setdiff1d(np.arange(stack.shape[0]), held)
        for method, lamps, shown, inside in rows(stack, train, held):
            scores[method, lamps].append(psnr(shown, truth[held]))
            if method != PEER:  # which shows what it has seen exactly
                fitted[method, lamps].append(psnr(inside, truth[train]))
    found = []
    for (method, lamps), parts in scores.items():
        each = np.concatenate(parts)
        known = fitted[method, lamps]
        found.append(
            {
                "method": method,
                "lamps": lamps,
                "mean dB": float(each.mean()),
                "worst dB": float(each.min()),
                "best dB": float(each.max()),
                "fitted dB": float(np.concatenate(known).mean()) if known else None,
            }
        )
    return sorted(found, key=lambda row: row["mean dB"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true", help="write benches/results/lamps.json")
    options = parser.parse_args()
    found = study(icon(options.data))
    show(f"held-out photographs of the icon, every {STEP}rd pixel, PSNR on coded values", found)
    if options.record:
        # Nothing is drawn at random: no seed.
        head = {"run": run_info("python benches/python/lamps.py --record"), "seed": None}
        print(f"\nwrote {write('lamps.json', head | {'folds': FOLDS, 'rows': found})}")


if __name__ == "__main__":
    main()

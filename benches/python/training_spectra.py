"""What reflectance estimators learn from more pigments, and their speed beside numpy's and a copy.

    python benches/python/training_spectra.py [--data DIR] [--write]

The set-up is that of the recorded study (``benches/study/pigments.py``), which sweeps the
estimators with the training spectra of colour-science and pigments that it only tests on. Here
pigments are split: some are learnt from, others tested on.
Speed is that of whole calls for a megapixel, the least of some rounds in turns.
``--write`` records both tables in benches/results/reflectance.json.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from record import data_folder, run_info, show, write

from impasto import Training
from impasto.training import default_training
from study import wiener_numpy
from study.fits import reflectance
from study.pigments import (
    GRID,
    PigmentPhotograph,
    photographed,
    read_pigments,
    six_bands,
    spectra_of,
    spectral_errors,
)
from study.settings import ESTIMATORS

LEARNING = tuple(name for name in ESTIMATORS if name != "linear-model")
"""All but the linear model, which learns no more than its few principal components."""
SPLITS, ROUNDS = 4, 7


def by_training_size(data: Path) -> list[dict[str, Any]]:
    """The six-band camera with more and more pigments in the training set.

    Mean over four splits by pigment number; about 378 spectra are held out.
    """
    truth, number = read_pigments(data)
    camera = six_bands(data)
    scores: dict[tuple[int, str], list[dict[str, float]]] = {}
    for split in range(SPLITS):
        rng = np.random.default_rng(10 + split)
        names = rng.permutation(np.unique(number))
        held = np.cumsum([(number == name).sum() for name in names]) <= 378
        test = np.isin(number, names[held])
        photograph = photographed(camera, truth[test], rng)
        others = truth[~test]
        order = rng.permutation(len(others))
        for count in (289, 449, 692, 1497):
            training = Training(
                GRID, np.vstack([default_training().at(GRID), others[order[: count - 289]]])
            )
            for estimator in LEARNING:
                fitted = reflectance(photograph, 1, estimator=estimator, training=training)
                found = spectral_errors(spectra_of(fitted, len(truth[test])), truth[test])
                scores.setdefault((count, estimator), []).append(asdict(found))
    return [
        {"training": count, "estimator": estimator}
        | {key: float(np.mean([s[key] for s in of])) for key in of[0]}
        for (count, estimator), of in scores.items()
    ]


def speed(data: Path, pixels: int = 1 << 20) -> list[dict[str, Any]]:
    """CPU ns per pixel of whole calls, six bands: ours on one thread, numpy's, and a copy."""
    camera = six_bands(data)
    truth, _ = read_pigments(data)
    rho = camera.response(truth, GRID, integration="sum")
    rho = rho[np.random.default_rng(0).integers(0, len(rho), pixels)].astype(np.float32).T
    photograph = PigmentPhotograph(camera, np.ascontiguousarray(rho[:, None]))
    flat = photograph.responses[:, 0]

    def root_polynomial() -> np.ndarray:
        root = np.sqrt(np.maximum(flat, 0))
        i, j = np.triu_indices(6, 1)
        return np.ones((11, 21), np.float32) @ np.vstack([flat, root[i] * root[j]])

    calls: dict[str, Callable[[], Any]] = {"a copy of six planes": flat.copy}
    for name in ESTIMATORS:
        calls[name] = partial(reflectance, photograph, 1, estimator=name)
    calls[wiener_numpy.NAME] = partial(wiener_numpy.fit, photograph, 1)
    calls["root-polynomial, numpy, no estimator built"] = root_polynomial
    least = dict.fromkeys(calls, math.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            start = time.process_time()
            call()
            least[name] = min(least[name], time.process_time() - start)
    return [{"what": name, "ns": 1e9 * took / pixels} for name, took in least.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    tables = {
        "training sets of growing size, six bands, held-out pigments": by_training_size(
            options.data
        ),
        "speed": speed(options.data),
    }
    for title, rows in tables.items():
        show(title, rows)
    if options.write:
        command = "python benches/python/training_spectra.py --write"
        write("reflectance.json", {"run": run_info(command)} | tables)


if __name__ == "__main__":
    main()

"""What reflectance estimators learn from more pigments, and their speed beside numpy's and a copy.

    python benches/python/training_spectra.py [--data DIR] [--write]

The set-up is that of the recorded study (``benches/study/pigments.py``), which sweeps the
estimators with the training spectra of colour-science and pigments that it only tests on. Here
pigments are held out in five folds: what a fold tests, and the centres that its estimators learn
from, have no pigment in common. A pigment is its number in Kremer's catalogue, with all its shades
and boards; or, stricter, its family, the first three digits (grades of azurite are 102xx).
Other materials are held out by set: CES 99, AMPAS 190 (without what is above 1), three charts.
Speed is that of whole calls for a megapixel, the least of some rounds in turns.
``--write`` records the tables in benches/results/reflectance.json and sets those of the pages.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

import colour
import numpy as np
from numpy.typing import NDArray
from pages import set_tables
from record import ROOT, data_folder, run_info, show, write
from training_centres import COUNT, centres

from impasto import Camera, Training
from impasto.training import ampas190, ces99, general_training
from study import wiener_numpy
from study.fits import reflectance
from study.pigments import (
    CAMERAS,
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
FOURTH = "ensemble"
"""The default, which the recorded study does not know."""
SPLITS, ROUNDS = 4, 7
FOLDS = 5
CHARTS = ("ColorChecker N Ohta", "PMC", "ISO 17321-1")
Spectra = NDArray[np.float64]

GENERAL = "CES 99, AMPAS 190"
TRAININGS: dict[str, int | None] = {
    GENERAL: 0,
    "and 128 centres": 128,
    "and 256 centres": 256,
    "and 512 centres": 512,
    f"and {COUNT} centres: default": COUNT,
    "and all other pigments": None,
}
"""How many centres of the pigments that are not tested; None: these themselves."""
LEAKY = f"and {COUNT} centres, none held out"
"""No fair test: what the training set could reach if it had the very pigments."""


def families(number: NDArray[Any]) -> NDArray[Any]:
    """The first three digits of pigment numbers."""
    return np.array([each[:3] for each in number])


def folds_of(group: NDArray[Any]) -> NDArray[np.intp]:
    """The fold of each spectrum: groups stay together, folds have nearly the same size."""
    size = np.zeros(FOLDS, int)
    fold: dict[Any, int] = {}
    for each in np.random.default_rng(0).permutation(np.unique(group)):
        fold[each] = int(size.argmin())
        size[fold[each]] += (group == each).sum()
    return np.array([fold[each] for each in group])


def learnt(pigments: Spectra, count: int | None) -> Training:
    """The general spectra and those of pigments, or so many centres of theirs."""
    general = general_training().at(GRID)
    if count == 0:
        return Training(GRID, general)
    return Training(
        GRID, np.vstack([general, pigments if count is None else centres(pigments, count)])
    )


def estimated(
    camera: Camera, truth: Spectra, training: Training, estimator: Any, seed: int
) -> Spectra:
    """Spectra found for a noisy photograph of true ones."""
    photograph = photographed(camera, truth, np.random.default_rng(seed))
    fitted = reflectance(photograph, 1, estimator=estimator, training=training)
    return spectra_of(fitted, len(truth))


def errors(found: Spectra, truth: Spectra) -> dict[str, float]:
    """As the tables have them."""
    every = spectral_errors(found, truth)
    return {"RMSE %": 100.0 * every.spectrum, "dE00": every.colour, "dE00 p95": every.colour_p95}


def held_out(
    camera: Camera, truth: Spectra, group: NDArray[Any], training: str, estimator: Any
) -> dict[str, float]:
    """Errors over all pigments, each estimated from others."""
    fold = folds_of(group)
    found = np.empty_like(truth)
    for each in range(FOLDS):
        test = fold == each
        own = (
            learnt(truth, COUNT) if training == LEAKY else learnt(truth[~test], TRAININGS[training])
        )
        found[test] = estimated(camera, truth[test], own, estimator, 10 + each)
    return errors(found, truth)


@cache
def other_materials() -> tuple[tuple[Spectra, Spectra], ...]:
    """Sets of other materials, and the general spectra that are left to learn from."""
    ces, ampas = ces99().at(GRID), ampas190().at(GRID)
    charts = [
        np.interp(GRID, spectrum.wavelengths, spectrum.values)
        for chart in CHARTS
        for spectrum in colour.SDS_COLOURCHECKERS[chart].values()
    ]
    both = np.vstack([ces, ampas])
    return (ces, ampas), (ampas[ampas.max(axis=1) <= 1], ces), (np.array(charts), both)


def on_other_materials(camera: Camera, pigments: Spectra, estimator: Any) -> dict[str, float]:
    """Mean errors of the sets that were not learnt from; ``pigments`` were, besides."""
    each = []
    for truth, general in other_materials():
        training = Training(GRID, np.vstack([general, pigments]))
        each.append(errors(estimated(camera, truth, training, estimator, 3), truth))
    return {key: float(np.mean([one[key] for one in each])) for key in each[0]}


def by_training_set(data: Path) -> list[dict[str, Any]]:
    """The default estimator and ever wider training sets; what was the default comes first."""
    truth, number = read_pigments(data)
    rows = []
    for name, (make, _) in CAMERAS.items():
        camera = make(data)
        for training, estimator in [
            (GENERAL, "root-polynomial"),
            *((training, FOURTH) for training in (*TRAININGS, LEAKY)),
        ]:
            number_, family = (
                held_out(camera, truth, group, training, estimator)
                for group in (number, families(number))
            )
            rows.append(
                {"camera": name, "training": training, "estimator": estimator}
                | number_
                | {f"{key}, family": value for key, value in family.items()}
            )
    return rows


def by_estimator(data: Path) -> list[dict[str, Any]]:
    """Pigments that were held out, and other materials."""
    truth, number = read_pigments(data)
    rows = []
    for name, (make, _) in CAMERAS.items():
        camera = make(data)
        for training in (GENERAL, f"and {COUNT} centres: default"):
            count = TRAININGS[training]
            centres_ = centres(truth, count) if count else np.empty((0, GRID.size))
            for estimator in (*LEARNING, FOURTH):
                pigments = held_out(camera, truth, number, training, estimator)
                others = on_other_materials(camera, centres_, estimator)
                rows.append(
                    {"camera": name, "training": training, "estimator": estimator}
                    | pigments
                    | {f"{key}, others": value for key, value in others.items()}
                )
    return rows


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
                GRID, np.vstack([general_training().at(GRID), others[order[: count - 289]]])
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
    for name in (*ESTIMATORS, FOURTH):
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
        "held out by pigment": by_training_set(options.data),
        "estimators": by_estimator(options.data),
        "speed": speed(options.data),
    }
    for title, rows in tables.items():
        show(title, rows)
    if options.write:
        command = "python benches/python/training_spectra.py --write"
        write("reflectance.json", {"run": run_info(command)} | tables)
        for page in ("accuracy.md", "accuracy-and-time.md"):
            set_tables(ROOT / "docs" / page)


if __name__ == "__main__":
    main()

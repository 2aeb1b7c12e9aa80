"""What each reflectance estimator costs and gains, on 1586 measured pigments.

    python benches/python/reflectance_ladder.py [--data DIR] [--write]

Set-up: 400-700 nm in steps of 10, plain sums, light = 3000 K blackbody, white = 1 in each band;
noise of 8 averaged frames with 30 000 e- full well and 3 e- read noise; training with the spectra
in the colour-science wheel (CES 99 + AMPAS 190) and sigma 9.1e-4. HypPigments (Deborah, WHISPERS
2022, CC BY 4.0) are only ever tested on, except in the training ladder, where pigments are split.
``--write`` records the table in benches/results/reflectance.json. Lower is better everywhere.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import impasto
from impasto import Camera, Training, fit_reflectance
from impasto.colour import delta_e, lab_from_xyz, xyz_from_spectrum
from impasto.training import default_training

GRID = np.arange(400.0, 701.0, 10.0)
SIGMA = 9.1e-4
ESTIMATORS = ("linear-model", "wiener", "root-polynomial", "radial-basis")
SPLITS = 4
ROOT = Path(__file__).resolve().parents[2]


def cameras(data: Path) -> dict[str, Camera]:
    """The three camera systems: RGB, RGB through two filters, six bandpass filters."""
    measured = np.load(data / "spectra" / "cameras.npz")
    body = measured["sensitivity"][list(measured["name"]).index("Nikon_D5100")].T
    rgb = np.array([np.interp(GRID, measured["wavelength"], curve) for curve in body])
    filters = np.load(data / "spectra" / "filters.npz")

    def through(name: str) -> np.ndarray:
        row = filters["transmittance"][list(filters["name"]).index(name)]
        return rgb * np.interp(GRID, filters["wavelength"], row)

    efficiency = np.interp(GRID, np.arange(400, 701, 50), [0.35, 0.5, 0.6, 0.62, 0.6, 0.55, 0.45])
    centres = np.arange(425, 676, 50)[:, None]
    six = np.exp2(-4 * ((GRID - centres) / 50.0) ** 2) * efficiency
    return {
        "RGB": Camera(GRID, rgb, 3000.0),
        "RGB+2": Camera(
            GRID, np.vstack([through("Tiffen 80A"), through("Tiffen 8 Yellow 2")]), 3000.0
        ),
        "6BP": Camera(GRID, six, 3000.0),
    }


def pigments(data: Path) -> tuple[np.ndarray, np.ndarray]:
    """Spectra ``(1586, 31)`` and pigment numbers; six that exceed 1 are left out."""
    file = np.load(data / "spectra" / "hyppigments.npz")
    wavelength = file["wavelength"].astype(float)
    visible = (wavelength >= 400) & (wavelength <= 720)
    keep = file["reflectance"][:, visible].max(axis=1) <= 1
    rows = file["reflectance"][keep].astype(float)
    return np.array([np.interp(GRID, wavelength, row) for row in rows]), file["kremer"][keep]


def photographed(camera: Camera, spectra: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Responses ``(N, band)`` with shot and read noise."""
    rho = camera.response(spectra, GRID, integration="sum")
    deviation = np.sqrt(np.maximum(30000 * rho + 9, 0)) / 30000 / np.sqrt(8)
    return rho + rng.standard_normal(rho.shape) * deviation


def estimated(
    camera: Camera,
    rho: np.ndarray,
    estimator: str,
    training: Training | None = None,
    **options: Any,
) -> tuple[np.ndarray, Any]:
    """Spectra ``(N, 31)`` of responses ``(N, band)``, through the public call."""
    options = {"noise": SIGMA, "threads": 1, "integration": "sum"} | options
    fit = fit_reflectance(
        None, rho.T[:, None], camera,
        estimator=estimator, training=training, wavelengths=GRID, **options,
    )  # fmt: skip
    return fit.coefficients[:, 0].T.astype(float) @ fit.basis, fit


def score(estimate: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """RMSE over wavelengths, CIEDE2000 under D65 and goodness of fit, over spectra."""
    operator = xyz_from_spectrum(GRID, "D65")
    rmse = np.sqrt(((estimate - truth) ** 2).mean(axis=1))

    def lab(spectra: np.ndarray) -> np.ndarray:
        return lab_from_xyz(operator @ np.maximum(spectra, 1e-4).T, operator.sum(axis=1))

    colour = delta_e(lab(estimate), lab(truth))
    fitness = (estimate * truth).sum(axis=1)
    fitness /= np.linalg.norm(estimate, axis=1) * np.linalg.norm(truth, axis=1)
    return {
        "rmse": float(rmse.mean()),
        "rmse_p95": float(np.percentile(rmse, 95)),
        "de": float(colour.mean()),
        "de_p95": float(np.percentile(colour, 95)),
        "gfc": float(fitness.mean()),
    }


def shipped(data: Path, seed: int = 0) -> list[dict[str, Any]]:
    """Every camera and estimator with the shipped training set."""
    truth, _ = pigments(data)
    rows = []
    for name, camera in cameras(data).items():
        rho = photographed(camera, truth, np.random.default_rng(seed))
        for estimator in ESTIMATORS:
            estimate, fit = estimated(camera, rho, estimator)
            row = {"camera": name, "estimator": estimator, "rank": len(fit.basis)}
            rows.append(row | score(estimate, truth) | {"ridge": fit.info["ridge"]})
    return rows


def ladder(data: Path) -> list[dict[str, Any]]:
    """The six-band camera with more and more pigments in the training set.

    Mean over four splits by pigment number; about 378 spectra are held out.
    """
    truth, number = pigments(data)
    camera = cameras(data)["6BP"]
    scores: dict[tuple[int, str], list[dict[str, float]]] = {}
    for split in range(SPLITS):
        rng = np.random.default_rng(10 + split)
        names = rng.permutation(np.unique(number))
        held = np.cumsum([(number == name).sum() for name in names]) <= 378
        test = np.isin(number, names[held])
        rho = photographed(camera, truth[test], rng)
        others = truth[~test]
        order = rng.permutation(len(others))
        for count in (289, 449, 692, 1497):
            training = Training(
                GRID, np.vstack([default_training().at(GRID), others[order[: count - 289]]])
            )
            for estimator in ESTIMATORS[1:]:
                estimate, _ = estimated(camera, rho, estimator, training)
                scores.setdefault((count, estimator), []).append(score(estimate, truth[test]))
    return [
        {"training": count, "estimator": estimator}
        | {key: float(np.mean([s[key] for s in of])) for key in of[0]}
        for (count, estimator), of in scores.items()
    ]


def speed(data: Path, pixels: int = 1 << 20) -> list[dict[str, Any]]:
    """Megapixels per second on one thread, six bands, beside numpy's matrix product and a copy."""
    camera = cameras(data)["6BP"]
    truth, _ = pigments(data)
    rho = camera.response(truth, GRID, integration="sum")
    rho = rho[np.random.default_rng(0).integers(0, len(rho), pixels)].astype(np.float32).T
    rho = np.ascontiguousarray(rho.reshape(6, 1024, -1))
    flat = rho.reshape(6, -1)

    def best(call: Any) -> float:
        times = []
        for _ in range(5):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
        return pixels / min(times) / 1e6

    from impasto import _core

    rows = [{"what": "numpy copy of 6 planes", "mpx_per_s": best(flat.copy)}]
    response = camera.operator(GRID, integration="sum")
    for estimator in ESTIMATORS:
        built = _core.spectral_estimator(
            estimator, response, default_training().at(GRID), SIGMA, None, 1
        )  # fmt: skip
        rate = best(lambda built=built: built.apply(rho, None, 1, None))
        rows.append({"what": f"{estimator}, k = {built.basis.shape[1]}", "mpx_per_s": rate})
    matrix = np.ones((6, 6), np.float32)
    rows.append({"what": "numpy (6, 6) @ (6, N)", "mpx_per_s": best(lambda: matrix @ flat)})

    def root_polynomial() -> np.ndarray:
        root = np.sqrt(np.maximum(flat, 0))
        i, j = np.triu_indices(6, 1)
        return np.ones((13, 21), np.float32) @ np.vstack([flat, root[i] * root[j]])

    rows.append({"what": "numpy root-polynomial, k = 13", "mpx_per_s": best(root_polynomial)})
    return rows


def show(title: str, rows: list[dict[str, Any]]) -> None:
    print(f"\n{title}")
    print("  ".join(f"{key:>16}" for key in rows[0]))
    for row in rows:
        cells = (f"{v:16.4g}" if isinstance(v, float) else f"{v!s:>16}" for v in row.values())
        print("  ".join(cells))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    default = os.environ.get("IMPASTO_DATA", ROOT.parent / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    tables = {
        "shipped training, 1586 pigments": shipped(options.data),
        "training ladder, six bands, held-out pigments": ladder(options.data),
        "speed, one thread, one megapixel": speed(options.data),
    }
    for title, rows in tables.items():
        show(title, rows)
    if options.write:
        machine = {
            "processor": platform.processor() or platform.machine(),
            "python": sys.version.split()[0],
            "impasto": impasto.__version__,
            "simd": impasto._core.build_info()["simd"],
            "command": "python benches/python/reflectance_ladder.py --write",
        }
        target = ROOT / "benches" / "results" / "reflectance.json"
        target.write_text(json.dumps({"machine": machine} | tables, indent=1) + "\n")


if __name__ == "__main__":
    main()

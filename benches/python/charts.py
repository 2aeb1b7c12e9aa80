"""Cameras from a simulated photograph of a ColorChecker, against the measured cameras.

    python benches/python/charts.py [--data DIR] [--record]

Thirteen of the 52 measured cameras under D50 and A; the chart (``tests/oracles/colour_chart.py``)
differs from its table by 1.5 % in every patch, an assumption. CIEDE2000 of 300 pigments under
the light, their reflectance estimated by ``impasto.fit_reflectance``: with the measured
sensitivities, with those from the chart, and their XYZ by the matrix from the chart; and what the
chart itself says, of patches that were left out. ``--record`` writes benches/results/charts.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto.calibrate import camera_from_chart
from impasto.calibrate.chart import GRID, chart_reflectances
from impasto.colour import delta_e, lab_from_xyz, spectrum, xyz_from_spectrum

sys.path.insert(0, str(ROOT / "tests"))

from oracles import colour_chart

WHITE = np.array([0.6, 0.95, 0.7])
UNLIKE = 0.015
EVERY = 4


def pigments(data: Path) -> np.ndarray:
    """Every fifth of the measured pigments, ``(pigment, 31)``."""
    file = np.load(data / "spectra" / "hyppigments.npz")
    names = {file[name].ndim: name for name in file.files if file[name].dtype.kind == "f"}
    grid, spectra = file[names[1]].astype(float), file[names[2]].astype(float)[::5]
    return np.array([np.interp(GRID, grid, one) for one in spectra])


def colours(responses: np.ndarray, camera: impasto.Camera, light: str) -> np.ndarray:
    planes = np.ascontiguousarray(responses.T[:, None], dtype=np.float32)
    found = impasto.fit_reflectance(None, planes, camera)
    spectra = found.coefficients[:, 0].T.astype(np.float64) @ found.basis
    return spectra @ xyz_from_spectrum(found.wavelengths, light).T


def compared(data: Path, light: str) -> list[dict[str, Any]]:
    file = np.load(data / "spectra" / "cameras.npz")
    spectra, operator = pigments(data), xyz_from_spectrum(GRID, light)
    truth, white = spectra @ operator.T, operator.sum(axis=1)

    def errors(xyz: np.ndarray) -> np.ndarray:
        return delta_e(*(lab_from_xyz(one.T, white) for one in (xyz, truth)))

    rows: dict[str, list[np.ndarray]] = {}
    said = []
    for number, curves in enumerate(file["sensitivity"][::EVERY]):
        curves = np.array([np.interp(GRID, file["wavelength"], curve) for curve in curves.T])
        weights = curves * spectrum(light, GRID)
        weights = weights / weights.sum(axis=1, keepdims=True)
        off = 1 + np.random.default_rng(number).normal(0, UNLIKE, (24, 1))
        seen = (off * chart_reflectances()) @ weights.T * WHITE
        found = camera_from_chart(colour_chart.photograph(seen, seed=number), light)
        responses = spectra @ weights.T
        measured = impasto.Camera(GRID, curves, light)
        for name, xyz in (
            ("measured sensitivities", colours(responses, measured, light)),
            ("from the chart", colours(responses, found.camera, light)),
            ("a matrix from the chart", responses @ found.matrix.T),
        ):
            rows.setdefault(name, []).append(errors(xyz))
        said.append(found.delta_e)
    table = []
    for name, each in (*rows.items(), ("patches left out, as the command says", said)):
        values = np.concatenate(each)
        values = values[np.isfinite(values)]
        high = float(np.quantile(values, 0.95))
        table.append({"light": light, "what": name, "mean": float(values.mean()), "p95": high})
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--record", action="store_true", help="write benches/results/charts.json")
    options = parser.parse_args()
    found = [row for light in ("D50", "A") for row in compared(options.data, light)]
    show("colour errors of cameras from a chart, dE00", found)
    if options.record:
        head = {"run": run_info("python benches/python/charts.py --record")}
        print(f"\nwrote {write('charts.json', head | {'rows': found})}")


if __name__ == "__main__":
    main()

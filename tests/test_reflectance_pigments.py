"""How well measured pigments are estimated; HypPigments (Deborah, WHISPERS 2022), CC BY 4.0."""

from __future__ import annotations

import importlib.util
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto.simulate import camera as simulated_camera
from study import pigments
from study.fits import reflectance
from study.settings import ESTIMATORS


def _benchmark():
    path = Path(__file__).parents[1] / "benches" / "python" / "training_spectra.py"
    spec = importlib.util.spec_from_file_location("training_spectra", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


benchmark = _benchmark()


@pytest.fixture(scope="module")
def shipped(data):
    found = {}
    for camera in pigments.CAMERAS:
        photograph = pigments.pigment_data(camera, camera, data, 1, seed=1)
        for estimator in ESTIMATORS:
            fitted = reflectance(photograph.stack, 1, estimator=estimator)
            found[camera, estimator] = asdict(pigments.judged_spectra([fitted], [photograph]))
    return found


# Limits: what an independent implementation reached, plus 5 to 15 %.
@pytest.mark.parametrize(
    ("camera", "estimator", "limits"),
    [
        ("6BP", "wiener", {"spectrum": 0.0142}),
        ("6BP", "root-polynomial", {"spectrum": 0.0109, "colour": 0.56, "colour_p95": 1.2}),
        ("6BP", "radial-basis", {"spectrum": 0.0116, "colour": 0.62}),
        ("RGB", "wiener", {"spectrum": 0.0335}),
        ("RGB", "linear-model", {"spectrum": 0.0350}),
        ("RGB", "root-polynomial", {"spectrum": 0.0288, "colour": 1.65}),
        ("RGB+2", "root-polynomial", {"spectrum": 0.0222}),
    ],
)
def test_pigments_are_estimated_within_the_limits(camera, estimator, limits, shipped):
    row = shipped[camera, estimator]
    assert {key: row[key] for key in limits if row[key] > limits[key]} == {}
    if camera == "6BP":
        assert row["fitness"] >= 0.997


def test_the_default_is_never_much_worse_than_wiener(shipped):
    for camera in ("RGB", "RGB+2", "6BP"):
        ratio = (
            shipped[camera, "root-polynomial"]["spectrum"] / shipped[camera, "wiener"]["spectrum"]
        )
        assert ratio <= 1.05


@pytest.mark.slow
def test_more_training_spectra_pay_off(data):
    rows = {(row["training"], row["estimator"]): row for row in benchmark.by_training_size(data)}
    assert rows[1497, "radial-basis"]["spectrum"] <= 0.0060
    assert rows[1497, "radial-basis"]["colour"] <= 0.40
    for name in benchmark.LEARNING:
        assert rows[1497, name]["spectrum"] < rows[289, name]["spectrum"]


@pytest.mark.parametrize(
    ("camera", "noise"), [("rgb", 1e-3), ("six-band", 1e-3), ("six-band", 1e-2)]
)
def test_intervals_hold_pigments_that_were_not_trained_on(data, camera, noise, tmp_path):
    """1592 measured pigments, none of them among the training spectra, through noisy responses.

    The interval is for 95 % of the training spectra, which are more varied than pigments: more of
    these may lie within. At each wavelength alone the share is that of correlated errors, so it may
    be a few percent lower.
    """
    measured = np.load(data / "spectra" / "hyppigments.npz")
    grid = np.arange(410.0, 701.0, 5.0)
    spectra = np.array([
        np.interp(grid, measured["wavelength"], one) for one in measured["reflectance"]
    ])  # fmt: skip
    lens = simulated_camera(camera)
    random = np.random.default_rng(0)
    responses = spectra @ lens.operator(grid).T
    responses += noise * random.normal(size=responses.shape)
    found = impasto.fit_reflectance(
        None, np.ascontiguousarray(responses.T[:, None]), lens, wavelengths=grid, noise=noise
    )
    limits = np.array([found.interval(0, x) for x in range(len(spectra))])
    inside = (spectra >= limits[:, 0]) & (spectra <= limits[:, 1])
    assert 0.93 <= inside.mean() <= 0.99
    assert inside.mean(axis=0).min() >= 0.88
    # It is no wider than it need be: half of it holds clearly fewer.
    half = np.abs(spectra - limits.mean(axis=1)) <= 0.25 * np.diff(limits, axis=1)[:, 0]
    assert half.mean() <= 0.90
    # It is saved with the result, and files of earlier versions have none.
    found.save(tmp_path / "a.npz")
    assert np.array_equal(impasto.Reflectance.load(tmp_path / "a.npz").interval(0, 7), limits[7])
    arrays = dict(np.load(tmp_path / "a.npz"))
    del arrays["spread"]
    np.savez(tmp_path / "old.npz", **arrays)
    assert impasto.Reflectance.load(tmp_path / "old.npz").interval(0, 7) is None

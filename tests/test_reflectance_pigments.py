"""How well measured pigments are estimated; HypPigments (Deborah, WHISPERS 2022), CC BY 4.0."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest


def _benchmark():
    path = Path(__file__).parents[1] / "benches" / "python" / "reflectance_ladder.py"
    spec = importlib.util.spec_from_file_location("reflectance_ladder", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


benchmark = _benchmark()


@pytest.fixture(scope="module")
def shipped(data):
    rows = benchmark.shipped(data, seed=1)
    return {(row["camera"], row["estimator"]): row for row in rows}


# Limits: what an independent implementation reached, plus 5 to 15 %.
@pytest.mark.parametrize(
    ("camera", "estimator", "limits"),
    [
        ("6BP", "wiener", {"rmse": 0.0142}),
        ("6BP", "root-polynomial", {"rmse": 0.0109, "de": 0.56, "de_p95": 1.2}),
        ("6BP", "radial-basis", {"rmse": 0.0116, "de": 0.62}),
        ("RGB", "wiener", {"rmse": 0.0335}),
        ("RGB", "linear-model", {"rmse": 0.0350}),
        ("RGB", "root-polynomial", {"rmse": 0.0288, "de": 1.65}),
        ("RGB+2", "root-polynomial", {"rmse": 0.0222}),
    ],
)
def test_pigments_are_estimated_within_the_limits(camera, estimator, limits, shipped):
    row = shipped[camera, estimator]
    assert {key: row[key] for key in limits if row[key] > limits[key]} == {}
    if camera == "6BP":
        assert row["gfc"] >= 0.997


def test_the_default_is_never_much_worse_than_wiener(shipped):
    for camera in ("RGB", "RGB+2", "6BP"):
        ratio = shipped[camera, "root-polynomial"]["rmse"] / shipped[camera, "wiener"]["rmse"]
        assert ratio <= 1.05


def test_more_training_spectra_pay_off(data):
    rows = {(row["training"], row["estimator"]): row for row in benchmark.ladder(data)}
    assert rows[1497, "radial-basis"]["rmse"] <= 0.0060
    assert rows[1497, "radial-basis"]["de"] <= 0.40
    for name in benchmark.ESTIMATORS[1:]:
        assert rows[1497, name]["rmse"] < rows[289, name]["rmse"]

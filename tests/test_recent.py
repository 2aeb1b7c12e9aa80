"""What is kept for calls that ask for the same again: estimators of reflectance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import _core
from impasto._internal.recent import Recent
from impasto.fit import reflectance

WAVELENGTHS = np.arange(400.0, 701.0, 10.0)
CURVES = np.exp(-(((WAVELENGTHS - np.array([[450.0], [550.0], [620.0]])) / 40.0) ** 2))
CAMERA = impasto.Camera(WAVELENGTHS, CURVES, "D65")
RESPONSES = np.random.default_rng(0).uniform(0.1, 0.9, (3, 5, 7)).astype(np.float32)


def test_the_one_used_least_recently_goes() -> None:
    made: list[str] = []

    def make(key: str) -> str:
        made.append(key)
        return key.upper()

    kept: Recent[str] = Recent(2)
    for key in ("a", "b", "a", "c", "a", "b"):
        assert kept.get(key, lambda key=key: make(key)) == key.upper()  # type: ignore[misc]
    assert made == ["a", "b", "c", "b"]


def test_what_cannot_be_made_is_not_kept() -> None:
    kept: Recent[int] = Recent(2)

    def fail() -> int:
        raise ValueError("not today")

    with pytest.raises(ValueError, match="not today"):
        kept.get("a", fail)
    assert kept.get("a", lambda: 3) == 3


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """One entry for each estimator that the core builds."""
    calls: list[Any] = []
    core = _core.spectral_estimator

    def counted(*arguments: Any) -> Any:
        calls.append(arguments)
        return core(*arguments)

    monkeypatch.setattr(_core, "spectral_estimator", counted)
    monkeypatch.setattr(reflectance, "RECENT", Recent(8))
    return calls


def fitted(**options: Any) -> impasto.Reflectance:
    options = {"estimator": "wiener"} | options
    return impasto.fit_reflectance(None, RESPONSES, CAMERA, **options)


def test_the_same_estimator_is_built_once(built: list[Any]) -> None:
    first, second = fitted(), fitted()
    assert len(built) == 1
    assert first.coefficients.tobytes() == second.coefficients.tobytes()
    assert first.basis.tobytes() == second.basis.tobytes()
    assert first.info == second.info


@pytest.mark.parametrize(
    "options",
    [
        {"noise": 0.01},
        {"rank": 2},
        {"estimator": "linear-model"},
        {"wavelengths": np.arange(410.0, 691.0, 10.0)},
        {"training": (WAVELENGTHS, np.random.default_rng(1).uniform(0, 1, (40, 31)))},
    ],
    ids=str,
)
def test_another_estimator_is_another_one(built: list[Any], options: Any) -> None:
    first, second = fitted(), fitted(**options)
    assert len(built) == 2
    assert first.coefficients.tobytes() != second.coefficients.tobytes()


def test_a_result_belongs_to_its_caller(built: list[Any]) -> None:
    first = fitted()
    expected = {name: getattr(first, name).copy() for name in ("basis", "wavelengths", "spread")}
    for name in expected:
        getattr(first, name)[:] = -1.0
    first.info["bands"].append("another")
    assert first.interface is not None
    first.interface[:] = -1.0
    second = fitted()
    assert len(built) == 1
    for name, before in expected.items():
        np.testing.assert_array_equal(getattr(second, name), before)
    assert len(second.info["bands"]) == 3
    assert second.interface is not None
    assert (second.interface != -1.0).any()

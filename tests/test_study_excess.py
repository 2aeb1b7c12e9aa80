"""How far above the least cost searches end: the cost, the least, the rows of a study."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
import study
from oracles import forward, lobes
from oracles.rigs import spiral
from study import data_sets, excess_cost, figures, fits, subsets, tables
from study.minpack import STRIDE
from study.sentences import paragraphs

SIZES = data_sets.Sizes(painting=32, icon=32, paintings=2)


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """The study's pixels of a painting in our own model: sixteen, clipped highlights among them."""
    made, _ = data_sets.available(SIZES, 0, None)
    return subsets.strided(made["own model"](), stride=STRIDE)[0].stack


@pytest.fixture(scope="module")
def leasts(stack: impasto.Stack) -> excess_cost.LeastCosts:
    return excess_cost.least_costs_of(stack)


def ends(stack: impasto.Stack, leasts: excess_cost.LeastCosts, steps: int, precision: Any) -> Any:
    effort = excess_cost.effort_of(precision, steps)
    return leasts.excess(fits.search(stack, 1, effort=effort))


def test_the_cost_is_that_of_the_oracle() -> None:
    """Of a bumpy surface: the formulas were written down twice, and weights but for shadows."""
    lights = spiral()
    rng = np.random.default_rng(4)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, 2, 3)), np.ones((1, 2, 3))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.2, 0.6, (3, 2, 3))
    light = forward.stack(normal, diffuse, np.full((2, 3), 6.0), 0.15, impasto.Rig(lights)) + 0.02
    samples = light.astype(np.float32)
    stack = impasto.Stack(samples, lights=lights, saturation=float(samples.max()))
    found = excess_cost.least_costs_of(stack)
    for number, target in enumerate(found.targets):
        pixel = samples.astype(np.float64).reshape(*light.shape[:2], -1)[:, :, number]
        n = normal.reshape(3, -1)[:, number]
        weights = target.root**2
        lit = weights / lobes.weights(pixel)
        # Roundings of a sum, a quotient and a square.
        assert lit.max() < 1.0 + 1e-14
        assert np.mean(lit > 1.0 - 1e-14) > 0.6
        for gamma in (0.1, 0.2, 0.3):
            theirs, _ = lobes.weighted_cost(pixel.mean(axis=1), weights, n, gamma, lights)
            # Small differences of samples of unit size, a part in a thousand or more of them.
            assert target.cost(n, gamma) == pytest.approx(theirs, rel=1e-9)
            assert found.costs[number] < theirs


def test_searches_come_to_the_least_with_steps(stack: Any, leasts: excess_cost.LeastCosts) -> None:
    few, some, many = (ends(stack, leasts, steps, "double") for steps in (1, 3, 30))
    for shares in (few, some, many):
        assert np.isfinite(shares).all()
        # MINPACK ends where a step gains no more than 1e-12 of the cost.
        assert shares.min() > -1e-11
    assert np.median(few) > 100.0 * np.median(some) > 10_000.0 * np.median(many)
    # A search ends where a step gains less than 1e-4 of the cost, and each gains far less than the
    # one before it: what is left is less than the last.
    assert many.max() < 1e-4
    assert np.median(many) < 1e-8
    # Residuals of some per cent in single precision, whose rounding is 6e-8 of the sample.
    single = ends(stack, leasts, 30, "single")
    assert single.max() < 1e-4
    assert np.median(many) < np.median(single) < 1e-6


def test_the_least_is_the_same_again(stack: impasto.Stack, leasts: excess_cost.LeastCosts) -> None:
    again = excess_cost.least_costs_of(stack, threads=1)
    assert again.costs.tobytes() == leasts.costs.tobytes()


def test_pixels_without_a_lobe_do_not_count(
    stack: impasto.Stack, leasts: excess_cost.LeastCosts
) -> None:
    fitted = fits.search(stack, 1, effort=excess_cost.effort_of("single", 30))
    lobes = fitted.lobes.copy()
    lobes[0, 0] = 0
    shares = leasts.excess(replace(fitted, lobes=lobes))
    assert np.flatnonzero(np.isnan(shares)).tolist() == [0]
    known = excess_cost.summary([shares])
    assert known["median"] == np.median(shares[1:])
    # Two hundredths above the least is bad, half a hundredth is not.
    by_hand = excess_cost.summary([np.array([0.02, 0.0]), np.array([0.005, np.nan, 0.0])])
    assert (by_hand["median"], by_hand["bad"]) == (0.0025, 0.25)
    with pytest.raises(subsets.TooFewError, match="0 of 2 pixels"):
        excess_cost.summary([np.full(2, np.nan)])


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The knob alone, on simulated photographs of our own model."""
    out = tmp_path_factory.mktemp("search")
    return study.run(out, knobs=["search"], sizes=SIZES, repeats=1, threads=1)


def test_rows_of_a_study_tell_the_excess(found: dict[str, Any], tmp_path: Path) -> None:
    rows = found["rows"]
    assert len(rows) == len(excess_cost.STEPS) * len(excess_cost.PRECISIONS)
    assert all(row["excess"].keys() == {"median", "p99", "bad"} for row in rows)
    (table,) = (made for name, made in tables.tables(rows).items() if name == "excess")
    assert [line["steps"] for line in table] == list(excess_cost.STEPS)
    for precision in excess_cost.PRECISIONS:
        first, *_, last = (line[f"p99 %, {precision}"] for line in table)
        assert last < 1e-3 * first
        bad = [line[f"bad %, {precision}"] for line in table]
        assert bad[0] > 50.0
        assert bad[-1] == 0.0
    again = study.run(tmp_path, knobs=["search"], sizes=SIZES, repeats=1)
    assert [row["excess"] for row in again["rows"]] == [row["excess"] for row in rows]


def test_they_are_drawn_and_written(found: dict[str, Any], tmp_path: Path) -> None:
    assert {path.name for path in figures.draw(found, tmp_path)} == {"excess.svg", "excess.png"}
    assert {path.name for path in study.write(found, tmp_path)} >= {"study.md", "excess.svg"}
    assert "Cost above the least" in (tmp_path / "study.md").read_text("utf-8")


def test_a_sentence_says_how_near_searches_come() -> None:
    """By hand, on two data sets: the second ten times as far off."""
    rows = [
        {
            "knob": "search", "setting": f"{precision}, {steps} steps", "data": data,
            "number": steps, "cost": {"cpu": 1.0, "wall": 1.0},
            "excess": {"median": more * 1e-8 * fine, "p99": more * p99 * fine, "bad": more * bad},
        }
        for precision, fine in (("single", 1.0), ("double", 0.1))
        for steps, p99, bad in ((6, 1e-4, 1e-3), (30, 1e-6, 0.0))
        for data, more in (("own model", 1.0), ("icon", 10.0))
    ]  # fmt: skip
    assert paragraphs(rows)["excess"] == (
        'A search of 6 steps (`"standard"`) ends 1e-04 to 1e-03 above the least cost in single '
        "precision (99th percentile) and 1e-05 to 1e-04 in double; 0.1 to 1.0 % of the pixels end "
        "more than a hundredth above it. With 30 steps these are 1e-06 to 1e-05 and 1e-07 to "
        "1e-06, and 0.0 %; the medians are 1e-08 to 1e-07 and 1e-09 to 1e-08."
    )
    # The quick study has no search of six steps.
    assert "excess" not in paragraphs([row for row in rows if row["number"] == 30])


def test_without_scipy_it_is_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    found = study.run(tmp_path, knobs=["search"], quick=True, sizes=SIZES, repeats=1, threads=1)
    assert (found["rows"], found["failed"]) == ([], [])
    assert any(said.startswith("single, 1 step: ") for said in found["skipped"])

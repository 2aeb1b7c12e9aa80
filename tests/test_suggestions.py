"""A small part of the benchmark of `suggest_effort` on stacks that it was not tuned on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import suggestions

import impasto


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> dict[str, impasto.Stack]:
    """Two of the twenty, and not the icon."""
    return dict(suggestions.stacks(2, tmp_path_factory.mktemp("nowhere")))


def test_requested_errors_are_met(two: dict[str, impasto.Stack]) -> None:
    """Within 15 %; times are recorded, no test asserts them."""
    for name, stack in two.items():
        row = suggestions.checked(stack, ("error",))
        assert row["error met"], name
        assert row["error reached"] <= 1.15 * row["error requested"]
        # A trial has fewer photographs, so its error is larger. Twice is too much: that was the
        # ratio when neighbouring photographs were held out together.
        assert 0.5 < row["error ratio"] < 1.15


def test_the_stacks_differ_and_are_the_same_every_time(
    two: dict[str, impasto.Stack], tmp_path: Path
) -> None:
    again = dict(suggestions.stacks(2, tmp_path))
    assert two.keys() == again.keys()
    assert len({stack.shape for stack in two.values()}) == 2
    for name, stack in two.items():
        assert (stack.samples == again[name].samples).all()


def test_a_summary_counts_what_is_met() -> None:
    def row(met: bool, ratio: float) -> dict[str, Any]:
        one = {"met": met, "ratio": ratio}
        return {f"{w} {key}": value for w in ("error", "seconds") for key, value in one.items()}

    found = suggestions.summary([row(True, 0.9), row(False, 1.3), row(True, 1.0)])
    assert [line["met"] for line in found] == ["2 of 3", "2 of 3"]
    assert [found[0][key] for key in ("least", "median", "largest")] == pytest.approx(
        [0.9, 1.0, 1.3]
    )


def test_requests_that_are_not_met_are_listed() -> None:
    rows: list[dict[str, Any]] = [
        {"stack": "1: 64 pixels, 24 lights, satin", "error met": False, "seconds met": True},
        {"stack": "icon", "error met": True, "seconds met": True},
    ]
    rows = [row | {"took": took} for row, took in zip(rows, (2.04, 1.0), strict=True)]
    assert suggestions.sentences(rows) == {
        "missed": "Not met: error on 64 pixels, 24 lights, satin.",
        "took": "The suggestion itself took 1.0 to 2.0 s.",
    }
    assert suggestions.sentences(rows[1:])["missed"] == "It was met everywhere."

"""What a study says that fits cost: turns, halves, memory."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import study
from impasto.study import memory, record, specimens, sweep, words
from impasto.study.measure import Cost

SIZES = specimens.Sizes(painting=16, views=4, icon=16)
BYTES = 200


def hungry(stack: impasto.Stack, threads: int | None) -> int:
    """A fit that takes so many bytes for every pixel, and gives them back."""
    assert threads == 1
    return int(np.ones((BYTES, *stack.shape[2:]), np.uint8).max())


def test_fits_of_a_data_set_take_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first turn is slow, as on a machine that is busy: no ratio tells."""
    asked: list[str] = []
    speed = iter([*[3.0] * 3, *[1.0] * 3, *[1.1] * 3])

    def timed(fit: Any, megapixels: float) -> Any:
        seconds = next(speed)
        return fit(), Cost(seconds, seconds)

    monkeypatch.setattr(sweep, "timed", timed)
    found = study.run(
        tmp_path, quick=True, knobs=["stereo"], sizes=SIZES, repeats=3,
        advance=lambda done, total, name: asked.append(f"{done}/{total} {name}"),
    )  # fmt: skip
    names = [row["setting"] for row in found["rows"]]
    assert len(names) == 3
    assert asked == [f"{i}/9 own model: {names[i % 3]}" for i in range(9)] + ["9/9 "]
    assert [row["cost"] for row in found["rows"]] == [{"cpu": 1.0, "wall": 1.0}] * 3
    assert [row["halves"] for row in found["rows"]] == [[1.1, 1.0]] * 3
    # What is read again from the file is the same.
    assert record.Journal(tmp_path).found()["rows"] == found["rows"]


def test_turns_that_are_missing_are_taken(tmp_path: Path) -> None:
    def run() -> dict[str, Any]:
        return study.run(tmp_path, quick=True, knobs=["stereo"], sizes=SIZES, repeats=2)

    first = run()
    journal = tmp_path / record.RUNS
    whole = journal.read_text("utf-8")
    journal.write_text("\n".join(whole.splitlines()[:-2]) + "\n", encoding="utf-8")
    again = run()
    assert len(journal.read_text("utf-8").splitlines()) == len(whole.splitlines())
    for one, other in zip(first["rows"], again["rows"], strict=True):
        assert one["error"] == other["error"]
        assert one["halves"][0] == other["halves"][0]
    assert first["rows"][0] == again["rows"][0]
    assert first["rows"][-1]["halves"][1] != again["rows"][-1]["halves"][1]


def test_halves_are_compared_in_proportion() -> None:
    """Twice as slow in one half is no difference; a fifth more of one fit of three is."""
    rows = [{"halves": halves} for halves in ([2.0, 1.0], [4.0, 2.0], [2.4, 1.0])]
    assert words.again(rows) == (
        "Of 3 fits, timed in every other turn and in those between, 67 % agree within a tenth in "
        "proportion to the others, half of them within 0.0 %; the largest difference is 20 %. "
        "Errors are the same, bit for bit."
    )


@pytest.mark.skipif(sys.platform != "linux", reason="where /proc tells of memory")
def test_memory_of_a_fit_is_told_apart_from_that_of_its_process() -> None:
    stack = impasto.simulate.default_capture("tominaga-rgb-camera", size=(16, 16)).stack
    found = memory.per_megapixel(hungry, stack, 1)
    assert found is not None
    assert "MALLOC_TRIM_THRESHOLD_" not in os.environ
    # Bytes for a pixel are megabytes for a megapixel; pages and the heap's rounding are the rest.
    assert found == pytest.approx(BYTES, rel=0.1)

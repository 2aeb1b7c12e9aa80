"""What a study says that fits cost: turns, a second run, memory."""

from __future__ import annotations

import inspect
import itertools
import os
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import impasto
import study
from study import data_sets, journal, memory, reference_fit, repeatability, sentences, sweep, timing
from study.timing import Timing

SIZES = data_sets.Sizes(painting=16, views=4, icon=16, paintings=1)
BYTES = 200


def hungry(stack: impasto.Stack, threads: int | None) -> int:
    """A fit that takes so many bytes for every pixel, and gives them back."""
    assert threads == 1
    return int(np.ones((BYTES, *stack.shape[2:]), np.uint8).max())


class Busy:
    """A reference fit on a machine of random speed; the fits take the seconds given here."""

    seconds: ClassVar[dict[str, float]] = {}
    noise = 0.0

    def __init__(self, threads: int | None) -> None:
        del threads
        self.rng = np.random.default_rng(5)

    def beside(self, fit: Any, megapixels: float) -> Any:
        name = inspect.getclosurevars(fit).nonlocals["setting"].name
        slow = float(np.exp(self.rng.normal(0.0, 0.5)))
        ratio = slow * float(np.exp(self.rng.normal(0.0, self.noise)))
        took = self.seconds.get(name, 1.0) * ratio
        return fit(), Timing(took, took, 0.01 * slow, 0.01 * slow)


def stereo(out: Path, repeats: int, **more: Any) -> dict[str, Any]:
    """A study of five fits to one data set of the two that need no files."""
    options = {"knobs": ["stereo"], "sizes": SIZES, "threads": 1} | more
    return study.run(out, repeats=repeats, **options)


def test_costs_are_ratios_to_what_is_timed_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half the speed or twice as much at any moment: no ratio tells, and one turn is enough."""
    monkeypatch.setattr(sweep, "ReferenceFit", Busy)
    seconds = {"0 steps": 1.0, "1 step": 2.0, "2 steps": 3.0, "5 steps": 5.0, "10 steps": 7.0}
    monkeypatch.setattr(Busy, "seconds", seconds)
    found = stereo(tmp_path, 3)
    costs = {row["setting"]: row["cost"] for row in found["rows"]}
    assert costs.keys() == Busy.seconds.keys()
    for kind in ("cpu", "wall"):
        least = costs["0 steps"][kind]
        # Exponentials of means of logarithms: a few roundings.
        for name, cost in costs.items():
            assert cost[kind] / least == pytest.approx(seconds[name], rel=1e-12)
        # A hundred reference fits to the second, whose seconds are those of the median.
        assert least == pytest.approx(100.0 * found["run"]["reference fit"][kind], rel=1e-12)
    assert [row["timings"] for row in found["rows"]] == [3] * 5
    assert found["run"]["reference fit"]["timings"] == 15
    # What is read again from the file is the same.
    assert journal.Journal(tmp_path).found() == found


def test_turns_go_on_until_a_cost_is_sure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "ReferenceFit", Busy)
    monkeypatch.setattr(Busy, "noise", 0.04)
    rows = stereo(tmp_path / "some", 8)["rows"]
    for row in rows:
        assert row["doubt"] <= timing.CERTAIN or row["timings"] == 8 * timing.MOST
        assert abs(np.log(row["cost"]["cpu"] / rows[0]["cost"]["cpu"])) < 5.0 * timing.CERTAIN
    # The error of a mean of half of n falls with the root of 0.84 n, for a normal law: of 12
    # it is CERTAIN on the average, by luck of fewer; all five of 8 would be too much of it.
    assert max(row["timings"] for row in rows) > 8
    monkeypatch.setattr(Busy, "noise", 0.5)
    assert [row["timings"] for row in stereo(tmp_path / "all", 8)["rows"]] == [8 * timing.MOST] * 5
    # One turn tells nothing of the next.
    assert [row["timings"] for row in stereo(tmp_path / "one", 1)["rows"]] == [1] * 5
    # The quick study takes every other fit, and has no time to be sure.
    assert [row["timings"] for row in stereo(tmp_path / "quick", 2, quick=True)["rows"]] == [2] * 3


def test_fits_take_turns_each_in_another_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(sweep, "ReferenceFit", Busy)
    stereo(tmp_path, 6, advance=lambda done, total, name: asked.append(f"{done}/{total} {name}"))
    names = [words.rpartition(": ")[2] for words in asked[:-1]]
    assert [words.split()[0] for words in asked] == [f"{i}/30" for i in range(31)]
    by_turn = [names[place : place + 5] for place in range(0, 30, 5)]
    assert all(sorted(turn) == sorted(by_turn[0]) for turn in by_turn)
    assert len({tuple(turn) for turn in by_turn}) > 1


@pytest.mark.parametrize("slow", [0.0, 0.1])
def test_the_error_of_a_cost_is_what_it_says(slow: float) -> None:
    """A thousand costs, some of whose turns are twice as slow: they scatter as is foretold."""
    rng = np.random.default_rng(8)
    found = []
    for _ in range(1000):
        logs = rng.normal(0.0, 0.05, 16) + np.log(2.0) * (rng.random(16) < slow)
        found.append(timing.pace([Timing(float(np.exp(v)), 1.0, 1.0, 1.0) for v in logs], "cpu"))
    paces, doubts = np.array(found).T
    # From sixteen turns, half of which count, a deviation is known to 1 / sqrt(2 * 8), a quarter;
    # the mean of a thousand squares is not, but sets that are slow by more than a quarter, one in
    # sixty, rule it.
    assert np.log(paces).std() == pytest.approx(np.sqrt((doubts**2).mean()), rel=0.2)
    # A tenth that is slow moves the middle half by what shifts its edges, a tenth of a probability
    # over the law's height, 0.2 deviations, a little more for those sets; the mean of all by 0.07.
    assert abs(np.log(paces).mean()) < 0.016


def test_fits_of_milliseconds_have_more_turns() -> None:
    """None of these costs is ever sure; a single turn of several runs makes no fit a short one."""

    def ends(runs: list[int]) -> int:
        drawn = [Timing(1.0 + n % 2, 1.0, 1.0, 1.0, run) for n, run in enumerate(runs)]
        return next(n for n in itertools.count() if not timing.uncertain(drawn[:n], 4))

    assert ends([1] * 99) == 4 * timing.MOST
    assert ends([20, 1] * 50) == 4 * timing.MOST
    assert ends([2] * 99) == 4 * timing.MORE


@pytest.mark.parametrize("runs", [1, 9])
@pytest.mark.parametrize("noise", [0.02, 0.045, 0.09])
def test_a_cost_is_as_sure_as_it_says_where_turns_end_once_it_seems_sure(
    noise: float, runs: int
) -> None:
    """A thousand costs under the rule, drawn: no clock."""
    rng = np.random.default_rng(8)
    repeats = 6
    most = repeats * (timing.MOST if runs == 1 else timing.MORE)
    found, fewest, all_of_them = [], [], []
    for _ in range(1000):
        drawn = [
            Timing(float(np.exp(v)), 1.0, 1.0, 1.0, runs) for v in rng.normal(0.0, noise, most)
        ]
        # A cost that nobody can be sure of ends, too.
        count = next(n for n in itertools.count() if not timing.uncertain(drawn[:n], repeats))
        doubts = [timing.pace(drawn[:n], "cpu")[1] for n in range(repeats, count + 1)]
        assert repeats <= count <= most
        assert all(doubt > timing.CERTAIN for doubt in doubts[:-1])
        assert doubts[-1] <= timing.CERTAIN or count == most
        found.append(timing.pace(drawn[:count], "cpu"))
        fewest.append(timing.pace(drawn[:repeats], "cpu")[0])
        all_of_them.append(timing.pace(drawn, "cpu")[0])
    logs, said = np.log(np.array(found)[:, 0]), np.array(found)[:, 1]
    # The rule sees how far turns lie apart, not where: the middle is as likely too low as too high,
    # within four deviations of a mean, and scatters no more than that of the fewest turns and no
    # less than that of all of them. A thousand tell a deviation to 2.2 %; those of the same draws
    # share most of that.
    assert abs(logs.mean()) < 4.0 * logs.std() / np.sqrt(1000)
    assert 0.95 * np.log(all_of_them).std() < logs.std() < 1.05 * np.log(fewest).std()
    # What a rule says that may look at many moments and ends at the first small number: too little.
    # Between six turns and twelve an error falls by the root of two, which is the most that luck at
    # the first look can pretend to; between six and thirty-six by that of six, of which the many
    # that end on the way have no need: less than two.
    most_luck = np.sqrt(2.0) if runs == 1 else 2.0
    assert 0.9 < logs.std() / np.sqrt((said**2).mean()) < most_luck


def test_the_reference_fit_is_timed_before_and_after(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that is told what everything takes."""
    now = [0.0]

    def take(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(reference_fit.impasto, "fit_sbrdf", lambda *_, **__: take(pace[0]))
    monkeypatch.setattr(reference_fit.time, "process_time", lambda: now[0])
    monkeypatch.setattr(reference_fit.time, "perf_counter", lambda: 2.0 * now[0])
    pace = [0.015]
    stick = reference_fit.ReferenceFit(1)

    runs = iter([0.005, 0.015, 0.003, 0.015, 0.015])

    def fit() -> str:
        take(next(runs))
        pace[0] = 0.045
        return "found"

    result, turn = stick.beside(fit, 0.5)
    assert result == "found"
    # Five runs are the first to take 40 ms, and the third of them the least: 3 ms. Two of the
    # reference fit's are the first to take 20 ms before, one is enough after.
    assert now[0] == pytest.approx(0.015 + 2 * 0.015 + 0.053 + 0.045)
    assert turn.cpu == pytest.approx(0.006)
    assert turn.wall == pytest.approx(0.012)
    assert (turn.reference_cpu, turn.reference_wall) == pytest.approx((0.03, 0.06))


def test_turns_that_are_missing_are_taken(tmp_path: Path) -> None:
    first = stereo(tmp_path, 2)
    lines = tmp_path / journal.RUNS
    whole = lines.read_text("utf-8").splitlines()
    lines.write_text("\n".join(whole[:4]) + "\n", encoding="utf-8")
    again = stereo(tmp_path, 2)
    assert lines.read_text("utf-8").splitlines()[:4] == whole[:4]
    for one, other in zip(first["rows"], again["rows"], strict=True):
        assert one["error"] == other["error"]
        assert other["timings"] >= 2


# --- a second run


def costing(*costs: float, data: str = "icon") -> list[dict[str, Any]]:
    return [
        {
            "data": data, "knob": "stereo", "setting": f"{place}", "cost": {"cpu": cost},
            "error": {"psnr": 30.0 + place}, "doubt": 0.01, "timings": 8 + place,
        }
        for place, cost in enumerate(costs)
    ]  # fmt: skip


def test_two_runs_are_compared_in_proportion() -> None:
    """Twice as slow is no difference; a fifth more of one fit of three is."""
    info = dict.fromkeys((*journal.TERMS, *journal.CLOCKS), "same")
    first = {"run": info, "rows": costing(2.0, 4.0, 2.0)}
    second = {"run": info, "rows": costing(4.0, 8.0, 4.8)}
    rows = repeatability.beside(first, second)
    alone, pairs = repeatability.apart(rows)
    assert alone == pytest.approx([0.0, 0.0, 0.2])
    assert pairs == pytest.approx([0.0, 0.2, 0.2])
    assert not repeatability.kept(rows)
    assert sentences.again(rows) == (
        "A second run reproduces the errors of 3 of 3 fits bit for bit. Its costs, relative to "
        "their median, agree within a tenth for 2 of 3 fits (median difference 0.0 %, largest "
        "20 %), and so do 33.3 % of the 3 ratios of two fits of a data set. The estimated standard "
        "error of a cost is 1.0 % (median; at most 1.0 %) after 8 to 10 timings."
    )
    close = {"run": info, "rows": costing(4.0, 8.0, 4.2)}
    assert repeatability.kept(repeatability.beside(first, close))
    close["rows"][1]["error"]["psnr"] = float(np.nextafter(31.0, 32.0))
    assert not repeatability.kept(repeatability.beside(first, close))
    # A fit that the second run has not is no agreement.
    assert not repeatability.kept(
        repeatability.beside(first, {"run": info, "rows": close["rows"][:1]})
    )


@pytest.mark.parametrize("term", ["commit", "seed", "threads", "processor"])
def test_runs_of_two_studies_are_not_compared(term: str) -> None:
    info = dict.fromkeys((*journal.TERMS, *journal.CLOCKS), "same")
    first = {"run": info, "rows": costing(1.0)}
    with pytest.raises(impasto.ArgumentError, match=f"another study \\({term} 'other'"):
        repeatability.beside(first, {"run": info | {term: "other"}, "rows": costing(1.0)})


@pytest.mark.parametrize("term", ["seed", "repeats"])
def test_a_second_run_of_another_study_is_refused_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, term: str
) -> None:
    monkeypatch.setattr(sweep, "ReferenceFit", Busy)
    first = stereo(tmp_path / "first", 2)["run"]
    assert stereo(tmp_path / "again", 2, like=first)["rows"]
    begun: list[str] = []
    changed = {"seed": {"seed": 1, "repeats": 2}, "repeats": {"repeats": 3}}[term]
    with pytest.raises(impasto.ArgumentError, match=f"another study \\({term} "):
        stereo(
            tmp_path / "other",
            **changed,
            like=first,
            advance=lambda done, total, name: begun.append(name),
        )
    assert not begun
    # Nor is there a folder that would refuse the right one.
    assert not (tmp_path / "other").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="where /proc tells of memory")
def test_memory_of_a_fit_is_told_apart_from_that_of_its_process() -> None:
    stack = impasto.simulate.default_capture("tominaga-rgb-camera", size=(16, 16)).stack
    # Without pytest's own note of where it is.
    before = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    found = memory.per_megapixel(hungry, stack, 1)
    assert found is not None
    assert {name: os.environ.get(name) for name in before} == before
    assert all(name in before or name.startswith("PYTEST") for name in os.environ)
    # Bytes for a pixel are megabytes for a megapixel; pages and the heap's rounding are the rest.
    assert found == pytest.approx(BYTES, rel=0.1)

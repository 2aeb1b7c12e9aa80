"""Studies that are interrupted, moved to another machine, or find a defect."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
import study
from study import data_sets, fits, journal, sweep
from study.__main__ import main
from study.journal import RUNS

SIZES = data_sets.Sizes(painting=16, views=4, icon=16, paintings=1)
KNOBS = ("normals", "peer")
"""Eight fits of ours in milliseconds, and peers: the quick study takes three of either."""


def run(out: Path, **more: Any) -> dict[str, Any]:
    told: list[str] = []
    options = {"quick": True, "knobs": KNOBS, "sizes": SIZES, "repeats": 1, "threads": 1} | more
    found = study.run(out, advance=lambda *words: told.append(words[2]), **options)
    return found | {"told": told}


def costs(found: dict[str, Any]) -> dict[str, Any]:
    return {row["setting"]: row["cost"] for row in found["rows"]}


def lines(out: Path) -> list[Any]:
    return [json.loads(line) for line in (out / RUNS).read_text("utf-8").splitlines()]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows locks no folders")
def test_two_studies_never_share_a_folder(tmp_path: Path) -> None:
    with (
        journal.alone(tmp_path / "new"),
        pytest.raises(impasto.ArgumentError, match=r"another study is at work in .*new; wait"),
    ):
        run(tmp_path / "new")
    assert not (tmp_path / "new" / RUNS).exists()
    assert run(tmp_path / "new")["rows"]


@pytest.mark.parametrize("knobs", ["normals", ["normals", "nonsense"]])
def test_a_knob_that_there_is_none_of(tmp_path: Path, knobs: Any) -> None:
    with pytest.raises(
        impasto.ArgumentError, match=r"knobs: expected a list of some of effort, .* found "
    ):
        run(tmp_path / "out", knobs=knobs)
    assert not (tmp_path / "out").exists()


def test_others_files_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "photograph.png").touch()
    with pytest.raises(impasto.ArgumentError, match="holds files that no study made"):
        run(tmp_path)
    with pytest.raises(impasto.ArgumentError, match="is a file; name a folder"):
        run(tmp_path / "photograph.png")
    assert [path.name for path in tmp_path.iterdir()] == ["photograph.png"]


@pytest.mark.parametrize("edge", [1, 16])
def test_numbers_that_are_none_are_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edge: int
) -> None:
    """A single pixel lies on no grid of bounds; widths may be as far off as can be."""
    monkeypatch.setattr(sweep, "widths_off", lambda *_: np.inf)
    sizes = data_sets.Sizes(painting=edge, views=edge, icon=edge, paintings=1)
    found = run(tmp_path, knobs=["precision"], sizes=sizes)
    assert found["failed"] == []
    for row in found["rows"]:
        assert "width" not in row
        assert ("strength" in row) == ("bound" in row) == (edge > 1)
    study.write(journal.Journal(tmp_path).found(), tmp_path, figures=False)

    def refused(word: str) -> None:
        raise AssertionError(word)

    texts = (tmp_path / RUNS).read_text("utf-8").splitlines()
    for text in [*texts, (tmp_path / "study.json").read_text("utf-8")]:
        json.loads(text, parse_constant=refused)


def test_an_interrupted_study_goes_on(tmp_path: Path) -> None:
    first = run(tmp_path)
    journal = tmp_path / RUNS
    whole = journal.read_text("utf-8").splitlines()
    # The last but one is whole, the last was being written.
    journal.write_text("\n".join(whole[:-1]) + "\n" + whole[-1][:40], encoding="utf-8")
    again = run(tmp_path)
    *before, last = (json.loads(line) for line in whole)
    assert lines(tmp_path)[:-1] == before
    # The last is fitted anew: its errors are the same, its times never are.
    anew = lines(tmp_path)[-1]
    assert anew["timing"] != last["timing"]
    assert anew | {"timing": 0} == last | {"timing": 0}
    assert [row["error"] for row in again["rows"]] == [row["error"] for row in first["rows"]]
    with pytest.raises(impasto.ArgumentError, match="another study"):
        run(tmp_path, seed=1)


@pytest.mark.parametrize("other", [{"repeats": 2}, {"threads": 2}])
def test_times_under_other_terms_are_never_mixed(tmp_path: Path, other: dict[str, int]) -> None:
    first, second = run(tmp_path), run(tmp_path, **other)
    assert costs(first).keys() == costs(second).keys()
    for name, cost in costs(second).items():
        assert cost != costs(first)[name]
    # Back where it began, nothing is timed a third time.
    before = len(lines(tmp_path))
    assert costs(run(tmp_path)) == costs(first)
    assert [line for line in lines(tmp_path)[before:] if "timing" in line] == []
    # What only reads a folder reads what came last.
    assert costs(journal.Journal(tmp_path).found()) == costs(first)


def test_another_machine_times_everything_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(tmp_path)
    here = journal.run_info()
    monkeypatch.setattr(sweep, "run_info", lambda: here | {"processor": "another", "cores": 64})
    second = run(tmp_path)
    assert second["run"]["processor"] == "another"
    assert len(second["rows"]) == len(first["rows"])
    for name, cost in costs(second).items():
        assert cost != costs(first)[name]
    # Errors are a matter of data, seed and code alone.
    for one, other in zip(first["rows"], second["rows"], strict=True):
        assert one["error"] == other["error"]


def test_other_photographs_are_other_terms(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    (folder / "brdf").mkdir(parents=True)
    (folder / "brdf" / "sgd_100.csv").write_text("material\n", encoding="utf-8")
    first = data_sets.digests(folder)
    assert list(first) == ["shifted gamma"]
    (folder / "brdf" / "sgd_100.csv").write_text("materials\n", encoding="utf-8")
    assert data_sets.digests(folder) != first
    assert data_sets.digests(None) == {}


def test_a_defect_shows_as_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not as skipped, which is what a peer is that is not installed; and it is tried again."""

    def refused(*_: Any, **__: Any) -> Any:
        raise impasto.GeometryError("lights: a defect")

    with monkeypatch.context() as broken:
        broken.setattr(fits.impasto, "fit_normals", refused)
        broken.setattr("study.sweep.QUICK", SIZES)
        # Of all knobs, which other tests run, the command would take half a minute.
        broken.setattr("study.__main__.run", partial(study.run, knobs=KNOBS))
        broken.setattr("study.__main__.data_folder", lambda: tmp_path / "nowhere")
        found = run(tmp_path)
        command = ["--quick", "--out", str(tmp_path / "cli"), "--repeats", "1"]
        assert main([*command, "--no-figures"]) == 1
    assert "failed: " in capsys.readouterr().err
    assert len(found["failed"]) == 3
    assert all("GeometryError: lights: a defect" in words for words in found["failed"])
    assert found["skipped"] == []
    assert {row["knob"] for row in found["rows"]} == {"peer"}
    again = run(tmp_path)
    assert again["failed"] == []
    assert len(again["rows"]) == len(found["rows"]) + 3


def test_a_peer_that_is_not_installed_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "scipy.optimize", None)
    found = run(tmp_path)
    assert [words.split(":")[0] for words in found["skipped"]] == ["MINPACK (SciPy), one lobe"]
    assert found["failed"] == []


@pytest.mark.parametrize(
    "line",
    [
        '{"data": "icon"}',
        '{"data": 1, "knob": 2, "setting": 3, "again": {}}',
        '{"again": {"cpu": 1}}',
    ],
)
def test_an_object_that_is_no_run_is_corrupt(tmp_path: Path, line: str) -> None:
    run(tmp_path, knobs=["normals"])
    with (tmp_path / RUNS).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")
    last = len(lines(tmp_path))
    with pytest.raises(impasto.CorruptInputError, match=f"line {last} is no run of a study"):
        run(tmp_path, knobs=["normals"])
    head = {"schema": journal.SCHEMA, "run": {}}
    (tmp_path / RUNS).write_text(json.dumps(head) + "\n", encoding="utf-8")
    with pytest.raises(impasto.CorruptInputError, match="no journal of a study"):
        journal.Journal(tmp_path)


@pytest.mark.parametrize("line", ["null", "12", "[1]", '"schema"'])
def test_a_line_that_is_no_run_is_corrupt(tmp_path: Path, line: str) -> None:
    """JSON all the same."""
    (tmp_path / RUNS).write_text(f"{line}\n{line}\n", encoding="utf-8")
    with pytest.raises(impasto.CorruptInputError, match="line 1 is no run of a study"):
        run(tmp_path)
    # A first line is never one that was cut off: what has only that is not thrown away.
    (tmp_path / RUNS).write_text('{"schema": 5, "ru', encoding="utf-8")
    with pytest.raises(impasto.CorruptInputError, match="line 1 is no JSON"):
        run(tmp_path)
    (tmp_path / RUNS).write_bytes(b"\xff\xfe\n\xff\n")
    with pytest.raises(impasto.CorruptInputError, match="line 1 is no JSON"):
        run(tmp_path)


FULL_DISK = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from study.journal import Journal, run_info
from study.report import write
out = Path(sys.argv[1])
found = Journal(out).found()
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
for step in (
    lambda: Journal(out, {"run": run_info() | {"threads": 9}, "missing": {}}),
    lambda: write(found, out, figures=False),
):
    try:
        step()
    except OSError:
        print("refused")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX limits files")
def test_a_full_disk_leaves_a_study_as_it_was(tmp_path: Path) -> None:
    """One that goes on writes the whole journal anew: hours of runs."""
    study.write(run(tmp_path, knobs=("effort",)), tmp_path, figures=False)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    folder = Path(study.__file__).parents[1]
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path), str(folder)]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["refused"] * 2
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

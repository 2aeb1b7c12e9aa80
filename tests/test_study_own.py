"""``impasto.study`` and ``impasto study``: settings tried on one's own photographs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.cli import main
from impasto.study import Study, Trial, sweep, table, trials, write
from impasto.study.suggestion import SETTINGS, VIEW_SETTINGS, chosen

FEW = ({"joint": False}, {"pooling": "pixel", "effort": "draft"})


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """24 lights on a painting with three varnishes."""
    azimuth = np.arange(24) * np.pi * (3.0 - np.sqrt(5.0))
    z = np.linspace(0.5, 0.95, 24)
    across = np.sqrt(1.0 - z * z)
    lights = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    scene = simulate.painting(5, (24, 24), varnish="patches")
    return simulate.capture(scene, impasto.Rig(lights), "rgb").stack


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """One run per timing: these tests assert no time."""
    monkeypatch.setattr(trials, "TIMED_SECONDS", 1e-9)


@pytest.fixture
def study() -> Study:
    """Trials by hand: a, b and d are the front."""
    found = (
        Trial({"joint": False}, 1.0, 0.4),
        Trial({"pooling": "pixel", "effort": "draft"}, 10.0, 0.204),
        Trial({"effort": "standard"}, 20.0, 0.3),
        Trial({"pooling": "pixel", "effort": impasto.Effort(rounds=4)}, 100.0, 0.2),
    )
    return Study((24, 3, 8, 9), found, chosen(found, error=None, seconds=None))


def test_every_setting_is_tried(stack: impasto.Stack, fast: None) -> None:
    told: list[tuple[int, int]] = []
    found = impasto.study.run(stack, advance=lambda *at: told.append(at))
    asked = SETTINGS + sweep.MORE_SETTINGS
    assert told == [(n, len(asked)) for n in range(1, len(asked) + 1)]
    assert sorted(map(str, (t.options for t in found.trials))) == sorted(map(str, asked))
    assert [t.seconds for t in found.trials] == sorted(t.seconds for t in found.trials)
    assert found.shape == stack.shape
    # The lobes of three varnishes differ: no pooled lobe is as good as lobes per pixel.
    best = min(found.trials, key=lambda trial: trial.error)
    assert best.options["pooling"] == "pixel"
    assert found.suggestion.error <= 1.03 * best.error


def test_errors_are_those_of_a_suggestion(stack: impasto.Stack, fast: None) -> None:
    """The same folds and pixels: only times differ from run to run."""
    suggested = {str(t.options): t.error for t in impasto.suggest_effort(stack, error=0.1).tried}
    for trial in impasto.study.run(stack, settings=FEW).trials:
        assert trial.error == suggested[str(trial.options)]


def test_many_views_are_tried_with_lafortune_lobes(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def tried(_: Any, settings: Any, **__: Any) -> list[Trial]:
        asked.extend(settings)
        return [Trial(options, 1.0, 0.5) for options in settings]

    monkeypatch.setattr(sweep, "tried", tried)
    views = np.tile([0.0, 0.0, 1.0], (24, 1))
    views[12:] = [0.0, 0.6, 0.8]
    impasto.study.run(impasto.Stack(stack.samples, lights=stack.rig.directions, views=views))
    assert [options for options in asked if "model" in options] == [
        *VIEW_SETTINGS,
        *sweep.MORE_VIEW_SETTINGS,
    ]


def test_the_front_is_what_no_other_beats(study: Study) -> None:
    assert [trial.seconds for trial in study.front] == [1.0, 10.0, 100.0]


def test_without_a_limit_the_fastest_near_the_best_is_suggested(study: Study) -> None:
    # 0.204 is two per cent above 0.2.
    assert study.suggestion.options == {"pooling": "pixel", "effort": "draft"}
    assert study.suggestion.met


@pytest.mark.parametrize(
    ("limits", "seconds", "met"),
    [
        ({"error": 0.25, "seconds": None}, 10.0, True),
        ({"error": None, "seconds": 50.0}, 10.0, True),
        ({"error": 0.1, "seconds": 5.0}, 1.0, False),
    ],
)
def test_limits_are_met_or_the_nearest_is_named(
    study: Study, limits: dict[str, Any], seconds: float, met: bool
) -> None:
    found = chosen(study.trials, **limits)
    assert (found.seconds, found.met) == (seconds, met)


def test_a_table_for_people(study: Study) -> None:
    lines = str(study).splitlines()
    assert lines[0].split() == ["setting", "time", "error", "front"]
    assert lines[1].split("  ")[0] == "fit_sbrdf(stack, joint=False)"
    assert lines[1].split()[2:] == ["1", "s", "40", "%", "*"]
    # What an effort leaves at its default is not repeated.
    assert lines[4].startswith("fit_sbrdf(stack, pooling='pixel', effort=Effort(rounds=4))")
    assert not lines[3].endswith("*")
    assert lines[-1].endswith("will take 10 s here and relight with an error of 20 %.")
    assert "| `fit_sbrdf(stack, joint=False)` | 1 s | 40 % | * |" in table.markdown(
        study.trials, study.front
    )


def test_files(study: Study, tmp_path: Path) -> None:
    names = [path.name for path in write(study, tmp_path)]
    assert names == ["study.json", "study.md", "front.svg", "front.png"]
    content = json.loads((tmp_path / "study.json").read_text("utf-8"))
    assert content["shape"] == [24, 3, 8, 9]
    assert [trial["front"] for trial in content["trials"]] == [True, True, False, True]
    assert content["trials"][3]["options"]["effort"]["rounds"] == 4
    assert content["suggestion"]["seconds"] == 10.0
    page = (tmp_path / "study.md").read_text("utf-8")
    assert "24 photographs of 9 x 8 pixels, 3 bands." in page
    before = (tmp_path / "front.svg").read_bytes()
    write(study, tmp_path)
    assert (tmp_path / "front.svg").read_bytes() == before
    assert [path.name for path in write(study, tmp_path, figure=False)] == names[:2]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"settings": ()}, "settings: expected at least one"),
        ({"settings": [{"pooling": "pixel", "joint": False}]}, "joint: "),
        ({"error": 1.0}, "error: expected a share below 1"),
        ({"seconds": -1}, "seconds: expected a number above 0"),
    ],
)
def test_wrong_calls(stack: impasto.Stack, wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(impasto.ArgumentError, match=told):
        impasto.study.run(stack, **wrong)


def test_the_command(
    stack: impasto.Stack,
    tmp_path: Path,
    fast: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sweep, "SETTINGS", FEW)
    monkeypatch.setattr(sweep, "MORE_SETTINGS", ())
    np.savez(tmp_path / "stack.npz", samples=stack.samples, lights=stack.rig.directions)
    out = tmp_path / "found"
    assert main(["study", str(tmp_path / "stack.npz"), "--out", str(out), "--quiet"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "fit_sbrdf(stack, pooling='pixel', effort='draft')" in said.out
    assert "here and relight with an error of" in said.out
    assert {path.name for path in out.iterdir()} == {
        "study.json", "study.md", "front.svg", "front.png", "report.json",
    }  # fmt: skip
    assert main(["study", str(tmp_path / "stack.npz"), "--json", "--error", "0.9"]) == 0
    assert json.loads(capsys.readouterr().out)["suggestion"]["met"] is True
    assert main(["info", str(out)]) == 0
    assert "impasto study" in capsys.readouterr().out

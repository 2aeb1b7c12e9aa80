"""``impasto capture run`` and ``check``, and the file of shots."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import captures
from impasto.capture import Pose, ShotPlan, read_shots, write_shots
from impasto.capture.drivers import simulated
from impasto.cli import main
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io import read_session, write_lights

# --- shots.toml


def test_a_plan_reads_back_to_the_same_shots(tmp_path: Path) -> None:
    """Directions bit for bit; poses with a view, a lamp and joints."""
    plan = captures.plan(5)
    posed = replace(
        plan.shots[4], pose=Pose((0.6, 0.0, 0.8), (0.0, 0.6, 0.8), {"tilt joint": 0.25})
    )
    plan = replace(plan, shots=(*plan.shots[:4], posed, *plan.shots[5:]))
    write_shots(tmp_path / "shots.toml", plan)
    again = read_shots(tmp_path / "shots.toml")
    assert again.shots == plan.shots
    assert np.array_equal(again.directions, plan.directions)
    near = ShotPlan(plan.shots, plan.directions, 700.0 * plan.directions)
    write_shots(tmp_path / "near.toml", near)
    read = read_shots(tmp_path / "near.toml").positions_mm
    assert read is not None
    assert np.array_equal(read, 700.0 * plan.directions)


LAMPS = "version = 1\n[lamps]\ndirections = [[0.0, 0.0, 1.0]]\n"
SHOT = '[[shots]]\nname = "a"\nkind = "photograph"\nlamp = 1\nexposure_s = 0.01\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAMPS + SHOT + "lampe = 2\n", "shot 1: 'lampe' is no key; did you mean 'lamp'?"),
        (LAMPS + SHOT.replace("lamp = 1", "lamp = 2"), "expected a lamp from 1 to 1, found 2"),
        (LAMPS + SHOT.replace("photograph", "photo"), "did you mean 'photograph'?"),
        (LAMPS + SHOT.replace("0.01", "0.0"), "shot 1: exposure_s: expected a positive number"),
        (LAMPS + SHOT.replace('"a"', '"../a"'), "is no name of a file"),
        (LAMPS + SHOT + SHOT.replace('"a"', '"A"'), "is the name of several shots"),
        (LAMPS + SHOT.replace("photograph", "dark"), "a dark frame has no lamp, found lamp 1"),
        (LAMPS + SHOT.replace("lamp = 1\n", ""), "expected a lamp from 1 to 1, found None"),
        (LAMPS + SHOT + "view = [0, 0, 0]\n", "a direction of length 0"),
        (LAMPS, "expected sections [[shots]]"),
        (SHOT, "version: expected 1, found None"),
        ("version = 1\nlights = 3\n" + SHOT, "'lights' is no key"),
    ],
)
def test_a_wrong_plan_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "shots.toml"
    path.write_text(text)
    with pytest.raises(ArgumentError) as caught:
        read_shots(path)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)


def test_a_plan_that_is_no_toml_is_damaged(tmp_path: Path) -> None:
    (tmp_path / "shots.toml").write_text("[[shots\n")
    with pytest.raises(CorruptInputError, match="cannot be read as TOML"):
        read_shots(tmp_path / "shots.toml")


# --- the commands


@pytest.fixture
def light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A light file of six lamps; the simulated rig has the small painting of the tests."""
    monkeypatch.setattr("impasto.simulate.painting", lambda **_: captures.painting())
    monkeypatch.setattr(simulated, "camera_named", lambda name: captures.camera())
    path = tmp_path / "rig.lp"
    write_lights(path, captures.light_file(6).directions, [f"lamp{n}.jpg" for n in range(1, 7)])
    return path


def words(*more: Any) -> list[str]:
    return ["capture", *map(str, more)]


def test_a_simulated_capture_from_a_light_file(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(words("run", "--lights", light, "--out", out, "--darks", 1, "--quiet")) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["taken    9 of 9 shots", f"written  {out}/session.toml"]
    assert printed.err == ""
    assert sorted(p.stem for p in (out / "photographs").iterdir()) == [
        f"lamp{n}" for n in range(1, 7)
    ]
    assert main(words("check", out, "--quiet")) == 0
    assert main(["session", "check", str(out)]) == 0
    assert main(words("run", "--lights", light, "--out", out)) == 1
    assert "--resume" in capsys.readouterr().err
    # The name of the plan is in the folder.
    assert main(words("run", "--resume", "--out", out, "--quiet")) == 0


def test_a_dry_run_prints_a_plan_that_can_be_run(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words("run", "--lights", light, "--dry-run", "--references", 0)) == 0
    printed = capsys.readouterr()
    assert printed.err == "9 shots: 3 dark shots, 6 photograph shots; nothing is taken\n"
    shots = tmp_path / "shots.toml"
    shots.write_text(printed.out)
    assert main(words("run", "--shots", shots, "--out", tmp_path / "a", "--quiet")) == 0


def test_a_plan_of_lamps_is_what_run_photographs(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dark frames and reference shots with the lamps that tell most; exposures of a light file."""
    shots, out = tmp_path / "plan.toml", tmp_path / "out"
    assert main(words("plan", "none", "--add", 4, "--out", shots, "--quiet")) == 0
    assert main(words("run", "--shots", shots, "--out", out, "--quiet")) == 0
    assert "taken    9 of 9 shots" in capsys.readouterr().out
    plan = read_shots(shots)
    session = read_session(out)
    assert session.directions is not None
    for number, found in enumerate(session.directions.values()):
        np.testing.assert_array_equal(found, plan.directions[number])
    assert main(words("run", "--lights", light, "--dry-run", "--exposure", "2,8")) == 0
    assert capsys.readouterr().out.count("exposure_s = [0.002, 0.008]") == 6
    assert main(words("run", "--lights", light, "--dry-run", "--exposure", "0")) == 1
    assert "--exposure: expected milliseconds above 0" in capsys.readouterr().err


def test_the_retake_list_of_a_check(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 3 of a damaged file; --resume mends it."""
    out = tmp_path / "out"
    run = words("run", "--lights", light, "--out", out, "--quiet")
    assert main(run) == 0
    (out / "photographs" / "lamp3.png").unlink()
    capsys.readouterr()
    assert main(words("check", out, "--quiet")) == 3
    assert capsys.readouterr().out.splitlines() == [
        "taken    10 of 11 shots",
        "retake   lamp3 (lamp 3): photographs/lamp3.png is not there any more",
        "         -> bring it back",
        f"go on    impasto capture run --resume --out {out}, with the same devices",
    ]
    assert main(words("check", out, "--json")) == 3
    (retake,) = json.loads(capsys.readouterr().out)["retakes"]
    assert (retake["name"], retake["lamp"], retake["code"]) == ("lamp3", 3, "missing")
    assert main([*run, "--resume"]) == 0
    assert main(words("check", out, "--quiet")) == 0


def test_a_damaged_journal_is_named(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One digit of a hash in its third line; neither command goes on from it."""
    out = tmp_path / "out"
    run = words("run", "--lights", light, "--out", out, "--quiet")
    assert main(run) == 0
    journal = out / "capture" / "journal.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    digit = lines[2].index('"sha256": "') + len('"sha256": "')
    lines[2] = f"{lines[2][:digit]}{'0' if lines[2][digit] != '0' else '1'}{lines[2][digit + 1 :]}"
    journal.write_text("".join(lines))
    for command in (words("check", out, "--quiet"), [*run, "--resume"]):
        assert main(command) == 3
        said = " ".join(capsys.readouterr().err.split())
        assert "journal.jsonl: is damaged in line 3; bring back a copy of it" in said


def test_nothing_to_go_on_with_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words("run", "--resume", "--out", tmp_path / "out")) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "holds no capture that was begun; start it with --lights or --shots" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "--lights: give the light file of the rig, or a plan with --shots"),
        (["--camera", "folder"], "--watch: give the folder into which the camera saves"),
        (["--camera", "folder", "--watch", "nowhere"], "--watch: nowhere is no folder"),
        (["--dome", "/dev/ttyNONE7"], "--dome: the camera is simulated, which is the default"),
        (["--exposure", "0"], "--exposure: expected milliseconds above 0, found 0"),
        (["--darks", "-1"], "--darks: expected a whole number from 0 on, found -1"),
        (["--faults", "200"], "--faults: expected percent from 0 to 100, found 200"),
    ],
)
def test_wrong_options_are_named(
    light: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    lights = ["--lights", str(light)] if options else []
    assert main(words("run", *lights, "--out", tmp_path / "out", *options)) == 1
    printed = capsys.readouterr().err
    assert said in " ".join(printed.split())
    assert "Traceback" not in printed

"""What is said where a result is doubtful, or a call cannot do what was asked, leads somewhere."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import doctor, simulate
from impasto.cli import main
from impasto.io import write_stack


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def capture() -> simulate.Capture:
    return simulate.default_capture("tominaga-rgb-camera", size=(32, 40))


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory, capture: simulate.Capture) -> Path:
    path = tmp_path_factory.mktemp("stack") / "painting.npz"
    write_stack(path, capture.stack)
    return path


# --- the doctor


def test_many_views_are_no_duplicates_and_hide_lamps() -> None:
    painting = simulate.painting(seed=7, size=(48, 48), varnish="patches")
    stack = simulate.capture(painting, "snel-lafortune").stack
    diagnosis = doctor.examine(stack)
    assert diagnosis.of("warning", "error") == ()
    # Five times the scatter is more than the fifth that matters: fine would be a guess.
    assert diagnosis["strengths"].severity == "note"
    assert "fit_strengths" in diagnosis["strengths"].advice
    samples = stack.samples.copy()
    samples[5] = samples[300]
    copied = stack._replace(samples=samples)
    assert doctor.examine(copied)["duplicates"].observations == (5, 300)


def test_the_icons_lamps_are_not_called_equal(data: Path) -> None:
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    finding = doctor.examine(stack)["strengths"]
    assert finding.severity == "note"
    assert "cannot tell whether lamps differ" in finding.message


# --- fits


def test_lamps_that_still_change_say_by_how_much(stack: Path) -> None:
    rig = impasto.Rig(np.eye(3)[[2, 2, 2, 2]])
    samples = impasto.Stack(np.ones((4, 1, 2, 2), np.float32), lights=rig)
    change = np.array([0.0, 0.01, -0.02, 0.08])
    lamps = impasto.Strengths(np.ones(4), rig, samples, False, change)
    assert "2 of which the last round still changed by more than 1 % (up to 8.0 %)" in repr(lamps)
    assert "fit_strengths(lamps.stack) goes on" in repr(lamps)
    assert "changed" not in repr(replace(lamps, converged=True))
    assert "the others have settled" in repr(replace(lamps, change=np.eye(20)[0]))


def test_a_search_under_way_says_how_far_it_still_went(capture: simulate.Capture) -> None:
    fitted = impasto.fit_sbrdf(capture.stack)
    path = np.array([[1.0, 0.1], [2.0, 0.2], [2.02, 0.199]])
    part = replace(
        fitted, converged=False, verdict="fitted", path=path, covariance=np.diag([0.02, 0.01]) ** 2
    )
    assert "changed beta by 1 % and gamma by 0.5 % (less than their ±: harmless)" in repr(part)
    wild = replace(part, covariance=np.diag([0.001, 0.01]) ** 2)
    assert "harmless" not in repr(wild)
    mixed = replace(fitted, verdict="mixed", describes=0.4)
    assert 'pooling="pixel"' in repr(mixed)


def test_nothing_to_try_fits_on_is_refused(capture: simulate.Capture) -> None:
    lights = capture.stack.rig
    for value in (0.0, np.nan):
        samples = np.full((len(lights), 3, 8, 8), value, np.float32)
        with pytest.raises(impasto.ArgumentError, match="photographs that show something"):
            impasto.suggest_effort(impasto.Stack(samples, lights=lights), error=0.1)


# --- the command line


def test_lamps_are_estimated_by_a_word(stack: Path, tmp_path: Path) -> None:
    words = f"fit {stack} --out {tmp_path / 'fit'} --strengths --quiet"
    assert main(words.split()) == 0
    report = json.loads((tmp_path / "fit" / "report.json").read_text(encoding="utf-8"))
    found = impasto.fit_strengths(impasto.read_stack(stack))
    assert report["options"]["strengths"] is True
    assert report["results"]["strengths"]["factor"] == found.factor.tolist()
    rig = impasto.load_sbrdf(tmp_path / "fit" / "sbrdf.npz").rig
    np.testing.assert_array_equal(rig.intensities, found.rig.intensities)


def test_one_lobe_for_several_kinds_hints_at_the_pixels_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    painting = simulate.painting(seed=7, size=(48, 48), varnish="patches")
    patches = simulate.capture(painting, "tominaga-six-band-adaptation", noise=None).stack
    assert impasto.fit_sbrdf(patches).verdict == "mixed"
    write_stack(tmp_path / "stack.npz", patches)
    assert main(["fit", str(tmp_path / "stack.npz"), "--out", str(tmp_path / "fit")]) == 0
    assert "--pooling pixel (without --camera) gives each its own" in said(capsys)


def test_advice_on_spectra_does_not_lead_into_a_wall(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fit"
    assert main(f"fit {stack} --out {out} --pooling pixel --quiet".split()) == 0
    picture = tmp_path / "a.png"
    assert main(f"render {out} --illuminant A --out {picture} --quiet".split()) == 1
    told = said(capsys)
    assert "pixels' own lobes cannot be shown in another light yet" in told
    assert "fit again with --camera" not in told

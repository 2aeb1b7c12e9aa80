"""What is said where a result is doubtful, or a call cannot do what was asked, leads somewhere."""

from __future__ import annotations

import json
import subprocess
import sys
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


def test_strengths_do_not_depend_on_the_order_of_views() -> None:
    """Of hundreds many are lit from one height: a sort may leave those in any order.

    Which of a pixel's equal samples are kept does depend on it, and moves a strength by a hundredth
    here at most; what is usual of a height would by a third.
    """
    painting = simulate.painting(seed=7, size=(24, 24), varnish="patches")
    stack = simulate.capture(painting, "snel-lafortune").stack
    order = np.random.default_rng(3).permutation(len(stack.rig))
    one, other = (doctor.examine(views)["strengths"] for views in (stack, stack.take(order)))
    assert one.message == other.message
    np.testing.assert_allclose(
        np.array(other.numbers["gain"]), np.array(one.numbers["gain"])[order], rtol=0.03
    )


def test_the_icons_lamps_are_not_called_equal(data: Path) -> None:
    stack = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    finding = doctor.examine(stack)["strengths"]
    assert finding.severity == "note"
    assert "cannot check whether lamps differ" in finding.message


# --- fits


def test_lamps_that_still_change_say_by_how_much(stack: Path) -> None:
    rig = impasto.Rig(np.eye(3)[[2, 2, 2, 2]])
    samples = impasto.Stack(np.ones((4, 1, 2, 2), np.float32), lights=rig)
    change = np.array([0.0, 0.01, -0.02, 0.08])
    lamps = impasto.Strengths(np.ones(4), rig, samples, False, change)
    assert "2 of which the last round still changed by more than 1 % (up to 8.0 %)" in repr(lamps)
    assert "fit_strengths(lamps.stack) continues" in repr(lamps)
    assert "changed" not in repr(replace(lamps, converged=True))
    assert "the others have converged" in repr(replace(lamps, change=np.eye(20)[0]))
    nearly = replace(lamps, change=np.full(4, 0.006))
    assert "which the last round still changed by up to 0.6 %: they have converged" in repr(nearly)


def test_a_search_under_way_says_how_far_it_still_went(capture: simulate.Capture) -> None:
    fitted = impasto.fit_sbrdf(capture.stack, pooling="painting")
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


def test_lamps_are_estimated_by_a_word(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"fit {stack} --out {tmp_path / 'fit'} --strengths --quiet"
    assert main(words.split()) == 0
    report = json.loads((tmp_path / "fit" / "report.json").read_text(encoding="utf-8"))
    found = impasto.fit_strengths(impasto.read_stack(stack))
    assert report["options"]["strengths"] is True
    assert report["results"]["strengths"]["factor"] == found.factor.tolist()
    rig = impasto.load_sbrdf(tmp_path / "fit" / "sbrdf.npz").rig
    np.testing.assert_array_equal(rig.intensities, found.rig.intensities)
    assert main(["info", str(tmp_path / "fit")]) == 0
    low, high = found.factor.min(), found.factor.max()
    assert f"{len(found.factor)} lights, {low:.2f} to {high:.2f}" in capsys.readouterr().out


def test_lamps_are_estimated_with_the_lobes_that_are_fitted(stack: Path, tmp_path: Path) -> None:
    words = "--strengths --pooling pixel --lobes 1 --index 1.6 --quiet"
    assert main(f"fit {stack} --out {tmp_path / 'fit'} {words}".split()) == 0
    report = json.loads((tmp_path / "fit" / "report.json").read_text(encoding="utf-8"))
    found = impasto.fit_strengths(impasto.read_stack(stack), lobes=1, index=1.6)
    assert report["results"]["strengths"]["factor"] == found.factor.tolist()
    # The lamps are even: what tells the options is the gain on photographs held out.
    assert report["results"]["strengths"]["held_out"] == str(found.held_out)
    assert str(found.held_out) != str(impasto.fit_strengths(impasto.read_stack(stack)).held_out)


def test_several_varnishes_get_lobes_per_pixel_and_a_line_that_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    painting = simulate.painting(seed=7, size=(48, 48), varnish="patches")
    patches = simulate.capture(painting, "tominaga-six-band-adaptation", noise=None).stack
    assert impasto.fit_sbrdf(patches, pooling="painting").verdict == "mixed"
    write_stack(tmp_path / "stack.npz", patches)
    assert main(["fit", str(tmp_path / "stack.npz"), "--out", str(tmp_path / "fit")]) == 0
    told = said(capsys)
    assert "per pixel" in told
    assert "dB on 16 held-out photographs; one lobe for the painting" in told
    report = json.loads((tmp_path / "fit" / "report.json").read_text(encoding="utf-8"))
    assert report["results"]["choice"]["chosen"]["pooling"] == "pixel"


def test_advice_on_spectra_does_not_lead_into_a_wall(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fit"
    assert main(f"fit {stack} --out {out} --pooling pixel --quiet".split()) == 0
    picture = tmp_path / "a.png"
    assert main(f"render {out} --illuminant A --out {picture} --quiet".split()) == 1
    told = said(capsys)
    assert "fit again with --camera" in told
    again = f"fit {stack} --out {out} --pooling pixel --camera srgb --force --quiet"
    assert main(again.split()) == 0
    assert main(f"render {out} --illuminant A --out {picture} --quiet".split()) == 0
    assert picture.exists()


def test_words_out_of_range_are_refused_before_photographs_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no such stack: the option is what is wrong first."""
    words = f"fit {tmp_path / 'none.npz'} --out {tmp_path / 'fit'} --pooling pixel --lobes 5"
    assert main(words.split()) == 1
    assert "--lobes: expected 1 to 3 per pixel, found 5" in said(capsys)
    words = f"fit {tmp_path / 'none.npz'} --out {tmp_path / 'fit'} --index 0.5"
    assert main(words.split()) == 1
    assert "--index: expected a refractive index from 1 to 100" in said(capsys)


def test_lights_without_photographs_lead_to_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savetxt(tmp_path / "light_directions.txt", simulate.rig("tominaga-rgb-camera").directions)
    assert main(["fit", str(tmp_path), "--out", str(tmp_path.parent / "fit")]) == 1
    told = said(capsys)
    assert "has no pictures; give their folder with --images" in told
    assert "remove" not in told


def test_ctrl_c_is_one_line_from_the_first_import_on() -> None:
    program = """\
import sys
import impasto

class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "cyclopts":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
from impasto.cli import main
sys.exit(main(["info"]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "impasto: interrupted\n")


# --- words for programs


def test_pictures_with_colours_last_are_refused() -> None:
    lights = simulate.rig("tominaga-rgb-camera").directions
    last = np.ones((len(lights), 24, 30, 3), np.float32)
    with pytest.raises(impasto.ArgumentError, match=r"np\.moveaxis\(samples, -1, 1\)"):
        impasto.Stack(last, lights=lights)
    assert impasto.Stack(np.moveaxis(last, -1, 1), lights=lights).shape[1:] == (3, 24, 30)
    # Spectral cameras' bands have names, and a narrow crop of three bands is fine.
    named = impasto.Stack(last, lights=lights, bands=[f"{400 + 10 * i} nm" for i in range(24)])
    assert named.take(range(3)).shape == (3, 24, 30, 3)
    assert impasto.Stack(np.ones((len(lights), 3, 30, 2)), lights=lights).shape[3] == 2


def test_what_is_no_archive_is_called_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "lobes.png"
    picture.write_bytes(b"\x89PNG\r\n")
    with pytest.raises(impasto.CorruptInputError, match=r"lobes\.png: is no \.npz file$"):
        impasto.load_sbrdf(picture)
    assert main(f"render {picture} --out {tmp_path / 'a.png'}".split()) == 1
    assert "pickle" not in said(capsys)


def test_a_folder_of_the_command_line_is_loaded(stack: Path, tmp_path: Path) -> None:
    out = tmp_path / "fit"
    assert main(f"fit {stack} --out {out} --effort draft --quiet".split()) == 0
    whole = impasto.load_sbrdf(out)
    np.testing.assert_array_equal(whole.normal, impasto.load_sbrdf(out / "sbrdf.npz").normal)
    with pytest.raises(FileNotFoundError):
        impasto.load_sbrdf(tmp_path)


def test_every_fit_is_scored(capture: simulate.Capture) -> None:
    stack, truth = capture.stack, capture.truth
    labels = np.zeros(stack.shape[2:], int)
    fits = [
        impasto.fit_sbrdf(stack, pooling="pixel"),
        impasto.fit_sbrdf(stack, pooling="segment", segments=labels),
        impasto.fit_sbrdf(stack, model="lafortune", lobes=1),
    ]
    for fitted in fits:
        scored = simulate.score(truth, fitted)
        assert np.isnan([scored.beta, scored.gamma]).all()
        assert scored.normal_median < 20.0
    assert np.isfinite(simulate.score(truth, fits[1].painting).gamma)


def test_many_segments_have_room_in_a_line(capture: simulate.Capture) -> None:
    labels = np.arange(32 * 40).reshape(32, 40)
    fitted = impasto.fit_sbrdf(capture.stack, pooling="segment", segments=labels)
    assert len(repr(fitted)) < 500
    assert "and 1276 more" in repr(fitted)


def test_nothing_seen_is_not_no_highlight(capture: simulate.Capture) -> None:
    black = capture.stack._replace(samples=np.zeros_like(capture.stack.samples))
    fitted = impasto.fit_sbrdf(black, pooling="painting")
    assert fitted.verdict == "too-few"
    assert "no pixel that could show a highlight" in repr(fitted)
    whole = impasto.fit_sbrdf(black, pooling="segment", segments=np.zeros((32, 40), int))
    assert "0: no highlight (the painting's; too-few)" in repr(whole)


def test_a_black_background_is_no_damage(data: Path) -> None:
    balls = data / "two_balls"
    stack = impasto.read_stack(
        balls / "Objects", lights=balls / "light_directions.txt", encoding="linear"
    )
    assert "blank" not in {finding.code for finding in doctor.examine(stack).findings}


def test_a_bar_leaves_nothing_in_a_log(
    capture: simulate.Capture, capsys: pytest.CaptureFixture[str]
) -> None:
    impasto.fit_normals(capture.stack, progress=True)
    assert capsys.readouterr().err == ""


def test_a_place_that_cannot_be_written_is_named(
    capture: simulate.Capture, stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "nowhere" / "x.npz"
    with pytest.raises(FileNotFoundError) as caught:
        write_stack(path, capture.stack)
    assert caught.value.filename == str(path)
    (tmp_path / "file").touch()
    assert main(f"fit {stack} --out {tmp_path / 'file' / 'fit'} --quiet".split()) == 1
    assert f"{tmp_path / 'file'}" in said(capsys)


@pytest.mark.parametrize(
    ("option", "near"),
    [
        ({"model": "lafortun"}, "lafortune"),
        ({"pooling": "pixels"}, "pixel"),
        ({"effort": "standart"}, "standard"),
        ({"normals": "robustt"}, "robust"),
    ],
)
def test_words_that_are_nearly_right(
    capture: simulate.Capture, option: dict[str, str], near: str
) -> None:
    with pytest.raises(impasto.ArgumentError, match=f"did you mean '{near}'"):
        impasto.fit_sbrdf(capture.stack, **option)  # type: ignore[call-overload]


def test_a_scene_is_told_in_a_line() -> None:
    scene = impasto.Scene([(0, 0.71, 0.71)], illuminant="A", adaptation=0.56, shadows=True)
    assert repr(scene) == "<Scene 1 light (A), an eye adapted by 0.56, with shadows, on srgb>"
    assert repr(scene.display) == "<Display srgb>"
    assert repr(impasto.Rig([(0, 0, 1)])) == "<Rig 1 light>"


def test_modules_are_there_when_they_are_named() -> None:
    """As the documentation names them: without an import of their own."""
    words = "import impasto; impasto.doctor.examine; impasto.simulate.painting; impasto.doktor"
    told = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, check=False
    )
    last = told.stderr.splitlines()[-1]
    assert last.startswith("AttributeError: module 'impasto' has no attribute 'doktor'")


def test_a_diagram_says_what_its_lines_are(capture: simulate.Capture) -> None:
    fitted = impasto.fit_sbrdf(capture.stack, model="lafortune", lobes=1)
    y, x = np.argwhere(fitted.status < 16)[0].tolist()
    legend = fitted.lobe_plot(y, x).legends[0]
    words = [text.get_text() for text in legend.get_texts()]
    assert {"light", "its mirror"} <= set(words)
    for factor in (1.0, 1.5, 2.0, 3.0, 4.5, 7.0):
        maps = {"diffuse": factor * fitted.diffuse, "specular": factor * fitted.specular}
        circles = replace(fitted, **maps).lobe_plot(y, x).axes[0].get_yticks()
        assert 4 <= len(circles) <= 6, "numbers run into each other, or there are none"
    with pytest.raises(impasto.ArgumentError, match=r"y: expected a whole number, found 3\.5"):
        fitted.lobe_plot(3.5, 2)  # type: ignore[arg-type]

"""``impasto export`` and ``impasto rti`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

import impasto
from command_line import complaint
from impasto import simulate
from impasto.cli import main
from impasto.io import read_image, read_relightable, read_stack

ROWS, COLUMNS = 20, 24


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of the RGB camera's system, with the width of a pixel."""
    from impasto import systems

    path = tmp_path_factory.mktemp("fit") / "sbrdf.npz"
    capture = simulate.default_capture("tominaga-rgb-camera", size=(ROWS, COLUMNS))
    system = systems.get("tominaga-rgb-camera")
    stack = system.prepared(capture.stack)
    system.fit_sbrdf(stack, system.fit_normals(stack)).save(path)
    return path


def test_a_fit_becomes_files_and_says_what_is_lost(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.glb"
    assert main(["export", "gltf", str(result), "--out", str(out), "--displaced"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "dE00" in said
    assert "lost all but one lobe" in said
    assert out.read_bytes().startswith(b"glTF")
    assert (tmp_path / "a.glb.loss.json").is_file()


def test_a_detail_as_json(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.rti"
    words = ["export", "hsh", str(result), "--out", str(out), "--region", "2", "3", "8", "10"]
    assert main([*words, "--json", "--quiet"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["format"] == "HSH"
    assert report["files"][0][0] == "a.rti"
    assert read_relightable(out).shape == (8, 10)


@pytest.mark.parametrize(
    ("words", "files"),
    [
        (["openlime"], ["layers.json", "kd.png", "rti/info.json"]),
        (["relight", "--functions", "ptm"], ["info.json", "plane_5.jpg"]),
        (["iiif", "--light", "180,20", "--url", "https://museum.example/x"], ["info.json"]),
        (["usd"], ["painting.usda", "textures/normal.png"]),
        (["materialx"], ["painting.mtlx"]),
        (["mitsuba"], ["scene.xml"]),
    ],
)
def test_folders(words: list[str], files: list[str], result: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["export", words[0], str(result), "--out", str(out), *words[1:], "--quiet"]) == 0
    assert [name for name in files if not (out / name).is_file()] == []
    assert json.loads((out / "loss.json").read_text())["kind"] == "impasto loss"


def test_wrong_uses(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    export = ["export", "usd", str(result), "--out"]
    assert "no export of impasto wrote" in complaint([*export, str(tmp_path)], 1, capsys)
    assert "--pitch" in complaint([*export, str(tmp_path / "a"), "--pitch", "-1"], 1, capsys)
    words = ["export", "gltf", str(result), "--out", str(tmp_path / "a.obj")]
    assert "--out" in complaint(words, 1, capsys)
    web = ["export", "web", str(result), "--out", str(tmp_path)]
    assert complaint(web, 1, capsys).startswith("impasto: --out:")
    iiif = ["export", "iiif", str(result), "--out", str(tmp_path / "a")]
    assert "--quality" in complaint([*iiif, "--quality", "0"], 1, capsys)
    assert "--url" in complaint([*iiif, "--url", "museum"], 1, capsys)
    missing = str(tmp_path / "none")
    assert "does not exist" in complaint(["export", "ptm", missing, "--out", "a.ptm"], 1, capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_an_old_file_is_described_shown_and_made_photographs(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = tmp_path / "a.ptm"
    assert main(["export", "ptm", str(result), "--out", str(old), "--quiet"]) == 0
    assert main(["info", str(old)]) == 0
    said = capsys.readouterr().out
    assert "PTM_FORMAT_RGB" in said
    assert f"{COLUMNS} x {ROWS} pixels" in said
    picture = tmp_path / "a.png"
    assert main(["rti", "render", str(old), "--out", str(picture), "--light", "0,45"]) == 0
    light = (0.5**0.5, 0.0, 0.5**0.5)
    shown = np.moveaxis(read_relightable(old).display(light), -1, 0)
    np.testing.assert_array_equal(read_image(picture), shown)
    stack = tmp_path / "a.npz"
    assert main(["rti", "photographs", str(old), "--out", str(stack)]) == 0
    found = read_stack(stack)
    assert found.samples.shape == (40, 3, ROWS, COLUMNS)
    capsys.readouterr()
    words = ["rti", "render", str(old), "--out", str(tmp_path / "a.gif")]
    assert "--out" in complaint(words, 1, capsys)
    old.write_bytes(old.read_bytes()[:200])
    assert "truncated" in complaint(["info", str(old)], 3, capsys)


def test_a_smaller_scale_has_the_columns_that_were_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a store; any other width is refused with those that there are, and so is one of a file."""
    from impasto import jobs
    from killed_jobs import OPTIONS, stack

    store = tmp_path / "a.impasto.zarr"
    jobs.run(stack((60, 128)), store, **OPTIONS)
    out = tmp_path / "a.exr"
    export = ["export", "height", str(store), "--out", str(out), "--quiet"]
    for width, rows in (("128", 60), ("64", 30)):
        assert main([*export, "--width", width]) == 0
        assert read_image(out).shape == (1, rows, int(width))
    said = complaint([*export, "--width", "100"], 1, capsys)
    assert "(128, 64" in said
    assert "found 100" in said
    both = complaint([*export, "--width", "64", "--region", "0", "0", "4", "4"], 2, capsys)
    assert "one of them" in both


def test_a_file_has_one_scale(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", "ptm", str(result), "--out", str(tmp_path / "a.ptm"), "--width", "12"]
    assert "has no smaller scale" in complaint(words, 1, capsys)
    assert list(tmp_path.iterdir()) == []


def test_heights_are_about_the_plane_of_the_panel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A panel that leans by 15 degrees: both commands take it out, or keep it, and say so."""
    y, x = np.mgrid[:24, :30]
    p, q = 0.27 + 0.05 * np.cos(0.7 * x), 0.05 * np.sin(0.6 * y)
    normal = np.stack([-p, -q, np.ones_like(p)])
    normal /= np.linalg.norm(normal, axis=0)
    lights = [(x, y, 0.8) for x, y in ((0.6, 0), (0, 0.6), (-0.6, 0), (0, -0.6))]
    shown = impasto.Surface(normal, np.full((3, 24, 30), 0.5)).predict(lights)
    fit = impasto.fit_sbrdf(impasto.Stack(shown, lights=lights), pooling="none")
    fit.save(tmp_path / "sbrdf.npz")
    for more in ([], ["--no-level"]):
        words = [str(tmp_path), "--pitch", "0.1", *more, "--out"]
        assert main(["height", *words, str(tmp_path / "a.tif")]) == 0
        alone = capsys.readouterr().err
        assert main(["export", "height", *words, str(tmp_path / "a.exr")]) == 0
        exported = capsys.readouterr().err
        heights = [tifffile.imread(tmp_path / "a.tif"), read_image(tmp_path / "a.exr")[0]]
        np.testing.assert_allclose(heights[0] - heights[0].mean(), heights[1], atol=1e-5)
        assert (np.ptp(heights[0]) > 0.5) == bool(more)
        for said in (alone, exported):
            assert "lights" not in said
            about = "degrees to the left; heights are about its own plane (--no-level"
            assert (about in said) == (not more)

"""The gloss on the command line: models, lobes of pixels and segments, and options that clash."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

import impasto
from command_line import complaint, photographs
from impasto.cli import main
from impasto.cli.options import Angles
from impasto.io import read_stack, write_exr


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photographs(tmp_path_factory.mktemp("stack"))


def test_every_pixel_may_have_lobes_of_its_own(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "lobes"
    words = ["--pooling", "pixel", "--lobes", "1", "--out", str(out), "--quiet"]
    assert main(["fit", str(stack), *words]) == 0
    saved = impasto.load_sbrdf(out / "sbrdf.npz")
    assert isinstance(saved, impasto.LobeSbrdf)
    assert saved.specular.shape[:2] == (1, 3)
    names = {"1.R", "1.G", "1.B", "1.gamma", "1.sigma", "lobes", "ambient.R"}
    with OpenEXR.File(str(out / "lobes.exr"), separate_channels=True) as file:
        assert names <= set(file.channels())
    content = json.loads((out / "report.json").read_text())
    told = content["options"]
    assert (told["pooling"], told["lobes"], told["ambient"]) == ("pixel", 1, True)
    assert told["coated"] is content["results"]["coated"] is False
    assert "extraction" not in told
    assert sum(content["results"]["lobes"]) == 32 * 40
    assert main(["render", str(out), "--out", str(tmp_path / "lit.png"), "--quiet"]) == 0
    assert main(["info", str(out / "sbrdf.npz")]) == 0
    assert "per pixel" in capsys.readouterr().out


def test_a_fit_says_what_it_did_and_what_to_do_next(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a matte fit"
    assert main(["fit", str(stack), "--pooling", "none", "--out", str(out)]) == 0
    told = capsys.readouterr().err
    assert "not fitted" in told
    assert "no highlight found" not in told  # none was looked for
    last = told.splitlines()[-1]
    assert last.startswith(f"Look at '{out}/overview.jpg'")
    # The commands can be copied as they are, blanks in names included.
    command = shlex.split(last.split("pictures: ")[1])
    assert command[:3] == ["impasto", "render", str(out)]
    command[-1] = str(tmp_path / "raking.png")
    assert main([*command[1:], "--quiet"]) == 0


def test_lobes_of_lafortune_are_fitted_and_rendered(
    stack: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "lobes"
    words = ["--model", "lafortune", "--lobes", "1", "--out", str(out), "--quiet"]
    assert main(["fit", str(stack), *words]) == 0
    saved = impasto.load_sbrdf(out / "sbrdf.npz")
    assert isinstance(saved, impasto.LafortuneSbrdf)
    assert len(saved.specular) == 1
    names = {"1.R", "1.G", "1.B", "1.cxy", "1.cz", "1.exponent", "lobes"}
    names |= {f"1.{name}_sigma" for name in ("specular", "direction", "exponent")}
    with OpenEXR.File(str(out / "lobes.exr"), separate_channels=True) as file:
        assert names == set(file.channels())
    content = json.loads((out / "report.json").read_text())
    assert content["options"]["model"] == "lafortune"
    assert content["results"]["verdict"] == "one-view"
    assert cv2.imread(str(out / "overview.jpg")) is not None
    picture = tmp_path / "lit.exr"
    assert main(["render", str(out), "--out", str(picture), "--exposure", "1", "--quiet"]) == 0
    with OpenEXR.File(str(picture), separate_channels=True) as file:
        red = file.channels()["R"].pixels
    expected = saved.predict([Angles(90.0, 45.0).direction])[0, 0]
    fine = saved.status < impasto.Status.DARK
    # Bands to XYZ and back: a few roundings.
    np.testing.assert_allclose(red[fine], expected[fine], rtol=0, atol=4e-6)
    for path in (out, out / "sbrdf.npz"):
        assert main(["info", str(path)]) == 0
        printed = capsys.readouterr().out
        assert "lobes per pixel" in printed
        assert "one-view" in printed
        assert "direction sigma degrees median  " in printed


def test_the_effort_of_all_fits_can_be_chosen(stack: Path, tmp_path: Path) -> None:
    out, draft = tmp_path / "lobes", impasto.effort.PRESETS["draft"]
    words = f"fit {stack} --pooling pixel --effort draft --out {out} --quiet"
    assert main(words.split()) == 0
    assert json.loads((out / "report.json").read_text())["options"]["effort"] == "draft"
    saved = impasto.load_sbrdf(out / "sbrdf.npz")
    expected = impasto.fit_sbrdf(read_stack(stack), pooling="pixel", effort=draft)
    np.testing.assert_array_equal(saved.normal, expected.normal)
    usual = impasto.fit_sbrdf(read_stack(stack), pooling="pixel")
    assert not np.array_equal(saved.normal, usual.normal, equal_nan=True)


@pytest.fixture(scope="module")
def labels(stack: Path) -> Path:
    """Left, right, and a corner that belongs to neither."""
    path = stack.parent / "labels.png"
    codes = np.full((32, 40), 60, np.uint8)
    codes[:, 20:] = 200
    codes[:4, :4] = 0
    assert cv2.imwrite(str(path), codes)
    return path


def test_every_segment_may_have_a_lobe_of_its_own(
    stack: Path, labels: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "segments"
    words = f"fit {stack} --pooling segment --segments {labels} --out {out} --quiet"
    assert main(words.split()) == 0
    saved = impasto.load_sbrdf(out / "sbrdf.npz")
    assert isinstance(saved, impasto.SegmentSbrdf)
    assert [one.label for one in saved.segments] == [60, 200]
    assert (saved.labels[:4, :4] == -1).all()
    assert (saved.labels[4:, :20] == 60).all()
    with OpenEXR.File(str(out / "gloss.exr"), separate_channels=True) as file:
        np.testing.assert_array_equal(file.channels()["beta"].pixels, saved.beta)
    content = json.loads((out / "report.json").read_text())
    assert [one["label"] for one in content["results"]["segments"]] == [60, 200]
    assert [Path(one["file"]).name for one in content["inputs"]] == [stack.name, labels.name]
    assert content["options"]["segments"] == str(labels)
    assert main(["render", str(out), "--out", str(tmp_path / "lit.png"), "--quiet"]) == 0
    assert main(["info", str(out)]) == 0
    assert "200: " in capsys.readouterr().out
    # Part of both: the photographs' region is cut out of the labels, too.
    part = tmp_path / "part"
    photographs = tmp_path / "photographs"
    assert main(["demo", "--size", "32", "--out", str(photographs), "--quiet"]) == 0
    picture = np.zeros((32, 32, 3), np.uint8)
    picture[:, 16:] = (0, 0, 255)
    assert cv2.imwrite(str(tmp_path / "red.png"), picture)
    words = (
        f"fit {photographs}/photographs --dark 1024 --saturation 65520 --region 8 8 16 24 "
        f"--pooling segment --segments {tmp_path}/red.png --out {part} --quiet"
    )
    assert main(words.split()) == 0
    saved = impasto.load_sbrdf(part / "sbrdf.npz")
    assert isinstance(saved, impasto.SegmentSbrdf)
    # Red in 8 bits: 255 * 256^2.
    assert [one.label for one in saved.segments] == [255 << 16]
    assert (saved.labels[:, :8] == -1).all()
    assert (saved.labels[:, 8:] == 255 << 16).all()


# --- mistakes


@pytest.fixture(scope="module")
def mistakes(stack: Path) -> dict[str, str]:
    """Names that the command lines below may use."""
    tmp_path = stack.parent
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.eye(9, dtype=np.uint8))
    black = tmp_path / "black.png"
    cv2.imwrite(str(black), np.zeros((32, 40), np.uint8))
    blurred = tmp_path / "blurred.png"
    cv2.imwrite(str(blurred), np.arange(32 * 40, dtype=np.uint16).reshape(32, 40))
    float_ = tmp_path / "float.exr"
    write_exr(float_, {"Y": np.ones((32, 40), np.float32)})
    garbage = tmp_path / "garbage.npz"
    garbage.write_bytes(b"no archive")
    return {
        "stack": str(stack),
        "small": str(small),
        "black": str(black),
        "blurred": str(blurred),
        "float": str(float_),
        "garbage": str(garbage),
        "tmp": str(tmp_path),
    }


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        ("--model phong", 2, "--model"),
        ("--pooling brush", 2, "--pooling"),
        ("--pooling painting --lobes 2", 2, "--lobes goes with --pooling pixel"),
        ("--pooling none --coated", 2, "--coated goes with --pooling painting or --pooling pixel"),
        ("--pooling painting --no-ambient", 2, "--ambient goes with --pooling pixel"),
        ("--lobes 2 --no-joint", 2, "--lobes and --joint: no fit has them together"),
        ("--model lafortune --ambient", 2, "--model lafortune has no --ambient"),
        ("--model lafortune --pooling painting", 2, "excludes --pooling painting"),
        ("--effort best", 2, "--effort"),
        ("--segments {small}", 1, "9 x 9 pixels"),
        ("--pooling segment", 2, "needs --segments, a picture"),
        ("--model lafortune --pooling segment", 2, "--pooling segment"),
        ("--model lafortune --index 1.5", 2, "has no --index"),
        ("--pooling pixel --extraction papers", 2, "has no --extraction"),
        (
            "--pooling pixel --camera srgb --system tominaga-rgb-camera",
            2,
            "excludes --system",
        ),
        ("--model lafortune --lobes 0", 1, "--lobes: expected 1 to 3"),
        ("--pooling pixel --lobes 4", 1, "found 4"),
        ("--pooling segment --segments {tmp}/no.png", 1, "no.png"),
        ("--pooling segment --segments {small}", 1, "9 x 9 pixels"),
        ("--pooling segment --segments {black}", 1, "entirely black"),
        ("--pooling segment --segments {blurred}", 1, "1279 colours"),
        ("--pooling segment --segments {float}", 1, "whole codes"),
        ("--pooling segment --segments {garbage}", 3, "garbage.npz"),
    ],
)
def test_a_mistake_says_what_and_what_to_do(
    options: str,
    code: int,
    told: str,
    mistakes: dict[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    words = [word.format(**mistakes) for word in options.split()]
    command = ["fit", mistakes["stack"], "--out", str(out), *words]
    assert told in complaint(command, code, capsys)
    assert list(tmp_path.iterdir()) == []

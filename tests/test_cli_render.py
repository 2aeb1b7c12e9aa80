"""``impasto render``: one picture of a result, under any lamps."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import colour
import cv2
import numpy as np
import OpenEXR
import pytest

from command_line import complaint
from impasto import GpuUnavailableError
from impasto.cli import main

SIZE = 48


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("render") / "demo"
    assert main(["demo", "--out", str(out), "--size", str(SIZE), "--quiet"]) == 0
    return out


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().err.split())


def test_a_dark_picture_is_told_and_brightened(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"render {demo} --light 90,45 --out {tmp_path / 'above.png'} --exposure".split()
    assert main([*words, "0.05"]) == 0
    told = said(capsys)
    assert "a dark picture" in told
    assert main([*words, told.split("--exposure ")[1].split()[0]]) == 0
    assert "a dark picture" not in said(capsys)
    shown = cv2.imread(str(tmp_path / "above.png"))
    assert shown is not None
    # 99 % of the pixels reach up to 0.9 of the display's light, code 243 of sRGB; the exposure is
    # told to two digits, 5 % of light or six codes at the most.
    assert np.percentile(shown.max(axis=2), 99) == pytest.approx(243, abs=7)


def test_a_bright_picture_is_told_and_darkened(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"render {demo} --light 90,45 --out {tmp_path / 'above.png'} --exposure".split()
    assert main([*words, "20"]) == 0
    told = said(capsys)
    assert "clips less than 1 %" in told
    assert main([*words, told.split("--exposure ")[1].split()[0]]) == 0
    told = said(capsys)
    assert "--exposure" not in told
    assert "a dark picture" not in told


def test_a_result_is_rendered_under_any_light(demo: Path, tmp_path: Path) -> None:
    day, lamp = tmp_path / "day.png", tmp_path / "lamp.png"
    assert main(f"render {demo} --light 90,45 --out {day} --quiet".split()) == 0
    words = f"render {demo} --light 90,45 --light=-90,60 --illuminant 2856K --adaptation 0.56"
    assert main(f"{words} --shadows --view 0,60 --out {lamp} --quiet".split()) == 0
    pictures = [cv2.imread(str(path)) for path in (day, lamp)]
    assert pictures[0] is not None
    assert pictures[1] is not None
    assert pictures[0].shape == (SIZE, SIZE, 3)
    # Seen from 60 degrees of elevation, the width shrinks to sin(60 degrees).
    assert pictures[1].shape[1] == pytest.approx(SIZE * np.sin(np.radians(60)), abs=2)


def test_a_lamp_is_yellower_than_daylight(demo: Path, tmp_path: Path) -> None:
    ratio = {}
    for name in ("D65", "A"):
        path = tmp_path / f"{name}.exr"
        assert main(f"render {demo} --illuminant {name} --out {path} --quiet".split()) == 0
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {key: channel.pixels for key, channel in file.channels().items()}
        ratio[name] = float(planes["B"].mean() / planes["R"].mean())
    assert ratio["A"] < ratio["D65"]


def linear(demo: Path, out: Path, words: str) -> np.ndarray:
    """``(3, y, x)`` linear light of a picture at exposure 1."""
    assert main(f"render {demo} {words} --exposure 1 --out {out} --quiet".split()) == 0
    with OpenEXR.File(str(out), separate_channels=True) as file:
        return np.stack([file.channels()[name].pixels for name in "RGB"])


def test_lamps_have_illuminants_of_their_own(demo: Path, tmp_path: Path) -> None:
    def picture(words: str) -> np.ndarray:
        return linear(demo, tmp_path / "lamps.exr", words)

    both = picture("--light 180,30,warm --light 0,30,cool --light 90,60 --illuminant A")
    # Light adds up: 2700 K and 4000 K are what warm and cool are documented to be.
    sum_ = picture("--light 180,30 --illuminant 2700K")
    sum_ = sum_ + picture("--light 0,30,4000") + picture("--light 90,60,A")
    # Three sums of rounded single-precision numbers against one.
    np.testing.assert_allclose(both, sum_, rtol=1e-5, atol=1e-6)


def test_the_eye_adapts_to_the_sum_of_lamps(demo: Path, tmp_path: Path) -> None:
    """Von Kries' factors on cones, D65 over the sum of both whites (colour-science)."""
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    shape = colour.SpectralShape(360, 830, 1)

    def white(light: colour.SpectralDistribution) -> np.ndarray:
        found = colour.sd_to_XYZ(light.align(shape), observer, method="Integration")
        return np.asarray(found / found[1])

    day = white(colour.SDS_ILLUMINANTS["D65"].copy())
    both = white(colour.sd_blackbody(2700.0, shape)) + day  # of equal intensities
    cones = np.array([[0.40024, 0.7076, -0.08081], [-0.2263, 1.16532, 0.04570], [0, 0, 0.91822]])
    factors = (cones @ day) / (cones @ both / both[1])
    to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    seen = np.linalg.inv(cones @ to_xyz) @ np.diag(factors) @ cones @ to_xyz

    out, words = tmp_path / "adapted.exr", "--light 180,30,warm --light 0,30,D65"
    plain = linear(demo, out, words)
    adapted = linear(demo, out, f"{words} --adaptation 1 --adaptation-mode anchored")
    expected = np.einsum("ij,jyx->iyx", seen, plain)
    # The published matrix of sRGB has four digits, the spectra steps of 1 nm; to adapt to one of
    # the two lamps makes blue a third brighter or darker.
    np.testing.assert_allclose(adapted, expected, rtol=0, atol=1e-3 * expected.max())
    assert np.abs(adapted - plain).max() > 0.05 * expected.max()


def test_a_display_is_named_or_measured(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "p3.png"
    assert main(["render", str(demo), "--display", "Display P3", "--out", str(out)]) == 0
    assert b"iCCP" in out.read_bytes()[:200]


def test_a_near_lamp_lights_what_is_near(demo: Path, tmp_path: Path) -> None:
    thirds = []
    for x in (-30, 30):
        out = tmp_path / f"{x}.exr"
        assert main(f"render {demo} --point {x},0,30 --out {out} --quiet".split()) == 0
        with OpenEXR.File(str(out), separate_channels=True) as file:
            green = np.asarray(file.channels()["G"].pixels)
        third = green.shape[1] // 3
        thirds.append((green[:, :third].mean(), green[:, -third:].mean()))
    assert thirds[0][0] > thirds[1][0]
    assert thirds[0][1] < thirds[1][1]


def test_a_room_lights_without_lamps_and_can_be_turned(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    for name, more in (
        ("hall", ""),
        ("turned", " --environment-rotation 40"),
        ("lit", " --light 0,30"),
    ):
        out = tmp_path / f"{name}.png"
        words = f"render {demo} --environment gallery{more} --exposure 1 --out {out} --quiet"
        assert main(words.split()) == 0
        picture = cv2.imread(str(out))
        assert picture is not None
        shown.append(picture.astype(int))
    assert np.abs(shown[0] - shown[1]).max() > 10
    # A lamp besides adds light.
    assert (shown[2] >= shown[0] - 1).all()
    assert shown[2].mean() > shown[0].mean() + 10
    out = tmp_path / "none.png"
    assert main(f"render {demo} --environment gone.hdr --out {out} --quiet".split()) == 1
    assert "gone.hdr" in said(capsys)
    assert not out.exists()


MISTAKES = [
    *(
        (f"--system tominaga-rgb-camera {more}", 2, "--system has its own lights")
        for more in (
            "--tolerance 0",
            "--explain",
            "--backend auto",
            "--environment-rotation 0",
            "--light 90,45",
            "--shadows",
        )
    ),
    ("--environment-rotation 30", 2, "--environment-rotation turns a room: it needs --environment"),
    ("--environment gallery --environment-rotation nan", 1, "expected degrees, found nan"),
    ("--environment Gallery", 1, "found 'Gallery'; did you mean 'gallery'?"),
    ("--environment GALLERY", 1, "found 'GALLERY'; did you mean 'gallery'?"),
    (
        "--environment=",
        1,
        "--environment: expected gallery, skylight, window, overcast, candles, or a file .exr, "
        ".hdr or .pic, found ''",
    ),
    (
        "--environment room.jpg",
        1,
        "expected gallery, skylight, window, overcast, candles, or a file .exr, .hdr or .pic, "
        "found 'room.jpg'",
    ),
    ("--tolerance 1", 1, '--tolerance: expected 0, "code:1" or "dE:0.5", found \'1\''),
    ("--tolerance dE:-1", 1, "--tolerance: expected 0"),
    ("--backend vulkan", 2, "--backend"),
]


@pytest.mark.parametrize(("words", "code", "text"), MISTAKES)
def test_a_mistake_is_one_line_with_its_name(
    demo: Path,
    tmp_path: Path,
    words: str,
    code: int,
    text: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = f"render {demo} --out {tmp_path / 'picture.png'} {words}".split()
    assert text in complaint(given, code, capsys)
    assert list(tmp_path.iterdir()) == []


def test_no_tolerance_is_written_in_many_ways(demo: Path, tmp_path: Path) -> None:
    shown = []
    for number, words in enumerate(("", "--tolerance 0", "--tolerance 0.0", "--tolerance=-0e3")):
        out = tmp_path / f"{number}.png"
        assert main(f"render {demo} {words} --out {out} --quiet".split()) == 0
        shown.append(out.read_bytes())
    assert len(set(shown)) == 1


def test_a_tolerance_leaves_out_what_is_explained(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At 1e-5 of the display's white nobody sees the gloss."""
    words = f"render {demo} --exposure 1e-5 --explain --quiet --out".split()
    said = {}
    for allowed in ("0", "dE:0.5"):
        assert main([*words, str(tmp_path / f"{allowed[:2]}.exr"), "--tolerance", allowed]) == 0
        captured = capsys.readouterr()
        assert captured.err == ""
        said[allowed] = captured.out
        header, *_ = captured.out.splitlines()
        assert header.split() == ["effect", "decision", "why", "error", "saves"]
        assert f"tolerance {allowed}; left out in any tile: at most" in captured.out
    lobe = {
        allowed: next(line.split()[2] for line in text.splitlines() if line.startswith("lobe 1"))
        for allowed, text in said.items()
    }
    assert lobe == {"0": "on", "dE:0.5": "bounded"}
    assert (tmp_path / "0.exr").read_bytes() != (tmp_path / "dE.exr").read_bytes()


def test_a_backend_is_taken_or_one_line_says_why_not(
    demo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def lit(*arguments: Any) -> Any:
        used.append(arguments)
        raise GpuUnavailableError("no graphics card")

    used: list[Any] = []
    monkeypatch.setattr("impasto.picture.lit_by_card", lit)
    shown = {}
    for backend in ("cpu", "gpu"):
        out = tmp_path / f"{backend}.png"
        assert main(f"render {demo} --backend {backend} --out {out}".split()) == 0
        shown[backend] = out.read_bytes()
        lines = capsys.readouterr().err.splitlines()
        warned = [line for line in lines if "graphics card" in line]
        assert warned == ["warning: no graphics card; the CPU makes the picture"] * len(used)
        assert not any("Warning" in line or ".py" in line for line in lines)
    assert len(used) == 1
    assert shown["cpu"] == shown["gpu"]


def test_a_lamp_has_a_size_and_an_eye_a_place(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = {}
    for name, more in {
        "hard": "",
        "soft": "--lamp-size 20",
        "near": "--eye 4,-3,9",
    }.items():
        out = tmp_path / f"{name}.png"
        words = f"render {demo} --light 160,15 --shadows --quiet {more} --out {out}"
        assert main(words.split()) == 0
        shown[name] = cv2.imread(str(out))
    assert shown["soft"].shape == shown["hard"].shape == (SIZE, SIZE, 3)
    assert (shown["soft"] != shown["hard"]).any()
    # In perspective the near corner is larger than the far one: the picture is larger, and black
    # beside the painting.
    assert shown["near"].shape[1] > SIZE
    assert (shown["near"][0, -1] == 0).all()
    for wrong, (code, told) in {
        "--lamp-size 200": (1, "--lamp-size: expected 0 to 90 degrees, found 200"),
        "--lamp-size nan": (1, "--lamp-size: expected 0 to 90 degrees, found nan"),
        "--eye 4,-3,9 --view 20,60": (2, "--view is a direction and --eye a place"),
        "--eye 4,-3,0.01": (1, "move the eye away"),
        "--eye 4,-3,-9": (1, "in front of the painting"),
    }.items():
        words = f"render {demo} --quiet --out {tmp_path / 'no.png'} {wrong}"
        assert told in complaint(words.split(), code, capsys)


def test_a_varnish_yellows_a_painting_and_is_taken_off(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def blue_over_red(*words: str) -> float:
        out = tmp_path / "shown.exr"
        lit = ["--light", "90,45", "--exposure", "1", "--out", str(out)]
        assert main(["render", str(demo), *lit, *words]) == 0
        with OpenEXR.File(str(out), separate_channels=True) as file:
            channels = file.channels()
            return float(np.median(channels["B"].pixels / channels["R"].pixels))

    plain = blue_over_red()
    assert plain == pytest.approx(blue_over_red("--varnish", "clear"), rel=0.05)
    assert blue_over_red("--varnish", "brown") < blue_over_red("--varnish", "yellowed") < plain
    assert blue_over_red("--remove-varnish", "yellowed") > plain
    capsys.readouterr()
    both = ["--varnish", "clear", "--remove-varnish", "brown"]
    where = ["render", str(demo), "--out", str(tmp_path / "x.png")]
    assert "give one of them" in complaint([*where, *both], 2, capsys)
    clear = ["--remove-varnish", "clear"]
    assert "changes no colour" in complaint([*where, *clear], 2, capsys)


def test_false_colours_are_told(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "lit.png")
    assert main(["render", str(demo), "--out", out]) == 0
    assert "false colours" not in said(capsys)
    # The same fit without the spectra beside it.
    bare = shutil.copy(demo / "sbrdf.npz", tmp_path / "bare.npz")
    assert main(["render", str(bare), "--out", out]) == 0
    assert "false colours: three of 6 bands" in said(capsys)

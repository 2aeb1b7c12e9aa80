"""``impasto animate``: films of a result, complete or not at all."""

from __future__ import annotations

import hashlib
import json
from inspect import signature
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import impasto
from command_line import complaint
from impasto.cli import main
from impasto.cli.animate import animate as film_command
from killed_jobs import stack

SIZE = 40


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("animate") / "demo"
    assert main(["demo", "--out", str(out), "--size", str(SIZE), "--quiet"]) == 0
    return out


def pictures(folder: Path) -> list[NDArray[np.uint8]]:
    return [np.asarray(Image.open(path)) for path in sorted(folder.glob("frame-*.png"))]


def animate(demo: Path, out: Path, words: str) -> None:
    assert main(f"animate {demo} --out {out} {words} --quiet".split()) == 0


def test_a_folder_holds_one_picture_per_frame(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "film"
    animate(demo, out, "--raking --frames 12 --elevation 20")
    names = [f"frame-{number:02}.png" for number in range(12)]
    assert sorted(path.name for path in out.iterdir()) == [*names, "report.json"]
    with Image.open(out / names[0]) as picture:
        assert "icc_profile" in picture.info
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert [entry["file"] for entry in report["outputs"]] == names
    for entry in report["inputs"]:
        assert hashlib.sha256(Path(entry["file"]).read_bytes()).hexdigest() == entry["sha256"]
    names_read = [Path(entry["file"]).name for entry in report["inputs"]]
    assert names_read == ["sbrdf.npz", "reflectance.npz"]
    # As given, and what follows where nothing was given.
    options = report["options"]
    assert (options["raking"], options["frames"], options["elevation"]) == (True, 12, 20.0)
    assert (options["fps"], options["illuminant"], options["level"]) == (12.0, "D65", True)
    parameters = set(signature(film_command).parameters) - {"out", "force", "quiet"}
    assert options.keys() == parameters
    assert report["timings_s"].keys() == {"film"}
    # Each frame is what impasto render makes of its lamp; a lying board is white.
    exposure = 1.0 / np.sin(np.radians(20.0))
    alone = tmp_path / "alone.png"
    for number in (0, 5):
        words = f"render {demo} --light {30 * number},20 --exposure {exposure:.17g} --quiet"
        assert main([*words.split(), "--out", str(alone)]) == 0
        # The exposure of a white board is 1 less a rounding: a code where light is on an edge.
        difference = np.asarray(Image.open(alone)).astype(int) - pictures(out)[number]
        assert np.abs(difference).max() <= 1
    # A shorter film leaves nothing of the longer one.
    animate(demo, out, "--raking --frames 3")
    assert len(pictures(out)) == 3


def test_a_film_is_the_frames_of_the_folder(demo: Path, tmp_path: Path) -> None:
    folder, film = tmp_path / "film", tmp_path / "deep" / "film.png"
    for out in (folder, film):
        animate(demo, out, "--raking --shadows --frames 4")
    frames = pictures(folder)
    assert len({frame.tobytes() for frame in frames}) == 4
    with Image.open(film) as animated:
        assert animated.n_frames == 4  # type: ignore[attr-defined]
        for number, frame in enumerate(frames):
            animated.seek(number)
            np.testing.assert_array_equal(np.asarray(animated.convert("RGB")), frame)


def test_a_narrow_film_of_a_store_is_made_of_a_smaller_scale(tmp_path: Path) -> None:
    """Frames are what impasto render makes with the same width."""
    store = impasto.run(stack(), tmp_path / "a.zarr", tile=32, pooling="none")
    rows, columns = impasto.open_sbrdf(store).shape
    width, height = 30, round(30 / columns * rows)
    words = f"--width {width} --light 30,45 --no-level"
    animate(store, tmp_path / "turning", f"--turntable --frames 2 {words}")
    assert {one.shape for one in pictures(tmp_path / "turning")} == {(height, width, 3)}
    report = json.loads((tmp_path / "turning" / "report.json").read_text(encoding="utf-8"))
    still = tmp_path / "still.png"
    line = (
        f"render {store} --out {still} --quiet --exposure {report['results']['exposure']} {words}"
    )
    assert main(line.split()) == 0
    assert np.array_equal(np.asarray(Image.open(still)), pictures(tmp_path / "turning")[0])


def test_a_store_that_is_too_large_needs_a_width(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = impasto.run(stack(), tmp_path / "a.zarr", tile=32, pooling="none")
    monkeypatch.setattr("impasto.cli.scale.WHOLE", 1000)
    line = f"animate {store} --raking --out {tmp_path / 'film.png'} --quiet"
    assert "--width 1920" in complaint(line.split(), 1, capsys)
    assert main([*line.split(), "--width", "40", "--frames", "1"]) == 0


def test_a_turning_painting_narrows_to_both_sides(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "turn"
    animate(demo, out, "--turntable --frames 4 --angle 60 --light 90,45")
    frames = pictures(out)
    assert {frame.shape for frame in frames} == {(SIZE, SIZE, 3)}
    covered = [int(frame.any(axis=(0, 2)).sum()) for frame in frames]
    assert covered[0] == covered[2] == SIZE
    # cos 60 degrees of the width, and a pixel at each border.
    assert covered[1] == pytest.approx(SIZE / 2, abs=2)
    assert covered[3] == pytest.approx(SIZE / 2, abs=2)


def test_the_eye_adapts_frame_by_frame(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "adapting"
    animate(demo, out, "--adaptation 0..1 --frames 3")
    frames = [frame.astype(float).mean(axis=(0, 1)) for frame in pictures(out)]
    blue = [mean[2] / mean[0] for mean in frames]
    # Under illuminant A to an eye that does not, that half and that wholly adapts.
    assert blue[0] < blue[1] < blue[2]
    animate(demo, tmp_path / "back", "--adaptation 1..0 --frames 3 --illuminant A")
    for one, other in zip(pictures(out), reversed(pictures(tmp_path / "back")), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_other_formats_are_written(demo: Path, tmp_path: Path, suffix: str) -> None:
    film = tmp_path / f"film.{suffix}"
    animate(demo, film, "--raking --frames 5 --fps 10")
    reader = cv2.VideoCapture(str(film))
    count = 0
    while reader.read()[0]:
        count += 1
    reader.release()
    assert count == 5


def test_an_interrupted_film_leaves_nothing(
    demo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original, calls = impasto.render, []

    def interrupted(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return original(*arguments, **options)

    monkeypatch.setattr(impasto, "render", interrupted)
    for name in ("film", "film.png", "film.gif", "film.mp4"):
        calls.clear()
        words = f"animate {demo} --out {tmp_path / name} --raking --frames 9 --quiet"
        assert main(words.split()) == 130
        assert list(tmp_path.iterdir()) == []


ELEVATION = "--elevation: expected degrees from 0.01 to 90"
ANGLE = "--angle: expected degrees from 0.01 to 89.9"
FPS = "--fps: expected 0.01 to 500 pictures per second"
EXPOSURE = "--exposure: expected a positive factor"
MISTAKES = [
    ("--out {out}.gif", 2, "one of --raking, --turntable and --adaptation"),
    ("--out {out}.gif --raking --turntable", 2, "one of --raking"),
    ("--out {out}.gif --raking --light 1,2", 2, "--raking has its own lamp"),
    ("--out {out}.gif --raking --angle 3", 2, "--angle belongs to another kind"),
    ("--out {out}.gif --turntable --elevation 3", 2, "--elevation belongs to another kind"),
    ("--out {out}.gif --raking 15", 2, "animate: '15' belongs to no option"),
    ("--out {out}.gif --adaptation 0", 2, "two degrees such as 0..1"),
    ("--out {out}.gif --adaptation 0..2", 2, "from 0 to 1"),
    *(
        (f"--out {{out}}.png --raking --elevation={wrong}", 1, f"{ELEVATION}, found {found}")
        for wrong, found in (("0", "0"), ("1e-40", "1e-40"), ("-5", "-5"), ("nan", "nan"))
    ),
    ("--out {out}.gif --raking --elevation 91", 1, f"{ELEVATION}, found 91"),
    *(
        (f"--out {{out}}.png --turntable --angle={wrong}", 1, f"{ANGLE}, found {wrong}")
        for wrong in ("0", "1e-40", "-5", "nan", "90", "inf")
    ),
    *(
        (f"--out {{out}}.png --raking --fps={wrong}", 1, f"{FPS} in PNG, found {wrong}")
        for wrong in ("0", "nan", "1e+09", "-1")
    ),
    ("--out {out} --raking --fps 501", 1, f"{FPS}, found 501"),
    *(
        (f"--out {{out}}.png --raking --exposure={wrong}", 1, f"{EXPOSURE}, found {wrong}")
        for wrong in ("nan", "0", "-1", "inf")
    ),
    ("--out {out}.png --raking --exposure 1e40", 1, f"{EXPOSURE} from 1e-30 to 1e+30, found 1e+40"),
    ("--out {out}.gif --raking --frames 0", 1, "--frames: expected a number from 1"),
    (
        "--out {out}.gif --raking --fps 60",
        1,
        "--fps: expected 0.01 to 50 pictures per second in GIF",
    ),
    ("--out {out}.gif --turntable --angle 40 --light 0,10", 1, "not in front"),
    ("--out {out}.avi --raking", 1, ".png, .gif or .mp4"),
    ("--out {out}.mp4 --raking --display display-p3", 1, "codes of sRGB only"),
    ("--out {demo}/photographs --raking", 1, "contains files of other programs"),
]


@pytest.mark.parametrize(("words", "code", "told"), MISTAKES)
def test_a_mistake_is_one_line_with_its_name(
    demo: Path,
    tmp_path: Path,
    words: str,
    code: int,
    told: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = words.format(out=tmp_path / "film", demo=demo).split()
    assert told in complaint(["animate", str(demo), *given], code, capsys)
    assert list(tmp_path.iterdir()) == []


def test_the_least_elevation_and_one_frame_make_a_film(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"animate {demo} --raking --elevation 0.01 --frames"
    for frames, text in (("1", "film.png, 1 frame "), ("2", "film.png, 2 frames ")):
        assert main([*words.split(), frames, "--out", str(tmp_path / "film.png")]) == 0
        assert text in capsys.readouterr().err


def test_the_help_says_what_is_needed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["--help"], ["animate", "--help"]):
        assert main(words) == 0
        text = " ".join(capsys.readouterr().out.replace("│", " ").split())
        assert "One of --raking, --turntable and --adaptation is needed." in text

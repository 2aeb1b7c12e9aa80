"""Mirror balls beside the painting: they are found, and near lamps have positions."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

import impasto
from impasto.calibrate import BallCamera, lamp_positions, lights_from_balls, read_balls
from impasto.cli import main
from impasto.errors import ArgumentError, GeometryError
from impasto.io import LightFile, read_lights, write_lights
from oracles import mirror_ball

SIZE = (330, 480)
RADIUS, DIAMETER_MM = 55.0, 22.0
PITCH = DIAMETER_MM / (2 * RADIUS)
PLACES = ((-170.0, -95.0), (168.0, -100.0))
"""Middles of two balls in pixels, x right and y up from the middle of the photograph."""
LAMPS = 500.0 * np.array(
    [
        [np.cos(turn) * sine, np.sin(turn) * sine, np.sqrt(1 - sine * sine)]
        for turn, sine in ((0.2, 0.5), (1.4, 0.7), (2.5, 0.3), (3.7, 0.6), (4.9, 0.65))
    ]
)
"""mm from the middle of the photograph."""


def photographs(
    folder: Path, far: float = 1.0, places: tuple[tuple[float, float], ...] = PLACES
) -> Path:
    """Balls on a plane with patches and spots that glitter as varnish does."""
    folder.mkdir()
    rng = np.random.default_rng(2)
    patches = cv2.resize(
        rng.uniform(0.05, 0.5, (11, 16)), SIZE[::-1], interpolation=cv2.INTER_CUBIC
    )
    cv2.circle(patches, (240, 120), 40, 0.05, -1)
    for number, lamp in enumerate(far * LAMPS):
        picture = patches * lamp[2] / np.linalg.norm(lamp)
        picture[rng.integers(20, 200, 60), rng.integers(100, 380, 60)] = 0.9
        for place in places:
            ball = np.array([*place, RADIUS])
            picture = mirror_ball.photograph(
                ball, RADIUS, [lamp / PITCH], SIZE, glow=2.5, ground=picture
            )
        picture = np.clip(picture + rng.normal(0.0, 0.001, SIZE), 0.0, 1.0)
        codes = np.repeat(np.rint(65535 * picture).astype(np.uint16)[..., None], 3, axis=2)
        tifffile.imwrite(folder / f"{number:02}.tif", codes, photometric="rgb")
    return folder


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photographs(tmp_path_factory.mktemp("beside") / "near")


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def test_two_balls_are_found_among_painted_circles_and_glitter(near: Path) -> None:
    read = read_balls(near)
    assert read.frame == SIZE
    assert len(read.balls) == 2
    for ball, (x, y) in zip(read.balls, PLACES, strict=True):
        assert ball.corner is not None
        rows, columns = ball.pictures.shape[1:]
        middle = np.add(ball.corner, ((columns - 1) / 2, (rows - 1) / 2))
        truth = (SIZE[1] - 1) / 2 + x, (SIZE[0] - 1) / 2 - y
        # Of a crop that the border of the photograph cuts, the middle lies elsewhere.
        assert np.abs(middle - truth).max() < 0.3 * RADIUS


def test_a_real_ball_that_fills_the_photographs_is_found(data: Path, tmp_path: Path) -> None:
    """Each of the two published balls alone is up to 0.6 degrees off (``balls.json``)."""
    folder, out = data / "two_balls" / "LightProbe-2", tmp_path / "lamps.lp"
    assert main(["calibrate", "lights", str(folder), "--out", str(out), "--quiet"]) == 0
    published = np.loadtxt(folder / "light_directions.txt").T
    assert angles(read_lights(out).directions, published).max() < 0.8


def test_photographs_of_an_icon_show_no_ball(data: Path) -> None:
    """It is gilded, and has haloes: round things that glitter."""
    with pytest.raises(ArgumentError, match=r"no mirror ball found .*, 72 in all"):
        read_balls(data / "icon_rti")


def test_near_lamps_have_positions(near: Path, tmp_path: Path) -> None:
    """The errors are those that are predicted: of fifteen numbers none is off by five of them.

    With balls b = 340 pixels apart, r = 55 and lamps at D = 2500, an error d of a highlight turns
    its ray by 2 d / r and moves the crossing of two rays by 2 d D^2 / (r b), 134 mm for one pixel;
    5 mm of 500 are 0.04 pixels.
    """
    out = tmp_path / "lamps.dome"
    words = ["calibrate", "lights", str(near), "--diameter", str(DIAMETER_MM), "--quiet"]
    assert main([*words, "--out", str(out)]) == 0
    written = read_lights(out)
    assert written.positions is not None
    assert np.abs(written.positions - LAMPS).max() < 5.0
    stack = impasto.read_stack(near, lights=out, encoding="linear")
    assert stack.rig.pitch_mm == pytest.approx(PITCH, rel=1e-3)
    assert all(isinstance(light, impasto.PointLight) for light in stack.rig.lights)
    read = read_balls(near)
    camera = BallCamera(None, ((SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2))
    found = lights_from_balls(read.balls, camera)
    places = lamp_positions(found, DIAMETER_MM, camera)
    # Sums of the libraries beneath end in bits that change with the alignment of memory.
    np.testing.assert_allclose(places.mm, written.positions, rtol=1e-6, atol=1e-4)
    assert (np.linalg.norm(places.mm - LAMPS, axis=1) < 5.0 * places.sigma).all()


def test_directions_are_those_from_the_middle_of_the_photograph(near: Path, tmp_path: Path) -> None:
    """A tenth of a degree is a twentieth of a pixel of a highlight, 2 d / r.

    From the middle between the balls, the lamps stand up to five degrees elsewhere.
    """
    out = tmp_path / "lamps.lp"
    assert main(["calibrate", "lights", str(near), "--out", str(out), "--quiet"]) == 0
    truth = LAMPS / np.linalg.norm(LAMPS, axis=1, keepdims=True)
    found = read_lights(out)
    assert angles(found.directions, truth).max() < 0.1
    assert found.names == tuple(f"{number:02}.tif" for number in range(len(LAMPS)))
    camera = BallCamera(None, ((SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2))
    at_balls = lights_from_balls(read_balls(near).balls, camera)
    assert angles(at_balls.directions, truth).max() > 1.0
    assert (
        np.radians(angles(found.directions, truth)) < 5.0 * at_balls.from_middle(camera).sigma
    ).all()


def test_a_ball_that_is_cut_off_is_named_and_the_whole_one_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """30 pixels lie beyond the border; the search finds circles to one pixel, three are allowed.

    One ball takes a lamp D = 500 mm away for distant: it sees it from its own place, 39 mm from
    the middle of the photograph, so atan(39 / 500), 4.5 degrees, off at most; half one more for
    the highlight.
    """
    middle = (SIZE[1] / 2 - RADIUS + 30.0, -60.0)
    folder, out = photographs(tmp_path / "cut", places=(PLACES[0], middle)), tmp_path / "lamps.lp"
    assert main(["calibrate", "lights", str(folder), "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    cut = re.search(r"a ball is left out: the right border cuts (\d+) pixels off it", said)
    assert cut is not None
    assert abs(int(cut[1]) - 30) <= 3
    assert "1 ball, 5 lamps" in said
    truth = LAMPS / np.linalg.norm(LAMPS, axis=1, keepdims=True)
    assert angles(read_lights(out).directions, truth).max() < 5.0


def test_a_ball_that_is_cut_off_alone_is_refused(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "cut", places=((SIZE[1] / 2 - RADIUS + 30.0, -60.0),))
    with pytest.raises(ArgumentError, match=r"right border cuts (29|30|31) pixels off the ball"):
        lights_from_balls(read_balls(folder).balls)


def test_boxes_take_the_place_of_the_search(near: Path, tmp_path: Path) -> None:
    row, column = (SIZE[0] - 1) / 2 - PLACES[0][1], (SIZE[1] - 1) / 2 + PLACES[0][0]
    box = [str(round(row - 62)), str(round(column - 62)), "124", "124"]
    out = tmp_path / "one.lp"
    words = ["calibrate", "lights", str(near), "--ball", *box, "--out", str(out), "--quiet"]
    assert main(words) == 0
    assert len(read_lights(out)) == len(LAMPS)


@pytest.mark.parametrize(
    ("words", "code", "complaint"),
    [
        ("--out a.dome", 2, "--out: positions in a .dome need the --diameter"),
        ("--out a.csv", 1, "--out: expected a name ending in .lp or .dome"),
        ("--out a.lp --focal 50", 2, "--focal and --sensor belong together"),
        ("--out a.lp --ball 0 0 999 9", 1, "ball: expected TOP LEFT HEIGHT WIDTH within"),
        ("--out a.lp --circles x.txt", 1, "x.txt does not exist"),
        ("--out a.lp --circles x.txt --ball 0 0 9 9", 1, "--circles: they say where the balls are"),
        ("--out a.dome --diameter 0", 1, "--diameter: expected the diameter of the balls in mm"),
    ],
)
def test_mistakes(
    words: str,
    code: int,
    complaint: str,
    near: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "lights", str(near), *words.split(), "--quiet"]) == code
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_distant_lamps_have_no_position(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = photographs(tmp_path / "far", far=1e4)
    out = tmp_path / "lamps.dome"
    words = ["calibrate", "lights", str(folder), "--diameter", "22", "--quiet", "--out", str(out)]
    assert main(words) == 1
    assert "lights: positions are not known (distant: no lamp is nearer" in capsys.readouterr().err
    assert not out.exists()


def test_photographs_without_a_ball_or_of_other_sizes(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "none", places=())
    with pytest.raises(ArgumentError, match=r"no mirror ball found .*, 5 in all"):
        read_balls(folder)
    tifffile.imwrite(folder / "09.tif", np.zeros((20, 30, 3), np.uint8), photometric="rgb")
    with pytest.raises(ArgumentError, match=r"09\.tif: 30 x 20 pixels, but 00\.tif has 480 x 330"):
        read_balls(folder)


def test_a_dome_file_needs_positions_and_a_width(tmp_path: Path) -> None:
    directions = LAMPS / np.linalg.norm(LAMPS, axis=1, keepdims=True)
    lights = LightFile(tmp_path, "dome", None, directions, np.ones(5), positions=LAMPS)
    with pytest.raises(ArgumentError, match="width of the photograph"):
        write_lights(tmp_path / "a.dome", lights)
    with pytest.raises(ArgumentError, match="give a LightFile with positions"):
        write_lights(tmp_path / "a.dome", directions)


def test_one_ball_tells_no_positions(near: Path) -> None:
    camera = BallCamera(None, ((SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2))
    found = lights_from_balls(read_balls(near).balls[:1], camera)
    with pytest.raises(GeometryError, match="one ball cannot tell distances"):
        lamp_positions(found, DIAMETER_MM, camera)

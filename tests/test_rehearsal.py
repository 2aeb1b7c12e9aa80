"""Rehearsed sessions: the photographs by themselves, and all commands at a small size."""

from __future__ import annotations

import json
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

from impasto._internal.peak import peak_bytes
from impasto.cli import main
from impasto.cli.photographs import write_photographs
from impasto.cli.rehearse import _listed
from impasto.errors import ArgumentError
from impasto.io import read_session, write_session
from impasto.rehearsal.course import Step, carried_out, moving_steps, steps
from impasto.rehearsal.moving_views import CARD_AT, CARD_SIDES, FLATTEST, steep_pairs
from impasto.rehearsal.moving_views import LATTICE as LENS_LATTICE
from impasto.rehearsal.moving_views import MARKER as LARGE
from impasto.rehearsal.photographs import BALL, LATTICE, MARKER, Session
from impasto.rehearsal.relief import Relief
from impasto.rehearsal.studio import Lamp, MirrorBall, Studio, StudioCamera
from impasto.rehearsal.things import picture, uniform
from impasto.simulate import default_capture, rig
from oracles import flat_scene, mirror_ball, relief_scene

DOCS = Path(__file__).parents[1] / "docs"
SIZE, FOCAL, FAR = (60, 80), 300.0, 600.0
DISTORTION = (-0.2, 0.05, 0.001, -0.002)


def camera(**pose: float) -> StudioCamera:
    return StudioCamera(SIZE, FOCAL, FAR, distortion=DISTORTION, **pose)


def test_points_are_seen_where_the_oracle_sees_them() -> None:
    """A lens, a tilt and a roll: a dot on the plane against Newton's method in numpy."""
    pose = {"tilt": 0.6, "azimuth": 1.1, "roll": 0.3}
    other = flat_scene.Camera(
        SIZE[::-1], FOCAL, (*DISTORTION, 0.0), distance=FAR,
        **{name: np.degrees(value) for name, value in pose.items()},
    )  # fmt: skip
    dot = np.array([[21.0, -13.0]])

    def shine(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.exp(-((x - dot[0, 0]) ** 2 + (y - dot[0, 1]) ** 2) / (2.0 * 4.0**2))[None]

    seen = Studio(camera(**pose)).light(Lamp(np.array([0.0, 0.0, 1e6]), 1.0), shine)[0]
    rows, columns = np.indices(SIZE)
    middle = np.array([(seen * columns).sum(), (seen * rows).sum()]) / seen.sum()
    # Perspective and dimming shift the centroid of a dot 2 pixels wide by its width squared over
    # the focal length times their slopes, below 0.02 pixels.
    assert np.abs(middle - other.pixel(dot)[0]).max() < 0.03


def test_a_ball_shows_the_lamp_where_the_shortest_path_touches_it() -> None:
    """Fermat's principle, without the law of reflection (``tests/oracles/mirror_ball.py``)."""
    far, focal, ball = 500.0, 6000.0, MirrorBall(8.0, -5.0, 9.0)
    eye = StudioCamera((480, 640), focal, far)
    lamp = np.array([150.0, 80.0, 300.0])
    dark = uniform(0.0, 1)
    seen = Studio(eye).light(Lamp(lamp, 1.0), dark, balls=(ball,))[0]
    rows, columns = np.indices(seen.shape)
    weight = np.where(seen > 0.1 * seen.max(), seen, 0.0)
    found = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    towards = np.array([0.0, 0.0, far])
    expected = mirror_ball.highlight(
        np.array([ball.x, ball.y, ball.radius]) - towards, ball.radius, lamp - towards, focal
    ) + np.array([319.5, 239.5])
    # The mirrored lamp is 2 pixels wide; what it covers is not quite symmetric about its middle.
    assert np.abs(found - expected).max() < 0.15


def test_light_falls_off_with_the_inverse_square_and_the_cosine() -> None:
    lamp = Lamp(np.array([100.0, 0.0, 200.0]), 2.0)
    middle, below = (lamp.irradiance(np.array(x), np.array(0.0)) for x in (0.0, 100.0))
    assert middle == pytest.approx(2.0 * 200.0 / np.hypot(100.0, 200.0))
    assert below == pytest.approx(2.0 * (100.0**2 + 200.0**2) / 200.0**2)


def test_a_picture_lies_about_the_middle() -> None:
    planes = np.arange(12.0).reshape(1, 3, 4)
    seen = picture(planes, 0.5)
    x, y = np.meshgrid((np.arange(4) - 1.5) * 0.5, (1.0 - np.arange(3)) * 0.5)
    # Coordinates of remap are fractions of 1/32 pixel; these are whole.
    assert (seen(x, y) == planes).all()
    assert np.isnan(seen(np.array([[1.01]]), np.array([[0.0]]))).all()


def run_page(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every Python block of a page, in a folder."""
    monkeypatch.chdir(folder)
    for example in Sybil(parsers=[PythonCodeBlockParser()]).parse(DOCS / name).examples():
        example.evaluate()


def pictures_of(name: str) -> list[str]:
    """The figures in the folder of a tutorial, and its page says nothing of others."""
    page = (DOCS / name).read_text(encoding="utf-8")
    written = sorted(path.name for path in Path().glob("figure-*.png"))
    assert set(re.findall(r"`(figure-[\w-]+\.png)`", page)) <= set(written)
    return written


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smallest session of a camera that stands."""
    out = tmp_path_factory.mktemp("standing") / "rehearsal"
    assert main(["rehearse", "--out", str(out), "--size", "96", "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smallest session of a moving camera that works: 16 pairs, a painting of 96 pixels."""
    out = tmp_path_factory.mktemp("moving") / "rehearsal-snel"
    words = ["rehearse", "snel-lafortune", "--out", str(out), "--size", "96", "--views", "16"]
    assert main([*words, "--quiet"]) == 0
    return out


def test_printed_commands_begin_with_the_folder_in_which_they_run(
    capsys: pytest.CaptureFixture[str],
) -> None:
    _listed(Path("of Mary's altar"), [Step(("session", "init", "painting"), "one file for all")])
    first, second = capsys.readouterr().out.splitlines()
    assert shlex.split(first) == ["cd", "of Mary's altar"]
    assert second == "impasto session init painting"


@pytest.mark.slow
def test_a_session_is_rehearsed_from_raw_photographs_to_the_picture(standing: Path) -> None:
    """Its markers are 26 pixels wide and its balls 45, the errors as much larger."""
    out = standing
    found = json.loads((out / "rehearsal.json").read_text())
    errors = found["errors"]
    # Balls of 23 pixels' radius: half a pixel of a highlight is 2 / 23 radians times a half.
    assert errors["lamps_worst_degrees"] < 3.0
    assert errors["normal_mean_degrees"] < errors["lamps_worst_degrees"] + 2.0
    assert errors["relit_delta_e_mean"] < 5.0
    assert len(found["commands"]) == 8
    assert all(one["peak_mib"] > 20.0 for one in found["commands"])
    assert cv2.imread(str(out / "rehearsal.png")).std() > 20.0
    assert cv2.imread(str(out / "relit.png")).shape == (96, 96, 3)


@pytest.mark.slow
def test_the_tutorial_of_the_rgb_camera_runs(
    standing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_page("tutorial-rgb.md", standing.parent, monkeypatch)
    assert pictures_of("tutorial-rgb.md") == [f"figure-{n}.png" for n in (10, 11, 12, 13, 8, 9)]
    found, true = (cv2.imread(f"figure-{n}.png").astype(float) for n in (12, 13))
    # The session above is allowed 5 CIEDE2000 in a light that the paper does not choose; its
    # procedure has half as much again (docs/systems.md). Of 100 in lightness these are 8 %.
    assert np.abs(found - true)[4:-4, 4:-4].mean() < 0.08 * 255.0


def test_rays_meet_the_relief_where_newtons_method_does() -> None:
    """A lens, 60 degrees of tilt and a relief of 5 mm (``tests/oracles/relief_scene.py``)."""
    pose = {"tilt": np.radians(60.0), "azimuth": 0.7, "roll": 0.3}
    other = flat_scene.Camera(
        SIZE[::-1], FOCAL, (*DISTORTION, 0.0), distance=FAR,
        **{name: np.degrees(value) for name, value in pose.items()},
    )  # fmt: skip
    side, pitch, count = 80.0, 0.25, 320
    truth = relief_scene.bumps(side, side, -2.0, 3.0, 30.0, 10.0)
    x, y = np.meshgrid(*2 * [(np.arange(count) - (count - 1) / 2) * pitch])
    relief = Relief(truth(x, -y)[0].astype(np.float32), pitch)
    eye = camera(**pose)
    worst, moved = 0.0, 0.0
    points = relief_scene.surface_points(other, truth, 2)
    for rays, (right, up, *_) in zip(eye.rays(), points, strict=True):
        found = relief.met(eye.place, rays)
        own = np.hypot(right - found[0], up - found[1])
        flat = eye.place[:2, None, None] - eye.place[2] * rays[:2] / rays[2]
        worst = max(worst, own.max())
        moved = max(moved, np.hypot(right - flat[0], up - flat[1]).max())
    # Remap rounds places to 1/32 pixel: 0.004 mm times slopes below 0.5; bilinear heights are off
    # by the curvature times the pitch squared over 8: 0.2 / mm * 0.06 mm^2 / 8. Bisection of a step
    # of at most a pixel ends within 0.001 mm. Slanted by 60 degrees, 1.7 to 3 times that where
    # rays graze the surface.
    assert worst < 0.02
    assert moved > 3.0


def test_the_upper_part_of_a_relief_hides_what_is_behind() -> None:
    """A wall 2 mm high from x = 2 mm to 4 mm, seen from the right at 45 degrees."""
    height = np.zeros((41, 201), np.float32)
    height[:, 120:141] = 2.0
    relief = Relief(height, 0.1)
    place = np.array([100.0, 0.0, 100.0])
    seen = np.array([[1.0, -1.0, 2.9, 3.5, 7.0]])
    rays = np.stack([seen - place[0], np.zeros_like(seen), np.full_like(seen, -place[2])])
    x, y = relief.met(place, rays)
    # On the ray to x on the plane, height z is at x + (100 - x) z / 100. Those to -1 and 7 miss the
    # wall, that to 1 meets its top, and those to 2.9 and 3.5 the side at 4, within a pixel.
    assert x[0, 1] == pytest.approx(-1.0, abs=1e-2)
    assert x[0, 0] == pytest.approx(1.0 + 0.99 * 2.0, abs=0.01)
    assert x[0, 2:4] == pytest.approx([4.0, 4.0], abs=0.11)
    assert x[0, 4] == pytest.approx(7.0, abs=1e-2)
    assert np.abs(y).max() == 0.0


def test_pairs_that_are_too_flat_are_left_out() -> None:
    """Angles by the arc cosine; a subset is a part of the whole, with both ends."""
    every, flat = steep_pairs(None)
    angles = np.degrees(np.arccos(rig("snel-lafortune").views[:, 2]))
    assert flat == (angles > FLATTEST + 1e-6).sum()
    assert len(every) + flat == 770
    some, same = steep_pairs(40)
    assert (len(set(some.tolist())), same) == (40, flat)
    assert set(some.tolist()) <= set(every.tolist())
    assert (some[0], some[-1]) == (every[0], every[-1])


@pytest.mark.slow
def test_a_session_with_moving_views_is_rehearsed(moving: Path) -> None:
    out = moving
    found = json.loads((out / "rehearsal.json").read_text())
    errors = found["errors"]
    assert (found["views"], found["left_out"], len(found["commands"])) == (16, 154, 6)
    # The paper asks for half a pixel. The mesh must take out half of the parallax at least; that of
    # strokes remains, 0.04 mm rms or 0.2 pixels times the tangent of the view.
    assert errors["aligned_rms_px"] < 0.5 * errors["flat_rms_px"] < 0.5
    # What the mesh cannot follow: strokes of 0.04 mm rms, and as much for its own errors.
    assert errors["depth_rms_mm"] < 0.08
    # Shifts of 0.2 pixels of 0.2 mm on slopes that change by 10 degrees in a stroke of 1 mm turn a
    # normal by half a degree; 16 lights in noise add a few times that.
    assert errors["normal_mean_degrees"] < 4.0
    assert errors["other_delta_e_mean"] < 6.0
    assert errors["lobes_gloss"] > errors["lobes_matte"]
    assert cv2.imread(str(out / "rehearsal.png")).std() > 20.0


@pytest.mark.slow
def test_the_tutorial_of_lobes_runs(moving: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_page("tutorial-lafortune.md", moving.parent, monkeypatch)
    rooms = ("church", "kitchen", "outside")
    assert pictures_of("tutorial-lafortune.md") == [f"figure-20-{room}.png" for room in rooms]
    church, kitchen, outside = (cv2.imread(f"figure-20-{room}.png").astype(float) for room in rooms)
    assert church.shape == kitchen.shape == outside.shape == (96, 96, 3)
    # Blue light of the sky against the lamp of a kitchen.
    assert outside[..., 0].mean() / outside[..., 2].mean() > (
        1.2 * kitchen[..., 0].mean() / kitchen[..., 2].mean()
    )


@pytest.mark.slow
def test_the_tutorial_of_six_bands_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On photographs that need no alignment: a third rehearsal would take half a minute."""
    painting = tmp_path / "rehearsal-six" / "painting"
    painting.parent.mkdir()
    capture = default_capture("tominaga-six-band-adaptation", size=(48, 48))
    write_photographs(painting, capture)
    (painting / "camera.csv").rename(painting.parent / "camera.csv")
    assert main(["session", "init", str(painting)]) == 0
    session = replace(read_session(painting / "session.toml"), dark=1024.0, saturation=65520.0)
    (painting / "session.toml").unlink()
    write_session(painting / "session.toml", session)
    run_page("tutorial-six-band.md", tmp_path, monkeypatch)
    figures = pictures_of("tutorial-six-band.md")
    assert {f"figure-{n}-{view}.png" for n in (8, 9) for view in ("front", "slanted")} <= {*figures}


def test_every_tutorial_is_run_here() -> None:
    """tests/test_docs.py leaves them to this file."""
    own = Path(__file__).read_text(encoding="utf-8")
    pages = sorted(page.name for page in DOCS.glob("tutorial-*.md"))
    assert len(pages) == 3
    assert [page for page in pages if f'run_page("{page}"' not in own] == []


def test_the_page_has_the_commands_of_moving_views() -> None:
    """Those of a painting of 128 pixels of 0.2 mm, with a frame of 6 pixels."""
    page = (Path(__file__).parents[1] / "docs" / "rehearsal.md").read_text()
    section = page.split("In the folder `rehearsal-snel`:")[1].split("```")[1]
    session = SimpleNamespace(
        size_mm=(28.0, 28.0), painting=SimpleNamespace(size=(128, 128)), rim=6,
        marker_mm=LARGE * 25.6, lattice_mm=LENS_LATTICE * 25.6,
        card_mm=tuple(25.6 * share for share in (*CARD_AT, *CARD_SIDES)),
    )  # fmt: skip
    assert re.findall(r"^\$ (.*)$", section, re.M) == [
        str(one) for one in moving_steps(session, 0.2)
    ]


def test_the_page_has_the_commands_that_are_run() -> None:
    """Those of a painting of 256 pixels of 0.2 mm."""
    width = 256 * 0.2
    session = Session(Path(), None, (width, width), 2 * BALL * width, MARKER * width,
                      LATTICE * width, ())  # fmt: skip
    page = (Path(__file__).parents[1] / "docs" / "rehearsal.md").read_text()
    section = page.split("In the folder `rehearsal`:")[1].split("```")[1]
    assert re.findall(r"^\$ (.*)$", section, re.M) == [
        str(one) for one in steps(session, 3000, 0.2)
    ]


def test_a_command_that_fails_is_told_to_its_last_line(tmp_path: Path) -> None:
    """Nothing of what it printed is lost, and what runs after it does not run."""
    step = Step(("session", "check", "nowhere"), "is all there?")
    with pytest.raises(ArgumentError) as caught:
        list(carried_out(tmp_path, [step, step]))
    said = str(caught.value)
    head = "impasto session check nowhere ended with exit code 1: impasto: nowhere: cannot be read"
    assert said.startswith(head)
    assert said.count("impasto session check") == 1


def test_memory_is_that_of_the_system_or_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """The maximum of a process never falls; a system without ``/proc`` is asked another way.

    ``getrusage`` counts in pages of 4 KiB and is brought up to date later than ``/proc``: both
    agree here within 64 MiB, or it counts the larger parent, which is more.
    """
    whole = np.ones(1 << 24)
    found = peak_bytes()
    assert found is not None
    assert found > whole.nbytes
    monkeypatch.setattr(Path, "read_text", missing)
    other = peak_bytes()
    assert other is not None
    assert other > found - (1 << 26)
    monkeypatch.setitem(sys.modules, "resource", None)
    assert peak_bytes() is None


def missing(*_: object, **__: object) -> str:
    raise FileNotFoundError


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--size", "40"], "--size: expected at least 96"),
        (["--out", "."], "already exists"),
        (["--views", "20"], "--views: is for snel-lafortune"),
        (["snel-lafortune", "--views", "5"], "--views: expected 12 to 616"),
    ],
)
def test_mistakes_are_named(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["rehearse", *words]) == 1
    assert said in capsys.readouterr().err

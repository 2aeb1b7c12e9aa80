"""Lamps from mirror balls: published data, simulated balls, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

import impasto
from impasto._internal.student import upper_tail
from impasto.calibrate import (
    BallCamera,
    BallPhotographs,
    adjust,
    given_outline,
    lights_from_balls,
    read_balls,
)
from impasto.cli import main
from impasto.errors import ArgumentError
from impasto.io import read_lights
from oracles import mirror_ball

SIZE = (260, 280)
BALL, RADIUS = np.array([6.3, -4.6, 0.0]), 100.0
FAR = 1e7
LAMPS = [
    FAR * np.array([np.cos(a) * s, np.sin(a) * s, np.sqrt(1 - s * s)])
    for a, s in ((0.3, 0.5), (1.8, 0.7), (3.1, 0.3), (4.4, 0.6), (5.5, 0.75))
]


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(axis=-1)))


def simulated(**changes: object) -> BallPhotographs:
    noise = np.random.default_rng(5)
    pictures = [mirror_ball.photograph(BALL, RADIUS, [lamp], SIZE, glow=4.0) for lamp in LAMPS]
    pictures = np.clip(np.array(pictures) + noise.normal(0, 0.001, (5, *SIZE)), 0, 1)
    return replace(BallPhotographs(pictures, "ball", full=1.0), **changes)


def refused(*balls: BallPhotographs) -> str:
    with pytest.raises(ArgumentError) as caught:
        lights_from_balls(balls)
    return str(caught.value)


# --- the published data


def test_the_published_rule_gives_the_published_directions(data: Path) -> None:
    """16 digits are printed; single precision would do for 0.01 degrees."""
    read = read_balls(data / "two_balls", circles="circle_data.txt")
    found = lights_from_balls(read.balls, rule="median")
    for number in (1, 2):
        path = data / "two_balls" / f"LightProbe-{number}" / "light_directions.txt"
        assert degrees(found.single[number - 1], np.loadtxt(path).T).max() < 0.01


def test_the_command_finds_the_lights_of_a_folder_by_itself(data: Path, tmp_path: Path) -> None:
    """Half a degree is what the data's own two balls differ from their mean."""
    out = tmp_path / "lights.lp"
    words = ["calibrate", "lights", str(data / "two_balls"), "--out", str(out), "--quiet"]
    assert main(words) == 0
    lights = read_lights(out)
    published = np.loadtxt(data / "two_balls" / "light_directions.txt").T
    assert degrees(lights.directions, published).max() < 0.5
    assert lights.names is not None
    assert lights.names[0] == "Image_01.png"
    assert out.with_suffix(".png").is_file()
    assert main(words) == 1  # nothing is overwritten


def test_photographs_of_the_object_become_normals_from_the_folder_alone(
    data: Path, tmp_path: Path
) -> None:
    """Against those under the published lights, which differ by up to half a degree.

    If all lamps turned by as much in one way, the normals would; the medians cannot differ by more.
    """
    out, folder = tmp_path / "lights.lp", data / "two_balls"
    assert main(["calibrate", "lights", str(folder), "--out", str(out), "--quiet"]) == 0
    own, published = (
        impasto.fit_normals(
            impasto.read_stack(folder / "Objects", lights=lights, encoding="linear"),
            method="least-squares",
        ).normal
        for lights in (out, folder / "light_directions.txt")
    )
    known = np.isfinite(own).all(axis=0) & np.isfinite(published).all(axis=0)
    assert known.mean() > 0.9
    assert np.median(degrees(own[:, known].T, published[:, known].T)) < 0.5


def test_two_balls_that_cannot_tell_say_distant(data: Path) -> None:
    read = read_balls(data / "two_balls", circles="circle_data.txt")
    found = lights_from_balls(read.balls)
    assert found.near_fit is not None
    assert not found.near.any()
    assert found.verdict.startswith("distant")


# --- simulated balls


def test_directions_of_a_simulated_ball() -> None:
    """0.05 degrees are 0.04 pixels at this radius: 2 delta / (r cos theta)."""
    found = lights_from_balls([simulated()])
    truth = np.array(LAMPS) / FAR
    assert degrees(found.directions, truth).max() < 0.05
    assert found.verdict == "distant: one ball cannot tell distances"


FOCAL = 4000.0
TWO = [np.array([-120.0, 10.0, -1000.0]), np.array([130.0, -20.0, -1010.0])]
UNIT = 25.0


def measured(lamps: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    outlines = np.array([mirror_ball.outline(ball, UNIT, FOCAL) for ball in TWO])
    pixels = [[mirror_ball.highlight(ball, UNIT, lamp, FOCAL) for lamp in lamps] for ball in TWO]
    return outlines, np.array(pixels)


NEAR = [np.array([300.0, 400.0, -400.0]), np.array([-350.0, 100.0, -350.0]),
        np.array([50.0, -450.0, -500.0])]  # fmt: skip


def test_positions_reach_the_cramer_rao_bound() -> None:
    """The root mean square of 60 trials lies within a tenth of its value; twice the bound is asked.

    The bound is that of Fermat's path in ``oracles/mirror_ball.py``, by difference quotients.
    """
    sigma, outline_sigma = 0.05, 0.05
    outlines, pixels = measured(NEAR)
    noise = np.random.default_rng(3)
    covariance = np.broadcast_to(outline_sigma**2 * np.eye(3), (2, 3, 3))
    errors = []
    for _ in range(60):
        found = adjust(
            BallCamera(FOCAL),
            outlines + noise.normal(0, outline_sigma, outlines.shape),
            covariance,
            pixels + noise.normal(0, sigma, pixels.shape),
            np.full(pixels.shape[:2], sigma),
            distant=False,
        )
        assert found.near.all()
        place = found.origin + found.direction / found.inverse_distance[:, None]
        errors.append(UNIT * place - np.array(NEAR))
    mean_square = np.square(errors).sum(axis=2).mean(axis=0)
    for lamp, own in zip(NEAR, mean_square, strict=True):
        bound = mirror_ball.position_bound(TWO, UNIT, lamp, FOCAL, sigma, outline_sigma)
        assert own < 4.0 * np.trace(bound)


def test_exact_highlights_give_exact_positions_and_far_lamps_are_distant() -> None:
    outlines, pixels = measured(NEAR)
    covariance = np.broadcast_to(1e-4 * np.eye(3), (2, 3, 3))
    table = (BallCamera(FOCAL), outlines, covariance)
    found = adjust(*table, pixels, np.full((2, 3), 0.01), distant=False)
    place = UNIT * (found.origin + found.direction / found.inverse_distance[:, None])
    # The oracle's Newton steps end at 1e-13 radians; parallax is 0.3: 1e-6 is generous.
    assert np.abs(place - np.array(NEAR)).max() < 1e-6 * 1000.0
    far = [lamp * 1e5 + np.array([0.0, 0.0, 1e8]) for lamp in NEAR]
    _, pixels = measured(far)
    noise = np.random.default_rng(1).normal(0, 0.2, pixels.shape)
    found = adjust(*table, pixels + noise, np.full((2, 3), 0.2), distant=False)
    assert not found.near.any()


# --- what is refused


def test_no_ball() -> None:
    grey = np.random.default_rng(0).uniform(0.4, 0.6, (5, *SIZE))
    assert "ball: no ball found" in refused(BallPhotographs(grey, "ball"))


def test_a_ball_that_a_border_cuts_off() -> None:
    ball = simulated()
    cut = replace(ball, pictures=ball.pictures[:, :, 70:])
    assert "left border cuts" in refused(cut)


def test_no_highlight() -> None:
    ball = simulated()
    pictures = ball.pictures.copy()
    pictures[2] = mirror_ball.photograph(BALL, RADIUS, [], SIZE)
    assert "ball/photograph 3: no highlight" in refused(replace(ball, pictures=pictures))


def test_two_highlights() -> None:
    ball = simulated()
    pictures = ball.pictures.copy()
    pictures[1] = np.clip(mirror_ball.photograph(BALL, RADIUS, LAMPS[:2], SIZE, glow=4.0), 0, 1)
    assert "ball/photograph 2: two highlights" in refused(replace(ball, pictures=pictures))


def test_an_overexposed_ball() -> None:
    """8-bit codes that are clipped almost everywhere have no highlight of a lamp."""
    ball = simulated()
    pictures = np.rint(255 * ball.pictures)
    x, y = np.indices(SIZE)[::-1]
    pictures[0, np.hypot(x - 150, y - 130) < 40] = 255
    assert "overexposed" in refused(replace(ball, pictures=pictures, full=255.0))


def test_nan() -> None:
    ball = simulated()
    ball.pictures[3, 100, 100] = np.nan
    assert "ball/photograph 4: 1 pixels are NaN" in refused(ball)


def test_another_number_of_photographs() -> None:
    ball = simulated()
    other = replace(ball, pictures=ball.pictures[:4], name="other")
    assert "'ball': 5, 'other': 4" in refused(ball, other)


def test_a_reverse_order_and_mirrored_photographs() -> None:
    ball = simulated(outline=given_outline(139.5 + 6.3, 129.5 + 4.6, 100.0, 0.1))
    other = replace(ball, pictures=ball.pictures[::-1], name="other")
    assert "other: its photographs seem to be in the reverse order" in refused(ball, other)
    flipped = given_outline(139.5 - 6.3, 129.5 + 4.6, 100.0, 0.1)
    other = replace(ball, pictures=ball.pictures[:, :, ::-1], name="other", outline=flipped)
    assert "mirrored left to right" in refused(ball, other)


def test_folders_without_a_ball_or_with_another_number(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="has no folder of a ball"):
        read_balls(tmp_path)


def test_the_tail_of_students_t_is_that_of_scipy() -> None:
    """17 terms below 1 are off by 2e-15 in all; 1e-14 leaves SciPy as much and more."""
    for freedom in (1, 2, 3, 4, 7, 12, 33):
        for t in (-3.0, 0.0, 0.7, 3.0, 9.0):
            expected = scipy.stats.t.sf(t, freedom)
            assert abs(upper_tail(t, freedom) - expected) < 1e-14, (t, freedom)

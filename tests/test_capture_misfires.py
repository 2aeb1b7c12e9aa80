"""Thresholds of single photographs, on pictures made with numpy and OpenCV."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from impasto.capture import Pose
from impasto.capture.misfires import (
    blurred,
    clipped,
    clock_jump,
    drifted,
    duplicate_frame,
    light_in_the_dark,
    moved,
    no_light,
    sharpness,
    surely_still,
    warmed_up,
    wrong_exposure,
    wrong_pose,
)


@pytest.fixture(scope="module")
def paint() -> np.ndarray:
    """Strokes of several widths, 240 pixels, linear light."""
    noise = np.random.default_rng(8).standard_normal((3, 240, 240)).astype(np.float32)
    fields = [cv2.GaussianBlur(n, (0, 0), s) for n, s in zip(noise, (1.0, 2.0, 6.0), strict=True)]
    log = sum(field / field.std() for field in fields)
    return np.asarray(0.15 * np.exp(0.3 * log), np.float32)


def shifted(picture: np.ndarray, x: float, y: float) -> np.ndarray:
    """By Fourier's theorem of shifts, exact for pictures that repeat."""
    rows, columns = picture.shape
    wave = np.exp(-2j * np.pi * (np.fft.fftfreq(columns) * x + np.fft.fftfreq(rows)[:, None] * y))
    return np.asarray(np.fft.ifft2(np.fft.fft2(picture) * wave).real, np.float32)


def noisy(picture: np.ndarray, seed: int) -> np.ndarray:
    """Shot noise of 30 000 electrons at full scale."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.poisson(np.maximum(picture, 0.0) * 30000.0) / 30000.0, np.float32)


@pytest.mark.parametrize(
    ("x", "y"), [(1.0, 0.0), (0.0, -1.0), (0.5, 0.5), (-3.0, 2.0), (20.0, 0.0)]
)
def test_a_shift_is_found_and_named(paint: np.ndarray, x: float, y: float) -> None:
    misfire = moved(noisy(paint, 1), noisy(shifted(paint, x, y), 2))
    assert misfire is not None
    words = [f"{abs(x):.1f} px to the {'right' if x > 0 else 'left'}"] if x else []
    words += [f"{abs(y):.1f} px {'down' if y > 0 else 'up'}"] if y else []
    assert " and ".join(words) in misfire.why


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.3, 0.0), (0.0, -0.3)])
def test_less_than_half_a_pixel_is_no_shift(paint: np.ndarray, x: float, y: float) -> None:
    assert moved(noisy(paint, 1), noisy(shifted(paint, x, y), 2)) is None


def test_pictures_that_are_surely_still_are_not_searched(paint: np.ndarray) -> None:
    """Noise alone, and a lamp that is 5 % stronger; half a pixel in any direction is too much."""
    first = noisy(paint, 1)
    assert surely_still(first, noisy(paint, 2))
    assert surely_still(first, noisy(1.05 * paint, 2))
    for angle in np.radians(np.arange(0.0, 180.0, 30.0)):
        moved_by_half = shifted(paint, 0.5 * np.cos(angle), 0.5 * np.sin(angle))
        assert not surely_still(first, noisy(moved_by_half, 2))


def test_small_pictures_and_noise_alone_are_not_judged(paint: np.ndarray) -> None:
    small = paint[:70, :70]
    assert moved(small, np.roll(small, 2, 1)) is None
    level = np.full((240, 240), 0.2, np.float32)
    assert moved(noisy(level, 1), noisy(level, 2)) is None


def test_a_blur_of_one_pixel_is_found_and_noise_is_none(paint: np.ndarray) -> None:
    """A Gaussian of one pixel leaves exp(-w^2) of the power at w: most of it lies above w = 1."""
    sharp = sharpness(noisy(paint, 1))
    soft = sharpness(noisy(np.asarray(cv2.GaussianBlur(paint, (0, 0), 1.0)), 2))
    misfire = blurred(soft, sharp)
    assert misfire is not None
    assert misfire.code == "blurred"
    assert blurred(sharpness(noisy(paint, 3)), sharp) is None
    # Half of the light has twice the relative noise, and the same edges.
    assert blurred(sharpness(noisy(0.5 * paint, 4)), sharp) is None


def test_light_is_compared_with_a_flat_painting() -> None:
    """Reference 0.3, dark 0.02: a lamp with a third of the cosine gives 0.0933 above the dark."""
    third = 1.0 / 3.0
    assert no_light(0.02 + 0.5 * 0.28 * third, 0.02, 0.3, third) is None
    misfire = no_light(0.02 + 0.05 * 0.28 * third, 0.02, 0.3, third)
    assert misfire is not None
    assert misfire.why == "no light: 5 % of what this lamp should give"
    assert no_light(0.02, 0.02, 0.3, third) is not None


def test_dark_frames_are_dark() -> None:
    assert light_in_the_dark(0.0156, []) is None  # 1024 of 65535, a black level
    assert light_in_the_dark(0.1, []) is not None
    assert light_in_the_dark(0.035, [0.02, 0.02]) is None
    assert light_in_the_dark(0.05, [0.02, 0.02]) is not None


def test_exposures_and_clipped_pixels() -> None:
    assert clipped(0.45) is None
    assert clipped(0.6) is not None
    assert wrong_exposure(1 / 125, 1 / 127) is None
    assert wrong_exposure(0.01, None) is None
    misfire = wrong_exposure(0.01, 0.0125)
    assert misfire is not None
    assert misfire.why == "the camera says 12.5 ms, the plan 10 ms"


def test_a_stage_that_stops_short_is_named() -> None:
    """0.05 degrees are nothing; a joint that is not read back is not where it should be."""
    ordered = Pose((0.6, 0.0, 0.8), None, {"tilt": 0.5, "turn": 1.0})
    near = replace(ordered, angles={"tilt": 0.5 + np.radians(0.05), "turn": 1.0})
    assert wrong_pose(ordered, near) is None
    short = wrong_pose(ordered, replace(ordered, angles={"tilt": 0.5, "turn": 0.9}))
    assert short is not None
    assert short.why == "the stage is off by 5.7 degrees (joint turn)"
    silent = wrong_pose(ordered, replace(ordered, angles={"tilt": 0.5}))
    assert silent is not None
    assert silent.why == "the stage does not say where its joint turn is"
    assert wrong_pose(ordered, replace(ordered, view=(0.0, 0.0, 1.0))) is not None


def test_an_old_file_names_its_shot() -> None:
    assert duplicate_frame("ab", {"cd": "shot_1"}) is None
    misfire = duplicate_frame("cd", {"cd": "shot_1"})
    assert misfire is not None
    assert "the same file as that of shot_1" in misfire.why


def test_drift_and_warm_up() -> None:
    assert drifted(1.014, 1.0) is None
    misfire = drifted(0.95, 1.0)
    assert misfire is not None
    assert misfire.why == "the reference lamp is 5.0 % darker than at the beginning"
    assert not warmed_up([1.0, 1.0])
    assert warmed_up([0.9, 0.999, 1.0, 1.001])
    assert not warmed_up([0.999, 1.0, 1.004])


def test_the_clock_may_be_wrong_but_not_jump() -> None:
    assert clock_jump(-7200.0, -7201.5) is None  # two hours slow, whole seconds
    words = clock_jump(0.0, -3600.0)
    assert words is not None
    assert "has jumped 3600 s back" in words

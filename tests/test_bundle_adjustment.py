"""Bundle adjustment of a rig, against dense least squares and against rigs that were put in."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import _core
from impasto._internal.border import RigArguments
from impasto.fit.bundle_adjustment import BundleAdjustment, RigNumbers
from impasto.fit.held_out import Comparison, HeldOut
from impasto.fit.lobe_profile import LobeProfile
from impasto.surface import Lobe
from oracles import forward
from test_rig_refinement import error, photographs

PITCH, SHAPE, BANDS, LIGHTS = 4.0, (3, 4), 2, 11
SHARED, OWN = 3, 3
EACH = SHARED + BANDS * OWN
"""Unknowns of a pixel: tilts and log gamma; diffuse, ambient and specular strength of each band."""
RIDGE = 1e-4
"""Of the equations of a pixel, relative to their diagonal."""
STEP = 0.01
"""By which the inverse distances of two rigs differ."""
NUMBERS = 2 + LIGHTS


def rig_of(numbers: np.ndarray) -> impasto.Rig:
    """Inverse distances of camera and lamps, in 1 / 40 mm, and logarithms of strengths."""
    angle = 2.4 * np.arange(LIGHTS)
    sine = np.linspace(0.2, 0.8, LIGHTS)
    towards = np.stack([sine * np.cos(angle), sine * np.sin(angle), np.sqrt(1.0 - sine**2)], axis=1)
    camera, lamps, *log = numbers.tolist()
    lights = [
        impasto.PointLight((*(40.0 / lamps * one).tolist(),), math.exp(strength))
        for one, strength in zip(towards, log, strict=True)
    ]
    return impasto.Rig(lights, views=impasto.PointView((3.0, -2.0, 40.0 / camera)), pitch_mm=PITCH)


class Scene:
    """Surfaces of some pixels whose samples a plain model predicts."""

    def __init__(self, coated: bool, profile: LobeProfile | None) -> None:
        rng = np.random.default_rng(2)
        pixels = SHAPE[0] * SHAPE[1]
        normal = np.stack([*rng.normal(0.0, 0.2, (2, pixels)), np.ones(pixels)])
        normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
        # Single precision, as surfaces have it.
        unknowns = rng.uniform(0.2, 0.8, (pixels, EACH)).astype(np.float32)
        unknowns[:, :2] = 0.0
        unknowns[:, 2] = np.log(rng.uniform(0.2, 0.4, pixels).astype(np.float32))
        unknowns[:, SHARED + 2 :: OWN] *= 10.0
        unknowns[3, SHARED + 1] = 0.0  # at its bound
        unknowns[5, SHARED + 2 :: OWN] = 0.0
        self.normal, self.unknowns = normal.astype(np.float64), unknowns.astype(np.float64)
        self.coated, self.profile = coated, profile
        # What turning z to the normal makes of x and y: a ridge depends on the choice of tangents.
        x, y, z = self.normal
        self.tangents = (
            np.stack([1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), -x]),
            np.stack([-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), -y]),
        )
        self.numbers = np.r_[0.4, 0.5, rng.normal(0.0, 0.3, LIGHTS)]

    def shown(self, unknowns: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """``(n, band, obs)`` in double precision, by the formulas of the papers."""
        across, along = self.tangents
        normal = self.normal + across * unknowns[:, 0] + along * unknowns[:, 1]
        normal = (normal / np.linalg.norm(normal, axis=0)).reshape(3, *SHAPE)
        gamma = np.exp(unknowns[:, 2]).reshape(SHAPE)
        own = unknowns[:, SHARED:].reshape(*SHAPE, BANDS, OWN)
        rig = rig_of(numbers)
        images = []
        for light in rig.lights:
            assert isinstance(light, impasto.PointLight)
            towards, squared = forward.to_light(SHAPE, PITCH, light.position)
            eye, _ = forward.to_light(SHAPE, PITCH, rig.view_positions[0])
            gain = np.sum(np.square(light.position)) / squared
            half = (towards + eye) / np.linalg.norm(towards + eye, axis=0)
            angle = np.arccos((half * normal).sum(axis=0))
            factor = 1.0 if self.profile is None else self.profile.at(angle)
            bands = [
                forward.radiance(
                    normal, own[None, ..., band, 0], own[..., band, 2] * factor, gamma, towards,
                    eye, coated=self.coated,
                )[0] * gain + own[..., band, 1]
                for band in range(BANDS)
            ]  # fmt: skip
            images.append(np.array(bands).reshape(BANDS, -1) * light.intensity)
        return np.array(images).transpose(2, 1, 0)

    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """``(n, band, obs, number)`` by the rig, and ``(..., unknown)`` by those of the pixel."""

        def central(by: Callable[[float], np.ndarray]) -> np.ndarray:
            # Rounding of 1e-15 and a third derivative of some 1e3 times 1e-10.
            return (by(1e-5) - by(-1e-5)) / 2e-5

        def of_rig(number: int) -> np.ndarray:
            way = np.eye(NUMBERS)[number]
            if number < 2:  # as the rigs that are given differ
                there = self.shown(self.unknowns, self.numbers + STEP * way)
                return (there - self.shown(self.unknowns, self.numbers)) / STEP
            return central(lambda by: self.shown(self.unknowns, self.numbers + by * way))

        def of_pixel(number: int) -> np.ndarray:
            way = np.eye(EACH)[number]
            slope = central(lambda by: self.shown(self.unknowns + by * way, self.numbers))
            if number >= SHARED:
                slope[self.unknowns[:, number] == 0.0] = 0.0
            return slope

        rig = np.stack([of_rig(number) for number in range(NUMBERS)], axis=-1)
        return rig, np.stack([of_pixel(number) for number in range(EACH)], axis=-1)

    def surface(self) -> impasto.Surface:
        """The same, as a fit returns it."""

        def planes(number: int) -> np.ndarray:
            own = self.unknowns[:, SHARED + number :: OWN].T
            return np.ascontiguousarray(own, np.float32).reshape(BANDS, *SHAPE)

        gamma = np.exp(self.unknowns[:, 2]).reshape(SHAPE).astype(np.float32)
        gamma[self.unknowns[:, SHARED + 2].reshape(SHAPE) == 0.0] = np.nan  # no lobe, no width
        return impasto.Surface(
            np.ascontiguousarray(self.normal, np.float32).reshape(3, *SHAPE),
            planes(0),
            (Lobe(planes(2), (gamma,)),),
            pitch_mm=PITCH,
            ambient=planes(1),
            coated=self.coated,
        )

    def equations(
        self, errors: np.ndarray, slopes: np.ndarray, held: np.ndarray, *, strengths: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Those of the library."""
        rigs = [rig_of(self.numbers + STEP * way) for way in (0.0, *np.eye(NUMBERS)[:2])]
        rig, *moved = map(RigArguments.of, rigs)
        profile = self.profile
        return _core.rig_equations(
            self.surface(),
            None if profile is None else (profile.knots, profile.factor),
            rig,
            rigs[0].intensities,
            moved,
            STEP,
            strengths,
            *(
                np.ascontiguousarray(one.transpose(2, 1, 0)).reshape(LIGHTS, BANDS, *SHAPE)
                for one in (errors, slopes)
            ),
            held,
            1,
        )


SCENES = {
    "plain": Scene(False, None),
    "coated": Scene(True, None),
    "shaped": Scene(False, LobeProfile(np.array([0.1, 0.35, 0.6]), np.array([1.2, 0.6, 1.5]))),
}


def sampled() -> tuple[np.ndarray, np.ndarray]:
    """``(n, band, obs)`` errors and slopes; some samples do not count, nor does a whole pixel."""
    rng = np.random.default_rng(3)
    shape = (SHAPE[0] * SHAPE[1], BANDS, LIGHTS)
    used = rng.random(shape) > 0.1
    used[7] = False
    return np.where(used, rng.normal(size=shape), 0.0), np.where(
        used, rng.uniform(0.5, 2.0, shape), 0.0
    )


def followed(
    rig: np.ndarray, pixel: np.ndarray, held: np.ndarray, *, errors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of each pixel what is left of derivatives and errors in the photographs held.

    By dense least squares with a row for each ridge.
    """
    left = []
    for one, own, wrong in zip(rig, pixel, errors, strict=True):
        fitted = np.ones_like(held) if held.all() else ~held
        own_to_fit = own[:, fitted].reshape(-1, EACH)
        known = own if held.all() else np.concatenate([own_to_fit, own[:, held].reshape(-1, EACH)])
        scale = np.sqrt((known.reshape(-1, EACH) ** 2).sum(axis=0))
        scale[scale == 0.0] = 1.0
        along = np.concatenate([one, wrong[..., None]], axis=-1)
        to_fit = along[:, fitted].reshape(-1, along.shape[-1])
        if not held.all():
            to_fit[:, -1] = 0.0  # they are at their least squares
        follow = np.linalg.lstsq(
            np.concatenate([own_to_fit, math.sqrt(RIDGE) * np.diag(scale)]),
            np.concatenate([to_fit, np.zeros((EACH, along.shape[-1]))]),
            rcond=None,
        )[0]
        left.append((along - own @ follow)[:, held].reshape(-1, along.shape[-1]))
    return np.array([one[:, :-1] for one in left]), np.array([one[:, -1] for one in left])


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("strengths", [True, False])
def test_equations_are_those_of_dense_least_squares(name: str, every: int, strengths: bool) -> None:
    """All photographs, or every second of them held out, whose errors change as surfaces follow."""
    scene, (errors, slopes) = SCENES[name], sampled()
    held = np.arange(LIGHTS) % every == 0
    rig, pixel = (one * slopes[..., None] for one in scene.derivatives())
    rig = rig[..., : NUMBERS if strengths else 2]
    left, wrong = followed(rig, pixel, held, errors=errors)
    weight = np.ones(len(left))
    if every > 1:
        squares = (left**2).sum(axis=1)
        leverage = np.column_stack([squares[:, :2], squares[:, 2:].sum(axis=1)])
        known = slopes.any(axis=(1, 2))
        usual = np.median(leverage[known], axis=0)
        # Without strengths nothing is to be bounded by them.
        times = np.divide(leverage, usual, where=usual > 0.0, out=np.zeros_like(leverage))
        weight = 1.0 / np.maximum(times.max(axis=1), 1.0)
        assert weight.min() < 0.8
    matrix, right = scene.equations(errors, slopes, held, strengths=strengths)
    expected = np.einsum("n,nki,nkj->ij", weight, left, left)
    # Roundings of 6e-8 in the maps and in the places of pixels, where highlights change tenfold.
    close: dict[str, float] = {"rtol": 1e-5, "atol": 1e-6 * np.abs(expected).max()}
    np.testing.assert_allclose(matrix, expected, **close)
    np.testing.assert_allclose(right, np.einsum("n,nki,nk->i", weight, left, wrong), **close)


def test_no_pixel_at_all_tells_nothing() -> None:
    # Of a sample without one pixel that can be fitted.
    none = np.zeros((SHAPE[0] * SHAPE[1], BANDS, LIGHTS))
    for held in (np.ones(LIGHTS, np.bool_), np.arange(LIGHTS) % 2 == 0):
        matrix, right = SCENES["plain"].equations(none, none, held, strengths=True)
        np.testing.assert_array_equal(matrix, np.zeros((NUMBERS, NUMBERS)))
        np.testing.assert_array_equal(right, np.zeros(NUMBERS))


@pytest.fixture(scope="module")
def everything() -> tuple[Any, impasto.Stack, impasto.Rig, np.ndarray]:
    """Near camera, near lamps and uneven strengths, under a rig that says nothing of it."""
    normal, stack, true = photographs(3.0, 4.0)
    strength = np.random.default_rng(7).uniform(0.5, 1.5, len(stack.rig))
    samples = np.asarray(stack.samples) * strength[:, None, None, None].astype(np.float32)
    return normal, stack._replace(samples=samples), true, strength


@pytest.mark.slow
def test_camera_lamps_and_strengths_are_found_together(everything: Any) -> None:
    normal, stack, true, strength = everything
    refined = impasto.refine_rig(stack)
    report = refined.refinement
    assert report is not None
    assert report.camera.accepted
    assert report.lamps.accepted
    assert report.strengths.accepted
    assert report.open[0] == "overall strength"
    # Noise of 0.2 % of white, some 1 % of a sample, in 144 pixels of three bands: 0.05 % in a
    # strength, if nothing but it were sought. Distances are correlated with all strengths.
    off = np.log(refined.intensities / strength)
    assert np.abs(off - np.median(off)).mean() < 0.005
    assert report.camera.found == pytest.approx(3.0, rel=0.02)
    assert report.lamps.found == pytest.approx(4.0, rel=0.01)
    even = stack._replace(samples=np.asarray(stack.samples) / strength[:, None, None, None])
    told = error(normal, even, true)
    # What is promised of all at once.
    assert error(normal, stack, refined) < 1.3 * told


@pytest.mark.slow
def test_a_black_photograph_has_the_strength_that_was_given() -> None:
    _, stack, _ = photographs(math.inf, math.inf)
    strength = np.random.default_rng(7).uniform(0.5, 1.5, len(stack.rig))
    stack = stack._replace(samples=np.asarray(stack.samples) * strength[:, None, None, None])
    samples = np.array(stack.samples)
    samples[5] = 0.0
    refined = impasto.refine_rig(stack._replace(samples=samples), camera=False, lamps=False)
    assert refined.refinement is not None
    assert refined.refinement.strengths.accepted
    assert refined.intensities[5] == 1.0
    off = np.log(np.delete(refined.intensities / strength, 5))
    # As above.
    assert np.abs(off - np.median(off)).max() < 0.005


@pytest.mark.slow
def test_lamps_of_any_strength_are_found() -> None:
    """All samples of a lamp that is off by so much are outliers at first."""
    _, stack, _ = photographs(math.inf, math.inf)
    log = np.random.default_rng(7).uniform(-math.log(4.0), math.log(4.0), len(stack.rig))
    stack = stack._replace(samples=np.asarray(stack.samples) * np.exp(log)[:, None, None, None])
    off = np.log(impasto.refine_rig(stack).intensities) - log
    # Noise is a few per cent of the dimmest photographs, in 144 pixels of three bands.
    assert np.abs(off - np.median(off)).max() < 0.01


@pytest.mark.slow
def test_strengths_that_are_held_do_not_run_away() -> None:
    """Lamps on one side of a matte painting, which does not tell strengths from a tilt."""
    _, stack, _ = photographs(math.inf, math.inf, specular=0.0)
    lights = stack.rig.directions
    side = np.flatnonzero(lights[:, 0] > -0.2)
    strength = np.random.default_rng(7).uniform(0.6, 1.4, len(side))
    stack = stack.take(side)
    stack = stack._replace(samples=np.asarray(stack.samples) * strength[:, None, None, None])
    test, adjustment, start = adjusting(stack)
    found = adjustment.solve(start, np.zeros(2, dtype=np.bool_), "held", nearest=1.0)
    assert np.ptp(found.log) < 1.5 * np.ptp(np.log(strength))
    before, after = (test.errors(adjustment._at(one), 2).trim for one in (start, found))
    assert after < before


@pytest.mark.slow
def test_a_lamp_of_which_most_samples_are_trimmed_has_no_equation() -> None:
    """The few that agree with what is given would agree with any strength."""
    _, stack, _ = photographs(math.inf, math.inf, specular=0.0)
    samples = np.array(stack.samples)
    # Every fourth pixel of two photographs is as it was; of one, three of four.
    samples[[5, 9]] *= np.where(np.arange(samples.shape[3]) % 4 == 0, 1.0, 4.0)
    samples[20] *= np.where(np.arange(samples.shape[3]) % 4 == 0, 4.0, 1.0)
    _, adjustment, start = adjusting(stack._replace(samples=samples.astype(np.float32)))
    surfaces, _ = adjustment._fitted(start)
    step, determined = adjustment._step(start, surfaces, [], "free", 1.0)
    assert np.flatnonzero(~determined).tolist() == [5, 9]
    np.testing.assert_array_equal(step[[5, 9]], 0.0)
    logs = adjustment._medians(start, surfaces[0], ~determined)
    # Three quarters of the samples are four times as bright, as is the median.
    np.testing.assert_allclose(logs, math.log(4.0), atol=0.05)
    every = adjustment._medians(start, surfaces[0], np.ones(len(stack.rig), np.bool_))
    np.testing.assert_array_equal(logs, every[[5, 9]])


def adjusting(stack: impasto.Stack) -> tuple[HeldOut, BundleAdjustment, RigNumbers]:
    """Adjustment of the strengths of a stack's lamps alone, from those that are given."""
    test = HeldOut(stack, 576, index=1.45, threads=1)

    def at(state: RigNumbers) -> impasto.Rig:
        factors = np.exp(state.log).tolist()
        return impasto.Rig(
            [replace(a, intensity=b) for a, b in zip(stack.rig.lights, factors, strict=True)],
            pitch_mm=stack.rig.pitch_mm,
        )

    start = RigNumbers(np.zeros(2), np.zeros(len(stack.rig)))
    return test, BundleAdjustment(test, at, stack.rig.directions, 1), start


def test_errors_below_the_smallest_do_not_fall() -> None:
    assert Comparison(0.02, 0.03, 0.0, 1.0).fall == 0.0
    assert Comparison(0.1, 0.02, 0.0, 1.0).fall == pytest.approx(0.5)


PROGRAM = """
import numpy as np
import impasto
import test_rig_refinement as rigs

rigs.SHAPE, rigs.PITCH = (12, 12), 4.0
rig = impasto.refine_rig(rigs.photographs(3.0, 4.0)[1], threads=1)
assert rig.refinement.camera.accepted or rig.refinement.lamps.accepted
print(np.r_[rig.vectors.ravel(), rig.view_positions.ravel(), rig.intensities].tobytes().hex())
"""


@pytest.mark.slow
def test_threads_of_blas_change_no_bit() -> None:
    found = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads},
            cwd=Path(__file__).parent,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for threads in ("1", "2")
    ]
    assert found[0] == found[1]

"""Bundle adjustment of a rig, against dense least squares and against rigs that were put in."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit import normal_equations
from impasto.fit.bundle_adjustment import BundleAdjustment, RigNumbers
from impasto.fit.held_out import Comparison, HeldOut
from impasto.fit.normal_equations import Linear, bounded, eliminated
from test_rig_refinement import error, photographs

PIXELS, BANDS, LIGHTS, PLACES = 7, 2, 9, 2
SHARED, OWN = 2, 2
EACH = SHARED + BANDS * OWN
"""Unknowns of a pixel."""


@pytest.fixture
def linear() -> Linear:
    rng = np.random.default_rng(2)
    shape = (PIXELS, BANDS, LIGHTS)
    return Linear(
        error=rng.normal(size=shape),
        shared=rng.normal(size=(*shape, SHARED)),
        own=rng.normal(size=(*shape, OWN)),
        place=rng.normal(size=(*shape, PLACES)),
        lamp=rng.uniform(0.5, 1.5, shape),
    )


def dense(linear: Linear) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of all samples ``(n, band, obs)`` by the rig, and by all pixels' unknowns."""
    assert linear.lamp is not None
    rig = np.zeros((*linear.error.shape, PLACES + LIGHTS))
    rig[..., :PLACES] = linear.place
    own = np.zeros((*linear.error.shape, PIXELS * EACH))
    for light in range(LIGHTS):
        rig[:, :, light, PLACES + light] = linear.lamp[:, :, light]
    for pixel in range(PIXELS):
        first = pixel * EACH
        own[pixel, :, :, first : first + SHARED] = linear.shared[pixel]
        for band in range(BANDS):
            at = first + SHARED + band * OWN
            own[pixel, band, :, at : at + OWN] = linear.own[pixel, band]
    return rig, own


@pytest.mark.parametrize("block", [3, 128])
def test_a_step_is_that_of_least_squares_in_all_unknowns(
    linear: Linear, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(normal_equations, "_BLOCK", block)
    monkeypatch.setattr(normal_equations, "_RIDGE", 0.0)
    matrix, right = eliminated(linear, np.ones(LIGHTS, dtype=np.bool_))
    rig, own = dense(linear)
    both = np.concatenate([rig, own], axis=-1).reshape(linear.error.size, -1)
    together = np.linalg.lstsq(both, linear.error.ravel(), rcond=None)[0]
    # Double precision and condition numbers below 100.
    np.testing.assert_allclose(
        np.linalg.solve(matrix, right), together[: PLACES + LIGHTS], rtol=1e-9, atol=1e-12
    )


def test_held_out_errors_change_as_the_surfaces_follow(
    linear: Linear, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(normal_equations, "_RIDGE", 0.0)
    monkeypatch.setattr(normal_equations, "bounded", lambda leverage: np.ones(len(leverage)))
    held = np.arange(LIGHTS) % 2 == 0
    matrix, right = eliminated(linear, held)
    rig, own = dense(linear)

    def rows(one: np.ndarray, photographs: np.ndarray) -> np.ndarray:
        part = one[:, :, photographs]
        return part.reshape(-1, part.shape[-1])

    follow = np.linalg.lstsq(rows(own, ~held), rows(rig, ~held), rcond=None)[0]
    left = rows(rig, held) - rows(own, held) @ follow
    np.testing.assert_allclose(matrix, left.T @ left, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, left.T @ linear.error[:, :, held].ravel(), atol=1e-9)


@pytest.mark.parametrize("lamps", [True, False])
def test_no_pixel_at_all_tells_nothing(linear: Linear, lamps: bool) -> None:
    # Of a sample without one pixel that can be fitted.
    none = linear.of(slice(0, 0), np.ones(LIGHTS, dtype=np.bool_))
    if not lamps:
        none = replace(none, lamp=None)
    matrix, right = eliminated(none, np.ones(LIGHTS, dtype=np.bool_))
    numbers = PLACES + LIGHTS * lamps
    np.testing.assert_array_equal(matrix, np.zeros((numbers, numbers)))
    np.testing.assert_array_equal(right, np.zeros(numbers))


def test_no_pixel_counts_more_than_a_usual_one() -> None:
    leverage = np.array([[1.0, 4.0], [2.0, 0.0], [3.0, 5.0], [200.0, 6.0], [0.0, 1.0]])
    weight = bounded(leverage)
    assert (weight[:, None] * leverage <= np.median(leverage, axis=0) * (1.0 + 1e-12)).all()
    assert weight[1] == 1.0
    # Nothing is known of what no pixel shows, and nothing bounded by it.
    assert bounded(np.zeros((4, 1))).tolist() == [1.0] * 4


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
    # Noise of 0.2 % of white, some 1 % of a sample, in 576 pixels of three bands: 0.03 % in a
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
    # Noise is a few per cent of the dimmest photographs, in 576 pixels of three bands.
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
    logs = adjustment._medians(start, surfaces[0])
    # Three quarters of the samples are four times as bright, as is the median.
    np.testing.assert_allclose(logs[[5, 9]], math.log(4.0), atol=0.05)


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
    # BLAS divides large products. These are of blocks of pixels: more of them than a block has make
    # none larger.
    assert normal_equations._BLOCK < 12 * 12
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

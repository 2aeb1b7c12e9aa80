"""Refinement of rigs, and the shortest fit, of stacks that nobody should take.

A call is refused in words of its own or ends in a result that says what it could not do; nothing
that numpy warns of is left (pytest makes it an error). Samples: tests/oracles, float64 numpy.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, GeometryError, PointLight, Rig, Stack, Status
from impasto.cli import main
from impasto.doctor.before_fit import before_fit
from impasto.fit.bundle_adjustment import BundleAdjustment, RigNumbers
from impasto.fit.held_out import HeldOut
from impasto.io import write_stack
from oracles import forward as oracle
from oracles.rigs import spiral

SIDE = 8
LIGHTS = spiral(24)
HUGE = np.float32(3e38)
"""Twice it is no float32."""
STRENGTHS: Any = {"camera": False, "lamps": False}
"""What takes least time."""


def samples(lights: Any = LIGHTS, side: int = SIDE) -> Any:
    """``(obs, band, y, x)`` of a varnished painting."""
    rng = np.random.default_rng(3)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, side, side)), np.ones((1, side, side))])
    normal /= np.linalg.norm(normal, axis=0)
    clean = oracle.stack(
        normal,
        rng.uniform(0.1, 0.6, (3, side, side)),
        np.full((side, side), 4.0),
        np.full((side, side), 0.15),
        Rig(lights),
    )
    return (clean + rng.normal(0.0, 0.002, clean.shape)).astype(np.float32)


def weak(strength: float) -> Stack:
    """A stack that gives one lamp this strength, which is 1."""
    each = [1.0] * len(LIGHTS)
    each[4] = strength
    lights = [DistantLight(tuple(d), s) for d, s in zip(LIGHTS.tolist(), each, strict=True)]
    return Stack(samples(), lights=lights)


def left_alone(rig: Rig, why: str) -> None:
    """Whether a rig is as given, for this reason."""
    assert rig.refinement is not None
    assert not rig.refinement.accepted
    assert why in str(rig.refinement)


def test_every_second_photograph_is_black() -> None:
    dark = samples()
    dark[::2] = 0.0
    # Two folds: one of them is fitted to black photographs alone, and judges nothing.
    rig = impasto.refine_rig(Stack(dark, lights=LIGHTS))
    left_alone(rig, "a part of the photographs alone fits no pixel")


def test_every_second_lamp_stands_in_one_plane() -> None:
    lights = LIGHTS.copy()
    lights[1::2, 1] = 0.0
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    # All lights determine the normals; those without the first fold do not.
    assert (impasto.fit_normals(Stack(samples(lights), lights=lights)).status < 16).all()
    rig = impasto.refine_rig(Stack(samples(lights), lights=lights))
    left_alone(rig, "the lights of 12 of the photographs determine no normal")
    same = np.tile(LIGHTS[:1], (24, 1))
    with pytest.raises(GeometryError, match="the 24 lights lie in one plane"):
        impasto.refine_rig(Stack(samples(same), lights=same))


def test_three_lights_in_turn_are_no_photographs_held_out() -> None:
    lights = spiral(3)[np.arange(24) % 3]
    # Of two folds each has all three; of the three that the last comparison needs, two.
    rig = impasto.refine_rig(Stack(samples(lights), lights=lights))
    left_alone(rig, "the lights of 16 of the photographs determine no normal")


def test_a_lamp_given_far_too_weak() -> None:
    stack = weak(1e-30)
    left_alone(impasto.refine_rig(stack), "a part of the photographs alone fits no pixel")
    # Samples divided by its strength overflow, and no pixel is fitted: there is no step.
    test = HeldOut(stack, 64, index=1.45, threads=1)
    adjustment = BundleAdjustment(test, lambda _: stack.rig, LIGHTS, 1)
    start = RigNumbers(np.zeros(2), np.zeros(24))
    for kind in ("free", "held"):
        found = adjustment.solve(start, np.zeros(2, np.bool_), kind, nearest=1.0)  # type: ignore[arg-type]
        assert found is start


def test_a_photograph_that_is_all_but_black() -> None:
    dim = samples()
    dim[3] = 1e-40
    # A lamp of 1e-40 is none that a rig may have.
    rig = impasto.refine_rig(Stack(dim, lights=LIGHTS).take(range(3, 24, 2)), **STRENGTHS)
    assert rig.refinement is not None
    assert not rig.refinement.accepted
    np.testing.assert_array_equal(rig.intensities, 1.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_samples_near_the_largest_float(sign: int) -> None:
    wild = samples()
    wild[3, :, 2, 5] = sign * HUGE
    wild[7] = sign * HUGE
    stack = Stack(wild, lights=LIGHTS).take(range(1, 24, 2))
    impasto.refine_rig(stack, **STRENGTHS)
    found = impasto.fit_sbrdf(stack, pooling="painting", residuals=True)
    assert (found.status < 16).sum() >= SIDE * SIDE - 1
    lost = np.isnan(found.normal).all(axis=0)
    np.testing.assert_array_equal(lost, found.status >= Status.DARK)


def test_all_samples_near_the_largest_float() -> None:
    stack = Stack(np.full((24, 3, 4, 4), HUGE), lights=LIGHTS)
    found = impasto.fit_sbrdf(stack)
    assert (found.status >= 16).all()
    assert found.rig.refinement is None or not found.rig.refinement.accepted


@cache
def refined(power: int) -> Rig:
    """The rig of photographs under uneven lamps, times a power of two."""
    uneven = np.exp(np.random.default_rng(5).normal(0.0, 0.4, 24)).astype(np.float32)
    given = samples(side=6) * uneven[:, None, None, None]
    stack = Stack(given * np.float32(2.0**power), lights=LIGHTS)
    return impasto.refine_rig(stack.take(range(0, 20, 2)), **STRENGTHS)


@pytest.mark.parametrize("power", [-40, 40])
def test_samples_times_a_power_of_two_have_the_same_rig(power: int) -> None:
    one, other = refined(0), refined(power)
    assert one.refinement is not None
    assert one.refinement.strengths.accepted
    assert other.refinement == one.refinement
    assert other.intensities.tobytes() == one.intensities.tobytes()


def test_views_from_behind_alone_fit_nothing() -> None:
    behind = Stack(samples(), lights=LIGHTS, views=(0.1, 0.0, -0.9))
    for fit in (impasto.refine_rig, impasto.fit_sbrdf, impasto.learn_sbrdf):
        with pytest.raises(GeometryError, match="views: all 24 views lie behind the painting"):
            fit(behind)


@pytest.mark.parametrize("fault", ["black", "huge", "lamp on a pixel"])
def test_the_check_before_a_fit(fault: str) -> None:
    spoiled, lights = samples(side=16), [PointLight(tuple(40.0 * d)) for d in LIGHTS]
    if fault == "black":
        spoiled[::2] = 0.0
    elif fault == "huge":
        spoiled[3] = HUGE
    else:
        lights[3] = PointLight((0.5, 0.5, 0.0))
    assert not before_fit(Stack(spoiled, lights=lights, pitch_mm=1.0)).findings


def test_an_empty_mask_has_a_share_that_is_a_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = Stack(samples()[:4], lights=LIGHTS[:4], mask=np.zeros((SIDE, SIDE), bool))
    write_stack(tmp_path / "stack.npz", nothing)
    assert main(["fit", str(tmp_path / "stack.npz"), "--out", str(tmp_path / "out")]) == 4
    said = capsys.readouterr().err
    assert "0.00 % of the pixels" in said
    assert "nan" not in said

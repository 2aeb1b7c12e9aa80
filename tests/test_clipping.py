"""Clipped highlights: what is left out, and the sentences of docs/clipping.md on one painting."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import systems

BENCHES = Path(__file__).resolve().parents[1] / "benches" / "python"
SIZE = 24


@pytest.fixture(scope="module")
def clipping() -> Iterator[Any]:
    """The benchmark whose record the page shows."""
    sys.path.insert(0, str(BENCHES))
    try:
        import clipping as module

        yield module
    finally:
        sys.path.remove(str(BENCHES))


def test_left_out_samples_are_not_numbers_and_others_stay() -> None:
    rng = np.random.default_rng(3)
    codes = rng.integers(200, 4096, (4, 3, 5, 6)).astype(np.uint16)
    lights = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (-0.6, 0.0, 0.8)]
    stack = impasto.Stack(codes, lights=lights, saturation=4000.0, scale=1 / 4000.0, black=100.0)
    found = impasto.leave_out_highlights(stack)
    over = codes >= 4000
    assert over.any()
    np.testing.assert_array_equal(np.isnan(found.samples), over)
    expected = (codes.astype(np.float64) - 100.0) / 4000.0
    # Two roundings of single precision.
    np.testing.assert_allclose(found.samples[~over], expected[~over], rtol=3e-7)
    assert found.names == stack.names
    system = systems.get("impasto")
    other = type(system)(**{**vars(system), "highlights": "left-out"})
    np.testing.assert_array_equal(other.prepared(stack).samples, found.samples)


def test_reconstructed_samples_are_right_if_paint_and_gloss_have_one_colour(
    clipping: Any,
) -> None:
    """Before any fit. Grey under white gloss, and gold: noise of 0.2 % in the colour is all.

    1 in CIEDE2000 is 1 % or more of light; the colour is taken from a sample as bright as 0.6, so
    that its noise is 0.3 %. Under golden gloss on blue paint the ratio of blue to green is between
    4 and 0.4, that of the highlight 0.4: tens of CIEDE2000.
    """
    off = {}
    for case in clipping.CASES:
        made = clipping.scene(case, 0, 30, SIZE)
        stack = clipping.reconstructed(made)
        light = np.array([stack.linear(i) for i in range(30)])
        where = made.clipped.any(axis=1) & np.isfinite(light).all(axis=1)
        assert where.sum() > 250
        white = float(np.quantile(made.light.mean(axis=1), 0.999))
        pair = (np.moveaxis(one, 1, 0)[:, where] for one in (light, made.light))
        off[case] = clipping.apart(*pair, white)
    assert off["grey paint, white gloss"] < 1.0
    assert off["gold"] < 1.0
    assert off["paints, white gloss"] > 3.0
    assert off["blue paint, golden gloss"] > 10.0


def test_samples_that_nobody_knows_to_be_clipped_cost_a_third_of_beta(clipping: Any) -> None:
    """Lobes of each pixel; what is known to be clipped costs a few per cent at most."""
    made = clipping.scene("paints, white gloss", 0, 16, SIZE)
    found = {way: clipping.measured(made, way, "pixel") for way in clipping.WAYS}
    assert found["as measured"]["beta"] < -33.0
    assert found["as measured"]["highlights"] > 15.0
    for way in ("left out", "censored"):
        assert abs(found[way]["beta"]) < 3.0
        assert abs(found[way]["gamma"]) < 1.0
    # With few lamps it helps to know the least that the light was.
    assert found["censored"]["highlights"] < 0.5 * found["left out"]["highlights"]


@pytest.mark.parametrize("case", ["paints, white gloss", "blue paint, golden gloss"])
def test_with_many_lamps_bounds_cost_nothing(clipping: Any, case: str) -> None:
    """60 lamps show the shoulders of every highlight: bounds say no more and take nothing away.

    The search begins with clipped samples at their level, where beta is 40 % too small, and takes
    two rounds. A hundredth of that is left at most; it was a sixth where bounds counted until a
    round reached them.
    """
    made = clipping.scene(case, 0, 60, SIZE)
    found = {way: clipping.measured(made, way, "pixel") for way in ("left out", "censored")}
    assert abs(found["censored"]["beta"] - found["left out"]["beta"]) < 0.4
    # The predicted highlights are off by noise, and by the part of beta that is left.
    assert found["censored"]["highlights"] < found["left out"]["highlights"] + 0.1
    assert found["censored"]["paint"] < found["left out"]["paint"] + 0.1


def test_one_lobe_of_the_painting_ignores_clipped_samples(clipping: Any) -> None:
    """Censored and left out are the same fit, bit for bit."""
    made = clipping.scene("paints, white gloss", 1, 16, SIZE)
    fits = [
        impasto.fit_sbrdf(clipping.WAYS[way](made), pooling="painting", refine=False)
        for way in ("left out", "censored")
    ]
    np.testing.assert_array_equal(fits[0].diffuse, fits[1].diffuse)
    assert (fits[0].beta, fits[0].gamma) == (fits[1].beta, fits[1].gamma)

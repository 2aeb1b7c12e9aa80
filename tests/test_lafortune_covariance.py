"""Standard deviations of Lafortune lobes: against numpy, against noise drawn many times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from oracles import lafortune_covariance
from oracles import lafortune_forward as oracle

SIGMAS = ("specular_sigma", "direction_sigma", "exponent_sigma")
SIZE = (24, 24)
NORMAL = np.array([0.12, -0.08, 1.0]) / np.sqrt(0.12**2 + 0.08**2 + 1.0)
LEANING = 0.06
"""Radians by which the sharp lobe leans off the mirror direction of light at 45 degrees."""
EXPONENTS = (60.0, 6.0)
DIFFUSE = (0.30, 0.20, 0.10)
SPECULAR = ((0.5, 0.45, 0.35), (0.12, 0.14, 0.10))
NOISE = 0.006


def lobes(directions: Any = (LEANING, 0.0)) -> dict[str, np.ndarray]:
    psi = np.asarray(directions)
    shape = np.s_[:, None, None]
    return {
        "normal": NORMAL[shape],
        "diffuse": np.array(DIFFUSE)[shape],
        "specular": np.array(SPECULAR)[:, :, None, None],
        "cxy": (np.sin(psi) - np.cos(psi))[shape],
        "cz": (np.sin(psi) + np.cos(psi))[shape],
        "exponent": np.array(EXPONENTS)[shape],
    }


def draws(rig: impasto.Rig, seed: int = 5, **changes: Any) -> impasto.Stack:
    """A pixel photographed SIZE times, noise drawn anew."""
    clean = oracle.stack(**(lobes() | changes), rig=rig)
    noise = np.random.default_rng(seed).standard_normal((*clean.shape[:2], *SIZE))
    return impasto.Stack((clean + NOISE * noise).astype(np.float32), lights=rig)


def fit(stack: impasto.Stack, lobes: int = 2) -> impasto.LafortuneSbrdf:
    return impasto.fit_sbrdf(stack, model="lafortune", lobes=lobes)


def luminance(stack: impasto.Stack) -> np.ndarray:
    return stack.samples.astype(np.float64).mean(axis=1)


def by_numpy(
    fit: impasto.LafortuneSbrdf, samples: np.ndarray, there: np.ndarray, count: int, **how: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of pixels that have so many lobes: of normals, and of lobes (lobe, 3, pixel)."""
    return lafortune_covariance.deviations(
        fit.normal[:, there], fit.diffuse.mean(axis=0)[there],
        fit.specular.mean(axis=1)[:count, there], fit.cxy[:count, there], fit.cz[:count, there],
        fit.exponent[:count, there], samples[:, there], fit.rig, **how,
    )  # fmt: skip


@pytest.fixture(scope="module")
def rig() -> impasto.Rig:
    return simulate.rig("snel-lafortune").take(range(0, 770, 5))


@pytest.fixture(scope="module")
def stack(rig: impasto.Rig) -> impasto.Stack:
    return draws(rig)


@pytest.fixture(scope="module")
def drawn(stack: impasto.Stack) -> impasto.LafortuneSbrdf:
    return fit(stack)


def test_deviations_are_those_of_numpy() -> None:
    # Strokes, patches of varnish and one to three lobes; nothing clips, so that every band counts
    # the same photographs.
    painting = simulate.painting(seed=7, size=(16, 20), varnish="patches")
    rig = simulate.rig("snel-lafortune").take(range(0, 770, 3))
    stack = simulate.capture(painting, rig, "rgb", model="lafortune", bits=None, clip=False).stack
    found = fit(stack, lobes=3)
    samples = luminance(stack)
    # Samples that were left out are off by half of themselves: such pixels are left to others.
    shown = found.predict().mean(axis=1, dtype=np.float64)
    outliers = np.abs(samples - shown) > 0.5 * np.maximum(samples, shown)
    for count in (1, 2, 3):
        there = (found.lobes == count) & ~outliers.any(axis=0)
        assert there.sum() > 50
        worst, own = by_numpy(found, samples, there, count)
        ours = np.array([getattr(found, name)[:count, there] for name in SIGMAS])
        known = np.isfinite(ours)
        assert known.mean() > 0.95
        # Maps are rounded to 6e-8, which n of some hundreds makes 3e-5 of a slope; what lobes
        # share magnifies that: three of them to 7e-4 in one pixel of a hundred.
        error = np.abs(ours / np.moveaxis(own, 1, 0) - 1.0)[known]
        assert np.median(error) < 1e-4
        assert error.max() < 5e-3
        # A change of slope is taken to turn the normal by its cosine, which is the most that it
        # may: along the slope it is that squared.
        normal = found.sigma[there] / worst
        assert normal.min() > 0.995
        assert (normal * found.normal[2, there]).max() < 1.005


def test_noise_scatters_lobes_as_far_as_is_said(drawn: impasto.LafortuneSbrdf) -> None:
    assert (drawn.lobes == 2).all()
    truth = np.array(SPECULAR).mean(axis=1)
    psi = np.arctan2(drawn.cz + drawn.cxy, drawn.cz - drawn.cxy)
    errors = {
        "specular_sigma": np.log(drawn.specular.mean(axis=1) / truth[:, None, None]),
        "direction_sigma": psi - np.array([LEANING, 0.0])[:, None, None],
        "exponent_sigma": np.log(drawn.exponent / np.array(EXPONENTS)[:, None, None]),
    }
    for name, error in errors.items():
        square = np.mean((error / getattr(drawn, name)) ** 2, axis=(1, 2))
        # Chi squared of 576 draws over 576 deviates from 1 by sqrt(2 / 576) = 0.059: four of those,
        # and 2 / 145 for noise that each pixel estimates from 145 degrees of freedom.
        assert (np.abs(square - 1.0) < 4 * 0.059 + 0.014).all(), (name, square)
    # The normal errs along two axes; sigma is that of the worse one, and an upper limit of it.
    off = np.cross(drawn.normal, NORMAL[:, None, None], axis=0)
    square = np.mean((off**2).sum(axis=0) / drawn.sigma**2)
    assert 1.0 - 0.25 < square < 2.0


def test_twice_the_photographs_halve_the_variance(
    rig: impasto.Rig, drawn: impasto.LafortuneSbrdf
) -> None:
    twice = fit(draws(rig.take([*range(len(rig))] * 2), seed=6))
    assert (twice.lobes == 2).all()
    for name in (*SIGMAS, "sigma"):
        ratio = np.median(getattr(drawn, name) / getattr(twice, name), axis=(-2, -1))
        # Noise estimated from 145 and 299 degrees of freedom, in ratios 7 % apart: the median of
        # 576 of them is known to 0.4 %. Lobes' places differ by a deviation, their slopes by some
        # percent of it.
        assert np.allclose(ratio, np.sqrt(2.0), rtol=0.02), (name, ratio)


def test_hard_case_28_a_power_of_two_changes_no_bit(
    rig: impasto.Rig, stack: impasto.Stack, drawn: impasto.LafortuneSbrdf
) -> None:
    for k in (-9, 12):
        scaled = fit(impasto.Stack(stack.samples * np.float32(2.0**k), lights=rig))
        for name in (*SIGMAS, "sigma"):
            assert np.array_equal(getattr(scaled, name), getattr(drawn, name)), (k, name)


def test_hard_case_18_under_one_view_directions_are_given(rig: impasto.Rig) -> None:
    frontal = impasto.Rig(rig.directions[::2])
    mirror = {name: lobes((0.0, 0.0))[name] for name in ("cxy", "cz")}
    stack = draws(frontal, normal=np.array([0.0, 0.0, 1.0])[:, None, None], **mirror)
    found = fit(stack, lobes=1)
    there = found.lobes == 1
    assert there.sum() > 100
    assert np.isnan(found.direction_sigma).all()
    assert np.isnan(found.sigma).all()
    _, own = by_numpy(found, luminance(stack), there, 1, known=True)
    for which, name in ((0, "specular_sigma"), (2, "exponent_sigma")):
        map_ = getattr(found, name)[0]
        assert np.array_equal(np.isfinite(map_), there)
        # The colours' strengths are those of a search that ended at a cost to 1e-6.
        assert np.allclose(map_[there], own[0, which], rtol=5e-3)


def test_a_number_at_its_bound_has_no_deviation(rig: impasto.Rig) -> None:
    # A lobe that leans further than any that was measured: n turn = 15, and the search's 8.
    far = {name: lobes((0.5, 0.0))[name] for name in ("cxy", "cz")}
    found = fit(draws(rig, **far), lobes=1)
    assert (found.lobes == 1).all()
    turn = np.tan(0.5 * np.arctan2(found.cz + found.cxy, found.cz - found.cxy))
    # To 1e-5 in the fit; maps are rounded besides.
    held = np.abs(turn * found.exponent) > 8.0 * (1.0 - 0.9e-5)
    assert held.mean() > 0.9
    assert np.isnan(found.direction_sigma[held]).all()
    # The strength depends on it: with the direction taken for known its sigma would be 1e-4.
    assert (found.specular_sigma[held] > 0.1).all()


def test_what_no_lobe_has_is_nan(drawn: impasto.LafortuneSbrdf, stack: impasto.Stack) -> None:
    matte = draws(drawn.rig, specular=np.zeros((2, 3, 1, 1)))
    found = fit(matte)
    for name in SIGMAS:
        assert np.isnan(getattr(found, name)[found.lobes <= np.arange(2)[:, None, None]]).all()
    # Eight photographs and one lobe: eight samples, six unknowns.
    few = fit(stack.take(range(0, 154, 20)), lobes=1)
    samples = np.isfinite(few.exponent)
    for name in SIGMAS:
        assert not np.isinf(getattr(few, name)).any()
        assert np.isnan(getattr(few, name)[~samples]).all()

"""Snel's rig, and photographs of Lafortune surfaces against an independent forward model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.errors import ArgumentError
from oracles import lafortune_forward as oracle

OFF: dict[str, Any] = {"noise": False, "bits": None, "clip": False}


@pytest.fixture(scope="module")
def painting() -> simulate.Painting:
    return simulate.painting(seed=5, size=(40, 44), varnish="patches")


@pytest.fixture(scope="module")
def rig() -> impasto.Rig:
    return simulate.rig("snel-lafortune")


def test_the_rig_samples_the_mirror_direction_most(rig: impasto.Rig) -> None:
    assert len(rig) == 690 + 80
    pairs = np.concatenate([rig.directions, rig.views], axis=1)
    assert len(np.unique(pairs.round(9), axis=0)) == 770, "no photograph is taken twice"
    light = rig.directions
    mirror = light * (-1.0, -1.0, 1.0)
    off = np.degrees(np.arccos(np.clip((mirror * rig.views).sum(axis=1), -1, 1)))
    # Half the photographs within 25 degrees of the mirror direction, which is 9 % of the sky.
    assert np.median(off) < 25.1
    assert np.isclose(np.unique(off[off > 1e-3].round(2))[0], 3.0), "the paper's smallest step"
    # Nothing is photographed along the surface, and no camera stands in its own light.
    assert rig.views[:, 2].min() > np.cos(np.radians(75.1))
    assert np.degrees(np.arccos((light * rig.views).sum(axis=1).max())) > 5
    # The last 80 are lit from all sides, the first 690 in one plane: isotropy.
    assert np.allclose(light[:690, 1], 0)
    azimuth = np.degrees(np.arctan2(light[690:, 1], light[690:, 0])) % 360
    assert len(np.unique(azimuth.round(3))) == 8


def test_near_lamps_keep_their_views(rig: impasto.Rig) -> None:
    near = simulate.rig("snel-lafortune", distance_mm=900.0)
    assert np.array_equal(near.views, rig.views)
    assert np.allclose(near.directions, rig.directions, rtol=0, atol=1e-15)


def test_photographs_are_the_equation(painting: simulate.Painting, rig: impasto.Rig) -> None:
    few = rig.take(range(0, 770, 11))
    capture = simulate.capture(painting, few, "rgb", model="lafortune", **OFF)
    truth = capture.truth
    assert truth.lobes is not None
    expected = oracle.stack(truth.normal, truth.diffuse, **vars(truth.lobes), rig=few)
    found = np.array([capture.stack.linear(i) for i in range(len(few))])
    # Float32 against float64. Light and view come into the pixel's frame (a rounding of 2^-24 for
    # each of three products), and d is a sum of products of the two (four more), near 1 where
    # the lobe is bright; d^n takes n times their sum, times the lobe's strength: 2.9e-5.
    steepest = (truth.lobes.exponent[:, None] * truth.lobes.specular).max()
    assert np.abs(found - expected).max() < 7 * 2.0**-24 * steepest
    assert np.abs(found - expected).mean() < 5e-7


def test_lobes_follow_the_varnish(painting: simulate.Painting) -> None:
    truth = simulate.capture(painting, "snel-lafortune", **OFF).truth
    assert truth.lobes is not None
    count = (truth.lobes.specular > 0).all(axis=1).sum(axis=0)
    for name, expected in (("none", 1), ("matte", 2), ("satin", 2), ("gloss", 3)):
        assert (count[painting.masks[name]] == expected).all(), name
    assert np.allclose(truth.lobes.cxy**2 + truth.lobes.cz**2, 2.0, rtol=0, atol=1e-6)
    # Used places come first, the sharpest lobe first of all.
    used = (truth.lobes.specular > 0).all(axis=1)
    assert (used[:-1] >= used[1:]).all()
    falling = truth.lobes.exponent[:-1] >= truth.lobes.exponent[1:]
    assert falling[used[1:]].all()


def test_a_paper_by_its_name(painting: simulate.Painting) -> None:
    named = simulate.capture(painting, "snel-lafortune", seed=3)
    assert named.stack.shape == (770, 3, 40, 44)
    assert named.stack.samples.dtype == np.uint16
    assert simulate.capture(painting, "tominaga-rgb-camera").truth.lobes is None
    with pytest.raises(ArgumentError, match="model"):
        simulate.capture(painting, "snel-lafortune", model="phong")  # type: ignore[arg-type]


def test_half_precision_photographs_read_alike(painting: simulate.Painting) -> None:
    few = simulate.rig("snel-lafortune").take(range(0, 770, 40))
    whole = simulate.capture(painting, few, "rgb", model="lafortune", **OFF).stack
    half = impasto.Stack(whole.samples.astype(np.float16), lights=whole.rig)
    normals, halved = (impasto.fit_normals(stack, method="huber") for stack in (whole, half))
    angle = np.degrees(np.arccos(np.clip((normals.normal * halved.normal).sum(axis=0), -1, 1)))
    # Half precision rounds by 2^-11 = 0.05 %: some hundredths of a degree.
    assert np.nanmax(angle) < 0.2


def test_wrong_shapes_are_refused_by_name() -> None:
    flat = np.zeros((3, 2, 2), np.float32)
    good = {"diffuse": np.ones((1, 2, 2)), "specular": np.ones((2, 1, 2, 2))}
    shapes = {name: np.ones((2, 2, 2)) for name in ("cxy", "cz", "exponent")}
    impasto.Surface.lafortune(flat, **good, **shapes)
    for name in ("specular", "cxy", "cz"):
        with pytest.raises(ArgumentError, match=rf"^{name}: expected shape"):
            impasto.Surface.lafortune(flat, **{**good, **shapes, name: np.ones((1, 2))})


def test_an_unknown_normal_shows_nothing_known() -> None:
    normal = np.zeros((3, 1, 2), np.float32)
    normal[2] = 1.0
    normal[:, 0, 1] = np.nan
    shape = np.ones((1, 1, 2), np.float32)
    rig = impasto.Rig(
        [(0, 0, 1), (0, 0, -1), (0, 0.6, 0.8)], views=[(0, 0, 1), (0, 0, 1), (0, 1, -1)]
    )
    shown = impasto.Surface.lafortune(
        normal, 0.5 * shape, shape[None], -shape, shape, shape
    ).predict(rig)
    assert np.isnan(shown[:, 0, 0, 1]).all()
    # Head on; lit from behind; seen from behind (diffuse only).
    assert np.allclose(shown[:, 0, 0, 0], [1.5, 0.0, 0.4], rtol=1e-6)


def test_more_light_than_numbers_hold_is_the_largest_number() -> None:
    normal = np.zeros((3, 1, 3), np.float32)
    normal[2] = 1.0
    specular = np.array([3e37, 1e37, 1e37], np.float32).reshape(1, 1, 1, 3)
    diffuse = np.array([3e38, 1e37, np.nan], np.float32).reshape(1, 1, 3)
    shape = np.ones((1, 1, 3), np.float32)
    lights = [
        impasto.DistantLight((0, 0, 1)),
        impasto.DistantLight((0, 0, 1), intensity=0.1),
        impasto.DistantLight((0, 0, -1)),
        impasto.DistantLight((0, 0, 1), intensity=1e30),
        impasto.PointLight((0.0, 0.0, 200.0), falloff=True),
    ]
    # Head on a lobe shows cz^n: 1.5^8 = 25.6 times its strength.
    rig = impasto.Rig(lights, pitch_mm=1.0)
    shown = impasto.Surface.lafortune(
        normal, diffuse, specular, -shape, 1.5 * shape, 8 * shape
    ).predict(rig)
    largest = np.finfo(np.float32).max
    first, second, third = np.moveaxis(shown[:, 0, 0], 1, 0).astype(np.float64)
    # Of what no number holds a tenth is a tenth of the largest, to one rounding.
    assert first[0] == largest
    assert first[1] == pytest.approx(0.1 * float(largest), rel=2e-7)
    assert (first[2], first[3]) == (0.0, largest)
    assert np.isfinite(first).all()
    # 26.63 times 1e37 is a number, and stays it: 8 ln 1.5 is rounded by 2e-7 in single precision.
    assert second[:2] == pytest.approx(np.array([1.0, 0.1]) * 2.662890625e38, rel=1e-5)
    assert np.isnan(third).all()

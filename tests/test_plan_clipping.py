"""What a display clips: bounds of light that no pixel exceeds, and tiles that are clipped whole."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import impasto

TILE = 256
SCALE = 1e4
"""A bound is printed to three digits behind the point: at this exposure, to seven."""


def normals(rng: np.random.Generator, size: tuple[int, int], slope: float) -> NDArray[np.float32]:
    slopes = rng.normal(0.0, slope, (2, *size))
    normal = np.stack([*slopes, np.ones(size)])
    return np.asarray(normal / np.linalg.norm(normal, axis=0), np.float32)


def random_case(seed: int) -> tuple[impasto.Surface, impasto.Scene]:
    """A surface that is lit everywhere, under lamps of all kinds."""
    rng = np.random.default_rng(seed)
    size = [(1, 1), (1, 300), (40, 30), (TILE, TILE), (260, 300)][seed % 5]
    normal = normals(rng, size, rng.choice([0.0, 0.02, 0.2]))
    bands = int(rng.choice([1, 3]))
    diffuse = rng.uniform(0.2, 0.9, (bands, 1, 1)) * rng.uniform(0.9, 1.0, (bands, *size))
    options: dict[str, Any] = {"pitch_mm": 0.5, "coated": bool(rng.random() < 0.2)}
    options["ambient"] = 0.1 * diffuse if rng.random() < 0.3 else None
    options["height"] = rng.uniform(0.0, 0.2, size).astype(np.float32)
    kind = rng.choice(["matte", "neutral", "tinted", "lafortune"])
    if kind == "matte":
        surface = impasto.Surface(normal, diffuse, **options)
    elif kind == "lafortune":
        strength = rng.uniform(0.0, 0.1, (1, bands, *size))
        ones = np.ones((1, *size))
        surface = impasto.Surface.lafortune(
            normal, diffuse, strength, -ones, ones, 20.0 * ones, **options
        )
    else:
        strength = rng.uniform(0.0, 0.5, (1, bands, *size) if kind == "tinted" else (1, *size))
        surface = impasto.Surface.torrance_sparrow(
            normal, diffuse, strength, np.full((1, *size), 0.2), **options
        )
    lights: list[Any] = []
    for _ in range(rng.integers(1, 4)):
        x, y = rng.uniform(-0.7, 0.7, 2)
        if rng.random() < 0.5:
            lights.append(impasto.DistantLight((x, y, 1.0), radius=rng.choice([0.0, 0.05])))
        else:
            far = rng.choice([50.0, 400.0, 3e4])
            place = (far * x, far * y, far)
            lights.append(
                impasto.PointLight(place, rng.uniform(0.3, 1.5), radius=rng.choice([0.0, 2.0]))
            )
    views = [None, (0.3, 0.1, 0.9), impasto.PointView((9.0, 5.0, 400.0))]
    scene = impasto.Scene(
        lights,
        view=views[rng.integers(3)],
        shadows=bool(rng.random() < 0.3),
        parallax=False,
        exposure=SCALE,
    )
    return surface, scene


def row(plan: impasto.Plan, name: str) -> Any:
    return next(effect for effect in plan.effects if effect.name == name)


def bound(surface: impasto.Surface, scene: impasto.Scene) -> float:
    """The brightest light that a plan thinks possible, at exposure 1."""
    reason = row(impasto.plan(surface, scene), "clipping").reason
    found = re.search(r"(\d+\.\d+) of the range", reason)
    assert found
    return float(found[1]) / SCALE


def same(plan: impasto.Plan) -> impasto.Image:
    """The picture as codes; planned and forced have the same, and the same counts."""
    planned, forced = plan.render(threads=1), plan.forced().render(threads=1)
    assert planned.display.tobytes() == forced.display.tobytes()
    assert planned.coverage.tobytes() == forced.coverage.tobytes()
    assert (planned.clipped, planned.outside) == (forced.clipped, forced.outside)
    return planned


@pytest.mark.parametrize("first", range(0, 200, 20))
def test_no_pixel_is_clipped_below_the_bound_of_light(first: int) -> None:
    """At 0.99 and 1.01 of it; and it is no looser than twice, in the median."""
    looseness = []
    for seed in range(first, first + 20):
        surface, scene = random_case(seed)
        most = bound(surface, scene)
        for share, decision in ((0.99, "no-op"), (1.01, "on")):
            plan = impasto.plan(surface, scene.changed(exposure=share / most))
            assert row(plan, "clipping").decision == decision, seed
            image = same(plan)
            if decision == "no-op":
                assert max(image.clipped.values()) == 0.0, seed
            if row(plan, "gamut clipping").decision == "no-op":
                assert max(image.outside.values()) == 0.0, seed
        looseness.append(share / float(np.max(image.linear)))
    assert min(looseness) >= 1.0
    assert np.median(looseness) < 2.0


def test_a_bound_without_slack_tells_a_hundredth_below_white_from_one_above() -> None:
    """A level grey of one lamp: the bound is the light itself, but for roundings."""
    for share, clipped in ((0.99, 0.0), (0.9999, 0.0), (1.0001, 1.0), (1.01, 1.0)):
        surface = level((0.5, 0.5, 0.5))
        scene = impasto.Scene([impasto.DistantLight((0.0, 0.6, 0.8))], exposure=share / 0.4)
        plan = impasto.plan(surface, scene)
        assert row(plan, "clipping").decision == ("on" if clipped else "no-op")
        assert row(plan, "gamut clipping").decision == "no-op"
        assert set(same(plan).clipped.values()) == {clipped}
    assert "light of up to 1.010 of the range, 0.01 stops too many" in plan.explain()
    assert "in at most 100.000 % of the painting; 1 tiles are clipped whole" in plan.explain()


def level(colour: tuple[float, ...], size: tuple[int, int] = (40, 30), **options: Any) -> Any:
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    diffuse = np.asarray(colour, np.float32)[:, None, None] * np.ones(size, np.float32)
    return impasto.Surface(normal, diffuse, **options)


@pytest.mark.parametrize("seed", range(60))
def test_tiles_that_are_clipped_whole_have_the_codes_of_lit_ones(seed: int) -> None:
    """Exposures about that at which the darkest pixel is white."""
    surface, scene = random_case(seed)
    scene = scene.changed(view=None)
    # In a shadow there is no light.
    linear = impasto.render(surface, scene.changed(exposure=1.0)).linear
    darkest = max(float(linear.min()), 0.05)
    for share in (0.99, 1.01, 1.5, 3.0):
        image = same(impasto.plan(surface, scene.changed(exposure=share / darkest)))
        if share < 1.0:
            assert min(image.clipped.values()) < 1.0


def test_many_tiles_are_clipped_whole() -> None:
    """Else the test before would say nothing of them."""
    found = 0
    for seed in range(60):
        surface, scene = random_case(seed)
        plan = impasto.plan(surface, scene.changed(view=None, exposure=30.0))
        found += plan._native.clipped_whole > 0
    assert found >= 20


def test_a_tile_that_is_clipped_whole_is_not_lit() -> None:
    """Above white in one channel and below 0 in two: its picture is that, with any light in it."""
    columns = np.where(np.arange(2 * TILE) < TILE, 0.3, 1.0).astype(np.float32)
    surface = level((1.0, -0.4, -0.2), (3, 2 * TILE))
    surface = replace(surface, diffuse=surface.diffuse * columns)
    scene = impasto.Scene([impasto.DistantLight((0.0, 0.0, 1.0))], exposure=2.0)
    plan = impasto.plan(surface, scene)
    assert plan._native.clipped_whole == 1
    assert row(plan, "clipping").tiles == 1
    assert row(plan, "gamut clipping").tiles == 2
    image = same(plan)
    assert image.display[:, TILE:].tolist() == [[[255, 0, 0]] * TILE] * 3
    # A mask of the core's plan on the forced one does the same.
    forced = plan.forced()
    masked = replace(forced, _native=forced._native.clipped_as(plan._native))
    assert masked.render().display.tobytes() == image.display.tobytes()
    records = {
        one["effect"]: one for one in json.loads(plan.measured(threads=1).to_json())["effects"]
    }
    assert records["clipping"]["decision"] == "on"
    assert records["clipping"]["tiles"] == 1
    assert "1 tiles are clipped whole, and not lit" in records["clipping"]["reason"]
    # Seconds, or 0 where they cannot be told from noise; the other line saves nothing by itself.
    assert records["clipping"]["saves_seconds"] >= 0.0
    assert records["gamut clipping"]["saves_seconds"] is None


def test_shadows_and_holes_keep_the_light_of_a_tile() -> None:
    bright = impasto.Scene([impasto.DistantLight((1.0, 0.0, 0.3))], exposure=50.0)
    height = np.zeros((40, 30), np.float32)
    height[:, 15] = 5.0
    surface = level((0.5, 0.5, 0.5), height=height, pitch_mm=1.0)
    assert impasto.plan(surface, bright)._native.clipped_whole == 1
    shadowed = impasto.plan(surface, bright.changed(shadows=True))
    assert shadowed._native.clipped_whole == 0
    assert same(shadowed).clipped["red"] < 1.0
    holed = replace(surface, diffuse=surface.diffuse.copy())
    holed.diffuse[1, 3, 3] = np.nan
    plan = impasto.plan(holed, bright)
    assert plan._native.clipped_whole == 0
    assert same(plan).display[3, 3].tolist() == [0, 0, 0]


def test_a_background_may_be_clipped() -> None:
    surface = level((0.5, 0.5, 0.5))
    surface.normal[:, 0, 0] = np.nan
    light = [impasto.DistantLight((0.0, 0.0, 1.0))]
    for grey, decision in ((0.5, "no-op"), (1.0, "on")):
        scene = impasto.Scene(light, exposure=1.0, background=(grey, grey, grey))
        assert row(impasto.plan(surface, scene), "clipping").decision == decision


def test_light_without_a_bound_is_said_to_have_none() -> None:
    surface = level((0.5, 0.5, 0.5))
    room = impasto.Scene(environment=impasto.Environment.named("gallery"))
    reason = row(impasto.plan(surface, room), "clipping").reason
    assert reason == "light without a bound in 100.000 % of the painting"
    follows = impasto.Scene([impasto.DistantLight((0, 0, 1))], exposure="maximum")
    found = row(impasto.plan(surface, follows), "clipping")
    assert (found.decision, found.reason) == ("on", "the exposure is not known before the picture")


def test_a_dark_pixel_before_a_bright_background_may_fall_below_black() -> None:
    """Shares of a slanted view sum up to 1 but for roundings: some of no light is a little less."""
    half = level((0.5, 0.5, 0.5), (37, 41))
    half.normal[2, :18] = -1.0
    scene = impasto.Scene([impasto.DistantLight((0.2, 0.0, 1.0))], view=(0.31, -0.21, 0.93))
    assert row(impasto.plan(half, scene), "gamut clipping").decision == "no-op"
    bright = impasto.plan(half, scene.changed(background=(0.2, 0.5, 0.9)))
    assert row(bright, "gamut clipping").decision == "on"
    assert row(bright, "clipping").decision == "no-op"
    assert max(same(bright).clipped.values()) == 0.0

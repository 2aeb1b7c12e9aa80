"""Plans: what is left out changes no bit, or less than the tolerance."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import impasto
from impasto import simulate
from impasto.errors import ArgumentError

TILE = 256
ROOM = impasto.Environment(np.random.default_rng(5).uniform(0.0, 2.0, (3, 16, 32)), name="noise")
SIZES = ((1, 1), (1, 300), *((37, 41), (41, 37)) * 6, (TILE, TILE), (270, 300))
"""Of which one is drawn: most errors show in small pictures, which take a hundredth of the time."""


def direction(azimuth: float, tangent: float) -> tuple[float, float, float]:
    """A direction whose elevation has this tangent."""
    length = math.hypot(1.0, tangent)
    return (math.cos(azimuth) / length, math.sin(azimuth) / length, tangent / length)


def relief_of(rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.float32]:
    """Waves over half of the picture: other tiles stay level."""
    rows, columns = np.mgrid[0 : size[0], 0 : size[1]]
    waves = np.zeros(size)
    for _ in range(3):
        across, down, phase = rng.uniform(-0.4, 0.4, 3)
        waves += rng.uniform(0.0, 0.3) * np.sin(across * columns + down * rows + 6 * phase)
    return np.asarray(waves * (columns < 0.5 * size[1]), np.float32)


def normals_of(height: NDArray[np.float32], pitch: float) -> NDArray[np.float32]:
    padded = np.pad(height.astype(np.float64), 1, mode="edge")
    across = (padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * pitch)
    up = (padded[:-2, 1:-1] - padded[2:, 1:-1]) / (2 * pitch)
    normal = np.stack([-across, -up, np.ones_like(across)])
    return np.asarray(normal / np.linalg.norm(normal, axis=0), np.float32)


def steepest(height: NDArray[np.float32], azimuth: float, pitch: float) -> float:
    """The steepest rise of the bilinear surface in a direction, in float64."""
    rows = np.pad(height.astype(np.float64), 1, mode="edge")
    across = np.diff(rows, axis=1) / pitch
    up = -np.diff(rows, axis=0) / pitch
    x, y = math.cos(azimuth), math.sin(azimuth)
    of_x = np.maximum(across[:-1] * x, across[1:] * x)
    of_y = np.maximum(up[:, :-1] * y, up[:, 1:] * y)
    return float((of_x + of_y).max())


@st.composite
def scenes(draw: st.DrawFn, faint: bool = False) -> tuple[impasto.Surface, impasto.Scene]:
    """A surface and a scene in which every effect may be there, absent or at its bound.

    With `faint` its lobes are so weak that a plan with a tolerance may leave them out.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = draw(st.sampled_from(SIZES))
    pitch = 0.5
    height = relief_of(rng, size)
    normal = normals_of(height, pitch)
    bands = draw(st.sampled_from((1, 3)))
    diffuse = rng.uniform(0.0, 0.9, (bands, *size)).astype(np.float32)
    if draw(st.booleans()):
        normal[:, rng.random(size) < 0.1] = np.nan
    if draw(st.booleans()):
        normal[:, : size[0] // 2] *= -1.0
    if not faint and draw(st.booleans()):
        # Longer or shorter than a unit vector: nothing is proven about these.
        normal *= draw(st.sampled_from((0.5, 1.0 + 1e-5, 3.0)))
    model = draw(st.sampled_from(("matte", "one", "maps", "tinted", "lafortune")))
    patches = rng.random(size) < 0.5
    patches[:, : size[1] // 2] = False
    beta = np.where(patches, rng.uniform(0.0, 3.0, size), 0.0).astype(np.float32)
    gamma = rng.uniform(0.01, 0.4, size).astype(np.float32)
    if faint:
        beta *= draw(st.sampled_from((1e-5, 1e-4, 1e-3)))
    elif draw(st.booleans()):
        beta *= 1e3  # highlights far brighter than white
    if not faint and draw(st.booleans()):
        draw(st.sampled_from((beta, gamma)))[rng.random(size) < 0.05] = np.nan
    options: dict[str, Any] = {"height": height, "pitch_mm": pitch}
    options["coated"] = draw(st.booleans())
    options["ambient"] = 0.1 * diffuse if draw(st.booleans()) else None
    if model == "lafortune":
        strength = np.broadcast_to(beta, (2, bands, *size)) * 0.1
        exponent = rng.uniform(2.0, 500.0, (2, *size)).astype(np.float32)
        cxy = np.full((2, *size), -1.0, np.float32)
        surface = impasto.Surface.lafortune(
            normal, diffuse, strength, cxy, -cxy, exponent, **options
        )
    elif model == "matte":
        surface = impasto.Surface(normal, diffuse, **options)
    else:
        strengths: Any = {"one": 1e-4 if faint else 0.5, "maps": beta}.get(
            model, np.stack([[beta] * bands])
        )
        widths: Any = {"one": 0.08}.get(model, gamma if model == "maps" else gamma[None])
        surface = impasto.Surface.torrance_sparrow(normal, diffuse, strengths, widths, **options)
    lights: list[Any] = []
    for _ in range(draw(st.integers(1, 3))):
        azimuth = draw(st.one_of(st.floats(0.0, 6.2), st.just(2.0 * math.pi)))
        if draw(st.booleans()):
            # At the bound of shadows, a little below and above.
            factor = draw(st.sampled_from((0.7, 0.99, 0.9999, 1.0001, 1.01, 3.0)))
            tangent = factor * max(steepest(height, azimuth, pitch), 0.02)
            # A lamp with a size reaches lower by its radius.
            radius = draw(st.sampled_from((0.0, 0.0, 1e-4, 0.02, 0.3)))
            towards = direction(azimuth, math.tan(min(math.atan(tangent) + radius, 1.5)))
            lights.append(impasto.DistantLight(towards, radius=radius))
        else:
            x, y = (200.0 * value for value in direction(azimuth, 0.0)[:2])
            far = draw(st.sampled_from((60.0, 900.0, 1e6)))
            radius = far * draw(st.sampled_from((0.0, 0.0, 0.1)))
            intensity = draw(st.floats(0.01, 2.0))
            lights.append(impasto.PointLight((x, y, far), intensity, radius=radius))
    eyes = ((0.3, -0.2, 0.9), (1e-7, 0.0, 1.0), (1.2e-5, 1.2e-5, 1.0), (4e-3, 0.0, 1.0))
    near = (impasto.PointView((9, 5, 400)), impasto.PointView((0, 0, 300)))
    view = draw(st.sampled_from((None, *eyes, *near)))
    scene = impasto.Scene(
        lights,
        environment=draw(st.sampled_from((None, None, None, ROOM))),
        view=view,
        shadows=draw(st.booleans()),
        perspective=view in near and draw(st.booleans()),
        parallax=draw(st.sampled_from((None, False, True))),
        # An effect may change the brightest pixel: under "maximum" nothing is left out.
        exposure=draw(st.sampled_from((None, 0.5) if faint else (None, 0.5, "maximum"))),
        background=draw(st.sampled_from(((0.0, 0.0, 0.0), (0.2, 0.5, 1.0)))),
    )
    return surface, scene


@pytest.mark.filterwarnings("ignore:normal")  # of other lengths, on purpose
@settings(max_examples=120, deadline=None, derandomize=True)
@given(scenes())
def test_without_a_tolerance_a_planned_picture_has_the_bits_of_the_forced_one(
    case: tuple[impasto.Surface, impasto.Scene],
) -> None:
    surface, scene = case
    plan = impasto.plan(surface, scene, threads=1)
    # Display codes are made in one pass, light in another.
    planned, forced = plan.render(threads=1), plan.forced().render(threads=1)
    assert planned.xyz.tobytes() == forced.xyz.tobytes()
    assert planned.coverage.tobytes() == forced.coverage.tobytes()
    assert planned.display.tobytes() == forced.display.tobytes()
    assert (planned.clipped, planned.outside) == (forced.clipped, forced.outside)
    clipped = {"clipping": planned.clipped, "gamut clipping": planned.outside}
    for name, shares in clipped.items():
        assert decisions(plan)[name][0] == "on" or max(shares.values()) == 0.0
    assert plan.error == 0.0


@pytest.mark.filterwarnings("ignore:normal")  # of other lengths, on purpose
def test_planned_pictures_stay_within_their_tolerance() -> None:
    left_out: list[bool] = []

    @settings(max_examples=100, deadline=None, derandomize=True)
    @given(
        st.booleans().flatmap(lambda faint: scenes(faint)),
        st.sampled_from(("dE:0.5", "dE:3", "code:1", "code:5")),
    )
    def check(case: tuple[impasto.Surface, impasto.Scene], tolerance: str) -> None:
        surface, scene = case
        plan = impasto.plan(surface, scene, tolerance=tolerance, threads=1)
        found = plan.verify(threads=1)
        left_out.append(any(effect.decision == "bounded" for effect in plan.effects))
        limit = float(tolerance.split(":")[1])
        assert plan.error <= limit
        # Light in single precision: a difference of 1e-6 of white is 0.001 of a dE00 in the dark.
        if tolerance.startswith("dE"):
            assert found.delta_e <= plan.error + 0.002
        else:
            # Codes are rounded after the difference that the tolerance means.
            assert found.codes <= math.ceil(limit)

    check()
    # Else nothing would be said of bounds. About a third leave something out; how many depends
    # on the modules that are imported, whose constants Hypothesis draws among its numbers.
    assert sum(left_out) >= 10


def frontal(columns: int, **options: Any) -> impasto.Surface:
    """A level surface with a lobe of 0.05 rad in its right half."""
    size = (TILE, columns)
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    beta = np.zeros(size, np.float32)
    beta[:, columns // 2 :] = 0.5
    diffuse = np.full((3, *size), 0.4, np.float32)
    return impasto.Surface.torrance_sparrow(
        normal, diffuse, beta, 0.05, pitch_mm=0.5, height=np.zeros(size, np.float32), **options
    )


def decisions(plan: impasto.Plan) -> dict[str, tuple[str, int]]:
    return {effect.name: (effect.decision, effect.tiles) for effect in plan.effects}


def test_each_effect_is_decided_and_says_why() -> None:
    scene = impasto.Scene([impasto.DistantLight((0.1, 0.0, 1.0))], shadows=True)
    plan = impasto.plan(frontal(2 * TILE), scene)
    found = decisions(plan)
    assert found["diffuse"] == ("on", 2)
    assert found["coated diffuse"] == ("absent", 0)
    # The left tile has no lobe; the highlight of the right one is in view.
    assert found["lobe 1"] == ("on", 1)
    assert found["cast shadows"] == ("no-op", 0)
    assert found["near light"] == ("absent", 0)
    assert found["spectra"][0] == "absent"
    text = plan.explain()
    assert "steepest rise towards light 1: 0.000; the light: 10.000" in text
    assert "on (1/2 tiles)" in text
    assert json.loads(plan.to_json())["effects"][0]["effect"] == "diffuse"
    without = "cast shadows, clipping, gamut clipping"
    assert repr(plan) == f"<Plan diffuse, lobe 1, without {without}, tolerance 0>"


def test_a_lobe_that_is_out_of_sight_is_left_out_within_the_tolerance() -> None:
    # 40 degrees from the mirror direction of a lobe of 0.05 rad: exp(-0.69 (0.35 / 0.05)^2).
    side = impasto.Scene([impasto.DistantLight(direction(0.3, 1.2))], exposure=1.0)
    surface = frontal(2 * TILE)
    exact = impasto.plan(surface, side)
    rough = impasto.plan(surface, side, tolerance="dE:0.5")
    assert decisions(exact)["lobe 1"] == ("on", 1)
    assert decisions(rough)["lobe 1"] == ("bounded", 0)
    assert 0.0 < rough.error <= 0.5
    assert decisions(rough.forced())["lobe 1"] == ("on", 2)


def test_a_far_lamp_is_taken_for_a_distant_one_within_the_tolerance() -> None:
    surface = frontal(2 * TILE)
    far = impasto.Scene([impasto.PointLight((0.0, 8e6, 8e6))])
    near = impasto.Scene([impasto.PointLight((0.0, 300.0, 300.0))])
    assert decisions(impasto.plan(surface, far))["near light"][0] == "on"
    assert decisions(impasto.plan(surface, far, tolerance="dE:0.5"))["near light"][0] == "bounded"
    assert decisions(impasto.plan(surface, near, tolerance="dE:0.5"))["near light"][0] == "on"


def test_a_plan_for_another_scene_uses_the_statistics_again() -> None:
    surface = frontal(2 * TILE)
    first = impasto.plan(surface, impasto.Scene([impasto.DistantLight((0.1, 0.0, 1.0))]))
    scene = impasto.Scene([impasto.DistantLight((0.9, 0.0, 0.2))], shadows=True)
    again, fresh = first.with_scene(scene), impasto.plan(surface, scene)
    assert again._statistics is not first._statistics  # without a relief
    assert again.explain() == fresh.explain()
    assert again.render().xyz.tobytes() == fresh.render().xyz.tobytes()
    third = again.with_scene(scene)
    assert third._statistics is again._statistics
    assert third.explain() == fresh.explain()


def test_statistics_are_made_anew_where_a_scene_changes_the_maps() -> None:
    """Of a leaning panel with steep cells, whose shadows rotate it, and under a varnish."""
    rng = np.random.default_rng(4)
    slopes = 0.3 + rng.normal(0.0, 0.1, (2, 300, 270))
    normal = np.stack([*slopes, np.ones_like(slopes[0])])
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    surface = impasto.Surface.torrance_sparrow(normal, rng.random((3, 300, 270)), 0.5, 0.05)
    light = impasto.DistantLight(direction(3.9, 0.3))
    shadows = impasto.Scene([light], shadows=True, exposure=1.0)
    bare = impasto.Scene([light], exposure=1.0)
    for first, second in ((shadows, bare), (bare, shadows)):
        plan = impasto.plan(surface, first, tolerance="dE:1").with_scene(second)
        assert plan.explain() == impasto.plan(surface, second, tolerance="dE:1").explain()
    painting = simulate.painting(size=(32, 32))
    varnished = impasto.Scene([light], varnish=impasto.Varnish())
    plan = impasto.plan(painting, bare).with_scene(varnished)
    assert plan.verify().equal
    assert plan.explain() == impasto.plan(painting, varnished).explain()


def test_many_lobes_are_left_out_together_or_not_at_all() -> None:
    """Lobes beyond the 28th share a decision: none may go without its part of the error."""
    surface = frontal(8)
    weak = [impasto.surface.Lobe(1e-6, (0.3,))] * 29
    many = replace(surface, lobes=(*weak, impasto.surface.Lobe(50.0, (0.3,))))
    scene = impasto.Scene([impasto.DistantLight((0.1, 0.0, 1.0))], exposure=1.0)
    plan = impasto.plan(many, scene, tolerance="dE:0.5")
    assert plan.verify().delta_e <= plan.error + 0.002


def test_lights_of_a_room_are_diffuse_light() -> None:
    room = impasto.Environment.named("gallery")
    plan = impasto.plan(frontal(8), impasto.Scene(environment=room))
    assert decisions(plan)["diffuse"] == ("on", 1)
    assert decisions(plan)["environment"] == ("on", 1)
    assert plan.verify().equal


def test_a_map_that_is_no_number_shows_the_background_lit_or_not() -> None:
    """Where the plan needs no lobe and no lamp, the picture has the same holes."""
    for light in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.05)):
        scene = impasto.Scene([impasto.DistantLight(light)], background=(0.2, 0.5, 1.0))
        for beta, gamma in ((np.nan, 1e-3), (0.5, np.nan)):
            surface = frontal(8)
            normal = surface.normal.copy()
            normal[:] = np.array([-0.6, 0.0, 0.8])[:, None, None]
            strength, width = np.full((2, TILE, 8), 0.5), np.full((2, TILE, 8), 1e-3)
            strength[0, 3, 3], width[0, 3, 3] = beta, gamma
            holed = impasto.Surface.torrance_sparrow(normal, surface.diffuse, strength, width)
            plan = impasto.plan(holed, scene)
            assert plan.render().coverage[3, 3] == 0.0
            assert plan.verify().equal


def test_a_slanted_view_is_never_left_out() -> None:
    """A highlight beside black moves; a picture from the corner has another size."""
    bright = impasto.Surface(
        frontal(175).normal, np.where(np.arange(175) % 7, 0.0, 1e3) * np.ones((3, TILE, 1))
    )
    for view in ((4e-3, 0.0, 1.0), (1.2e-5, 1.2e-5, 1.0)):
        scene = impasto.Scene([impasto.DistantLight((0, 0, 1))], view=view, exposure=1.0)
        plan = impasto.plan(bright, scene, tolerance="code:10")
        assert decisions(plan)["slanted view"][0] == "on"
        assert plan.verify().equal


def test_a_tolerance_is_rendered_with_and_a_backend_checked() -> None:
    surface = frontal(2 * TILE)
    # 10 degrees off the mirror direction of a lobe of 0.05 rad: too little to see, enough for bits.
    side = impasto.Scene([impasto.DistantLight(direction(0.3, 2.6))], exposure=1.0)
    rough = impasto.render(surface, side, tolerance="dE:0.5")
    assert (
        rough.xyz.tobytes()
        == impasto.plan(surface, side, tolerance="dE:0.5").render().xyz.tobytes()
    )
    assert rough.xyz.tobytes() != impasto.render(surface, side).xyz.tobytes()
    for backend in ("vulkan", None):
        wrong: Any = backend
        with pytest.raises(ArgumentError, match="backend"):
            impasto.plan(surface, side).render(backend=wrong)


def test_an_exposure_from_the_picture_is_said_to_leave_out_nothing() -> None:
    scene = impasto.Scene([impasto.DistantLight((0, 0, 1))], exposure="maximum")
    text = impasto.plan(frontal(8), scene, tolerance="dE:3").explain()
    assert "the exposure follows from the picture: nothing is left out by a bound" in text


def test_a_measured_plan_says_what_is_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that is put in: seconds of one picture after another."""
    scene = impasto.Scene([impasto.DistantLight((0.1, 0.0, 1.0))], shadows=True)
    plan = impasto.plan(frontal(2 * TILE), scene)
    everything = [9.0, 1.02, 1.0, 1.01]  # the first is not counted
    for lobe, shadows, saved in (
        # 0.4 s in one of two tiles; 0.01 s are less than the spread of all effects.
        ([0.7, 0.6, 0.65], [1.0, 0.99, 0.99], (0.2, 0.0)),
        # 0.05 s exceed either spread, in two of two tiles; a longer picture saves nothing.
        ([1.3, 1.2, 1.2], [0.96, 0.95, 0.96], (0.0, 0.05)),
        # 0.4 s are less than the spread of the pictures without the lobe.
        ([1.1, 0.6, 0.7], [1.0, 1.0, 1.0], (0.0, 0.0)),
    ):
        seconds, clock = iter([*everything, *lobe, *shadows]), [0.0]

        def render(*_: Any, seconds: Any = seconds, clock: Any = clock, **__: Any) -> None:
            clock[0] += next(seconds)

        def now(clock: Any = clock) -> float:
            return float(clock[0])

        with monkeypatch.context() as patched:
            patched.setattr(impasto.Plan, "render", render)
            patched.setattr(time, "perf_counter", now)
            measured = plan.measured(threads=1)
        assert next(seconds, None) is None
        saves = {effect.name: effect.saves for effect in measured.effects}
        assert saves["diffuse"] is None
        assert (saves["lobe 1"], saves["cast shadows"]) == pytest.approx(saved)
        assert f"{1e3 * saved[0]:.1f} ms" in measured.explain()
    assert " ms" in plan.measured(threads=1).explain()


@pytest.mark.parametrize(
    "tolerance", ["dE", "dE:x", "dE:-1", "dE:nan", "lab:1", 0.5, "1", False, np.zeros(3), 0j]
)
def test_a_tolerance_that_is_none_is_refused(tolerance: Any) -> None:
    scene = impasto.Scene([impasto.DistantLight((0.0, 0.0, 1.0))])
    with pytest.raises(ArgumentError, match=r'tolerance: expected 0, "code:1"'):
        impasto.plan(frontal(8), scene, tolerance=tolerance)

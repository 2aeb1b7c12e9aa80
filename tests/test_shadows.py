"""Cast shadows: steps and wedges of known shadow, and a march along the same lines."""

from __future__ import annotations

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, GeometryError

PITCH = 0.2


def marched(height: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Depth below the shadow's surface in float64, from its definition (brute force).

    Lines run away from the light, one row per step (the picture is transposed where the light
    crosses columns faster); on each, height is interpolated linearly between two pixels of the row;
    a sample's depth is max over all samples towards the light of (their height - distance * fall)
    minus its own height; a pixel's depth is interpolated between the two lines beside it.
    """
    x, down, z = light[0], -light[1], light[2]
    if abs(x) > abs(down):
        return marched(height.T, np.array([down, -x, z])).T
    if down > 0:
        return marched(height[::-1], np.array([x, -light[1], z]))[::-1]
    rows, columns = height.shape
    shear = -x / abs(down)
    fall = z * PITCH * np.hypot(1.0, shear) / np.hypot(x, down)
    padded = np.pad(height.astype(np.float64), ((0, 0), (1, 1)), mode="edge")

    def sample(row: int, at: np.ndarray) -> np.ndarray:
        inside = (at >= -1) & (at <= columns)
        place = np.clip(at + 1, 0, columns + 1)
        left = np.minimum(place.astype(int), columns)
        part = place - left
        value = (1 - part) * padded[row, left] + part * padded[row, left + 1]
        return np.where(inside, value, -np.inf)

    depth = np.full((rows, columns), -np.inf)
    for row in range(rows):
        shift = np.float64(np.floor(shear * row))
        part = shear * row - shift
        sides = []
        for offset in (-1, 0):
            line = np.arange(columns) + offset - shift
            own = sample(row, line + shear * row)
            above = [sample(r, line + shear * r) - (row - r) * fall for r in range(row)] or [
                np.full(columns, -np.inf)
            ]
            with np.errstate(invalid="ignore"):
                sides.append(np.maximum(np.max(above, axis=0) - own, -1e9))
        depth[row] = part * sides[0] + (1 - part) * sides[1]
    return depth


@pytest.mark.parametrize(
    "light",
    [(0.9, 0.0, 0.2), (0.0, -0.9, 0.2), (0.5, 0.7, 0.3), (-0.8, 0.31, 0.15), (0.6, -0.6, 0.3)],
)
def test_the_sweep_is_a_march_along_the_same_lines(light: tuple) -> None:
    rng = np.random.default_rng(11)
    height = rng.uniform(0.0, 0.4, (40, 33)).astype(np.float32)
    depth = marched(height, np.array(light))
    visible = impasto.cast_shadows(height, PITCH, light)
    # Single precision: 40 roundings of numbers below 8 (heights and falls), 2e-5 in all; closer
    # decisions may go either way.
    sure = np.abs(depth) > 2e-5
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(visible[sure] == 0.0, depth[sure] > 0.0)
    assert 0.05 < visible.mean() < 0.95


def test_a_step_throws_a_shadow_of_height_over_tangent() -> None:
    height = np.zeros((30, 60), np.float32)
    height[:, 40:] = 1.0
    visible = impasto.cast_shadows(height, PITCH, (0.8, 0.0, 0.6))
    # 1 mm / 0.75 = 1.333 mm = 6.67 pixels left of column 40.
    np.testing.assert_array_equal(visible[:, 34:40], 0.0)
    assert visible[:, :33].all()
    assert visible[:, 40:].all()


@pytest.mark.parametrize("azimuth", np.deg2rad([0, 30, 45, 77, 130, 215, 300]))
def test_a_wedge_is_dark_below_its_own_slope_and_lit_above(azimuth: float) -> None:
    # A ridge of slope 0.5 across the light's azimuth.
    y, x = np.mgrid[:81, :81]
    along = (x - 40) * np.cos(azimuth) + (40 - y) * np.sin(azimuth)
    height = (-0.5 * PITCH * np.abs(along)).astype(np.float32)
    inner = (slice(15, -15), slice(15, -15))
    for elevation, lit in ((0.6, True), (0.4, False)):
        light = (np.cos(azimuth), np.sin(azimuth), elevation)
        visible = impasto.cast_shadows(height, PITCH, light)[inner]
        away = along[inner] < -2
        assert (visible[away] == float(lit)).all()
        assert visible[along[inner] > 2].all()


def test_a_point_light_throws_longer_shadows_further_away() -> None:
    height = np.zeros((21, 201), np.float32)
    height[:, 60] = height[:, 140] = 1.0
    # Above the left end at 10 mm height: column 0 lies at x = -20 mm.
    visible = impasto.cast_shadows(height, PITCH, (-20.0, 0.0, 10.0), point=True)[10]
    # Similar triangles from (0 px, 10 mm) over (c px, 1 mm): the shadow ends at c * 10 / 9.
    for wall in (60, 140):
        end = wall * 10.0 / 9.0
        columns = np.arange(wall + 1, 201 if wall == 140 else 140)
        dark = columns[visible[columns] == 0.0]
        assert dark.min() == wall + 1
        assert abs(dark.max() - end) < 1.0


def test_a_far_point_light_is_a_distant_one_along_rows() -> None:
    rng = np.random.default_rng(2)
    height = rng.uniform(0.0, 0.3, (20, 50)).astype(np.float32)
    near = impasto.cast_shadows(height, PITCH, (9e6, 0.0, 3e6), point=True)
    far = impasto.cast_shadows(height, PITCH, (0.9, 0.0, 0.3))
    # Ties apart, which random heights do not make.
    np.testing.assert_array_equal(near, far)


def test_threads_change_no_bit() -> None:
    rng = np.random.default_rng(5)
    height = rng.uniform(0.0, 0.3, (90, 1200)).astype(np.float32)
    for light, point in (((0.3, 0.8, 0.3), False), ((40.0, 9.0, 30.0), True)):
        one, three = (
            impasto.cast_shadows(height, PITCH, light, point=point, threads=n) for n in (1, 3)
        )
        np.testing.assert_array_equal(one, three)


def test_a_scene_with_shadows_darkens_only_the_shaded() -> None:
    height = np.zeros((20, 60), np.float32)
    height[:, 30] = 1.0
    painting = impasto.Surface(
        np.broadcast_to(np.array([0, 0, 1], np.float32)[:, None, None], (3, 20, 60)),
        np.full((3, 20, 60), 0.5, np.float32),
        pitch_mm=PITCH,
    )
    lights = [(0.8, 0.0, 0.6)]
    plain = impasto.render(painting, impasto.Scene(lights))
    shaded = impasto.render(painting, impasto.Scene(lights, shadows=True), height=height)
    visible = impasto.cast_shadows(height, PITCH, lights[0])
    np.testing.assert_array_equal(shaded.xyz, plain.xyz * visible)
    assert (visible == 0).any()


@pytest.mark.parametrize(
    ("height", "light", "error", "words"),
    [
        (np.zeros((4, 4)), (1, 0, 0), GeometryError, "light: it stands behind"),
        (np.zeros((4, 4)), (1, 0), ArgumentError, "light: expected"),
        (np.zeros(4), (0, 0, 1), ArgumentError, "height: expected"),
    ],
)
def test_wrong_arguments_are_named(height, light, error, words) -> None:
    with pytest.raises(error, match=words):
        impasto.cast_shadows(height, PITCH, light)


def test_a_lamp_with_a_size_softens_the_edge_and_keeps_its_middle() -> None:
    height = np.zeros((20, 120), np.float32)
    height[:, 80:] = 2.0
    light = np.array([0.8, 0.0, 0.6])
    hard = impasto.cast_shadows(height, PITCH, light)[10]
    soft = impasto.cast_shadows(height, PITCH, light, radius=0.1)[10]
    # Half of the lamp is seen where the hard shadow ends, to a pixel.
    edge = int(np.flatnonzero(hard[:80] == 0.0).min())
    assert abs(float(soft[edge - 1 : edge + 1].mean()) - 0.5) < 0.15
    # From 36.9 - 5.7 to 36.9 + 5.7 degrees: 10 / tan = 16.5 to 10.9 pixels before the step.
    partly = np.flatnonzero((soft > 0.01) & (soft < 0.99))
    assert 80 - 17.5 <= partly.min() <= 80 - 14
    assert 80 - 13 <= partly.max() <= 80 - 9.9
    assert (np.diff(soft[:80]) <= 1e-6).all()
    near = impasto.cast_shadows(height, PITCH, 5000.0 * light, point=True, radius=500.0)[10]
    # 32 points of the lamp.
    np.testing.assert_allclose(near[:80], soft[:80], atol=0.12)
    with pytest.raises(ArgumentError, match="radius"):
        impasto.cast_shadows(height, PITCH, light, radius=-1.0)


def test_a_ditch_sees_the_sky_of_two_planes() -> None:
    # A groove along y whose walls rise by 45 degrees: at its bottom each side hides what a plane of
    # 45 degrees hides of its half, so that cos 45 remains.
    x = np.abs(np.arange(-60, 61)) * PITCH
    height = np.broadcast_to(x, (121, 121)).astype(np.float32)
    seen = impasto.sky_visibility(height, PITCH, azimuths=64)
    # Walls end at 60 pixels, and along y after as many: an eighth of the azimuths see past them.
    assert abs(seen[60, 60] - np.sqrt(0.5)) < 0.02
    flat = impasto.sky_visibility(np.zeros((9, 9)), PITCH)
    np.testing.assert_allclose(flat, 1.0, atol=1e-6)
    np.testing.assert_array_equal(
        seen, impasto.sky_visibility(height, PITCH, azimuths=64, threads=3)
    )
    for wrong in ({"azimuths": 3}, {"azimuths": 8.5}, {"albedo": 1.5}):
        with pytest.raises(ArgumentError):
            impasto.sky_visibility(height, PITCH, **wrong)


def bowl_by_brute_force(opening: float, albedo: float) -> float:
    """Irradiance at the bottom of a part of a sphere under an even sky, by sums of form factors.

    The open sky's is 1. ``opening`` is the angle at the centre from the bottom to the rim. Light
    comes through the disc within the rim, which is as bright as the sky, to the bottom and to every
    part of the bowl, and from there, reflected once by Lambert's law, to the bottom.
    """
    middle = (np.arange(200) + 0.5) / 200
    rim, top = np.sin(opening), -np.cos(opening)  # of a sphere of radius 1 about the origin
    radius, angle = (axis.ravel() for axis in np.meshgrid(middle * rim, middle * 2 * np.pi))
    disc = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(radius, top)])
    area = radius * (rim / 200) * (2 * np.pi / 200)

    def exchanged(place: np.ndarray, others: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """cos cos' / (pi r^2) from a place of the bowl, whose normal is to its centre."""
        way = others - place[:, None]
        square = (way**2).sum(axis=0)
        return np.asarray((-place @ way) * -(normals * way).sum(axis=0) / (np.pi * square**2))

    down = np.broadcast_to([[0.0], [0.0], [-1.0]], disc.shape)

    def sky(polar: float) -> float:
        place = np.array([np.sin(polar), 0.0, -np.cos(polar)])
        return float((exchanged(place, disc, down) * area).sum())

    bounced = 0.0
    for polar in middle * opening:
        place = np.array([[np.sin(polar)], [0.0], [-np.cos(polar)]])
        ring = 2 * np.pi * np.sin(polar) * opening / 200
        factor = exchanged(np.array([0.0, 0.0, -1.0]), place, -place)[0]
        # Close to the rim the disc's parts are coarse.
        inside = min(polar, opening - 0.05)
        bounced += ring * factor * sky(inside)
    return sky(0.0) + albedo * bounced


@pytest.mark.parametrize("opening", np.radians([50, 90]))
def test_one_bounce_in_a_bowl_is_the_sum_over_its_parts(opening: float) -> None:
    """Where every place sees as much of the sky, the one assumption that is made is true."""
    rows, columns = np.mgrid[-75:76, -75:76]
    away = np.hypot(rows, columns) / 60.0 * np.sin(opening)
    bowl = -np.sqrt(np.maximum(1.0 - away**2, np.cos(opening) ** 2))
    height = 60.0 * PITCH / np.sin(opening) * bowl
    for albedo in (0.0, 0.3, 0.8):
        found = impasto.sky_visibility(height, PITCH, azimuths=64, albedo=albedo)[75, 75]
        # A sample on the rim lies up to a pixel of 60 outside it: the tangent of the horizon is too
        # low by up to 1 / 60, the square of its sine, at most 0.5, by 2 / 60 of cos^2 of that.
        assert abs(found - bowl_by_brute_force(opening, albedo)) < 0.015


def test_one_bounce_has_its_limits() -> None:
    """Nothing is added where all of the sky is seen, up to as much again where hardly any is."""
    for albedo in (0.0, 0.5, 1.0):
        flat = impasto.sky_visibility(np.zeros((9, 9)), PITCH, albedo=albedo)
        np.testing.assert_allclose(flat, 1.0, atol=1e-6)
    shaft = np.zeros((41, 41))
    shaft[18:23, 18:23] = -60 * PITCH
    dark, *lit = (
        impasto.sky_visibility(shaft, PITCH, albedo=albedo)[20, 20] for albedo in (0.0, 0.5, 1.0)
    )
    # 60 pixels deep, its edges between pixels at most 4.3 away: (4.3 / 60)^2 of the sky.
    assert 0.0 < dark <= 0.0051
    # Of 1 + albedo (1 - V), V at most.
    np.testing.assert_allclose(lit, [1.5 * dark, 2.0 * dark], rtol=0.0051)


def test_relief_moves_what_is_seen_from_the_side() -> None:
    height = np.zeros((40, 80), np.float32)
    height[10:30, 30:50] = 1.0
    colours = np.full((3, 40, 80), 0.1, np.float32)
    colours[:, 10:30, 30:50] = 0.8
    normal = np.zeros((3, 40, 80), np.float32)
    normal[2] = 1.0
    painting = impasto.Surface(normal, colours, height=height, pitch_mm=PITCH)
    lights = [(0.0, 0.0, 1.0)]
    view = (0.6, 0.0, 0.8)
    flat = impasto.render(painting, impasto.Scene(lights, view=view)).xyz[1]
    raised = impasto.render(painting, impasto.Scene(lights, view=view, shadows=True)).xyz[1]
    assert flat.shape == raised.shape

    def middle(picture: np.ndarray) -> float:
        bright = picture[20] > 0.5 * picture.max()
        return float(np.flatnonzero(bright).mean())

    # A block 1 mm = 5 pixels high moves away from an eye on the right by 5 sin 36.9 = 3 pixels; a
    # wall towards the eye adds half its width of 3 pixels.
    assert 1.0 < middle(flat) - middle(raised) < 3.5


def test_texts_for_numbers_are_refused_by_name() -> None:
    flat = np.zeros((3, 3))
    with pytest.raises(impasto.ArgumentError, match="light: expected three finite numbers"):
        impasto.cast_shadows(flat, PITCH, "abc")
    for call in (
        lambda wrong: impasto.cast_shadows(wrong, PITCH, (0.0, 0.0, 1.0)),
        lambda wrong: impasto.sky_visibility(wrong, PITCH),
    ):
        for wrong in ("a", [["1"]], None):
            with pytest.raises(impasto.ArgumentError, match="height: expected"):
                call(wrong)
    with pytest.raises(impasto.ArgumentError, match="normal: expected unit normals"):
        impasto.integrate_normals("a")


def bumpy(size: tuple[int, int] = (60, 300)) -> impasto.Surface:
    """A matte relief of which half is level, with its own normals, 0.5 mm a pixel."""
    rows, columns = np.mgrid[0 : size[0], 0 : size[1]]
    height = np.where(columns < 120, 0.8 * np.sin(0.35 * columns) * np.sin(0.2 * rows), 0.0)
    down, across = np.gradient(height, 0.5)
    normal = np.stack([-across, down, np.ones(size)])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = np.full((3, *size), 0.5, np.float32)
    return impasto.Surface(
        normal.astype(np.float32), diffuse, height=height.astype(np.float32), pitch_mm=0.5
    )


@pytest.mark.parametrize(
    "lamp",
    [
        impasto.DistantLight((0.9, 0.2, 0.35), radius=0.08),
        impasto.PointLight((150.0, 40.0, 60.0), radius=12.0),
    ],
    ids=["distant", "near"],
)
def test_a_lamp_with_a_size_lights_what_sees_it(
    lamp: impasto.DistantLight | impasto.PointLight,
) -> None:
    surface = bumpy()
    scene = impasto.Scene([lamp], exposure=1.0)
    bare = impasto.render(surface, scene).xyz[1]
    found = impasto.render(surface, scene.changed(shadows=True)).xyz[1]
    near = isinstance(lamp, impasto.PointLight)
    place = lamp.position if near else lamp.direction
    expected = impasto.cast_shadows(surface.height, 0.5, place, point=near, radius=lamp.radius)
    lit = bare > 0
    # Shares are 16-bit numbers: half a step is 1 / 131070.
    np.testing.assert_allclose(found[lit] / bare[lit], expected[lit], atol=1e-5)
    assert ((expected > 0.2) & (expected < 0.8)).sum() > 100


def test_a_highlight_is_as_wide_as_its_lamp() -> None:
    """Against the mean of the pictures of many lamps without a size, spread over the disc."""
    size = (1, 161)
    slope = np.linspace(-0.2, 0.2, size[1])
    normal = np.stack([np.sin(slope), np.zeros_like(slope), np.cos(slope)])[:, None]
    black = np.zeros((1, *size), np.float32)
    gloss = impasto.Surface.torrance_sparrow(normal.astype(np.float32), black, 1.0, 0.05)
    exponent = np.full((1, *size), 300.0, np.float32)
    ones = np.ones((1, *size), np.float32)
    phong = impasto.Surface.lafortune(
        normal.astype(np.float32), black, ones[None], -ones, ones, exponent
    )
    radius, many = 0.12, 400
    turn = np.arange(many) * np.pi * (3 - 5**0.5)
    away = np.tan(radius) * np.sqrt((np.arange(many) + 0.5) / many)
    lamps = [
        impasto.DistantLight((r * np.cos(a), r * np.sin(a), 1.0), 1.0 / many)
        for r, a in zip(away, turn, strict=True)
    ]
    whole = impasto.DistantLight((0.0, 0.0, 1.0), radius=radius)
    for surface in (gloss, phong):
        exact, found, point = (
            impasto.render(surface, impasto.Scene(lights, exposure=1.0)).xyz[1, 0]
            for lights in (lamps, [whole], [impasto.DistantLight((0.0, 0.0, 1.0))])
        )
        # crates/impasto/src/relight/area.rs: 0.02 of the largest value for a lobe as wide as the
        # lamp, 0.22 for one a quarter as wide; these are 0.7 and 0.5 of it.
        assert np.abs(found - exact).max() < 0.08 * exact.max()
        assert np.abs(point - exact).max() > 0.3 * exact.max()


def test_a_relief_hides_a_part_of_the_room_and_gives_back_light() -> None:
    even = impasto.Environment(np.ones((3, 64, 128)), name="even")
    surface = bumpy()
    scene = impasto.Scene(environment=even, exposure=1.0)
    bare = impasto.render(surface, scene).xyz[1].astype(np.float64)
    shaded = scene.changed(shadows=True)
    found = impasto.render(surface, shaded).xyz[1] / bare
    seen = impasto.sky_visibility(surface.height, pitch_mm=0.5, azimuths=16).astype(np.float64)
    alone = 0.5 * (1.0 + surface.normal[2].astype(np.float64))
    left = np.minimum(seen / alone, 1.0)
    np.testing.assert_allclose(found, left * (1.0 + 0.5 * (1.0 - left)), atol=1e-4)
    assert left.min() < 0.85
    # Far from the relief all above 1.8 degrees is seen: 1.6 mm / tan(1.8 degrees) = 51 mm.
    assert (found[:, -60:] == 1.0).all()
    decisions = {one.name: one.decision for one in impasto.plan(surface, shaded).effects}
    assert [decisions[name] for name in ("sky occlusion", "one bounce")] == ["on", "on"]
    level = np.zeros(surface.shape, np.float32)
    flat = impasto.Surface(surface.normal, surface.diffuse, height=level, pitch_mm=0.5)
    plan = impasto.plan(flat, shaded)
    assert {one.name: one.decision for one in plan.effects}["sky occlusion"] == "no-op"
    assert plan.verify().equal


@pytest.mark.parametrize("radius", [-0.1, 2.0, float("nan"), "wide"])
def test_a_radius_that_no_lamp_has_is_refused(radius: float) -> None:
    with pytest.raises((GeometryError, ArgumentError), match="radius: expected"):
        impasto.DistantLight((0, 0, 1), radius=radius)
    with pytest.raises((GeometryError, ArgumentError), match="radius: expected"):
        impasto.PointLight((0, 0, 3.0), radius=radius)


def test_a_tiny_lamp_is_a_point_and_lights() -> None:
    surface = bumpy()
    towards = (0.9, 0.2, 0.35)
    hard, *tiny = (
        impasto.render(
            surface, impasto.Scene([impasto.DistantLight(towards, radius=r)], shadows=True)
        ).xyz
        for r in (0.0, 1e-8, 1e-7, 9e-4)
    )
    for found in tiny:
        np.testing.assert_array_equal(found, hard)
    shadow = impasto.cast_shadows(surface.height, 0.5, towards)
    np.testing.assert_array_equal(
        impasto.cast_shadows(surface.height, 0.5, towards, radius=1e-8), shadow
    )


def test_a_near_eye_straight_in_front_sees_heights_move_outwards() -> None:
    """A plateau of 5 mm seen from 50 mm: its edge at 10 mm appears at 10 / (1 - 5 / 50) mm."""
    size = (81, 81)
    rows, columns = np.mgrid[-40:41, -40:41]
    plateau = (np.abs(rows) <= 20) & (np.abs(columns) <= 20)
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    diffuse = np.where(plateau, 0.9, 0.1)[None].astype(np.float32)
    height = np.where(plateau, 5.0, 0.0).astype(np.float32)
    surface = impasto.Surface(normal, diffuse, height=height, pitch_mm=0.5)
    scene = impasto.Scene(
        [(0.0, 0.0, 1.0)],
        view=impasto.PointView((0.0, 0.0, 50.0)),
        perspective=True,
        parallax=True,
    )
    plan = impasto.plan(surface, scene)
    assert {row.name: row.decision for row in plan.effects}["parallax"] == "on"
    shown = impasto.render(surface, scene).xyz[1]
    assert shown.shape == size
    bright = np.flatnonzero(shown[40] > 0.5 * shown.max())
    # In pixels of 0.5 mm; the edge between two pixels is straight, half a pixel either way.
    assert bright[-1] - 40 == pytest.approx(20.5 / (1 - 0.1), abs=1.0)
    flat = impasto.render(surface, scene.changed(parallax=False)).xyz[1]
    assert (np.flatnonzero(flat[40] > 0.5 * flat.max()) - 40)[-1] == 20


@pytest.mark.filterwarnings("ignore:normal")  # long ones, on purpose
def test_long_normals_see_all_of_a_level_sky() -> None:
    normal = np.zeros((3, 20, 20), np.float32)
    normal[2] = 1.5
    level = np.zeros((20, 20), np.float32)
    surface = impasto.Surface(normal, np.full((3, 20, 20), 0.5), height=level, pitch_mm=0.5)
    room = impasto.Environment(np.ones((3, 16, 32)), name="even")
    assert impasto.plan(surface, impasto.Scene(environment=room, shadows=True)).verify().equal


def test_a_perspective_needs_a_near_eye_and_a_scale() -> None:
    surface = bumpy()
    lamp = [impasto.DistantLight((0.0, 0.3, 1.0))]
    for view in (None, (0.3, 0.0, 1.0)):
        scene = impasto.Scene(lamp, view=view, perspective=True)
        with pytest.raises(ArgumentError, match="perspective: it is that of a near eye"):
            impasto.render(surface, scene)
    eye = impasto.PointView((5.0, 3.0, 90.0))
    scene = impasto.Scene(lamp, view=eye, perspective=True)
    flat = impasto.Surface(surface.normal, surface.diffuse)
    with pytest.raises(GeometryError, match="a perspective needs the width of a pixel"):
        impasto.render(flat, scene)


@pytest.mark.parametrize("rim", [30.0, 60.0])
def test_the_bottom_of_a_bowl_in_an_even_room_has_its_closed_form(rim: float) -> None:
    """A part of a sphere, up to ``rim`` degrees from its lowest point, in the painting's plane.

    Any two elements of a sphere have the form factor dA / (4 pi R^2): every place sees the same
    share F = 1 - (1 - cos(rim)) / 2 of the room, and gives light back once as rho F (1 - F).
    """
    size, radius, pitch = 161, 10.0, 0.25
    rows, columns = pitch * np.mgrid[-80:81, -80:81]
    away = np.hypot(rows, columns)
    edge = radius * np.sin(np.radians(rim))
    deep = np.sqrt(np.maximum(radius**2 - away**2, 0.0)) - radius * np.cos(np.radians(rim))
    inside = away < edge
    height = np.where(inside, -deep, 0.0)
    normal = np.stack([-columns, rows, np.sqrt(np.maximum(radius**2 - away**2, 0.0))]) / radius
    normal = np.where(inside, normal, np.array([0.0, 0.0, 1.0])[:, None, None])
    reflects = 0.5
    surface = impasto.Surface(
        normal.astype(np.float32),
        np.full((1, size, size), reflects, np.float32),
        height=height.astype(np.float32),
        pitch_mm=pitch,
    )
    room = impasto.Environment(np.full((3, 64, 128), 1.0 / np.pi), name="even")
    scene = impasto.Scene(environment=room, exposure=1.0, shadows=True)
    found = impasto.render(surface, scene).xyz[1] / reflects
    share = 1.0 - 0.5 * (1.0 - np.cos(np.radians(rim)))
    exact = share * (1.0 + reflects * (1.0 - share))
    # The rim lies between two pixels: half of 0.25 mm in 5 to 9 mm of radius, a fortieth, changes
    # the sine of its elevation by a fortieth and the hidden share of 0.07 or 0.25 by a twentieth;
    # sky below 1.8 degrees adds 0.001.
    assert found[80, 80] == pytest.approx(exact, abs=0.05 * (1.0 - share) + 0.002)
    assert found[0, 0] == pytest.approx(1.0, abs=2e-3)

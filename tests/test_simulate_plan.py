"""Photographs through a lens, and what a plan leaves out of them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage, optimize

from impasto import DistantLight, PointLight, PointView, Rig, simulate
from impasto.errors import ArgumentError
from impasto.simulate import Optics
from impasto.simulate.photographs import Photographs

SIZE = (72, 88)


@pytest.fixture(scope="module")
def painting() -> simulate.Painting:
    return simulate.painting(seed=5, size=SIZE, varnish="patches")


def photographs(painting: simulate.Painting, rig: Rig, shadows: bool = False) -> Photographs:
    diffuse = painting.reflectance_in(simulate.camera("rgb"))
    return Photographs(painting, rig, diffuse, None, shadows)


def rows(plan: simulate.CapturePlan) -> dict[str, str]:
    return {effect.name: effect.decision for effect in plan.effects}


def radii(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and radii from the middle, as shares of half the diagonal."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    half = np.sqrt(shape[0] ** 2 + shape[1] ** 2) / 2
    x, y = (x - (shape[1] - 1) / 2) / half, (y - (shape[0] - 1) / 2) / half
    return x, y, np.sqrt(x * x + y * y)


def test_vignetting_is_the_fourth_power_of_a_cosine() -> None:
    flat = Optics(vignetting=0.4).flat((101, 61))
    _, _, radius = radii((101, 61))
    # tan of the angle from the axis grows with the radius; at radius 1 cos^4 is 0.6.
    tangent = np.sqrt(1 / np.sqrt(0.6) - 1)
    expected = np.cos(np.arctan(tangent * radius)) ** 4
    assert np.abs(flat - expected).max() < 2e-7  # a rounding of single precision
    assert flat[50, 30] == 1.0


@pytest.mark.parametrize("distortion", [(-0.12, 0.01), (0.2, -0.03), (-0.3, 0.08)])
def test_a_lens_shows_a_place_where_its_polynomial_says(distortion: tuple[float, float]) -> None:
    shape = (41, 60)
    x, y = Optics(distortion=distortion).sources(shape)
    half = np.hypot(*shape) / 2
    k1, k2 = distortion
    columns, rows_, seen = radii(shape)
    for at in [(0, 0), (40, 59), (3, 50), (20, 31), (39, 2)]:
        true = optimize.brentq(lambda r, at=at: r * (1 + k1 * r**2 + k2 * r**4) - seen[at], 0, 2)
        factor = true / seen[at]
        assert x[at] == pytest.approx(factor * columns[at] * half + 29.5, abs=1e-9)
        assert y[at] == pytest.approx(factor * rows_[at] * half + 20.0, abs=1e-9)


def test_resampling_keeps_what_a_parabola_is() -> None:
    # Cubic convolution is exact for polynomials of degree two (Keys 1981), away from the edges.
    shape = (50, 64)
    optics = Optics(distortion=(-0.1, 0.0))
    y, x = np.mgrid[: shape[0], : shape[1]] / 64.0
    surface = np.asarray([1 + x + 0.5 * y + x * x - x * y], dtype=np.float32)
    at_x, at_y = (value / 64.0 for value in optics.sources(shape))
    expected = 1 + at_x + 0.5 * at_y + at_x**2 - at_x * at_y
    inside = (slice(8, -8), slice(8, -8))
    # 16 products of weights and values up to 3, each rounded twice: 32 x 3 x 2^-24.
    error = np.abs(optics.distorted(surface)[0] - expected)[inside].max()
    assert error < 32 * 3 * 2.0**-24


def test_blur_is_a_gaussian() -> None:
    rng = np.random.default_rng(1)
    light = rng.random((2, 40, 50)).astype(np.float32)
    blurred = Optics(blur=1.3).blurred(light)
    expected = ndimage.gaussian_filter(
        light.astype(float), (0, 1.3, 1.3), mode="mirror", truncate=8
    )
    # OpenCV ends its kernel of single precision at four deviations: beyond lie 6e-5 of a Gaussian's
    # weight along each axis.
    assert np.abs(blurred - expected).max() < 2 * 2 * 6.4e-5


def test_the_order_of_a_lens(painting: simulate.Painting) -> None:
    optics = Optics(vignetting=0.3, distortion=(-0.05, 0.0), blur=0.8)
    rig = Rig([DistantLight((0.2, 0.1, 1.0))], pitch_mm=painting.pitch_mm)
    off: dict[str, Any] = {"noise": False, "bits": None, "exposure": 0.1}
    plain = simulate.capture(painting, rig, "rgb", **off).stack.linear(0)
    through = simulate.capture(painting, rig, "rgb", optics=optics, **off).stack.linear(0)
    expected = optics.blurred(optics.distorted(plain)) * optics.flat(SIZE)
    assert np.allclose(through, expected, rtol=1e-6, atol=1e-7)


RIGS: dict[str, dict[str, Any]] = {
    "distant": {"lights": [DistantLight((1.0, 0.3, 0.35)), DistantLight((0.0, 0.0, 1.0))]},
    "near": {"lights": [PointLight((40.0, 10.0, 50.0)), PointLight((-10.0, 3.0, 80.0))]},
    "a disc": {"lights": [PointLight((40.0, 10.0, 50.0), radius=8.0)]},
    "slanted": {"lights": [DistantLight((0.5, 0.3, 0.8))], "views": (0.6, 0.1, 0.7)},
    "a near eye": {
        "lights": [DistantLight((0.5, 0.3, 0.8))],
        "views": PointView((9.0, 0.0, 90.0)),
    },
}


@pytest.mark.parametrize("kind", RIGS)
@pytest.mark.parametrize("shadows", [False, True])
@pytest.mark.parametrize("model", ["torrance-sparrow", "lafortune"])
def test_no_tolerance_changes_no_sample(
    painting: simulate.Painting, kind: str, shadows: bool, model: Any
) -> None:
    rig = Rig(**RIGS[kind], pitch_mm=painting.pitch_mm)
    plan = simulate.plan(painting, rig, "six-band", model=model, shadows=shadows)
    assert plan.verify() == simulate.CaptureCheck(equal=True, codes=0.0)
    assert plan.error == 0.0


@pytest.mark.parametrize("kind", ["distant", "near", "slanted", "a near eye"])
def test_light_is_what_the_surface_predicts(painting: simulate.Painting, kind: str) -> None:
    rig = Rig(**RIGS[kind], pitch_mm=painting.pitch_mm)
    light = photographs(painting, rig)
    expected = light._surface.predict(rig)
    for observation in range(len(rig)):
        shown = light.light(observation, "planned")
        # Two orders of summing a diffuse term and two lobes: a few roundings of the sum.
        assert np.allclose(shown, expected[observation], rtol=8 * 2.0**-24, atol=1e-7)


def test_what_no_photograph_needs_is_left_out() -> None:
    matte = simulate.painting(seed=2, size=SIZE, varnish=None)
    rig = Rig([DistantLight((0.0, 0.01, 1.0))], pitch_mm=matte.pitch_mm)
    plan = simulate.plan(matte, rig, "rgb", shadows=True, noise=False)
    found = rows(plan)
    assert found["lobe 1"] in {"absent", "no-op"}
    assert found["cast shadows"] == "no-op"
    assert found["shot noise"] == found["vignetting"] == "absent"
    assert found["rounding"] == "on"
    assert not set(found) & {"environment", "parallax", "slanted view"}
    assert rows(plan.forced())["cast shadows"] == "on"
    assert plan.verify().equal


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("encoding", ["linear", "srgb", "2.2", "0.8"])
def test_no_sample_is_farther_than_the_tolerance(
    painting: simulate.Painting, seed: int, encoding: str
) -> None:
    """Effects of random strength, most of them near what the tolerance allows."""
    rng = np.random.default_rng(seed)
    limit = 10 ** rng.uniform(0.5, 2.5)
    share = limit / 65535

    def some(scale: float) -> float:
        return float(rng.choice([0.0, scale * rng.uniform(0.1, 1.2)]))

    optics = Optics(
        vignetting=some(share), distortion=(some(share / 40), 0.0), blur=some(0.1 + 10 * share)
    )
    height = rng.uniform(0.2, 1.0)
    rig = Rig([DistantLight((1.0, 0.3, height)), DistantLight((-1.0, 0.3, height))])
    rig = Rig(rig, pitch_mm=painting.pitch_mm)
    read = rng.uniform(1.0, 10.0)
    noise = simulate.Noise(full_well=(some(500.0 / share) or 1.0) ** 2 + 100.0, read=read)
    plan = simulate.plan(
        painting, rig, "rgb", bits=16, noise=bool(seed % 2) and noise, optics=optics,
        encoding=encoding, tolerance=f"code:{limit}", exposure=0.4,
    )  # fmt: skip
    assert plan.error <= limit
    # Before rounding; either sample is rounded to half a code.
    assert plan.verify().codes <= plan.error + 1.0


def walled(painting: simulate.Painting) -> tuple[simulate.Painting, Rig]:
    """A wall across the painting, and a lamp whose light it keeps from a part of it."""
    height = np.zeros(SIZE, np.float32)
    height[:, 40:44] = 2.0
    rig = Rig([DistantLight((1.0, 0.0, 0.5))], pitch_mm=painting.pitch_mm)
    return replace(painting, height=height), rig


@pytest.mark.parametrize("encoding", ["2.2", "3.0", "srgb"])
@pytest.mark.parametrize("blur", [0.16, 0.17, 0.18, 0.2])
def test_the_first_light_of_a_tone_curve_counts(
    painting: simulate.Painting, encoding: str, blur: float
) -> None:
    """A billionth of light beside a shadow is many codes of a curve that rises steeply from 0."""
    wall, rig = walled(painting)
    options: dict[str, Any] = {"bits": 16, "noise": False, "exposure": 0.4, "shadows": True}
    for limit in (0.1, 1.0, 5.0, 20.0, 100.0, 1e4):
        plan = simulate.plan(
            wall, rig, "rgb", optics=Optics(blur=blur), encoding=encoding,
            tolerance=f"code:{limit}", **options,
        )  # fmt: skip
        assert plan.error <= limit
        assert plan.verify().codes <= plan.error + 1.0
    assert rows(plan)["blur"] == "bounded"


def test_the_saturation_of_a_sensor(painting: simulate.Painting) -> None:
    """A bound of light that no sample exceeds; noise has none."""
    rig = Rig([DistantLight((0.2, 0.0, 1.0)), DistantLight((0.6, 0.3, 0.5))])
    rig = Rig(rig, pitch_mm=painting.pitch_mm)
    matte = replace(painting, beta=np.zeros_like(painting.beta))
    bright = max(float(photographs(matte, rig).light(i, "forced").max()) for i in range(2))
    assert 0.3 < bright < 1.2
    found = []
    for optics in (Optics(), Optics(distortion=(-0.05, 0.0), blur=0.5)):
        for share in (0.3, 0.6, 0.99, 1.01):
            plan = simulate.plan(
                matte, rig, "rgb", noise=False, exposure=min(share / bright, 1.0), optics=optics
            )
            row = next(effect for effect in plan.effects if effect.name == "saturation")
            stack = plan.capture().stack
            clipped = float((stack.samples == 4095).mean())
            found.append((row.decision, clipped > 0.0))
            if row.decision == "no-op":
                assert clipped == 0.0
                assert "no light exceeds" in row.reason
            else:
                assert "stops too many" in row.reason
            assert plan.verify().equal
    assert ("no-op", False) in found
    noisy = simulate.plan(matte, rig, "rgb", exposure=0.2 / bright)
    row = next(effect for effect in noisy.effects if effect.name == "saturation")
    assert row.decision == "on"
    assert row.reason.startswith("noise without a bound; before it, photograph")


def test_noise_that_is_not_there_is_absent_however_it_is_left_out(
    painting: simulate.Painting,
) -> None:
    rig = Rig([DistantLight((1.0, 0.3, 0.5))], pitch_mm=painting.pitch_mm)
    noise = simulate.Noise(full_well=1e9, read=0.0)
    plan = simulate.plan(painting, rig, "rgb", bits=8, noise=noise, tolerance="code:1")
    assert rows(plan)["shot noise"] == "bounded"
    assert rows(plan)["read noise"] == rows(plan.forced())["read noise"] == "absent"


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 2), (5, 3)])
def test_a_lens_on_few_pixels(shape: tuple[int, int]) -> None:
    """Blur that is wider than the picture, distortion of its only pixel."""
    light = np.random.default_rng(0).random((2, *shape)).astype(np.float32)
    wide = Optics(blur=40.0).blurred(light)
    # A mean over all pixels, of weights of single precision: what mirrored copies make of it.
    expected = ndimage.gaussian_filter(light.astype(float), (0, 40, 40), mode="mirror", truncate=4)
    assert np.abs(wide - expected).max() < 1e-4
    lens = Optics(vignetting=0.5, distortion=(-0.1, 0.0))
    shown = lens.distorted(light)
    assert np.isfinite(shown).all()
    if shape == (1, 1):
        assert np.array_equal(shown, light)
        assert lens.flat(shape) == 1.0
    assert np.abs(shown - light).max() <= lens.moved(shape) * light.max()


def test_a_lens_that_is_accepted_finds_where_its_polynomial_says() -> None:
    """Random lenses, many of which all but fold the corners."""
    rng = np.random.default_rng(3)
    accepted = 0
    for _ in range(400):
        k1 = rng.uniform(-0.6, 0.6)
        k2 = rng.uniform(-0.4, 0.4)
        try:
            lens = Optics(distortion=(k1, k2))
        except ArgumentError:
            continue
        accepted += 1
        shape = (31, 40)
        x, y = lens.sources(shape)
        half = np.hypot(*shape) / 2
        radius = np.hypot(x - 19.5, y - 15.0) / half
        _, _, seen = radii(shape)
        error = np.abs(radius * (1 + k1 * radius**2 + k2 * radius**4) - seen)
        assert error.max() < 1e-9, (k1, k2)
        # Farther places of the painting lie farther out: nothing is shown twice.
        order = np.argsort(seen.ravel())
        assert (np.diff(radius.ravel()[order]) > -1e-9).all(), (k1, k2)
    assert accepted > 100


@pytest.mark.parametrize(
    "lamp", [PointLight((9.0, 1.0, 6.0)), PointLight((9.0, 1.0, 6.0), radius=1.5)]
)
@pytest.mark.parametrize("origin", [(0.0, 0.0), (20.0, -10.0)])
def test_a_model_of_the_caller_has_the_same_shadows(
    painting: simulate.Painting, lamp: PointLight, origin: tuple[float, float]
) -> None:
    """In a part of a painting, whose middle is not the rig's, and of a disc, too."""
    wall, _ = walled(painting)
    rig = Rig([lamp], pitch_mm=painting.pitch_mm, origin=origin)
    lit, shaded = (photographs(wall, rig, shadows).light(0, "forced") for shadows in (False, True))

    def even(normal: Any, diffuse: Any, *_: Any) -> Any:
        return np.ones((1, *diffuse.shape))

    options: dict[str, Any] = {"noise": False, "bits": None, "exposure": 0.1}
    found = simulate.capture(wall, rig, "rgb", forward=even, shadows=True, **options)
    visible = found.stack.linear(0)
    dark = visible[0] == 0.0
    assert 100 < dark.sum() < 0.5 * dark.size
    # Where light arrives at all without the wall.
    arrives = lit.min(axis=0) > 1e-6
    assert np.array_equal(dark[arrives], (shaded.max(axis=0) == 0.0)[arrives])
    partly = (visible[0] > 0.0) & (visible[0] < 0.99)
    assert partly.any() == (lamp.radius > 0.0)


def test_small_effects_are_left_out(painting: simulate.Painting) -> None:
    """The tolerance is used: what stays far below it is not simulated, what exceeds it is."""
    rig = Rig([DistantLight((1.0, 0.3, 0.5))], pitch_mm=painting.pitch_mm)
    options: dict[str, Any] = {"bits": 8, "noise": simulate.Noise(1e9, 1.0)}
    small = Optics(vignetting=2e-4, distortion=(1e-6, 0.0), blur=0.15)
    plan = simulate.plan(painting, rig, "rgb", optics=small, tolerance="code:1", **options)
    left_out = {name for name, decision in rows(plan).items() if decision == "bounded"}
    assert {"shot noise", "lens distortion", "blur", "vignetting"} <= left_out
    check = plan.verify()
    assert not check.equal
    assert check.codes <= 1.0
    large = Optics(vignetting=0.2, distortion=(0.1, 0.0), blur=1.0)
    plan = simulate.plan(painting, rig, "rgb", optics=large, tolerance="code:1", bits=8)
    assert {"shot noise", "lens distortion", "blur", "vignetting"} <= {
        name for name, decision in rows(plan).items() if decision == "on"
    }


def test_noise_that_scatters_errors_leaves_light_in_place(painting: simulate.Painting) -> None:
    """Shot noise without read noise magnifies an error of no light without bound."""
    rig = Rig([DistantLight((1.0, 0.3, 0.5))], pitch_mm=painting.pitch_mm)
    noise = simulate.Noise(full_well=1000.0, read=0.0)
    plan = simulate.plan(painting, rig, "rgb", bits=8, noise=noise, tolerance="code:2")
    assert plan.error == 0.0
    assert rows(plan)["read noise"] == "absent"


def test_a_disc_lights_as_many_points_do(painting: simulate.Painting) -> None:
    """A lamp of 3 degrees against 400 points over its disc."""
    axis, radius = np.array([0.5, 0.2, 0.8]), np.radians(3.0)
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, (0, 0, 1.0))
    across /= np.linalg.norm(across)
    turn = np.arange(400) * np.pi * (3 - np.sqrt(5))
    apart = radius * np.sqrt((np.arange(400) + 0.5) / 400)
    up = np.cross(across, axis)
    points = axis + np.tan(apart)[:, None] * (
        np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * up
    )
    disc = Rig([DistantLight(axis, radius=radius)], pitch_mm=painting.pitch_mm)
    many = Rig([DistantLight(point) for point in points], pitch_mm=painting.pitch_mm)
    light = photographs(painting, many)
    expected = np.mean([light.light(i, "planned") for i in range(400)], axis=0, dtype=np.float64)
    shown = photographs(painting, disc).light(0, "planned")
    point = photographs(painting, Rig([DistantLight(axis)], pitch_mm=painting.pitch_mm)).light(
        0, "planned"
    )
    # Lobes of the varnish are at least as wide as the lamp: off by .02 of their peak at most.
    peak = float((expected - light.diffuse * painting.normal[2]).max())
    assert np.abs(shown - expected).max() < 0.02 * peak
    assert np.abs(point - expected).max() > 0.02 * peak


def test_the_table_and_the_archive(painting: simulate.Painting) -> None:
    rig = Rig([DistantLight((1.0, 0.3, 0.5))] * 3, pitch_mm=painting.pitch_mm)
    plan = simulate.plan(painting, rig, "rgb", optics=Optics(blur=0.7))
    text = plan.explain()
    assert "blur" in text
    assert "on (3/3 tiles)" in text
    assert "photograph 1: " in text
    assert text.splitlines()[-1] == "tolerance 0; left out of any sample: at most 0"
    recorded = json.loads(plan.to_json())
    assert recorded["tiles"] == 3
    assert [row["effect"] for row in recorded["effects"]] == [row.name for row in plan.effects]
    assert "blur" in repr(plan)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"vignetting": 1.0}, "vignetting"),
        ({"vignetting": float("nan")}, "vignetting"),
        ({"distortion": (0.1,)}, "distortion"),
        ({"distortion": (float("inf"), 0.0)}, "distortion"),
        ({"distortion": (-0.5, 0.0)}, "folds"),
        ({"distortion": (5.0, 0.0)}, None),
        ({"blur": -1.0}, "blur"),
        ({"blur": "much"}, "blur"),
    ],
)
def test_lenses_that_are_none(options: dict[str, Any], named: str | None) -> None:
    if named is None:
        assert Optics(**options).displacement((40, 40))[0] > 1.0
        return
    with pytest.raises((ArgumentError, TypeError), match=named):
        Optics(**options)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"tolerance": "dE:1"}, "codes"),
        ({"tolerance": "code:1", "bits": None}, "bits"),
        ({"tolerance": 3}, "tolerance"),
        ({"optics": 0.5}, "optics"),
        ({"forward": lambda *maps: maps, "model": "lafortune"}, "forward"),
    ],
)
def test_captures_that_are_refused(
    painting: simulate.Painting, options: dict[str, Any], named: str
) -> None:
    with pytest.raises((ArgumentError, TypeError), match=named):
        simulate.capture(painting, "tominaga-rgb-camera", **options)

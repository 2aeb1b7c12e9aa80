"""The hard cases of docs/numerics.md, one test each under the row's own name.

What a search or a model must do by itself stands in crates/impasto: tests/lm, tests/brdf and beside
the code (cases 8 to 12, 16, 25, 32). Here a painting goes through the public calls. Where the case
is one of a pixel, :func:`alone` asks what every row asks: NaN exactly where the status says so,
nothing infinite, and not one bit of another pixel other than where the bad one is masked. More
tests of the same cases have the number in their name. Samples: tests/oracles, float64 numpy.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
import pytest

import impasto
from circumstances import LEARNED
from impasto import Status, simulate
from impasto.fit.lobes import fit_lobes
from oracles import forward, lafortune_forward
from oracles import pooled as oracle
from oracles.lafortune_bound import log_exponent_deviation
from oracles.rigs import spiral

SHAPE = ROWS, COLUMNS = (7, 11)
PLACE = (3, 4)
"""Where the bad pixel is: in the middle of a register and of a row."""
BETA, GAMMA = 11.0, 0.15
NOISE = 0.004
"""Of Lafortune paintings, in each of three bands."""
GREY = NOISE / np.sqrt(3.0)


LIGHTS = spiral()
WHEEL = simulate.rig("snel-lafortune").take(range(0, 770, 7))
"""110 photographs, each with a view of its own."""


def surface(tilt: float = 0.15) -> tuple[Any, Any]:
    """Normals and colours."""
    rng = np.random.default_rng(3)
    normal = np.concatenate([rng.normal(0.0, tilt, (2, *SHAPE)), np.ones((1, *SHAPE))])
    return normal / np.linalg.norm(normal, axis=0), rng.uniform(0.1, 0.6, (3, *SHAPE))


def varnished(
    noise: float = 0.002, lights: Any = None, beta: float = BETA, gamma: float = GAMMA
) -> Any:
    """``(obs, band, y, x)`` of a Torrance-Sparrow painting under the spiral."""
    clean = forward.stack(
        *surface(),
        np.full(SHAPE, beta),
        np.full(SHAPE, gamma),
        impasto.Rig(LIGHTS if lights is None else lights),
    )
    noisy = clean + noise * np.random.default_rng(5).standard_normal(clean.shape)
    return noisy.astype(np.float32)


def wheeled(lobes: list[tuple[float, float, float, float]], noise: float = NOISE) -> Any:
    """The same of Lafortune lobes (strength, Cxy, Cz, n) under the wheel."""
    numbers = np.array(lobes, np.float64).reshape(-1, 4).T[..., None, None]
    strength, cxy, cz, exponent = np.broadcast_to(numbers, (4, len(lobes), *SHAPE))
    specular = np.repeat(strength[:, None], 3, axis=1)
    clean = lafortune_forward.stack(*surface(), specular, cxy, cz, exponent, WHEEL)
    noisy = clean + noise * np.random.default_rng(6).standard_normal(clean.shape)
    return noisy.astype(np.float32)


# Four passes that keep pixels apart, or share what a bad pixel has no say in ----------------------


def stereo(samples: Any, rig: Any, **options: Any) -> impasto.Normals:
    return impasto.fit_normals(impasto.Stack(samples, lights=rig, **options), learned=LEARNED)


def pooled(samples: Any, rig: Any, **options: Any) -> impasto.PooledSbrdf:
    return impasto.fit_sbrdf(impasto.Stack(samples, lights=rig, **options), pooling="painting")


def pixel(samples: Any, rig: Any, precision: Any = "single", **options: Any) -> impasto.LobeSbrdf:
    """Lobes of every pixel, without what is typical of the painting, which all pixels vote for, and
    without asking others where to start."""
    stack = impasto.Stack(samples, lights=rig, **options)
    return fit_lobes(
        stack,
        impasto.fit_normals(stack, learned=LEARNED),
        lobes=2,
        ambient=True,
        index=1.45,
        threads=2,
        progress=False,
        typical=False,
        effort=impasto.Effort(start="multistart", precision=precision),
    )


def lafortune(samples: Any, rig: Any, **options: Any) -> impasto.LafortuneSbrdf:
    stack, normals = impasto.Stack(samples, lights=rig, **options), stereo(samples, rig, **options)
    return impasto.fit_sbrdf(stack, model="lafortune", normals=normals)


@dataclass(frozen=True)
class Pass:
    """A call, its samples and rig, and which of its maps are NaN where the status is 16 or more."""

    fit: Callable[..., Any]
    samples: Callable[[], Any]
    rig: Any
    maps: tuple[str, ...]
    colours: tuple[str, ...]
    """Known where the status is DARK, too."""


GLOSS = [(0.3, -1.0, 1.0, 40.0)]
PASSES = {
    "stereo": Pass(stereo, varnished, LIGHTS, ("normal", "condition"), ("albedo",)),
    "pooled": Pass(pooled, varnished, LIGHTS, ("normal", "residual", "sigma"), ("diffuse",)),
    "pixel": Pass(
        pixel,
        varnished,
        LIGHTS,
        ("normal", "residual", "sigma"),
        ("diffuse", "ambient", "specular"),
    ),
    "lafortune": Pass(
        lafortune,
        lambda: wheeled(GLOSS),
        WHEEL,
        ("normal", "residual"),
        ("diffuse", "specular"),
    ),
}
PASSES["double"] = dataclasses.replace(PASSES["pixel"], fit=partial(pixel, precision="double"))
EVERY = pytest.mark.parametrize("name", PASSES)


def maps(fit: Any) -> dict[str, Any]:
    """The arrays of a result that end in (y, x)."""
    found = {field.name: getattr(fit, field.name) for field in fields(fit)}
    return {
        name: value
        for name, value in found.items()
        if isinstance(value, np.ndarray) and value.shape[-2:] == SHAPE
    }


def sound(fit: Any, way: Pass) -> None:
    """NaN exactly where the status says so, and nothing infinite."""
    for name, plane in maps(fit).items():
        assert not np.isinf(plane.astype(np.float64)).any(), name
    lost = fit.status >= 16
    for name in way.maps:
        plane = getattr(fit, name)
        np.testing.assert_array_equal(np.isnan(plane), np.broadcast_to(lost, plane.shape), name)
    for name in way.colours:
        plane = getattr(fit, name)
        unknown = np.broadcast_to(lost & (fit.status != Status.DARK), plane.shape)
        np.testing.assert_array_equal(np.isnan(plane), unknown, name)
        assert (plane[~unknown] >= 0.0).all(), name


def alone(name: str, spoil: Callable[[Any], None], **options: Any) -> Any:
    """Spoils the pixel at PLACE, ``(obs, band)``; checks its neighbours; returns the fit.

    In the pooled fit a pixel that is estimated has a say in the lobe, as its neighbours have:
    there nothing may move by more than a part of its own error.
    """
    way = PASSES[name]
    samples = way.samples()
    spoil(samples[(..., *PLACE)])
    found = way.fit(samples, way.rig, **options)
    mask = np.ones(SHAPE, bool)
    mask[PLACE] = False
    without = way.fit(samples, way.rig, mask=mask, **options)
    sound(found, way)
    if name == "pooled" and found.status[PLACE] < 16:
        moved = angle(found.normal, without.normal) / without.sigma
        assert moved[mask].max() < 0.2
        return found
    for key, plane in maps(found).items():
        same = plane[..., mask].tobytes() == maps(without)[key][..., mask].tobytes()
        assert same, f"{key}: another pixel has changed"
    return found


def angle(a: Any, b: Any) -> Any:
    """Radians between unit vectors along the first axis."""
    return np.linalg.norm(np.asarray(a, np.float64) - b, axis=0)


# The cases --------------------------------------------------------------------------------------


@EVERY
def test_case_1_black_pixel(name: str) -> None:
    def black(sample: Any) -> None:
        sample[:] = 0.0

    found = alone(name, black)
    assert found.status[PLACE] == Status.DARK
    # (Lafortune's colours are NaN with the rest; those of its photometric stereo are not.)
    colour = (
        found.diffuse if name in {"pooled", "pixel"} else getattr(found, "normals", found).albedo
    )
    np.testing.assert_array_equal(colour[(..., *PLACE)], 0.0)


@EVERY
def test_case_2_all_samples_clipped(name: str) -> None:
    def clip(sample: Any) -> None:
        sample[:] = 50.0

    assert alone(name, clip, saturation=50.0).status[PLACE] == Status.SATURATED


def test_case_3_clipped_highlight() -> None:
    clear = PASSES["pixel"].samples()
    level = np.percentile(clear, 97.0)
    clipped = np.minimum(clear, np.float32(level))
    found = pixel(clipped, LIGHTS, saturation=float(level))
    sound(found, PASSES["pixel"])
    one = (found.lobes == 1) & (found.status == Status.FITTED)
    assert one.mean() > 0.8
    error = np.abs(np.log(found.gamma[0] / GAMMA))[one]
    # Samples just below the clipping level pull on the flanks: errors have longer tails than noise.
    assert np.sum(error > 3.0 * found.gamma_sigma[0][one]) <= 3
    assert np.median(error / found.gamma_sigma[0][one]) < 1.5


def test_case_4_no_sample_shows_a_highlight() -> None:
    # Lights 45 to 80 degrees from the zenith, and a lobe of 3 degrees: the facets that mirror them
    # lean by 22 degrees, where 2^-54 of it is left. Slopes of the others reach 30 degrees.
    low = LIGHTS[LIGHTS[:, 2] < np.cos(np.radians(45.0))]
    normal, diffuse = surface()
    normal[:, *PLACE] = (0.0, 0.0, 1.0)
    clean = forward.stack(
        normal, diffuse, np.full(SHAPE, BETA), np.full(SHAPE, 0.05), impasto.Rig(low)
    )
    noise = 0.002 * np.random.default_rng(5).standard_normal(clean.shape)
    found = pixel((clean + noise).astype(np.float32), low)
    sound(found, PASSES["pixel"])
    assert found.lobes[PLACE] == 0
    np.testing.assert_array_equal(found.specular[(..., *PLACE)], 0.0)
    assert np.isnan(found.gamma[(..., *PLACE)]).all()
    assert angle(found.normal, normal)[PLACE] < 3.0 * found.sigma[PLACE]


def lobes(count: int = 30) -> tuple[Any, Any]:
    """Angles and samples of single lobes, for the engine by itself."""
    rng = np.random.default_rng(7)
    phi = rng.uniform(0.0, 0.5, (16, count))
    samples = 100.0 * np.exp(-np.log(2.0) * (phi / 0.2) ** 2) + rng.standard_normal(phi.shape)
    return phi.astype(np.float32), samples.astype(np.float32)


def lobe_alone(spoil: Callable[[Any, Any], None]) -> impasto.HighlightFit:
    """Spoils pixel 0 of the engine's smallest call and checks its neighbours."""
    phi, samples = lobes()
    without = impasto.fit_highlight(phi[:, 1:], samples[:, 1:])
    spoil(phi[:, 0], samples[:, 0])
    found = impasto.fit_highlight(phi, samples)
    for field in fields(found):
        plane = getattr(found, field.name)
        assert plane[..., 1:].tobytes() == getattr(without, field.name).tobytes(), field.name
        assert not np.isinf(plane.astype(np.float64)).any(), field.name
    assert np.isnan(found.gamma[0]) == (found.status[0] >= 16)
    return found


def test_case_5_one_sample_shows_the_highlight() -> None:
    def one(phi: Any, samples: Any) -> None:
        phi[:], samples[:] = 1.5, 0.0
        phi[3], samples[3] = 0.1, 60.0

    # One equation for strength and width.
    assert lobe_alone(one).status[0] == Status.RANK_DEFICIENT


def test_case_6_mirror_sharp_lobe() -> None:
    def mirror(phi: Any, samples: Any) -> None:
        # A fifth of the least width, and a mirror's: samples a few widths apart.
        phi[:] = np.arange(16) * 1e-4
        samples[:] = 1e6 * np.exp(-np.log(2.0) * (phi / 1e-4) ** 2)

    found = lobe_alone(mirror)
    assert found.status[0] == Status.ILL_CONDITIONED
    assert found.gamma[0] == pytest.approx(5e-4, rel=1e-3)
    assert np.isfinite(found.beta[0])


def test_case_7_flat_lobe() -> None:
    def flat(phi: Any, samples: Any) -> None:
        phi[:] = np.linspace(0.0, 0.5, 16)
        samples[:] = 30.0

    found = lobe_alone(flat)
    assert found.status[0] == Status.ILL_CONDITIONED
    assert found.gamma[0] == pytest.approx(1.25, rel=1e-3)
    # Beside a diffuse part and ambient light it tells nothing that they do not: no lobe. (The peak
    # is beta F / (N.V) = 0.0014, the noise of the three bands' mean 0.0012.)
    wide = pixel(varnished(beta=0.04, gamma=1.2), LIGHTS)
    sound(wide, PASSES["pixel"])
    assert (wide.lobes == 0).mean() > 0.9


def test_case_13_exponent_towards_0() -> None:
    found = lafortune(wheeled([(0.2, -1.0, 1.0, 0.3)]), WHEEL)
    sound(found, PASSES["lafortune"])
    assert (found.lobes == 0).mean() > 0.9
    assert (found.exponent[np.isfinite(found.exponent)] >= 1.0).all()


def test_case_14_two_equal_lobes() -> None:
    found = lafortune(wheeled([(0.2, -1.0, 1.0, 40.0)] * 2), WHEEL)
    sound(found, PASSES["lafortune"])
    assert (found.lobes == 1).mean() > 0.95
    one = found.lobes == 1
    # The median of so many is known to 1.25 / sqrt(count) of what one of them is, from three bands.
    normal, diffuse = surface()
    bound = log_exponent_deviation(normal, diffuse.mean(axis=0), 0.4, 40.0, WHEEL, GREY)
    known = 1.25 / np.sqrt(one.sum()) * np.median(bound[one])
    assert abs(np.log(np.median(found.exponent[0][one]) / 40.0)) < 3.0 * known


def test_case_15_lobes_that_cancel() -> None:
    # A dark ring about a highlight: only a negative lobe would fit it.
    way = PASSES["lafortune"]
    hollow = wheeled([(0.4, -1.0, 1.0, 60.0), (-0.15, -1.0, 1.0, 15.0)], noise=0.01)
    found = lafortune(hollow, WHEEL)
    sound(found, way)
    assert (found.specular >= 0.0).all()
    assert (found.diffuse >= 0.0).all()
    # Nor do large lobes of either sign meet in the middle.
    assert np.percentile(found.specular.max(axis=(0, 1)), 95) < 1.0


def test_case_17_normal_along_the_view() -> None:
    # One view: where the normal is along it nothing depends on Cxy; Phong's lobe is fitted.
    lights = WHEEL.directions
    rig = impasto.Rig(lights)
    normal, diffuse = surface()
    normal[:, *PLACE] = (0.0, 0.0, 1.0)
    specular = np.full((1, 3, *SHAPE), 0.3)
    shape = [np.full((1, *SHAPE), v) for v in (-1.0, 1.0, 20.0)]
    clean = lafortune_forward.stack(normal, diffuse, specular, *shape, rig)
    noise = NOISE * np.random.default_rng(6).standard_normal(clean.shape)
    stack = impasto.Stack((clean + noise).astype(np.float32), lights=rig)
    known = dataclasses.replace(impasto.fit_normals(stack), normal=normal.astype(np.float32))
    found = impasto.fit_sbrdf(stack, model="lafortune", normals=known)
    sound(found, PASSES["lafortune"])
    assert found.lobes[PLACE] == 1
    assert found.cxy[0][PLACE] == -1.0
    bound = log_exponent_deviation(normal, diffuse.mean(axis=0), 0.3, 20.0, rig, GREY, free=False)
    assert abs(np.log(found.exponent[0][PLACE] / 20.0)) < 3.0 * bound[PLACE]


def test_case_18_normal_and_axes_from_one_view() -> None:
    rig = impasto.Rig(WHEEL.directions)
    specular = np.full((1, 3, *SHAPE), 0.3)
    shape = [np.full((1, *SHAPE), v) for v in (-0.8, 1.0, 20.0)]
    clean = lafortune_forward.stack(*surface(), specular, *shape, rig)
    found = lafortune(clean.astype(np.float32), rig)
    sound(found, PASSES["lafortune"])
    assert found.verdict == "one-view"
    np.testing.assert_array_equal(found.normal, found.normals.normal)
    assert np.isnan(found.sigma).all()


@pytest.mark.parametrize("name", ["stereo", "pooled", "pixel"])
def test_case_19_coplanar_lights(name: str) -> None:
    flat = LIGHTS.copy()
    flat[:, 1] = 0.0
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    with pytest.raises(impasto.GeometryError, match="plane"):
        PASSES[name].fit(varnished(), flat)
    # One pixel that only photographs with lights in a plane show.
    mixed = LIGHTS.copy()
    mixed[:6] = flat[:6]
    samples = varnished(lights=mixed)
    samples[(slice(6, None), slice(None), *PLACE)] = np.nan
    found = PASSES[name].fit(samples, mixed)
    sound(found, PASSES[name])
    assert found.status[PLACE] == Status.RANK_DEFICIENT
    assert (np.delete(found.status.ravel(), PLACE[0] * COLUMNS + PLACE[1]) < 16).all()


@EVERY
def test_case_20_lights_in_a_line(name: str) -> None:
    if name in {"stereo", "pooled", "pixel"}:
        for count in (1, 2):
            with pytest.raises(impasto.GeometryError, match="at least three lights"):
                PASSES[name].fit(varnished()[:count], LIGHTS[:count])

    def two(sample: Any) -> None:
        sample[2:] = np.nan

    assert alone(name, two).status[PLACE] == Status.TOO_FEW_SAMPLES


def test_case_21_the_same_photograph_twice() -> None:
    samples = varnished(beta=0.0)
    again = [*range(60), 7, 7, 7]
    found = impasto.fit_normals(
        impasto.Stack(samples[again], lights=LIGHTS[again]), method="least-squares"
    )
    # Weighted least squares on all samples of the mean band, in double precision: four times the
    # weight for one photograph. Attached shadows are left out by both.
    grey = samples.mean(axis=1, dtype=np.float64).reshape(60, -1)
    weight = np.ones(60)
    weight[7] = 4.0
    kept = (found.rejected.sum(axis=0) == 0).ravel()
    assert kept.any()
    root = np.sqrt(weight)[:, None]
    best = np.linalg.lstsq(root * LIGHTS, root * grey[:, kept], rcond=None)[0]
    best /= np.linalg.norm(best, axis=0)
    # Sums of 60 in single precision: some 1e-6.
    np.testing.assert_allclose(found.normal.reshape(3, -1)[:, kept], best, atol=3e-6)
    # All photographs twice are the same minimum, and the same number of lobes but for the odd
    # pixel: a criterion that counts samples counts them twice.
    noisy = varnished()
    once = pixel(noisy, LIGHTS)
    twice = pixel(np.repeat(noisy, 2, axis=0), np.repeat(LIGHTS, 2, axis=0))
    assert (once.lobes == twice.lobes).mean() > 0.9
    assert np.median(angle(once.normal, twice.normal) / once.sigma) < 0.05


@pytest.mark.parametrize("name", ["stereo", "pooled", "pixel"])
def test_case_22_grazing_light_or_view(name: str) -> None:
    # Two lights that graze the painting: half the pixels turn away from them.
    grazing = np.vstack([LIGHTS, [[0.9999, 0.0, 0.01], [0.0, -0.9998, 0.02]]])
    found = PASSES[name].fit(varnished(lights=grazing), grazing)
    sound(found, PASSES[name])
    assert (found.status < 16).all()
    plain = PASSES[name].fit(varnished(), LIGHTS)
    # The squares of the lights' x, and of their y, sum up to 18: one more is a 19th of what is
    # known of that tilt, and moves it by sqrt(1 / 19) = 0.23 of its error; half the pixels move by
    # less than 1.18 times that along both, 0.27. The median of 77 scatters by 9 %: 0.34 at most.
    assert np.median(angle(found.normal, plain.normal) / plain.sigma) < 0.34
    # Views down to the horizon: G / (N.V) is a quotient of two vanishing numbers.
    views = [[1.0, 0.0, 10.0**-k] for k in range(1, 9)]
    rig = impasto.Rig([[0.0, 0.3, 0.9]] * 8, views=views)
    shown = impasto.Surface.torrance_sparrow(*surface(), 20.0, 0.2).predict(rig)
    assert np.isfinite(shown).all()


def test_case_23_light_opposite_to_the_view() -> None:
    for off in (0.0, 1e-12, 1e-6, 1e-4):
        rig = impasto.Rig([[1.0, 0.0, off]], views=[[-1.0, 0.0, 0.0]])
        shown = impasto.Surface.torrance_sparrow(*surface(), 200.0, 0.2).predict(rig)
        assert np.isfinite(shown).all()
        if off < 1e-4:
            # There is no half vector: what is seen is diffuse, to the bit.
            np.testing.assert_array_equal(shown, impasto.Surface(*surface()).predict(rig))
    views = np.tile([0.0, 0.0, 1.0], (61, 1))
    lights = np.vstack([LIGHTS, [1.0, 0.0, 0.0]])
    views[60] = [-1.0, 0.0, 0.0]
    rig = impasto.Rig(lights, views=views)
    samples = np.concatenate([varnished(), np.zeros((1, 3, *SHAPE), np.float32)])
    found = pooled(samples, rig)
    sound(found, PASSES["pooled"])
    plain = pooled(varnished(), LIGHTS)
    assert found.gamma == pytest.approx(plain.gamma, rel=0.01)


@pytest.mark.parametrize("name", ["stereo", "pooled"])
def test_case_24_shadowed_samples(name: str) -> None:
    def shade(sample: Any) -> None:
        sample[5:60:7] *= np.float32(0.04)

    def remove(sample: Any) -> None:
        sample[5:60:7] = np.nan

    shaded, removed = alone(name, shade), alone(name, remove)
    # Under shadow or not there at all: the same normal, to a fraction of its own error.
    apart = angle(shaded.normal, removed.normal)[PLACE]
    assert apart < removed.sigma[PLACE]


@EVERY
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf], ids=str)
def test_case_26_nan_infinite_negative_samples(name: str, value: float) -> None:
    def everything(sample: Any) -> None:
        sample[:] = value

    def some(sample: Any) -> None:
        sample[2:50:7, 1] = value

    assert alone(name, everything).status[PLACE] >= 16
    assert alone(name, some).status[PLACE] < 16

    def negative(sample: Any) -> None:
        sample[:] = -0.2

    assert alone(name, negative).status[PLACE] == Status.DARK


@EVERY
def test_case_27_constant_pixel(name: str) -> None:
    def constant(sample: Any) -> None:
        sample[:] = 0.25

    found = alone(name, constant)
    if name == "pixel":
        # Light that comes from everywhere, and no lobe.
        assert found.status[PLACE] < 16
        assert found.lobes[PLACE] == 0
        np.testing.assert_allclose(found.ambient[(..., *PLACE)], 0.25, rtol=1e-3)
    rig = impasto.Rig(PASSES[name].rig)

    def matte(sample: Any) -> None:
        # Constant but for the cosine, and exact: the residuals vanish.
        sample[:] = 0.25 * np.maximum(rig.directions @ (0.0, 0.0, 1.0), 0.0)[:, None]

    found = alone(name, matte)
    assert found.status[PLACE] < 16
    assert angle(found.normal, np.array([0.0, 0.0, 1.0])[:, None, None])[PLACE] < 1e-3
    if name in {"pixel", "lafortune"}:
        assert found.lobes[PLACE] == 0


@EVERY
def test_case_28_any_scale(name: str) -> None:
    way = PASSES[name]
    samples = way.samples()
    plain = way.fit(samples, way.rig)
    shapes = {"normal", "gamma", "gamma_sigma", "cxy", "cz", "exponent", "lobes", "sigma", "status"}
    for power in (-20, 7, 20):
        scaled = way.fit(samples * np.float32(2.0**power), way.rig)
        for key, plane in maps(plain).items():
            factor = 1.0 if key in shapes else 2.0**power
            if key in shapes | {"albedo", "diffuse", "specular", "ambient", "residual"}:
                np.testing.assert_array_equal(plane * np.float32(factor), maps(scaled)[key], key)
    for scale in (1e-6, 187.0, 1e6):
        scaled = way.fit(samples * np.float32(scale), way.rig)
        sound(scaled, way)
        # Other roundings of the samples, 6e-8 each.
        assert np.median(angle(scaled.normal, plain.normal)) < 1e-5


def test_case_29_sums_over_many_pixels() -> None:
    _, _, samples = oracle.scene()
    samples = samples.reshape(-1, oracle.BANDS, *oracle.SHAPE).astype(np.float32)
    one = impasto.Stack(samples, lights=oracle.lights())
    many = impasto.Stack(np.tile(samples, (1, 1, 20, 40)), lights=oracle.lights())
    # Of the copies another sample of pixels is learned from.
    starts = [impasto.fit_normals(stack, learned=LEARNED) for stack in (one, many)]
    expected = impasto.fit_sbrdf(one, joint=False, normals=starts[0])
    options: dict[str, Any] = {"joint": False, "normals": starts[1]}
    runs = (impasto.fit_sbrdf(many, threads=threads, **options) for threads in (1, 2, 3, 5, 8))
    answers = {(found.beta, found.gamma) for found in runs}
    assert len(answers) == 1
    # 800 copies are 4.6 million samples. In single precision sums of such would stand still.
    assert answers.pop() == pytest.approx((expected.beta, expected.gamma), rel=1e-10)


@EVERY
@pytest.mark.parametrize("count", [2, 3, 4, 5, 9])
def test_case_30_few_samples(name: str, count: int) -> None:
    keep = np.linspace(0, 59, count).astype(int)

    def few(sample: Any) -> None:
        gone = np.ones(len(sample), bool)
        gone[keep] = False
        sample[gone] = np.nan

    found = alone(name, few)
    status = found.status[PLACE]
    least = 5 if name in {"pixel", "double"} else 3
    assert (status == Status.TOO_FEW_SAMPLES) == (count < least)


@pytest.mark.parametrize("name", ["stereo", "pooled", "pixel"])
def test_case_31_one_gross_outlier(name: str) -> None:
    # Lafortune's passes have their own in test_lafortune_hard_cases.py.
    way = PASSES[name]
    for level in (0.9, 5.0):

        def strike(sample: Any, level: float = level) -> None:
            sample[33] = level

        assert alone(name, strike).status[PLACE] < 16
        samples = way.samples()
        strike(samples[(..., *PLACE)])
        # Whole, with what is typical of the painting.
        fit = way.fit
        if name == "pixel":
            fit = partial(impasto.fit_sbrdf, pooling="pixel", lobes=2)
            found, clean = (fit(impasto.Stack(s, lights=way.rig)) for s in (samples, way.samples()))
            error = np.log(found.gamma[0][PLACE] / GAMMA)
            assert abs(error) < 3.0 * found.gamma_sigma[0][PLACE]
        else:
            found, clean = fit(samples, way.rig), fit(way.samples(), way.rig)
        # No farther from where it would be without than three of its errors.
        assert angle(found.normal, clean.normal)[PLACE] < 3.0 * found.sigma[PLACE]

"""Hard cases of Lafortune lobes: one lobe in each pixel, its truth known, one thing gone wrong.

Truth and samples come from `oracles/lafortune_forward.py`; what noise permits (Cramer-Rao) from
differences of `oracles/lafortune_fit.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import impasto
from impasto import Status, simulate
from impasto.simulate.score import normal_error
from oracles import lafortune_fit as one_pixel
from oracles import lafortune_forward as oracle

NOISE = 0.005
"""Of every band; the mean of three has a deviation of 0.0029."""

HEIGHT, WIDTH = 6, 8


@dataclass(frozen=True)
class Surface:
    """Pixels of one mirror lobe each, and 385 photographs of them."""

    rig: impasto.Rig
    normal: np.ndarray
    diffuse: np.ndarray
    specular: np.ndarray
    exponent: np.ndarray
    samples: np.ndarray

    def parameters(self, y: int, x: int) -> np.ndarray:
        """Slopes, then (rho_d, A, turn, ln n) of the mean of the bands."""
        a, b, c = self.normal[:, y, x]
        strength = self.specular[0, :, y, x].mean()
        matte = self.diffuse[:, y, x].mean()
        return np.array([-a / c, -b / c, matte, strength, 0.0, np.log(self.exponent[0, y, x])])

    def deviations(self, fit: impasto.LafortuneSbrdf) -> np.ndarray:
        """``(y, x, 5)`` how far the fit is from the truth, in the least deviations possible."""
        found = np.empty((HEIGHT, WIDTH, 5))
        for y, x in np.ndindex(HEIGHT, WIDTH):
            truth = self.parameters(y, x)
            a, b, c = fit.normal[:, y, x]
            shape = one_pixel.parameters(
                fit.diffuse[:, y, x].mean(), fit.specular[:1, :, y, x].mean(axis=1),
                fit.cxy[:1, y, x], fit.cz[:1, y, x], fit.exponent[:1, y, x],
            )  # fmt: skip
            off = np.array([-a / c, -b / c, *shape]) - truth
            least = np.sqrt(np.diag(self.covariance(truth)))
            found[y, x] = (np.abs(off) / least)[[0, 1, 2, 3, 5]]
        return found

    def covariance(self, truth: np.ndarray) -> np.ndarray:
        def shown(at: np.ndarray) -> np.ndarray:
            normal = np.array([-at[0], -at[1], 1.0])
            scene = one_pixel.design(normal, self.rig.directions, self.rig.views)
            return np.asarray(one_pixel.radiance(at[2:], *scene))

        steps = 1e-5 * np.eye(truth.size)
        slopes = np.array([(shown(truth + s) - shown(truth - s)) / 2e-5 for s in steps])
        return np.asarray(np.linalg.inv(slopes @ slopes.T) * NOISE**2 / 3.0)


@pytest.fixture(scope="module")
def surface() -> Surface:
    rng = np.random.default_rng(4)
    rig = simulate.rig("snel-lafortune").take(range(0, 770, 2))
    slope = rng.normal(0.0, 0.1, (2, HEIGHT, WIDTH))
    normal = np.concatenate([-slope, np.ones((1, HEIGHT, WIDTH))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.4, (3, HEIGHT, WIDTH))
    one = (1, HEIGHT, WIDTH)
    specular = np.repeat(rng.uniform(0.3, 0.8, one)[:, None], 3, axis=1)
    exponent = rng.uniform(15.0, 60.0, one)
    samples = oracle.stack(normal, diffuse, specular, -np.ones(one), np.ones(one), exponent, rig)
    samples += NOISE * rng.standard_normal(samples.shape)
    return Surface(rig, normal, diffuse, specular, exponent, samples.astype(np.float32))


def fitted(
    surface: Surface, samples: np.ndarray, saturation: float | np.ndarray | None = None
) -> impasto.LafortuneSbrdf:
    stack = impasto.Stack(samples, lights=surface.rig, saturation=saturation)
    fit = impasto.fit_sbrdf(stack, model="lafortune", lobes=1)
    assert (fit.status < Status.DARK).all()
    assert (fit.lobes == 1).all()
    return fit


@pytest.fixture(scope="module")
def clean(surface: Surface) -> impasto.LafortuneSbrdf:
    return fitted(surface, surface.samples)


def test_one_lobe_is_as_near_as_noise_permits(
    surface: Surface, clean: impasto.LafortuneSbrdf
) -> None:
    off = surface.deviations(clean)
    # 240 numbers, nearly normal: 0.3 % beyond 3 are 0.6; five is one chance in 1,500.
    assert (off > 3.0).sum() < 5
    # Half of them lie within 0.67 of a deviation; a median of 240 is known to 0.05.
    assert np.median(off) < 0.9


def test_hard_case_3_clipped_highlights_are_left_out(surface: Surface) -> None:
    level = 0.7
    clipped = np.minimum(surface.samples, level)
    assert ((clipped >= level).any(axis=(0, 1))).mean() > 0.7
    dropped = surface.deviations(fitted(surface, clipped, saturation=level))
    believed = surface.deviations(fitted(surface, clipped))
    # Within 3 of the deviations that the whole highlight permits, but for some of the pixels whose
    # peaks are missing: less is known of those lobes.
    assert (dropped > 3.0).mean() < 0.05
    assert (believed > 3.0).mean() > 0.3


def test_hard_case_24_a_view_from_behind_shows_the_diffuse_part(surface: Surface) -> None:
    # Facets so steep that some views lie behind them, where photographs still show paint.
    rng = np.random.default_rng(5)
    around = rng.uniform(0.0, 2.0 * np.pi, (HEIGHT, WIDTH))
    normal = np.array([0.5 * np.cos(around), 0.5 * np.sin(around), np.ones_like(around)])
    normal /= np.linalg.norm(normal, axis=0)
    behind = np.tensordot(surface.rig.views, normal, axes=1) < 0
    assert behind.any(axis=0).all()
    one = (1, HEIGHT, WIDTH)
    samples = oracle.stack(
        normal, surface.diffuse, surface.specular, -np.ones(one), np.ones(one),
        np.full(one, 8.0), surface.rig,
    )  # fmt: skip
    samples += NOISE * rng.standard_normal(samples.shape)
    stack = impasto.Stack(samples.astype(np.float32), lights=surface.rig)
    fit = impasto.fit_sbrdf(stack, model="lafortune", lobes=1)
    left = np.sqrt(np.mean((samples - fit.predict()) ** 2, axis=(0, 1)))
    # The fit's model is that of predict, to rounding: nothing is left out.
    assert np.allclose(fit.residual, left, rtol=1e-3)
    # What is left is the noise, known from 1155 samples to 2 %; views from behind are 0.1 of light
    # and more.
    assert np.isclose(left, NOISE, rtol=0.1).all()


@pytest.mark.parametrize("value", [2.0, 0.0])
def test_hard_case_31_gross_outliers_are_left_out(
    surface: Surface, clean: impasto.LafortuneSbrdf, value: float
) -> None:
    rng = np.random.default_rng(6)
    samples = surface.samples.copy()
    for y, x in np.ndindex(HEIGHT, WIDTH):
        lit = np.flatnonzero(samples[:, :, y, x].mean(axis=1) > 0.2)
        samples[rng.choice(lit), :, y, x] = value
    fit = fitted(surface, samples)
    # As without them, all pixels: noise alone brings none of the 240 numbers beyond 3 here.
    assert (surface.deviations(clean) <= 3.0).all()
    assert (surface.deviations(fit) <= 3.0).all()
    # One sample of 385 less changes little, and the colours and the residual have not met it.
    assert np.allclose(fit.residual, clean.residual, rtol=0.01)
    assert np.allclose(fit.diffuse, clean.diffuse, rtol=0.01)


@pytest.mark.parametrize("value", [3.0, 5.0])
@pytest.mark.parametrize("red", [np.inf, np.nan], ids=["clipped", "missing"])
def test_hard_case_31_a_flash_that_clips_one_band_is_left_out_of_all(
    surface: Surface, clean: impasto.LafortuneSbrdf, value: float, red: float
) -> None:
    rng = np.random.default_rng(6)
    samples = surface.samples.copy()
    for y, x in np.ndindex(HEIGHT, WIDTH):
        flash = rng.choice(len(samples), 3, replace=False)
        samples[flash, :, y, x] = value
        samples[flash, 0, y, x] = red
    fit = fitted(surface, samples)
    # Peaks reach 1.2: everywhere a flash is off by more than half of itself. Three photographs of
    # 385 less, and nothing of what the other bands show in them: a colour known to 0.3 % changes by
    # a tenth of that.
    assert np.allclose(fit.residual, clean.residual, rtol=0.02)
    assert np.allclose(fit.diffuse, clean.diffuse, rtol=0.01)


def matte(count: int) -> tuple[impasto.Rig, np.ndarray]:
    """Noisy paint of 0.4 in so many photographs, each from a view of its own."""
    rng = np.random.default_rng(11)
    turn, height = 2.4 * np.arange(count), rng.uniform(0.35, 0.95, count)
    out = np.sqrt(1.0 - height**2)
    lights = np.stack([out * np.cos(turn), out * np.sin(turn), height], axis=1)
    views = np.concatenate([rng.normal(0.0, 0.5, (count, 2)), np.ones((count, 1))], axis=1)
    rig = impasto.Rig(lights, views=views / np.linalg.norm(views, axis=1, keepdims=True))
    noise = rng.normal(0.0, 0.02, (count, 3, 10, 40))
    return rig, 0.4 * height[:, None, None, None] + noise


@pytest.mark.parametrize("value", [2e19, 1e25, 1e31])
def test_hard_case_28_bands_that_cancel_out_leave_no_infinity(value: float) -> None:
    # Red and green of one photograph have a mean like any other's, and squares beyond single
    # precision at the scale of that mean.
    rig, samples = matte(24)
    samples[3, 0], samples[3, 1] = value, -value
    stack = impasto.Stack(samples.astype(np.float32), lights=rig)
    fit = impasto.fit_sbrdf(stack, model="lafortune", lobes=1)
    assert (fit.status < Status.DARK).all()
    for name in ("normal", "diffuse", "specular", "residual"):
        assert np.isfinite(getattr(fit, name)).all(), name
    # Blue shows what it is.
    assert np.median(fit.diffuse[2]) == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("value", [5.0, 1e31, -1e31])
def test_hard_case_31_a_flash_is_left_out_beside_lobes_that_are(value: float) -> None:
    # Noise of matte paint in twelve photographs looks like lobes to some pixels, and none of them
    # stays. What green and blue show where red is missing was judged by the search for fewer lobes,
    # which there is none for where the last one goes: any flash was believed.
    rig, samples = matte(12)
    samples[0, 0] = np.nan
    with_flash, without = samples.copy(), samples.copy()
    with_flash[0, 1:], without[0, 1:] = value, np.nan
    fit, expected = (
        impasto.fit_sbrdf(impasto.Stack(s.astype(np.float32), lights=rig), model="lafortune")
        for s in (with_flash, without)
    )
    assert (fit.lobes == 0).sum() > 200
    for name in ("diffuse", "specular", "residual", "normal"):
        np.testing.assert_array_equal(getattr(fit, name), getattr(expected, name))


def test_a_highlight_that_clips_red_alone_stays_in_other_bands(surface: Surface) -> None:
    # Half of the pixels' peaks are beyond 0.6, by what lobes in some ten photographs of 385 show.
    level = 0.6
    samples = surface.samples.copy()
    over = samples[:, 0] >= level
    assert (over.sum(axis=0) > 4).mean() > 0.5
    fit = fitted(surface, samples, saturation=np.array([level, np.inf, np.inf]))
    # Colours are linear in what a diffuse part of 1 and the lobe of strength 1 show, by numpy.
    nothing, one = np.zeros((1, 1, HEIGHT, WIDTH)), np.ones((1, HEIGHT, WIDTH))
    shape = (fit.cxy[:1], fit.cz[:1], fit.exponent[:1], surface.rig)
    matte = oracle.stack(fit.normal, one, nothing, *shape)
    lobe = oracle.stack(fit.normal, 0.0 * one, one[None], *shape)
    columns = np.concatenate([matte, lobe], axis=1)
    every, whole = np.empty((2, 2, 3, HEIGHT, WIDTH))
    for band, y, x in np.ndindex(3, HEIGHT, WIDTH):
        shown = samples[:, band, y, x].astype(np.float64)
        counts = ~over[:, y, x]
        for found, there in ((every, counts | (band > 0)), (whole, counts)):
            pixel = columns[there, :, y, x]
            found[:, band, y, x] = np.linalg.lstsq(pixel, shown[there], rcond=None)[0]
    colours = np.stack([fit.diffuse, fit.specular[0]])
    # What is raised to a power of 60 is rounded to 1e-7, the lobe therefore to 6e-6, and colours,
    # of columns that overlap, to a few times that. Without the samples beside the clipped ones
    # noise is another.
    np.testing.assert_allclose(colours, every, rtol=5e-5)
    clipped = over.any(axis=0)
    assert np.median(np.abs(whole / every - 1.0)[1, 1:, clipped]) > 1e-3
    # And they are those that were put in, to the deviations that the whole highlight permits.
    assert np.median(np.abs(colours[1, 1:] / surface.specular[0, 1:] - 1.0)) < 0.02


def test_hard_case_31_a_sharp_highlight_is_no_outlier(surface: Surface) -> None:
    # A highlight seen in few photographs, 100 times as far above the paint as noise goes, and not
    # quite of the model's shape: all of it stays.
    one = (1, HEIGHT, WIDTH)
    cxy, cz = -np.ones(one), np.ones(one)
    sharp, halo = np.full(one, 300.0), np.full(one, 90.0)
    strong = np.full((1, 3, HEIGHT, WIDTH), 3.0)
    samples = oracle.stack(
        surface.normal, surface.diffuse, np.concatenate([strong, 0.3 * strong]),
        np.repeat(cxy, 2, axis=0), np.repeat(cz, 2, axis=0), np.concatenate([sharp, halo]),
        surface.rig,
    )  # fmt: skip
    noise = NOISE * np.random.default_rng(7).standard_normal(samples.shape)
    fit = fitted(surface, (samples + noise).astype(np.float32))
    peak = fit.specular[0].mean(axis=0)
    assert np.median(np.abs(peak / 3.9 - 1.0)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("every", [7, 1])
@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_hard_case_31_some_gross_outliers_turn_no_normal(every: int, count: int) -> None:
    # Flashes of 5 beside 0.1 to 0.6 of paint, elsewhere in every pixel; one to three lobes of their
    # own, under the whole rig and a seventh of it.
    painting = simulate.painting(seed=7, size=(12, 14), varnish="patches")
    capture = simulate.capture(painting, "snel-lafortune")
    some = capture.stack.take(range(0, 770, every))
    samples = np.array([some.linear(i) for i in range(len(some.rig))], np.float32)
    rng = np.random.default_rng(count)
    spoiled = samples.copy()
    for y, x in np.ndindex(samples.shape[2:]):
        spoiled[rng.choice(len(samples), count, replace=False), :, y, x] = 5.0
    clean, fit = (
        impasto.fit_sbrdf(impasto.Stack(s, lights=some.rig), model="lafortune")
        for s in (samples, spoiled)
    )
    error, before = (normal_error(f.normal, capture.truth.normal) for f in (fit, clean))
    # Normals that noise alone brings within 0.04 degrees (median) used to be off by 8 where two of
    # 110 photographs are outliers. Three times a pixel's own error, or 0.1 degrees, is what fewer
    # and other samples do to it by chance: a twentieth of the photographs changes an estimate by a
    # quarter of its deviation. One pixel may end in another minimum. Of 110 photographs a subset
    # has 16 for its five unknowns: five outliers leave two of seven subsets clean, and the fits of
    # those may fail in a pixel of thirty.
    turned = error > np.maximum(3.0 * before, 0.1)
    assert turned.sum() <= (5 if every == 7 else 1)
    assert np.isclose(np.median(error), np.median(before), rtol=0.25)
    assert (fit.lobes == clean.lobes).mean() > 0.95

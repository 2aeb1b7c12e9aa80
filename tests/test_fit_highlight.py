"""One lobe per pixel through samples of known angle: against SciPy, and what must not change it."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import curve_fit

import impasto
from impasto import HighlightFit, Status, fit_highlight

PIXELS = 5000  # more than a tile, and no multiple of any register


def lobes(pixels: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Angles and samples: beta 50 to 200, gamma 0.06 to 0.36, noise of 1 % of beta."""
    rng = np.random.default_rng(seed)
    beta, gamma = rng.uniform(50, 200, pixels), rng.uniform(0.06, 0.36, pixels)
    phi = rng.uniform(0.0, 0.57, (16, pixels))
    samples = beta * (model(phi, 1.0, gamma) + 0.01 * rng.standard_normal(phi.shape))
    return phi.astype(np.float32), samples.astype(np.float32)


def model(phi: np.ndarray, beta: float, gamma: float) -> np.ndarray:
    """Eq. 9 of the RGB-camera paper with F G / (N . V) = 1."""
    return np.asarray(beta * np.exp(-np.log(2) * phi**2 / gamma**2))


def same(one: HighlightFit, other: HighlightFit, take: object = slice(None)) -> bool:
    """Bit by bit, NaN included."""
    return all(
        np.array_equal(getattr(one, f.name)[..., take], getattr(other, f.name), equal_nan=True)
        for f in fields(HighlightFit)
    )


def test_it_finds_what_scipy_finds() -> None:
    phi, samples = lobes(300)
    found = fit_highlight(phi, samples)
    assert (found.status == Status.FITTED).mean() > 0.98
    for pixel in np.flatnonzero(found.status == Status.FITTED):
        (beta, gamma), covariance = curve_fit(
            model,
            phi[:, pixel].astype(float),
            samples[:, pixel].astype(float),
            (float(found.beta[pixel]), float(found.gamma[pixel])),
            ftol=1e-14,
            xtol=1e-14,
        )
        # Costs that agree to 1e-6 leave places apart by a thousandth of a standard deviation
        # times the root of the degrees of freedom; single precision's sums add as much.
        spread = np.sqrt(np.diag(covariance))
        assert abs(found.beta[pixel] - beta) < 0.01 * spread[0]
        assert abs(found.gamma[pixel] - abs(gamma)) < 0.01 * spread[1]
        entries = [covariance[0, 0], covariance[0, 1], covariance[1, 1]]
        # The matrix is taken a thousandth of a standard deviation off; its condition is below 1e3.
        assert np.allclose(found.covariance[:, pixel], entries, rtol=0.01)
        residual = samples[:, pixel] - model(phi[:, pixel].astype(float), beta, gamma)
        assert found.residual[pixel] == pytest.approx(np.sqrt((residual**2).mean()), rel=1e-4)


def test_a_hundred_thousandth_of_the_truth_without_noise() -> None:
    phi, _ = lobes(PIXELS)
    gamma = np.linspace(0.06, 0.36, PIXELS)
    found = fit_highlight(phi, model(phi.astype(float), 120.0, gamma))
    fitted = found.status == Status.FITTED
    assert fitted.mean() > 0.99
    # Samples are rounded to 6e-8; a narrow lobe has some thirty times that in its width.
    assert np.median(np.abs(found.gamma / gamma - 1)[fitted]) < 1e-5
    assert np.median(np.abs(found.beta / 120.0 - 1)[fitted]) < 1e-5


def test_threads_and_the_order_of_pixels_change_no_bit() -> None:
    phi, samples = lobes(PIXELS)
    samples[3, ::97] = np.nan
    one = fit_highlight(phi, samples, threads=1)
    for threads in (2, 3, 5, 8):
        assert same(one, fit_highlight(phi, samples, threads=threads))
    order = np.random.default_rng(1).permutation(PIXELS)
    assert same(one, fit_highlight(phi[:, order], samples[:, order]), order)
    for start in (1, 4095):
        assert same(one, fit_highlight(phi[:, start:], samples[:, start:]), slice(start, None))


def test_a_sample_that_does_not_count_changes_no_bit() -> None:
    phi, samples = lobes(500)
    one = fit_highlight(phi, samples)
    for bad in (np.nan, np.inf, -np.inf):
        row, usual = np.full((2, 1, 500), [[[bad]], [[0.1]]], np.float32)
        assert same(one, fit_highlight(np.vstack([phi, usual]), np.vstack([samples, row])))
        assert same(one, fit_highlight(np.vstack([phi, row]), np.vstack([samples, usual])))


@pytest.mark.parametrize("power", [-110, -80, -76, -65, -20, -1, 7, 20, 32, 50])
def test_a_power_of_two_changes_strengths_by_it_and_no_width(power: int) -> None:
    phi, samples = lobes(500)
    scale = np.float32(2.0**power)
    one, other = fit_highlight(phi, samples), fit_highlight(phi, samples * scale)
    assert np.array_equal(one.status, other.status)
    assert np.array_equal(one.gamma, other.gamma, equal_nan=True)
    assert np.array_equal(one.covariance[2], other.covariance[2], equal_nan=True)
    assert np.array_equal(one.beta * scale, other.beta, equal_nan=True)
    assert np.array_equal(one.residual * scale, other.residual, equal_nan=True)
    # Below the smallest normal number a variance is that number: never 0, which would be certainty.
    exact = np.maximum(one.covariance[0].astype(float) * 4.0**power, np.finfo(np.float32).tiny)
    assert np.array_equal(exact.astype(np.float32), other.covariance[0], equal_nan=True)


@pytest.mark.parametrize("scale", [1e-20, 1e10, 1e15])
def test_no_scale_ends_where_it_started(scale: float) -> None:
    phi = np.linspace(0, 0.6, 16)[:, None]
    found = fit_highlight(phi, model(phi, 3.0, 0.2) * scale)
    # Samples are rounded to 6e-8, and so is the scaled decimal.
    assert found.status[0] == Status.FITTED
    assert found.gamma[0] == pytest.approx(0.2, rel=1e-5)
    assert found.beta[0] == pytest.approx(3.0 * scale, rel=1e-5)
    assert found.covariance[0, 0] >= 0.0
    assert not np.signbit(found.covariance[0, 0])


def test_no_lobe_that_is_broader_than_its_angles_ends_half_way() -> None:
    # The first step towards a broad lobe leads beyond the bound of its strength, where the
    # quadratic model foretells a rise; the cost falls all the same. That must not stop the search.
    rng = np.random.default_rng(3)
    pixels = 100_000
    gamma = rng.uniform(0.3, 1.2, pixels)
    phi = rng.uniform(0.0, 0.57, (16, pixels))
    noise = 1e-3 * rng.standard_normal(phi.shape)
    found = fit_highlight(phi, model(phi, 1.0, gamma) + noise)
    assert np.isin(found.status, [Status.FITTED, Status.ILL_CONDITIONED]).all()
    # The minimum lies below what the truth leaves; a search ends within 1e-5 of its cost, its
    # samples are rounded to 6e-8.
    assert np.all(found.residual <= 1.001 * np.sqrt((noise**2).mean(axis=0)))


def test_samples_too_large_for_a_variance_say_so() -> None:
    phi, samples = lobes(50)
    found = fit_highlight(phi, samples * np.float32(2.0**118))
    # Strengths of 1e37 and variances of 1e70.
    assert (found.status == Status.INVALID_INPUT).all()
    assert np.isnan(found.beta).all()
    assert np.isnan(found.covariance).all()


def test_samples_far_from_the_mirror_tell_no_width_and_nothing_is_infinite() -> None:
    few = fit_highlight(np.array([1.2199, 1.2346]), np.array([0.7709, 0.4671]))
    assert few.status in (Status.RANK_DEFICIENT, Status.EXACT)
    rng = np.random.default_rng(3)
    near = fit_highlight(np.array([1.0892, 1.3217, 1.0979]), np.array([0.7033, 0.2246, 0.3583]))
    assert not np.isinf(near.covariance).any()
    for count in (2, 3, 5):
        found = fit_highlight(rng.uniform(0.8, 1.5, (count, 20_000)), rng.random((count, 20_000)))
        assert not (found.status == Status.INVALID_INPUT).any()
        unknown = found.status >= 16
        for values in (found.beta, found.gamma, *found.covariance, found.residual):
            exact = found.status == Status.EXACT
            loose = values is found.beta or values is found.gamma
            nan = unknown & (found.status != Status.DARK) if values is found.beta else unknown
            assert np.array_equal(np.isnan(values), nan if loose else nan | exact)
            assert not np.isinf(values).any()


def test_bad_pixels_have_a_status_and_leave_their_neighbours_alone() -> None:
    phi, samples = lobes(9)
    clean = fit_highlight(phi, samples)
    samples[:, 0] = 0.0
    samples[:, 1] = np.nan
    samples[1:, 2] = np.nan
    samples[2:, 3] = np.nan
    phi[:, 4] = 0.2
    samples[:, 5] = -1.0
    phi[:, 6] = 3.0
    phi[0, 6] = 0.0
    found = fit_highlight(phi, samples)
    assert [Status(code).name for code in found.status[:6]] == [
        "DARK",
        "INVALID_INPUT",
        "TOO_FEW_SAMPLES",
        "EXACT",
        "RANK_DEFICIENT",
        "DARK",
    ]
    # One sample of a lobe and fifteen of none: as narrow as you like, down to the bound.
    assert found.status[6] in (Status.ILL_CONDITIONED, Status.RANK_DEFICIENT)
    assert found.beta[0] == found.beta[5] == 0.0
    assert np.isnan(found.gamma[[0, 1, 2, 4, 5]]).all()
    assert np.isfinite(found.gamma[3])
    assert np.isnan(found.covariance[:, 3]).all()
    assert same(
        HighlightFit(**{f.name: getattr(clean, f.name)[..., 7:] for f in fields(HighlightFit)}),
        HighlightFit(**{f.name: getattr(found, f.name)[..., 7:] for f in fields(HighlightFit)}),
    )


@settings(max_examples=40, deadline=None)
@given(
    arrays(np.float32, (6, 19), elements=st.floats(width=32)),
    arrays(np.float32, (6, 19), elements=st.floats(width=32)),
)
def test_nan_stands_where_the_status_says_so_whatever_comes_in(
    phi: np.ndarray, samples: np.ndarray
) -> None:
    found = fit_highlight(phi, samples)
    unknown = found.status >= 16
    assert np.array_equal(np.isnan(found.gamma), unknown)
    assert np.array_equal(np.isnan(found.beta), unknown & (found.status != Status.DARK))
    assert not np.isinf(found.beta).any()
    assert not np.isinf(found.gamma).any()


def test_any_shape_behind_the_observations() -> None:
    phi, samples = lobes(12)
    flat = fit_highlight(phi, samples)
    found = fit_highlight(phi.reshape(16, 3, 4).astype(float), samples.reshape(16, 3, 4))
    assert found.beta.shape == (3, 4)
    assert found.covariance.shape == (3, 3, 4)
    assert np.array_equal(found.gamma.ravel(), flat.gamma)
    assert fit_highlight(phi[:, 0], samples[:, 0]).beta.shape == ()


@pytest.mark.parametrize(
    ("phi", "samples", "message"),
    [
        (np.zeros((16, 2)), np.zeros((16, 3)), r"phi: expected the shape of samples, \(16, 3\)"),
        (np.zeros((16, 0)), np.zeros((16, 0)), r"samples: expected \(obs, ...\) numbers"),
        (np.zeros((2, 2), complex), np.zeros((2, 2)), "phi: expected an array of real numbers"),
        (np.zeros((2, 2)), [["a", "b"]], "samples: expected an array of real numbers"),
    ],
)
def test_bad_calls_are_refused_by_name(phi: object, samples: object, message: str) -> None:
    with pytest.raises(impasto.ArgumentError, match=message):
        fit_highlight(phi, samples)  # type: ignore[arg-type]

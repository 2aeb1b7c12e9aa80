"""Photographs held out: what they are compared on, and which errors are those of rounding."""

from __future__ import annotations

import numpy as np
import pytest

from impasto import Stack
from impasto.encoding import Encoding
from impasto.fit.held_out import ROUNDED, HeldOut, log_ratios

LIGHTS = np.array([[0.5, 0.1, 0.86], [-0.5, 0.2, 0.84], [0.1, -0.6, 0.79], [0.1, 0.6, 0.79]])
LIGHTS /= np.linalg.norm(LIGHTS, axis=1)[:, None]


def held_out(stack: Stack) -> HeldOut:
    return HeldOut(stack, 4096, index=1.45, threads=1)


def test_clipped_samples_are_not_compared() -> None:
    samples = np.random.default_rng(1).uniform(0.0, 1.0, (4, 3, 16, 16)).astype(np.float32)
    stack = Stack(samples, lights=LIGHTS, encoding=Encoding("srgb"), saturation=0.5)
    test = held_out(stack)
    np.testing.assert_array_equal(np.isnan(test.truth), samples >= 0.5)
    assert (test.truth[samples < 0.5] < 200).all()


def test_light_above_white_is_compared_as_it_is() -> None:
    """A lamp of eight times the strength of the others, in a file of floats."""
    samples = np.full((4, 1, 8, 8), 0.2, np.float32)
    samples[2] *= 8.0
    stack = Stack(samples, lights=LIGHTS, encoding=Encoding("srgb"))
    dim, strong = held_out(stack).truth[[0, 2], 0, 0, 0]
    # IEC 61966-2-1: 255 (1.055 v^(1 / 2.4) - 0.055), whose rounding to single precision is 1e-7.
    for found, value in ((dim, 0.2), (strong, 1.6)):
        assert found == pytest.approx(255.0 * (1.055 * value ** (1 / 2.4) - 0.055), rel=1e-6)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_errors_of_rounding_are_steps_of_the_files(bits: int) -> None:
    kind = np.uint8 if bits == 8 else np.uint16
    light = np.random.default_rng(2).uniform(0.05, 0.95, (4, 3, 24, 24))
    most = 2**bits - 1
    stack = Stack((light * most).round().astype(kind), lights=LIGHTS, scale=1.0 / most)
    test = held_out(stack)
    # The sample has a unit of light of its own, a power of two.
    unit = 2.0 ** np.round(np.log2(test.samples.max() / light.mean(axis=1).max()))
    exact = test.coded(light * unit)
    error = np.abs(test.truth - exact)
    # Rounding of uniform light is off by a quarter of a step in the mean, and the trimmed mean of
    # 90 % or so by less: `rounded` is above it, and by less than twice.
    trimmed = np.sort(error, axis=None)[: int(0.9 * error.size)].mean()
    assert trimmed < test.rounded < 2.0 * trimmed


def test_errors_of_rounding_are_those_of_8_bits_for_floats() -> None:
    samples = np.full((4, 1, 8, 8), 0.5, np.float32)
    assert held_out(Stack(samples, lights=LIGHTS)).rounded == ROUNDED


def test_errors_of_rounding_do_not_depend_on_shadows_and_masked_pixels() -> None:
    """In the dark a step of a linear file is many codes."""
    light = np.random.default_rng(5).uniform(0.3, 0.9, (4, 3, 24, 24))
    stack = Stack((255 * light).round().astype(np.uint8), lights=LIGHTS, scale=1.0 / 255)
    lit = held_out(stack).rounded
    black = stack.samples.copy()
    black[..., :16] = np.random.default_rng(6).integers(0, 2, (4, 3, 24, 16))
    mask = np.arange(24)[None, :].repeat(24, axis=0) >= 16
    masked = held_out(stack._replace(samples=black, mask=mask)).rounded
    shadowed = stack.samples.copy()
    shadowed[0, :, :, :16] = shadowed[1, :, :, 8:] = shadowed[2, :, :, ::2] = 1
    # Samples are uniform: the median of those that are left scatters by 3 %, half of that of steps.
    assert masked == pytest.approx(lit, rel=0.1)
    assert held_out(stack._replace(samples=shadowed)).rounded == pytest.approx(lit, rel=0.1)
    nothing = held_out(stack._replace(samples=np.zeros_like(black)))
    assert nothing.rounded == ROUNDED


def test_errors_of_rounding_of_codes_follow_from_full_scale() -> None:
    """Samples decoded by a tone curve are floats, in files of 8 bits or of 16."""
    samples = np.full((4, 1, 8, 8), 0.5, np.float32)
    for white, steps in ((255.0, 1.0), (65535.0, 255.0 / 65535.0), (1.0, 1.0)):
        stack = Stack(samples, lights=LIGHTS, encoding=Encoding("srgb", white=white))
        assert held_out(stack).rounded == pytest.approx(ROUNDED * steps, rel=1e-12)


def test_a_prediction_that_overflows_is_a_large_error() -> None:
    """Not one that nobody knows, which would not count."""
    test = held_out(Stack(np.full((4, 1, 8, 8), 0.5, np.float32), lights=LIGHTS))
    known = test.coded(np.array([np.inf, 1e38, 1.0, np.nan], np.float32))
    assert np.isfinite(known[:3]).all()
    assert known[0] > known[1] > known[2]
    assert np.isnan(known[3])


def test_ratios_are_medians_over_the_pixels_that_a_lamp_lights() -> None:
    """By numpy's median, photograph by photograph."""
    rng = np.random.default_rng(3)
    expected = rng.uniform(0.5, 1.0, (5, 9))
    samples = (
        np.array([2.0, 0.5, 1.0, 3.0, 1.0])[:, None] * expected * rng.uniform(0.9, 1.1, (5, 9))
    )
    intensities = np.array([1.0, 2.0, 1.0, 0.5, 1.0])
    samples[0, 4] = np.inf  # clipped: eight are left
    samples[1, :2] = 0.0
    expected[2, 3] = 0.0  # in shadow
    samples[3] = np.nan
    expected[4] = 1e-6
    found = log_ratios(samples, expected, intensities)
    even = expected / intensities[:, None]
    for photograph in (0, 1, 2):
        usable = np.isfinite(samples[photograph]) & (samples[photograph] > 0.0)
        usable &= even[photograph] > 0.2 * even.mean(axis=0)
        ratio = samples[photograph, usable] / expected[photograph, usable]
        assert found[photograph] == pytest.approx(np.median(np.log(ratio)), abs=1e-12)
    assert np.isnan(found[3:]).all()
    assert found.dtype == np.float64

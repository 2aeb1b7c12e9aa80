"""The yardstick of `impasto demo` is true: its own errors would flatter every fit."""

from __future__ import annotations

from types import SimpleNamespace

import colour
import numpy as np
import pytest

from impasto import simulate
from impasto.simulate.score import colour_error, normal_error

ZERO = 1e-6


@pytest.fixture(scope="module")
def capture() -> simulate.Capture:
    return simulate.default_capture(size=(24, 32))


def perfect(truth: simulate.Truth) -> tuple[SimpleNamespace, SimpleNamespace]:
    painting = truth.painting
    sbrdf = SimpleNamespace(
        normal=truth.normal,
        diffuse=truth.diffuse,
        beta=float(truth.beta[0, 0, 0]),
        gamma=float(truth.gamma[0, 0, 0]),
    )
    reflectance = SimpleNamespace(
        coefficients=painting.coefficients, basis=painting.basis, wavelengths=painting.wavelengths
    )
    return sbrdf, reflectance


def test_the_truth_has_no_error(capture: simulate.Capture) -> None:
    score = simulate.score(capture.truth, *perfect(capture.truth))
    # Single precision of unit vectors is 1e-7; of reflectances the same.
    assert score.normal_p95 < 1e-4
    assert score.reflectance_rmse < ZERO
    assert max(score.colour_p95.values()) < 1e-3
    assert abs(score.beta) + abs(score.gamma) < ZERO
    assert score.estimated == 1.0


def test_a_turned_normal_is_off_by_its_angle(capture: simulate.Capture) -> None:
    tilt = np.radians(3.0)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    flat = np.zeros((3, 2, 2))
    flat[2] = 1.0
    turned = np.einsum("ij,jyx->iyx", turn, flat)
    np.testing.assert_allclose(normal_error(turned, flat), 3.0, rtol=1e-6)
    np.testing.assert_allclose(normal_error(flat, -flat), 180.0)


def test_unknown_pixels_are_left_out(capture: simulate.Capture) -> None:
    sbrdf, reflectance = perfect(capture.truth)
    sbrdf.normal = sbrdf.normal.copy()
    sbrdf.normal[:, 0] = np.nan
    reflectance.coefficients = reflectance.coefficients.copy()
    reflectance.coefficients[:, 0] = np.nan
    score = simulate.score(capture.truth, sbrdf, reflectance)
    assert score.estimated == pytest.approx(23 / 24)
    assert score.normal_mean < 1e-4
    assert score.reflectance_rmse < ZERO
    assert np.isnan(score.normal_error[0]).all()


def test_errors_have_their_size_and_sign(capture: simulate.Capture) -> None:
    sbrdf, reflectance = perfect(capture.truth)
    sbrdf.beta *= 1.05
    sbrdf.gamma *= 0.97
    # A reflectance that is 0.01 too high at every wavelength, in one more basis spectrum.
    more = np.full((1, *capture.truth.painting.size), 0.01, np.float32)
    reflectance.coefficients = np.concatenate([reflectance.coefficients, more])
    reflectance.basis = np.vstack([reflectance.basis, np.ones(reflectance.wavelengths.size)])
    score = simulate.score(capture.truth, sbrdf, reflectance)
    assert score.beta == pytest.approx(0.05)
    assert score.gamma == pytest.approx(-0.03)
    assert score.reflectance_rmse == pytest.approx(0.01, rel=1e-4)


def test_colour_differences_are_those_of_colour_science(capture: simulate.Capture) -> None:
    """Spectra of a few pixels, integrated and compared by colour-science alone."""
    painting = capture.truth.painting
    darker = SimpleNamespace(
        coefficients=painting.coefficients * np.float32(0.9),
        basis=painting.basis,
        wavelengths=painting.wavelengths,
    )
    found = colour_error(painting, darker, "A")
    shape = colour.SpectralShape(float(painting.wavelengths[0]), float(painting.wavelengths[-1]), 1)
    light = colour.SDS_ILLUMINANTS["A"].copy().align(shape)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    white = colour.sd_to_XYZ(colour.sd_ones(shape), observer, light, method="Integration")
    for y, x in ((3, 5), (11, 20), (20, 9)):
        labs = []
        for factor in (0.9, 1.0):
            values = factor * painting.spectrum(y, x)
            sd = colour.SpectralDistribution(values, painting.wavelengths)
            sd = sd.interpolate(shape)
            xyz = colour.sd_to_XYZ(sd, observer, light, method="Integration")
            labs.append(colour.XYZ_to_Lab(xyz / white[1], colour.XYZ_to_xy(white)))
        expected = colour.delta_E(labs[0], labs[1], method="CIE 2000")
        # colour-science interpolates the spectrum by Sprague's formula and cuts the observer at
        # the ends of the spectrum; a difference of about 3 moves by less than 0.02 with either.
        assert found[y, x] == pytest.approx(float(expected), abs=0.02)

"""One matrix for the whole of colour: it must equal the steps, taken one by one elsewhere."""

from __future__ import annotations

import json

import colour
import numpy as np
import pytest

from impasto.colour import (
    STANDARD_OBSERVER,
    Display,
    White,
    XyzFold,
    adaptation,
    correlated_temperature,
    display_from_coefficients,
    display_from_xyz,
    planck,
    white_point,
    xyz_from_coefficients,
    xyz_from_spectrum,
)
from impasto.errors import ArgumentError
from oracles import mired_adaptation as paper

FINE = np.arange(360.0, 831.0)
GRID = np.arange(400.0, 701.0, 10.0)


@pytest.fixture(scope="module")
def reflectances() -> np.ndarray:
    """24 patches of the ColorChecker ``(24, 471)`` on the observer's grid."""
    patches = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    shape = colour.SpectralShape(360, 830, 1)
    return np.stack([patch.copy().align(shape).values for patch in patches])


def test_the_folded_matrix_equals_the_steps_of_the_paper(reflectances):
    # Step by step with colour-science and the paper written down: integrate each spectrum at 1 nm,
    # adapt (eq. 7 to 12), scale, display matrix, curve. Basis: six spectra, coefficients at random.
    basis = reflectances[[0, 5, 9, 13, 17, 20]]
    coefficients = np.random.default_rng(2).uniform(0.0, 0.3, (6, 50))
    lamp = 2862.0
    functions = colour.MSDS_CMFS[STANDARD_OBSERVER].values
    weights = functions * colour.colorimetry.planck_law(FINE * 1e-9, lamp)[:, None]
    weights /= weights[:, 1].sum()
    xyz = (coefficients.T @ basis) @ weights
    kelvin = paper.adapted_kelvin(2862.0, 6504.0, 0.56)
    adapt = paper.matrix(paper.white(lamp), paper.white(kelvin))
    linear = xyz @ adapt.T @ np.linalg.inv(Display.named("srgb").xyz_from_linear).T
    white = np.linalg.inv(Display.named("srgb").xyz_from_linear) @ paper.white(kelvin)

    fold = display_from_coefficients(basis, FINE, lamp, reference=6504.0, d=0.56)
    # The constants of planck_law differ by 2e-6 of c2's exponent; nothing else does.
    np.testing.assert_allclose((fold.diffuse @ coefficients).T, linear / white.max(), atol=2e-5)
    np.testing.assert_allclose(fold.interface, white / white.max(), atol=1e-12)
    codes = fold.display.encode(fold.diffuse @ coefficients)
    expected = colour.models.eotf_inverse_sRGB(np.clip(linear / white.max(), 0.0, 1.0))
    # The same 2e-5 through a slope of at most 12.92.
    np.testing.assert_allclose(codes.T, expected, atol=3e-4)


@pytest.mark.parametrize("illuminant", ["D65", "A", "FL11"])
def test_without_adaptation_the_fold_is_plain_colorimetry(reflectances, illuminant):
    shape = colour.SpectralShape(360, 830, 1)
    expected = colour.msds_to_XYZ(
        reflectances,
        colour.MSDS_CMFS[STANDARD_OBSERVER],
        colour.SDS_ILLUMINANTS[illuminant].copy().align(shape),
        method="Integration",
        shape=shape,
    )
    fold = xyz_from_coefficients(reflectances, FINE, illuminant)
    assert fold.adaptation is None
    np.testing.assert_allclose(fold.diffuse.T, expected / 100.0, atol=1e-10)
    np.testing.assert_allclose(fold.interface, white_point(illuminant), rtol=1e-12)


@pytest.mark.parametrize("mode", ["planck", "anchored"])
@pytest.mark.parametrize("d", [None, 0.0, 0.56, 1.0])
@pytest.mark.parametrize("display", ["srgb", "display-p3"])
def test_a_white_board_and_a_mirror_look_the_same_and_fit(d, mode, display):
    fold = display_from_coefficients(np.eye(31), GRID, "A", d=d, mode=mode, display=display)
    # Sums of 31 products.
    np.testing.assert_allclose(fold.diffuse @ np.ones(31), fold.interface, atol=1e-13)
    assert fold.interface.max() <= 1.0
    assert fold.interface.max() == pytest.approx(1.0, rel=1e-15)


def test_complete_anchored_adaptation_shows_white_as_white():
    # D65 by spectrum and the D65 that sRGB's standard prints differ in the fourth decimal of Z.
    fold = display_from_coefficients(np.eye(31), GRID, "A", d=1.0, mode="anchored")
    np.testing.assert_allclose(fold.interface, 1.0, atol=5e-4)
    codes = np.rint(255.0 * fold.display.encode(fold.interface))
    np.testing.assert_array_equal(codes, 255.0)


def test_an_observer_adapted_to_the_display_sees_full_drive_as_white():
    display = Display.calibrated(
        white=[0.95, 1.0, 1.30], primaries=[[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]], curve=2.2
    )
    fold = display_from_coefficients(
        np.eye(31), GRID, "A", reference="display", d=1.0, mode="anchored", display=display
    )
    np.testing.assert_allclose(fold.interface, 1.0, atol=1e-12)
    assert fold.white.scale == pytest.approx(1.0, rel=1e-12)
    assert fold.adaptation.reference_temperature == pytest.approx(
        correlated_temperature(White((0.95, 1.0, 1.30))).temperature, rel=1e-12
    )


def test_the_fold_is_linear_in_the_basis():
    random = np.random.default_rng(1)
    basis, mix = random.standard_normal((6, 31)), random.standard_normal((4, 6))
    one = display_from_coefficients(basis, GRID, "FL2", d=0.5)
    other = display_from_coefficients(mix @ basis, GRID, "FL2", d=0.5)
    np.testing.assert_allclose(other.diffuse, one.diffuse @ mix.T, atol=1e-12)


def test_a_lamp_as_values_on_the_grid_is_used_for_light_and_adaptation():
    lamp = planck(2862.0, GRID)
    fold = xyz_from_coefficients(np.eye(31), GRID, lamp, d=0.56, mode="anchored")
    pair = xyz_from_coefficients(np.eye(31), GRID, (GRID, lamp), d=0.56, mode="anchored")
    np.testing.assert_array_equal(fold.diffuse, pair.diffuse)
    np.testing.assert_allclose(
        fold.interface, adaptation((GRID, lamp), "D65", 0.56, "anchored").adapted_white, atol=1e-12
    )


def test_the_eye_may_be_adapted_to_another_light_than_the_paintings():
    # A spotlight of 2700 K on the painting in a room of 4000 K.
    fold = xyz_from_coefficients(np.eye(31), GRID, 2700.0, test=4000.0, reference=6504.0, d=0.8)
    expected = adaptation(4000.0, 6504.0, 0.8).matrix @ xyz_from_spectrum(GRID, 2700.0)
    np.testing.assert_allclose(fold.diffuse, expected, atol=1e-14)


def test_a_fold_may_start_from_any_matrix_to_xyz():
    srgb = Display.named("srgb")
    fold = display_from_xyz(
        XyzFold(srgb.xyz_from_linear, srgb.xyz_from_linear.sum(axis=1), None), "srgb", 1.0
    )
    np.testing.assert_allclose(fold.diffuse, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(fold.interface, 1.0, atol=1e-14)


def test_the_report_is_plain_data():
    fold = display_from_coefficients(np.eye(31), GRID, 2862.0, reference=6504.0, d=0.56)
    report = json.loads(json.dumps(fold.report()))
    assert report["adaptation"]["adapted_kelvin"] == pytest.approx(4169.5, abs=0.05)
    assert report["white_limited_by"] == "red"
    assert report["white_clipped"] == []
    plain = display_from_coefficients(np.eye(31), GRID, "D65").report()
    assert plain["adaptation"] is None
    assert fold.table(16).shape == (3, 16)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: xyz_from_coefficients(np.eye(31), GRID[:30], "A"), r"shape \(k, 30\)"),
        (lambda: xyz_from_coefficients(np.ones(31), GRID, "A"), r"shape \(k, 31\)"),
        (lambda: xyz_from_coefficients(np.ones((0, 31)), GRID, "A"), r"shape \(k, 31\)"),
        (
            lambda: xyz_from_coefficients(np.full((3, 31), np.nan), GRID, "A"),
            "basis: expected finite",
        ),
        (lambda: xyz_from_coefficients(np.eye(31), GRID, "A", d=2.0), "d: expected"),
        (lambda: xyz_from_coefficients(np.eye(31), GRID, "A", d=0.5, test="B2"), "test: unknown"),
        (lambda: display_from_coefficients(np.eye(31), GRID, "A", display="crt"), "display: "),
        (lambda: xyz_from_coefficients(np.eye(31), GRID, -5.0), "positive temperature"),
        (
            lambda: xyz_from_coefficients(
                np.eye(31), GRID, "A", d=0.5, reference=White((1.0, 0.0, 1.0))
            ),
            "reference: expected finite XYZ",
        ),
    ],
)
def test_bad_arguments_say_what_is_wrong(call, words):
    with pytest.raises(ArgumentError, match=words):
        call()

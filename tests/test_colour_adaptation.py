"""Incomplete chromatic adaptation: eq. 7 and 9 to 12 of the six-band paper."""

from __future__ import annotations

import colour
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impasto.colour import (
    CONES_FROM_XYZ,
    adaptation,
    adaptation_matrix,
    adapted_temperature,
    correlated_temperature,
    delta_e,
    lab_from_xyz,
    matrix_from_whites,
    planck,
    white_point,
)
from impasto.errors import ArgumentError
from oracles import mired_adaptation as paper

KELVIN = st.floats(1000.0, 25000.0)


def test_the_papers_temperature():
    # The paper: "240 mired (4170 K)" for d = 0.56 between illuminant A (2862 K) and 6504 K.
    kelvin = adapted_temperature(2862.0, 6504.0, d=0.56)
    assert kelvin == pytest.approx(4169.5, abs=0.05)
    assert 1e6 / kelvin == pytest.approx(239.84, abs=0.01)


# Computed once in long double from eq. 7; printed to 0.1 K.
@pytest.mark.parametrize(
    ("test", "reference", "kelvin"),
    [(2862.0, 6504.0, 4169.5), (2856.0, 6504.0, 4163.8), (2856.0, 6500.0, 4162.9)],
)
def test_other_temperatures(test, reference, kelvin):
    assert adapted_temperature(test, reference, 0.56) == pytest.approx(kelvin, abs=0.06)


@settings(deadline=None)
@given(KELVIN, KELVIN, st.floats(0.0, 1.0))
def test_temperatures_run_evenly_in_mired_from_test_to_reference(test, reference, d):
    kelvin = adapted_temperature(test, reference, d)
    expected = 1e6 / test + d * (1e6 / reference - 1e6 / test)
    assert 1e6 / kelvin == pytest.approx(expected, rel=1e-12)
    assert adapted_temperature(test, reference, 0.0) == test
    assert adapted_temperature(test, reference, 1.0) == reference
    # Symmetry: d from one side is 1 - d from the other.
    assert adapted_temperature(reference, test, 1.0 - d) == pytest.approx(kelvin, rel=1e-12)


# XYZ at Y = 1 printed to four decimals by tests/oracles/mired_adaptation.py.
@pytest.mark.parametrize(
    ("d", "x", "z"),
    [
        (0.0, 1.0984, 0.3560),
        (0.25, 1.0507, 0.4767),
        (0.5, 1.0112, 0.6372),
        (0.56, 1.0032, 0.6828),
        (0.75, 0.9827, 0.8485),
        (1.0, 0.9688, 1.1218),
    ],
)
def test_adapted_whites(d, x, z):
    white = adaptation(2856.0, 6504.0, d).adapted_white
    np.testing.assert_allclose(white, [x, 1.0, z], atol=5.1e-5)
    # The same sums in another order over 471 terms.
    np.testing.assert_allclose(
        white, paper.white(paper.adapted_kelvin(2856.0, 6504.0, d)), rtol=1e-12
    )


def test_the_cone_matrix_is_eq_9_digit_for_digit():
    np.testing.assert_array_equal(CONES_FROM_XYZ, paper.M)
    np.testing.assert_array_equal(
        CONES_FROM_XYZ, colour.adaptation.CHROMATIC_ADAPTATION_TRANSFORMS["Von Kries"]
    )


@pytest.mark.parametrize("mode", ["planck", "anchored"])
@pytest.mark.parametrize("test", ["A", "FL2", 2862.0, "D50"])
@pytest.mark.parametrize("d", [0.0, 0.25, 0.56, 1.0])
def test_matrices_equal_colour_sciences(test, d, mode):
    seen = adaptation(test, "D65", d, mode)
    # Their inverse and our solve agree to cond(M) = 3 roundings.
    expected = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        seen.test_white, seen.adapted_white, transform="Von Kries"
    )
    np.testing.assert_allclose(seen.matrix, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(adaptation_matrix(test, "D65", d, mode), seen.matrix)


@pytest.mark.parametrize("d", [0.0, 0.3, 0.56, 1.0])
def test_planck_matrices_equal_the_paper_written_down(d):
    expected = paper.matrix(
        paper.white(2862.0), paper.white(paper.adapted_kelvin(2862.0, 6504.0, d))
    )
    np.testing.assert_allclose(adaptation_matrix(2862.0, 6504.0, d), expected, atol=1e-12)


@pytest.mark.parametrize("mode", ["planck", "anchored"])
@pytest.mark.parametrize("test", ["A", "FL11", "D50", 3200.0])
def test_no_adaptation_changes_nothing(test, mode):
    np.testing.assert_allclose(adaptation_matrix(test, "D65", 0.0, mode), np.eye(3), atol=1e-12)


@pytest.mark.parametrize("test", ["A", "FL2", "FL11", "HP1", "LED-B1", 2862.0])
def test_anchored_adaptation_ends_at_the_true_white(test):
    matrix = adaptation_matrix(test, "D65", 1.0, "anchored")
    np.testing.assert_allclose(matrix @ white_point(test), white_point("D65"), atol=1e-12)


def test_planck_adaptation_ends_on_the_blackbody_locus():
    # 6504 K is 4.64 CIEDE2000 from D65 (a* +3.2, b* -2.0): the reason for "anchored".
    seen = adaptation("A", 6504.0, 1.0, "planck").adapted_white
    lab = lab_from_xyz(seen)
    np.testing.assert_allclose(lab, [100.0, 3.19, -2.00], atol=0.006)
    assert delta_e(lab, lab_from_xyz(white_point("D65"))) == pytest.approx(4.64, abs=0.005)


@pytest.mark.parametrize("d", [0.0, 0.56, 1.0])
def test_modes_agree_where_both_lights_are_blackbodies(d):
    np.testing.assert_array_equal(
        adaptation_matrix(2862.0, 6504.0, d, "planck"),
        adaptation_matrix(2862.0, 6504.0, d, "anchored"),
    )


@settings(deadline=None, max_examples=40)
@given(KELVIN, KELVIN, st.floats(0.0, 1.0))
def test_white_maps_to_the_adapted_white_with_its_luminance(test, reference, d):
    seen = adaptation(test, reference, d)
    np.testing.assert_allclose(seen.matrix @ seen.test_white, seen.adapted_white, atol=1e-12)
    assert seen.adapted_white[1] == pytest.approx(1.0, rel=1e-12)


def test_matrices_between_whites_chain_and_invert():
    a, b, c = (white_point(name) for name in ("A", "FL2", "D65"))
    chained = matrix_from_whites(b, c) @ matrix_from_whites(a, b)
    # Two products of matrices with entries below 4.
    np.testing.assert_allclose(chained, matrix_from_whites(a, c), atol=1e-13)
    np.testing.assert_allclose(
        matrix_from_whites(c, a) @ matrix_from_whites(a, c), np.eye(3), atol=1e-13
    )


def test_a_measured_lamp_adapts_like_its_temperature():
    grid = np.arange(360.0, 831.0)
    lamp = (grid, planck(2862.0, grid))
    # The correlated temperature of a sampled blackbody is its own to 1e-7.
    np.testing.assert_allclose(
        adaptation_matrix(lamp, 6504.0, 0.56), adaptation_matrix(2862.0, 6504.0, 0.56), atol=1e-6
    )
    assert correlated_temperature(lamp).temperature == pytest.approx(2862.0, rel=1e-7)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: adapted_temperature(2862.0, 6504.0, -0.01), r"d: expected 0 .* found -0.01"),
        (lambda: adapted_temperature(2862.0, 6504.0, 1.01), "d: expected 0"),
        (lambda: adapted_temperature(2862.0, 6504.0, float("nan")), "d: expected 0"),
        (lambda: adapted_temperature(2862.0, 6504.0, "half"), "d: expected a number"),
        (lambda: adapted_temperature(0.0, 6504.0, 0.5), "test: expected a positive"),
        (lambda: adapted_temperature(2862.0, -1.0, 0.5), "reference: expected a positive"),
        (lambda: adapted_temperature("A", 6504.0, 0.5), "test: expected kelvin"),
        (lambda: adaptation_matrix("A", "D65", 1.5), "d: expected 0"),
        (lambda: adaptation_matrix("A", "D65", 0.5, "mired"), "mode: expected"),
        (lambda: adaptation_matrix("A", "D56", 0.5), "reference: unknown name .* D65"),
        (lambda: adaptation_matrix("AA", "D65", 0.5), "test: unknown name"),
        (lambda: adaptation_matrix("A", -1.0, 0.5), "reference: expected a positive"),
        (lambda: adaptation_matrix(([400.0, 500.0], [0.0, -1.0]), 6504.0, 0.5), "test: expected v"),
        (lambda: matrix_from_whites([1.0, 0.0, 1.0], [1.0, 1.0, 1.0]), "source"),
        (lambda: matrix_from_whites([1.0, 1.0, 1.0], [1.0, np.nan, 1.0]), "target"),
        (lambda: matrix_from_whites([1.0, 1.0, 1.0], [0.9, 1.0, 0.0]), "cone responses"),
        (lambda: matrix_from_whites([1.0, 1.0], [1.0, 1.0, 1.0]), "source"),
    ],
)
def test_bad_arguments_say_what_is_wrong(call, words):
    with pytest.raises(ArgumentError, match=words):
        call()


def test_lab_and_difference_are_colour_sciences_on_planes():
    random = np.random.default_rng(3)
    xyz = random.uniform(0.0, 1.0, (3, 4, 5))
    other = random.uniform(0.0, 1.0, (3, 4, 5))
    white = white_point("FL2")
    expected = colour.XYZ_to_Lab(np.moveaxis(xyz, 0, -1), colour.XYZ_to_xy(white))
    lab, second = lab_from_xyz(xyz, "FL2"), lab_from_xyz(other, white)
    np.testing.assert_allclose(np.moveaxis(lab, 0, -1), expected, rtol=1e-12)
    difference = colour.delta_E(expected, np.moveaxis(second, 0, -1), method="CIE 2000")
    np.testing.assert_allclose(delta_e(lab, second), difference, rtol=1e-10)
    np.testing.assert_allclose(lab_from_xyz(7.0 * xyz, 7.0 * white), lab, rtol=1e-10)
    np.testing.assert_allclose(lab_from_xyz(white, white), [100.0, 0.0, 0.0], atol=1e-12)


# Sharma, Wu and Dalal (2005), "The CIEDE2000 color-difference formula", table 1.
@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ],
)
def test_published_differences(first, second, expected):
    assert delta_e(first, second) == pytest.approx(expected, abs=5e-5)


def test_one_bad_pixel_stays_one_bad_pixel():
    xyz = np.full((3, 2), 0.4)
    xyz[:, 1] = np.nan
    lab = lab_from_xyz(xyz)
    difference = delta_e(lab, np.zeros(3)[:, None])
    assert np.isfinite(lab[:, 0]).all()
    assert np.isnan(lab[:, 1]).all()
    assert np.isfinite(difference[0])
    assert np.isnan(difference[1])


def test_shapes_are_checked():
    with pytest.raises(ArgumentError, match=r"lab: expected shape \(3, ...\), found \(4, 3\)"):
        delta_e(np.zeros((4, 3)), np.zeros(3))
    with pytest.raises(ArgumentError, match="does not fit"):
        delta_e(np.zeros((3, 4)), np.zeros((3, 5)))
    with pytest.raises(ArgumentError, match="white"):
        lab_from_xyz(np.ones(3), [1.0, 0.0, 1.0])

"""Cameras: what bands see of a spectrum."""

from __future__ import annotations

import numpy as np
import pytest

from impasto import ArgumentError, Camera

GRID = np.arange(400, 701, 10.0)
CENTRES = np.array([450.0, 550.0, 620.0])
CURVES = np.exp(-(((GRID - CENTRES[:, None]) / 40.0) ** 2))


def ramp(wavelengths):
    return 0.1 + 0.8 * (wavelengths - 400.0) / 300.0


@pytest.mark.parametrize("illuminant", ["A", "FL2", 3000.0, np.linspace(0.2, 1.0, 31)])
@pytest.mark.parametrize("integration", ["1nm", "sum"])
def test_a_perfect_white_reads_one_in_every_band(illuminant, integration):
    camera = Camera(GRID, CURVES, illuminant)
    response = camera.response(np.ones((2, 31)), GRID, integration=integration)
    assert response.shape == (2, 3)
    # 301 products of numbers below one, divided by their own sum.
    np.testing.assert_allclose(response, 1.0, rtol=301 * 2**-53)


def test_the_integral_is_the_one_of_a_fine_sum():
    """Oracle: the definition, summed over 0.05 nm with an independent interpolation."""
    camera = Camera(GRID, CURVES, 3000.0)
    fine = np.arange(400, 700.001, 0.05)
    curves = np.array([np.interp(fine, GRID, curve) for curve in CURVES])
    light = fine**-5 / np.expm1(1.4388e7 / (fine * 3000.0))
    weights = curves * light
    expected = weights @ ramp(fine) / weights.sum(axis=1)
    # Rectangles of 1 nm against 0.05 nm: the end samples carry half a step too much weight,
    # 0.5 nm of a tail that is at most 2 % of the peak, out of 70 nm of band.
    np.testing.assert_allclose(camera.response(ramp(GRID), GRID), expected, atol=2e-4)


def test_the_response_depends_on_the_spectrum_not_on_its_sampling():
    camera = Camera(GRID, CURVES, "FL11")
    coarse, fine = np.arange(400, 701, 10.0), np.arange(380, 731, 2.0)
    # A straight line is reproduced by any interpolation of first order or higher.
    np.testing.assert_allclose(
        camera.response(ramp(coarse), coarse), camera.response(ramp(fine), fine), rtol=1e-12
    )
    plain = [camera.response(ramp(w), w, integration="sum") for w in (coarse, fine)]
    assert np.abs(plain[0] - plain[1]).max() > 1e-3, "the plain sum does depend on the spacing"


def test_the_scale_of_a_band_and_of_the_light_cancels():
    light = np.linspace(0.2, 1.0, 31)
    camera = Camera(GRID, CURVES, light)
    other = Camera(GRID, CURVES * [[3.0], [0.2], [1e6]], light * 7e-9)
    np.testing.assert_allclose(other.operator(GRID), camera.operator(GRID), rtol=1e-12)


def test_bands_have_names_and_arrays_are_the_cameras_own():
    assert Camera(GRID, CURVES, "A").bands == ("red", "green", "blue")
    assert Camera(GRID, CURVES[:2], "A").bands == ("band 0", "band 1")
    assert Camera(GRID, CURVES[:2], "A", bands=["x", "y"]).bands == ("x", "y")
    mine = CURVES.copy()
    camera = Camera(GRID, mine, "A")
    mine[:] = 0
    assert camera.sensitivities.max() > 0.9
    with pytest.raises(AttributeError):
        camera.bands = ()
    with pytest.raises(ValueError, match="read-only"):
        camera.sensitivities[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wavelengths": GRID[::-1]}, "wavelengths: .*increasing"),
        ({"wavelengths": GRID[:-1]}, r"sensitivities: expected shape \(band, 30\)"),
        ({"sensitivities": CURVES[0]}, "sensitivities: expected shape"),
        ({"sensitivities": CURVES * np.nan}, "sensitivities: .*nan in band 0 at 400 nm"),
        ({"sensitivities": CURVES * [[1.0], [0.0], [1.0]]}, "band 'green' has no response"),
        ({"sensitivities": CURVES * 1e200, "illuminant": np.full(31, 1e200)}, "'red' times the"),
        ({"bands": ["x"]}, "bands: expected 3 names, found 1"),
        ({"illuminant": "moonlight"}, "illuminant: unknown name 'moonlight'"),
        ({"illuminant": np.ones(30)}, "illuminant: expected 31 values"),
        ({"illuminant": -3.0}, "illuminant.*positive"),
    ],
)
def test_wrong_arguments_are_refused_in_words(change, words):
    arguments = {"wavelengths": GRID, "sensitivities": CURVES, "illuminant": "A"} | change
    with pytest.raises(ArgumentError, match=words):
        Camera(**arguments)


def test_a_spectrum_of_the_wrong_length_is_refused():
    with pytest.raises(ArgumentError, match=r"reflectance: expected \(\.\.\., 31\)"):
        Camera(GRID, CURVES, "A").response(np.ones(30), GRID)
    with pytest.raises(ArgumentError, match="integration"):
        Camera(GRID, CURVES, "A").operator(GRID, integration="simpson")

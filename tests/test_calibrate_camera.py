"""Cameras from a ColorChecker: measured cameras, simulated photographs, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
import tifffile
from numpy.typing import NDArray

import impasto
from impasto.calibrate import ChartCamera, camera_from_chart, read_chart
from impasto.calibrate.chart import GRID, chart_reflectances
from impasto.calibrate.sensitivities import non_negative
from impasto.cli import main
from impasto.errors import ArgumentError
from impasto.io import read_camera
from oracles import colour_chart

WHITE = np.array([0.6, 0.95, 0.7])
"""Light of a perfect white in the bands, where the slope of the light is 1."""
UNLIKE = 0.015
"""Standard deviation of the patches from the table of reflectances, relative: a real chart."""


@pytest.fixture(scope="module")
def weights(data: Path) -> NDArray[np.float64]:
    """``(3, 31)`` sensitivity times light: a measured camera under D50."""
    file = np.load(data / "spectra" / "cameras.npz")
    curves = file["sensitivity"][7].T
    camera = np.array([np.interp(GRID, file["wavelength"], curve) for curve in curves])
    light = camera * impasto.colour.spectrum("D50", GRID)
    return np.asarray(light / light.sum(axis=1, keepdims=True) * WHITE[:, None])


@pytest.fixture(scope="module")
def photograph(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    patches = chart_reflectances()
    patches = patches * (1 + np.random.default_rng(1).normal(0, UNLIKE, (24, 1)))
    return np.asarray(colour_chart.photograph(patches @ weights.T))


@pytest.fixture(scope="module")
def found(photograph: NDArray[np.float64]) -> ChartCamera:
    return camera_from_chart(photograph, "D50")


def test_the_chart_is_found_whichever_way_round(photograph: NDArray[np.float64]) -> None:
    """A tenth of the distance between patches is less than the margin of what is read of one."""
    truth = colour_chart.middles()
    rows, columns = photograph.shape[1:]
    turned = {
        0: truth,
        1: np.stack([truth[:, 1], columns - 1 - truth[:, 0]], axis=1),
        2: (columns - 1, rows - 1) - truth,
    }
    for turns, expected in turned.items():
        chart = read_chart(np.rot90(photograph, turns, axes=(1, 2)), "chart")
        assert np.abs(chart.places - expected).max() < 0.1 * 64
        assert chart.used.all()


def test_white_and_slope_of_the_light(found: ChartCamera) -> None:
    """A chart that is 1.5 % off in every patch tells its white to a fraction of that.

    24 patches tell a mean to 0.3 %; the white is brighter than any of them, and the slope shares
    their errors: three times as much is allowed. The middles of the outer patches span 0.48 of the
    width and 0.42 of the height of the photograph.
    """
    middle = colour_chart.middles().mean(axis=0) / colour_chart.SIZE[::-1] - 0.5
    shading = 1 + middle @ (0.05, -0.04)
    assert np.abs(found.white / (WHITE * shading) - 1).max() < 0.01
    assert np.abs(found.fit.slope - (0.48 * 0.05, 0.42 * -0.04)).max() < 0.015


def test_colours_of_paints_are_those_of_the_measured_camera(
    found: ChartCamera, weights: NDArray[np.float64], data: Path
) -> None:
    """Responses to 300 pigments, which the chart does not have.

    1.5 % of error in each patch, of which some eight in 24 are independent in a band, are 0.9 % of
    a response; the worst pigments lie outside of what the chart spans.
    """
    file = np.load(data / "spectra" / "hyppigments.npz")
    names = {file[name].ndim: name for name in file.files if file[name].dtype.kind == "f"}
    grid, spectra = file[names[1]].astype(float), file[names[2]].astype(float)[::5]
    spectra = np.array([np.interp(GRID, grid, one) for one in spectra])
    expected = spectra @ weights.T / WHITE
    response = found.camera.response(spectra, GRID, integration="sum")
    off = np.abs(response - expected)
    assert np.sqrt(np.square(off).mean()) < 0.009
    assert np.quantile(off, 0.95) < 0.02


def test_errors_of_patches_left_out(found: ChartCamera) -> None:
    """With a real chart's deviations: below one, and better than a matrix."""
    assert np.nanmean(found.delta_e) < 1.0
    assert np.nanmean(found.delta_e) < 0.8 * np.nanmean(found.matrix_delta_e)
    xyz = found.matrix @ np.ones(3)
    white = impasto.colour.xyz_from_spectrum(GRID, "D50").sum(axis=1)
    assert np.abs(xyz - white).max() < 0.03


def test_the_command_writes_a_camera_for_fit(
    photograph: NDArray[np.float64], found: ChartCamera, tmp_path: Path
) -> None:
    codes = np.rint(65535 * np.moveaxis(photograph, 0, -1)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "chart.tif", codes, photometric="rgb")
    out = tmp_path / "camera.csv"
    words = ["calibrate", "camera", str(tmp_path / "chart.tif"), "--illuminant", "D50", "--quiet"]
    corners = [f"{value:.1f}" for value in colour_chart.middles()[[0, 5, 23, 18]].ravel()]
    assert main([*words, "--corners", *corners, "--out", str(out)]) == 0
    written = read_camera(out)
    # The corners were given, and codes rounded: places of patches differ by a pixel.
    scale = found.camera.sensitivities.max()
    assert np.abs(written.sensitivities - found.camera.sensitivities).max() < 0.05 * scale
    # The chart's photograph lies there: a picture beside it would be taken for another one.
    assert (tmp_path / "calibration" / "camera.png").is_file()
    assert not out.with_suffix(".png").exists()
    assert main([*words, "--out", str(out)]) == 1


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ("none", "chart: no ColorChecker found; give the middles"),
        ("overexposed", "chart: only .* patches are neither clipped nor uneven"),
        ("grey", "chart: the colours of the chart explain .* of those of a ColorChecker"),
        ("outside", "corners: expected x and y of four patches within 700 x 500 pixels"),
        ("small", "chart: the patches of the chart are .* pixels apart, at least"),
        ("flat", "photograph: expected linear light .* found an array of shape"),
    ],
)
def test_mistakes(change: str, complaint: str, photograph: NDArray[np.float64]) -> None:
    corners: list[list[float]] | None = colour_chart.middles()[[0, 5, 23, 18]].tolist()
    light = photograph
    if change == "none":
        light, corners = np.full_like(light, 0.3), None
    elif change == "overexposed":
        light = np.clip(4.0 * light, 0.0, 1.0)
    elif change == "grey":
        light = np.random.default_rng(0).uniform(0.4, 0.42, light.shape)
    elif change == "outside":
        corners = [[-5.0, 0.0], [9.0, 9.0], [9.0, 9.0], [9.0, 9.0]]
    elif change == "small":
        corners = [[10.0, 10.0], [30.0, 10.0], [30.0, 22.0], [10.0, 22.0]]
    elif change == "flat":
        light = light[0]
    with pytest.raises(ArgumentError, match=complaint):
        camera_from_chart(light, "D50", corners=corners, name="chart")


def test_non_negative_least_squares_are_those_of_scipy() -> None:
    """Both end at the minimum: their residuals agree but for rounding, whatever the start."""
    random = np.random.default_rng(0)
    for trial in range(200):
        rows, columns = random.integers(3, 50), random.integers(1, 30)
        matrix = (
            random.normal(size=(rows, columns)) if trial % 2 else random.random((rows, columns))
        )
        right = random.normal(size=rows)
        start = random.random(columns) < 0.5 if trial % 3 else None
        found = non_negative(matrix, right, start)
        assert (found >= 0.0).all()
        _, least = scipy.optimize.nnls(matrix, right)
        assert np.linalg.norm(matrix @ found - right) - least < 1e-12 * (1.0 + least)

"""Height from normals, against known surfaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import impasto
import impasto.export
from impasto import ArgumentError


def known(rows: int, columns: int, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    """A smooth surface that is not periodic: heights in mm, and its analytic normals."""
    y, x = np.mgrid[:rows, :columns] / columns
    size = columns * pitch
    height = 0.04 * size * (np.sin(3 * x) + x * y + np.exp(-4 * ((x - 0.6) ** 2 + (y - 0.3) ** 2)))
    bump = np.exp(-4 * ((x - 0.6) ** 2 + (y - 0.3) ** 2))
    p = 0.04 * (3 * np.cos(3 * x) + y - 8 * (x - 0.6) * bump)
    # Rows run down, y runs up.
    q = -0.04 * (x - 8 * (y - 0.3) * bump)
    normal = np.stack([-p, -q, np.ones_like(p)])
    return height - height.mean(), (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


def test_a_known_surface_comes_back_at_512() -> None:
    truth, normal = known(512, 512, 0.1)
    # The goal of the project: 1e-4. The mean of two slopes misses the chord by (3/512)^2 / 12 =
    # 3e-6, and single-precision normals add a random walk of 1e-7 per pixel.
    assert relative(impasto.integrate_normals(normal, 0.1), truth) < 1e-5


@pytest.mark.parametrize("shape", [(96, 200), (201, 64)])
def test_any_shape_and_pitch(shape: tuple[int, int]) -> None:
    truth, normal = known(*shape, 0.25)
    # As above with 64 columns: (8/64)^2 / 12 = 1.3e-3 of the steepest part, less of the whole.
    assert relative(impasto.integrate_normals(normal, 0.25), truth) < 2e-3


def test_the_pitch_is_a_factor() -> None:
    _, normal = known(40, 50, 1.0)
    one, two = impasto.integrate_normals(normal), impasto.integrate_normals(normal, 2.0)
    np.testing.assert_array_equal(two, 2.0 * one)


def test_holes_take_the_slope_of_their_neighbours() -> None:
    truth, normal = known(128, 128, 0.1)
    normal[:, 40:43, 50:53] = np.nan
    normal[2, 90, 20] = -1.0
    found = impasto.integrate_normals(normal, 0.1)
    assert np.isfinite(found).all()
    # Nine pixels in 16384 know nothing: the hole's floor is wrong by its slope (0.1) times three
    # pixels, its surroundings by a dipole that dies with the distance.
    assert relative(found, truth) < 5e-3


def test_threads_change_no_bit() -> None:
    _, normal = known(150, 170, 0.1)
    np.testing.assert_array_equal(
        impasto.integrate_normals(normal, 0.1, threads=1),
        impasto.integrate_normals(normal, 0.1, threads=3),
    )


def test_no_normal_at_all_is_flat() -> None:
    assert not impasto.integrate_normals(np.full((3, 9, 7), np.nan, np.float32)).any()


@pytest.mark.parametrize(
    ("normal", "pitch", "words"),
    [
        (np.zeros((2, 4, 4)), 1.0, "normal: expected"),
        (np.zeros((3, 0, 4)), 1.0, "normal: expected"),
        (np.ones((3, 4, 4)), -1.0, "pitch_mm: expected"),
        (np.ones((3, 4, 4)), np.nan, "pitch_mm: expected"),
    ],
)
def test_wrong_arguments_are_named(normal: np.ndarray, pitch: float, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        impasto.integrate_normals(normal, pitch)


def test_a_fit_has_its_height(tmp_path: Path) -> None:
    """From the photographs of a known surface, in mm, by one call; exports write the same."""
    truth, normal = known(48, 64, 0.25)
    lights = np.array([(x, y, 0.8) for x, y in ((0.6, 0), (0, 0.6), (-0.6, 0), (0, -0.6))])
    shown = impasto.Surface(normal, np.full((3, 48, 64), 0.5)).predict(lights)
    fit = impasto.fit_sbrdf(
        impasto.Stack(shown, lights=impasto.Rig(lights, pitch_mm=0.25)), pooling="none"
    )
    found = fit.height()
    assert found.shape == (48, 64)
    # As above with 64 columns; matte photographs without noise have exact normals.
    assert relative(found, truth) < 2e-3
    np.testing.assert_allclose(fit.height(0.5), 2.0 * found, rtol=1e-6, atol=1e-6)
    level = impasto.find_level(fit.normal)
    np.testing.assert_array_equal(fit.height(level=True), fit.height(level=level))
    assert np.abs(fit.height(level=True) - found).max() > 0.1 * np.ptp(found)
    impasto.export.to("height", fit, tmp_path / "a.exr")
    stored = impasto.io.read_image(tmp_path / "a.exr")[0]
    np.testing.assert_allclose(stored, found - found.mean(), atol=1e-6 * np.ptp(found))
    report = impasto.export.to("height", fit, tmp_path / "b.exr", level=True)
    stored = impasto.io.read_image(tmp_path / "b.exr")[0]
    np.testing.assert_allclose(stored, fit.height(level=True), atol=1e-6 * np.ptp(found))
    assert any(words.startswith("the lean (the panel ") for words in report.lost)
    with pytest.raises(ArgumentError, match="level: expected"):
        impasto.export.to("height", fit, tmp_path / "c.exr", level="yes")
    with pytest.raises(ArgumentError, match="pitch_mm"):
        fit.height(-1.0)
    raised = impasto.Surface(normal, np.full((3, 48, 64), 0.5), height=truth, pitch_mm=0.25)
    impasto.export.to("height", raised, tmp_path / "d.exr", level=True)
    own = impasto.io.read_image(tmp_path / "d.exr")[0]
    plane = impasto.find_level(own_normals(own, 0.25))
    assert plane.angle < 0.2 * impasto.find_level(normal).angle


def own_normals(height: np.ndarray, pitch: float) -> np.ndarray:
    down, right = np.gradient(height, pitch)
    return np.stack([-right, down, np.ones_like(right)])

"""The pose of the camera: against known cameras, SciPy's least squares, and its own errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from impasto.align import FrontalView, camera_pose, camera_poses, frontal_view
from impasto.calibrate import Lens
from impasto.errors import ArgumentError, CorruptInputError, GeometryError
from impasto.io import LightFile, read_lights, write_lights
from oracles import flat_scene

SIZE, FOCAL = (800, 640), 900.0
K = (-0.12, 0.05, 0.0008, -0.0005, 0.0)
LENS = Lens(
    "brown", SIZE, np.array([[FOCAL, 0, 399.5], [0, FOCAL, 319.5], [0, 0, 1.0]]), np.array(K),
    np.zeros(4), np.zeros(5), 0.03, 10, 400,
)  # fmt: skip
PAINTING = (240.0, 180.0)
MARKS = flat_scene.grid_of(4, 3, 70.0)
CORNERS = np.array([(-120, 90), (120, 90), (120, -90), (-120, -90)], float)
SIGMA = 0.05


def eye(tilt: float, azimuth: float = 20.0) -> flat_scene.Camera:
    return flat_scene.Camera(
        SIZE, FOCAL, K, tilt=tilt, azimuth=azimuth, roll=4, distance=600, aim=(2.0, -1.0)
    )


def view_of(camera: flat_scene.Camera, mm: np.ndarray, noise: np.ndarray | float) -> FrontalView:
    names = tuple(f"mark {number}" for number in range(len(mm)))
    return frontal_view(mm, camera.pixel(mm) + noise, names, PAINTING, LENS, "a.tif")


@pytest.mark.parametrize("tilt", [0.0, 20.0, 60.0])
@pytest.mark.parametrize("mm", [MARKS, CORNERS], ids=["twelve", "four"])
def test_exact_marks_give_the_camera(tilt: float, mm: np.ndarray) -> None:
    """The way back through the lens ends within 1e-6 focal lengths; OpenCV's refinement stops at
    single precision's 1e-7 of the parameters: 600 mm to a thousandth."""
    camera = eye(tilt)
    found = camera_pose(view_of(camera, mm, 0.0))
    assert np.abs(found.place_mm - camera.place).max() < 2e-3
    assert np.abs(found.rotation - camera.axes).max() < 5e-6
    assert found.residual_px < 1e-3
    assert found.freedom == 2 * len(mm) - 6


def test_it_is_the_least_squares_of_scipy() -> None:
    """SciPy minimises the same reprojection, written with its own rotations and without a lens.

    Both stop where the cost is flat to 1e-8 of itself: a ten-thousandth of a standard deviation.
    """
    noise = np.random.default_rng(1).normal(0.0, SIGMA, MARKS.shape)
    view = view_of(eye(40.0), MARKS, noise)
    ideal = LENS.ideal(view.found)

    def off(parameters: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(parameters[:3]).as_matrix()
        places = np.column_stack([MARKS, np.zeros(len(MARKS))]) @ turn.T + parameters[3:]
        seen = FOCAL * places[:, :2] / places[:, 2:] + (399.5, 319.5)
        return (ideal - seen).ravel()

    own = camera_pose(view)
    start = np.concatenate(
        [Rotation.from_matrix(own.rotation).as_rotvec(), -own.rotation @ own.place_mm]
    )
    best = least_squares(off, start + 1e-3, x_scale=[1e-2] * 3 + [10.0] * 3, xtol=1e-12)
    place = -Rotation.from_rotvec(best.x[:3]).as_matrix().T @ best.x[3:]
    assert np.abs(own.place_mm - place).max() < 1e-3 * own.place_sigma_mm.max()
    rms = np.sqrt(2.0 * best.cost / len(MARKS))
    assert own.residual_px == pytest.approx(rms, rel=1e-6)


def test_the_errors_are_as_large_as_it_says() -> None:
    """Noise of 300 draws: standard deviations are known to 4 %, so 15 % are more than three."""
    camera, random = eye(50.0), np.random.default_rng(2)
    found = [
        camera_pose(view_of(camera, MARKS, random.normal(0.0, SIGMA, MARKS.shape)), sigma_px=SIGMA)
        for _ in range(300)
    ]
    places = np.array([one.place_mm for one in found]) - camera.place
    said = np.median([one.place_sigma_mm for one in found], axis=0)
    assert np.std(places, axis=0) == pytest.approx(said, rel=0.15)
    # The direction moves most along its worse axis: between that of one axis and of two alike.
    views = np.array([one.view for one in found])
    off = np.sqrt(np.square(views - views.mean(axis=0)).sum(axis=1).mean())
    worse = float(np.median([one.view_sigma for one in found]))
    assert 0.85 * worse < off < 1.15 * np.sqrt(2.0) * worse


def test_all_photographs_say_how_exact_a_mark_is() -> None:
    """Ten photographs of 12 marks leave 180 degrees of freedom: 5 % of the error, four of these."""
    random = np.random.default_rng(3)
    views = [
        view_of(eye(30.0, 36.0 * k), MARKS, random.normal(0.0, SIGMA, MARKS.shape))
        for k in range(10)
    ]
    found = camera_poses(views)
    assert found is not None
    assert {one.sigma_px for one in found} == {found[0].sigma_px}
    assert found[0].sigma_px == pytest.approx(SIGMA, rel=0.2)
    assert camera_poses([*views, FrontalView(np.eye(3), None, (), MARKS, MARKS)]) is None


def test_directions_from_every_place() -> None:
    """By hand: from (x, y, 0) to the camera, of unit length."""
    found = camera_pose(view_of(eye(30.0), MARKS, 0.0))
    ways = found.views(MARKS.reshape(3, 4, 2))
    expected = found.place_mm - np.column_stack([MARKS, np.zeros(len(MARKS))])
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    np.testing.assert_allclose(ways.reshape(-1, 3), expected, atol=1e-15)
    assert np.degrees(found.tilt) == pytest.approx(np.degrees(np.arccos(found.view[2])), abs=1e-9)


def test_what_has_no_pose() -> None:
    plain = FrontalView(np.eye(3), None, (), MARKS, np.zeros_like(MARKS))
    with pytest.raises(ArgumentError, match="needs its lens"):
        camera_pose(plain)
    mirrored = FrontalView(
        np.array([[1.5, 0, 400], [0, 1.5, 320], [0, 0, 1.0]]), LENS, (),
        LENS.observed(1.5 * MARKS + (400, 320)), np.zeros_like(MARKS),
    )  # fmt: skip
    with pytest.raises(GeometryError, match="no camera in front of the painting"):
        camera_pose(mirrored)


def test_a_light_file_has_the_places_of_cameras(tmp_path: Path) -> None:
    """Distances and directions come back to the last bits."""
    places = np.array([[300.0, -40.0, 520.0], [0.0, 10.0, 600.0], [-200.0, 90.0, 450.0]])
    lamps = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    views = places / np.linalg.norm(places, axis=1)[:, None]
    path = tmp_path / "lights.csv"
    file = LightFile(
        path, "csv", ("a.tif", "b.tif", "c.tif"), lamps, np.ones(3), views=views,
        view_positions=places, pitch_mm=0.25,
    )  # fmt: skip
    write_lights(path, file)
    back = read_lights(path)
    assert back.view_positions is not None
    np.testing.assert_allclose(back.view_positions, places, rtol=1e-15, atol=1e-12)
    np.testing.assert_allclose(back.views, views, atol=1e-15)
    assert back.pitch_mm == 0.25
    with pytest.raises(ArgumentError, match="width of a pixel, pitch_mm="):
        write_lights(path, replace(file, pitch_mm=None))
    text = path.read_text()
    for wrong in (text.replace("0.25", "0.5", 1), text.replace("0.25", "0")):
        path.write_text(wrong)
        with pytest.raises(CorruptInputError, match="one width of a pixel"):
            read_lights(path)

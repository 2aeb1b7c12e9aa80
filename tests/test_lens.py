"""The lens from photographs of a target: simulated cameras, the file, and what is refused."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from impasto.calibrate import Lens, lens_from_target, read_lens, target_from
from impasto.calibrate.target import refined_corners
from impasto.calibrate.tones import light_from
from impasto.cli import main
from impasto.errors import ArgumentError, CorruptInputError, GeometryError
from impasto.io import write_tiff16
from oracles import flat_scene

SIZE, FOCAL = (400, 320), 440.0
CENTRE = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
BROWN = (-0.15, 0.08, 0.001, -0.0008, 0.0)
RADIAL = (-0.15, 0.08, 0.0, 0.0, 0.0)
BOARD, SQUARE = (8, 6), 25.0
TARGET = "chessboard:8x6:25mm"
NOISE = 0.004


def codes(picture: np.ndarray, seed: int) -> np.ndarray:
    noisy = picture + np.random.default_rng(seed).normal(0, NOISE, picture.shape)
    return np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)[None]


def camera(number: int, k: tuple[float, ...]) -> flat_scene.Camera:
    place = np.random.default_rng(number)
    return flat_scene.Camera(
        SIZE, FOCAL, k, tilt=(0, 25, 35, 40, 30, 38, 28, 33)[number], azimuth=108 * number,
        roll=15 * number, distance=430, aim=place.uniform(-40, 40, 2),
    )  # fmt: skip


@cache
def photographs(k: tuple[float, ...]) -> list[np.ndarray]:
    board = flat_scene.chessboard(*BOARD, SQUARE, 0.35)
    return [codes(camera(number, k).photograph(board, 2), number) for number in range(8)]


def lens(**changes: object) -> Lens:
    values = {
        "model": "brown", "size": SIZE, "coefficients": np.array(BROWN),
        "matrix": np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1.0]]),
        "matrix_sigma": np.ones(4), "coefficient_sigma": np.ones(5), "residual_px": 0.03,
        "photographs": 8, "corners": 384,
    }  # fmt: skip
    return Lens(**(values | changes))


# --- the model


def test_the_model_is_that_of_opencv_and_of_the_oracle() -> None:
    """Two sums of five products in double precision: 1e-12 of 400 pixels."""
    points = np.random.default_rng(0).uniform((0, 0), SIZE, (50, 2))
    own = lens()
    rays = np.column_stack([(points - CENTRE) / FOCAL, np.ones(len(points))])
    peer = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), own.matrix, own.coefficients)[0]
    assert np.abs(own.observed(points) - peer.reshape(-1, 2)).max() < 1e-9
    x, y = flat_scene.distorted(*((points - CENTRE) / FOCAL).T, BROWN)
    assert np.abs(own.observed(points) - FOCAL * np.stack([x, y], 1) - CENTRE).max() < 1e-9


def test_the_way_back_is_newtons_of_the_oracle() -> None:
    """Both iterate to 1e-10 of a focal length of 440 pixels."""
    seen = np.random.default_rng(1).uniform((0, 0), SIZE, (50, 2))
    x, y = flat_scene.undistorted(*((seen - CENTRE) / FOCAL).T, BROWN)
    assert np.abs(lens().ideal(seen) - FOCAL * np.stack([x, y], 1) - CENTRE).max() < 1e-6


def test_a_place_that_the_model_never_reaches() -> None:
    """r (1 - 2 r^2) turns back at r = 0.41; the corner of the frame lies at 0.58."""
    folded = lens(coefficients=np.array([-2.0, 0.0, 0.0, 0.0, 0.0]), model="radial")
    with pytest.raises(ArgumentError, match=r"no inverse at pixel \(0, 0\)"):
        folded.ideal([[0.0, 0.0], [200.0, 160.0]])


# --- calibration


def test_refined_corners_are_better_than_those_of_the_detector() -> None:
    """The detector alone is off by 0.2 pixels here. OpenCV's refinement interpolates linearly,
    which leaves 0.02 to 0.05 pixels of edges as soft as these."""
    board = target_from(TARGET)
    one = camera(1, BROWN)
    light = light_from(photographs(BROWN)[1])
    truth = one.pixel(flat_scene.grid_of(*BOARD, SQUARE))
    numbers, found = board.find(light)
    assert len(numbers) == len(truth)
    # OpenCV may count from the other end of a board of an even number of rows.
    off = min(np.linalg.norm(some - truth, axis=1).mean() for some in (found, found[::-1]))
    assert off < 0.08
    again = refined_corners(light, found, 6.0)
    assert np.linalg.norm(again - found, axis=1).max() < 0.2


@pytest.mark.parametrize(("k", "model"), [(BROWN, "brown"), (RADIAL, "radial")])
def test_a_simulated_lens_is_recovered(k: tuple[float, ...], model: str) -> None:
    """What is asked of a lens: ideal pixels in the part of the frame where the target was.

    Corners are known to about 0.05 pixels; 384 of them give 4 + 5 numbers, so the mean error is of
    the order of 0.05 sqrt(9 / 384) = 0.01 pixels where errors are independent, and those of
    refinement are not: 0.05 is allowed. The focal length is compared with its own deviation.
    """
    found = lens_from_target(photographs(k), TARGET)
    own = found.lens
    assert own.model == model
    assert found.unused == ()
    assert own.residual_px < 0.1
    assert abs(own.matrix[0, 0] - FOCAL) < 4.0 * own.matrix_sigma[0]
    assert own.matrix_sigma[0] < 0.5
    corners = np.concatenate([view.found for view in found.views])
    x, y = flat_scene.undistorted(*((corners - CENTRE) / FOCAL).T, k)
    off = own.ideal(corners) - FOCAL * np.stack([x, y], 1)
    # A shift of the principal point shifts all pixels alike, and a pose absorbs it.
    assert np.std(off, axis=0).max() < 0.05
    if model == "radial":
        assert own.coefficients[2:].tolist() == [0.0, 0.0, 0.0]
        assert abs(own.coefficients[0] - k[0]) < 4.0 * own.coefficient_sigma[0]


def test_a_charuco_board_partly_outside_the_frame() -> None:
    target = target_from("charuco:7x5:30mm:22mm")
    drawn = target.board.generateImage((420, 300)).astype(float) / 255.0

    def board(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        # 2 pixels a mm: the middle of a pixel lies half a pixel inside.
        at = ((x + 105.0) * 2 - 0.5).astype(np.float32), ((75.0 - y) * 2 - 0.5).astype(np.float32)
        return 0.1 + 0.8 * cv2.remap(
            drawn, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
        )

    view = flat_scene.Camera(SIZE, FOCAL, BROWN, tilt=30, azimuth=50, distance=350, aim=(70, 0))
    numbers, found = target.find(light_from(codes(view.photograph(board, 2), 0)))
    assert 8 <= len(numbers) < len(target.corners)
    # Only 3 pixels around a corner are free of markers, and edges are hard: half as much again as
    # for the chessboard.
    off = np.linalg.norm(found - view.pixel(target.corners[numbers]), axis=1)
    assert off.mean() < 0.12


def test_the_command_writes_a_file_that_reads_back(tmp_path: Path) -> None:
    folder, out = tmp_path / "target", tmp_path / "lens.json"
    folder.mkdir()
    for number, one in enumerate(photographs(BROWN)):
        write_tiff16(folder / f"{number}.tif", one)
    write_tiff16(folder / "no-target.tif", np.full((1, *SIZE[::-1]), 0.5))
    words = ["calibrate", "lens", str(folder), "--target", TARGET, "--out", str(out), "--quiet"]
    assert main(words) == 0
    direct = lens_from_target(folder, TARGET)
    assert direct.unused == ("no-target.tif",)
    again = read_lens(out)
    # OpenCV adds in another order each time: the last digits differ.
    assert np.abs(again.matrix - direct.lens.matrix).max() < 1e-6
    assert (again.size, again.model, again.corners) == (SIZE, "brown", 384)
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == out.read_bytes()
    assert cv2.imread(str(out.with_suffix(".png"))).shape[1] > 1000
    assert main(words) == 1  # nothing is overwritten


# --- what is refused


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("chessboard", "expected a target such as"),
        ("chessboard:9x6", "expected a target such as"),
        ("chessboard:2x6:25mm", "3 inner corners or more"),
        ("chessboard:9x6:0mm", "lengths above 0 mm"),
        ("charuco:7x5:30mm:30mm", "smaller than squares"),
        ("charuco:7x5:30mm:22mm:4x4_5", "no dictionary of markers.*did you mean '4x4_50'"),
        ("charuco:14x14:30mm:22mm:4x4_50", "has 98 markers, but its dictionary 50"),
    ],
)
def test_other_targets(text: str, said: str) -> None:
    with pytest.raises(ArgumentError, match=said):
        target_from(text)


def test_photographs_that_do_not_show_the_target() -> None:
    grey = [np.full((1, *SIZE[::-1]), 30000, np.uint16)] * 3
    with pytest.raises(ArgumentError, match="was found in 0 of 3 photographs"):
        lens_from_target(grey, TARGET)
    with pytest.raises(ArgumentError, match="was found in 2 of 2 photographs, 3 are the least"):
        lens_from_target(photographs(BROWN)[:2], TARGET)


def test_photographs_of_different_sizes() -> None:
    one, two = photographs(BROWN)[:2]
    with pytest.raises(ArgumentError, match="photograph 2: 320 x 400 pixels, but photograph 1"):
        lens_from_target([one, two.transpose(0, 2, 1)], TARGET)


def test_views_that_are_all_alike() -> None:
    """From the front, a nearer camera and a longer lens make one picture."""
    board = flat_scene.chessboard(*BOARD, SQUARE, 0.35)
    pictures = [
        codes(flat_scene.Camera(
            SIZE, FOCAL, RADIAL, distance=430, roll=7 * number, aim=(10 * number, 0)
        ).photograph(board, 2), number)
        for number in range(3)
    ]  # fmt: skip
    with pytest.raises(GeometryError, match="faces the camera in all of them but one"):
        lens_from_target(pictures, TARGET, model="radial")


def test_files_that_hold_no_lens(tmp_path: Path) -> None:
    path = tmp_path / "lens.json"
    lens().save(path)
    content = json.loads(path.read_text())

    def said(**changes: object) -> str:
        path.write_text(json.dumps({**content, **changes}))
        with pytest.raises(CorruptInputError) as caught:
            read_lens(path)
        return str(caught.value)

    assert "is not the file of a lens" in said(kind="other")
    assert "version" in said(version=2)
    assert "expected radial or brown" in said(model="fisheye")
    assert "missing" in said(coefficients={"k1": 0.1})
    assert "3 x 3 finite numbers" in said(camera_matrix=[[1.0]])
    flat = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]]
    assert "focal lengths of a pixel or more" in said(camera_matrix=flat)
    assert "columns and rows from 1 on" in said(size_px=[0, 10])
    assert "cannot be read as the file of a lens" in said(size_px=None)
    path.write_text(json.dumps({k: v for k, v in content.items() if k != "model"}))
    with pytest.raises(CorruptInputError, match=r"the file of a lens \(it has no 'model'\)"):
        read_lens(path)
    path.write_text("{")
    with pytest.raises(CorruptInputError, match="not valid JSON"):
        read_lens(path)
    with pytest.raises(ArgumentError, match="cannot be read"):
        read_lens(tmp_path / "none.json")

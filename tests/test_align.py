"""Alignment: simulated photographs of known truth, shifts between lamps, and every mistake."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import impasto
from impasto.align import (
    FrontalView,
    Grid,
    Layout,
    Reference,
    align,
    camera_pose,
    find_marks,
    frontal_view,
    layout_from_markers,
    read_points,
    rectified,
    relit_shifts,
    shift_between,
    size_from,
)
from impasto.align.refinement import gradient_picture, phase_shift
from impasto.align.relighting import without_gauge
from impasto.calibrate import Lens
from impasto.calibrate.tones import light_from
from impasto.cli import main
from impasto.errors import ArgumentError, CorruptInputError, GeometryError
from impasto.io import read_image, read_lights, write_lights, write_png8, write_tiff16
from oracles import flat_scene, relief

SIZE, FOCAL = (480, 400), 560.0
K = (-0.15, 0.08, 0.001, -0.0008, 0.0)
LENS = Lens(
    "brown", SIZE, np.array([[FOCAL, 0, 239.5], [0, FOCAL, 199.5], [0, 0, 1.0]]), np.array(K),
    np.zeros(4), np.zeros(5), 0.03, 10, 400,
)  # fmt: skip
PAINTING, SIDE = (200.0, 150.0), 40.0
EXACT, TOUCHING = "aruco:4x4_50:40mm", "aruco:4x4_50"
POINTS = flat_scene.grid_of(7, 5, 20.0)
Scene = Callable[[np.ndarray, np.ndarray], np.ndarray]


def bits(*numbers: int) -> list[np.ndarray]:
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return [cv2.aruco.generateImageMarker(codes, number, 6) // 255 for number in numbers]


def scene(*numbers: int) -> Scene:
    return flat_scene.together(
        flat_scene.chessboard(7, 5, 20.0, 0.3),
        flat_scene.framed(*PAINTING, SIDE, bits(*numbers or (0, 1, 2, 3)), 0.3),
    )


def camera(tilt: float = 30.0, **changes: object) -> flat_scene.Camera:
    options = {"azimuth": 20, "roll": 4, "distance": 500, "aim": (2.0, -1.0)} | changes
    return flat_scene.Camera(SIZE, FOCAL, K, tilt=tilt, **options)


def codes(picture: np.ndarray, seed: int = 0) -> np.ndarray:
    noisy = picture + np.random.default_rng(seed).normal(0, 0.004, picture.shape)
    return np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)[None]


@cache
def photograph(tilt: float = 30.0) -> np.ndarray:
    return codes(camera(tilt).photograph(scene(), 2))


def view_of(picture: np.ndarray, layout: Layout, lens: Lens | None = LENS) -> FrontalView:
    marks = find_marks(light_from(picture), layout, "a.tif")
    return frontal_view(
        layout.mm(marks.names), marks.pixels, marks.names, layout.size_mm, lens, "a.tif"
    )


def off_px(view: FrontalView, eye: flat_scene.Camera) -> np.ndarray:
    """Errors of the grid in pixels of the frontal picture."""
    return np.linalg.norm(view.mm(eye.pixel(POINTS)) - POINTS, axis=1) / view.pixel_mm()


# --- marks and perspective


@pytest.mark.parametrize("markers", [EXACT, TOUCHING])
@pytest.mark.parametrize("tilt", [0.0, 45.0, 60.0])
def test_the_grid_lies_where_it_is(tilt: float, markers: str) -> None:
    """0.15 pixels are asked of a grid; at 60 degrees half as many rows show a length."""
    view = view_of(photograph(tilt), layout_from_markers(markers, PAINTING))
    assert len(view.names) == (16 if markers == EXACT else 4)
    limit = 0.15 if markers == EXACT or tilt < 60 else 0.3
    assert off_px(view, camera(tilt)).max() < limit
    assert (view.rms is None) == (markers == TOUCHING)


def test_corners_of_markers_are_better_than_opencvs() -> None:
    """OpenCV's own refinement of these corners is the peer."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters
    )
    picture, layout = photograph(45.0), layout_from_markers(EXACT, PAINTING)
    quads, numbers, _ = detector.detectMarkers((picture[0] >> 8).astype(np.uint8))
    peer = np.concatenate([quads[at].reshape(4, 2) for at in np.argsort(numbers.ravel())])
    marks = find_marks(light_from(picture), layout, "a.tif")
    truth = camera(45.0).pixel(layout.mm(marks.names))
    own = np.linalg.norm(marks.pixels - truth, axis=1).mean()
    assert own < 0.06
    assert own < 0.5 * np.linalg.norm(peer - truth, axis=1).mean()


def test_without_the_lens_the_grid_is_off() -> None:
    """The lens moves points of this frame by pixels, which the test of the grid must see."""
    view = view_of(photograph(0.0), layout_from_markers(EXACT, PAINTING), None)
    assert off_px(view, camera(0.0)).max() > 0.3


def test_the_place_of_the_camera() -> None:
    """0.03 pixels over 250 pixels at 500 mm: some tenths of a mm."""
    eye = camera(45.0)
    found = camera_pose(view_of(photograph(45.0), layout_from_markers(EXACT, PAINTING)))
    assert np.linalg.norm(found.place_mm - eye.place) < 1.0


def test_a_charuco_board_in_the_plane() -> None:
    layout = layout_from_markers("charuco:7x5:30mm:20mm", PAINTING)
    assert layout.target is not None
    drawn = layout.target.board.generateImage((420, 300)).astype(float) / 255.0

    def board(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        # 2 pixels a mm: the middle of a pixel lies half a pixel inside.
        at = ((x + 105.0) * 2 - 0.5).astype(np.float32), ((75.0 - y) * 2 - 0.5).astype(np.float32)
        return 0.1 + 0.8 * cv2.remap(
            drawn, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
        )

    view = view_of(codes(camera().photograph(board, 2)), layout)
    assert len(view.names) == 24
    assert off_px(view, camera()).max() < 0.15


def given(tmp_path: Path, **changes: object) -> Layout:
    corners = [(-100, 75), (100, 75), (100, -75), (-100, -75)]
    rough = np.rint(camera().pixel(corners)) + np.array([2, -1])
    names = ("upper left", "upper right", "lower right", "lower left")
    content = {
        "size_mm": PAINTING,
        "photographs": {"default": dict(zip(names, rough.tolist(), strict=True))},
    } | changes
    path = tmp_path / "points.json"
    path.write_text(json.dumps(content))
    return read_points(path)


@pytest.mark.parametrize("kind", ["corner", "disc"])
def test_points_given_by_hand_are_refined(kind: str, tmp_path: Path) -> None:
    """Roughly given by 2 pixels. A frame's corner is rounded by blur, which moves it inwards by a
    part of a pixel; a disc of 4 mm seen at 30 degrees has its centroid within 0.01 mm."""
    places = [(-100, 75), (100, 75), (100, -75), (-100, -75)]

    def frame(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        inside = flat_scene.step(100 - abs(x), 0.3) * flat_scene.step(75 - abs(y), 0.3)
        return 0.8 - 0.6 * inside

    def discs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.8 - 0.7 * sum(
            flat_scene.step(4.0 - np.hypot(x - a, y - b), 0.3) for a, b in places
        )

    picture = codes(camera().photograph(frame if kind == "corner" else discs, 2))
    view = view_of(picture, given(tmp_path, kind=kind))
    assert off_px(view, camera()).max() < (0.3 if kind == "corner" else 0.1)


# --- resampling


def test_corners_in_the_frontal_picture() -> None:
    """Found by OpenCV in the picture itself, whose own error is 0.02 to 0.05 pixels."""
    view = view_of(photograph(), layout_from_markers(EXACT, PAINTING))
    grid = Grid(PAINTING, view.pixel_mm())
    made = rectified(photograph(), view, grid)
    assert made.seen.all()
    expected = np.stack([
        POINTS[:, 0] / grid.pixel_mm + (grid.columns - 1) / 2,
        (grid.rows - 1) / 2 - POINTS[:, 1] / grid.pixel_mm,
    ], axis=1)  # fmt: skip
    start = np.ascontiguousarray(expected[:, None].astype(np.float32))
    picture = made.planes[0].astype(np.float32)
    found = cv2.cornerSubPix(picture, start, (6, 6), (-1, -1), (3, 100, 1e-4)).reshape(-1, 2)
    assert np.linalg.norm(found - expected, axis=1).mean() < 0.1


def plain(scale: float = 1.0) -> FrontalView:
    """A photograph of 100 x 80 pixels of ``1 / scale`` mm, seen from the front."""
    matrix = np.array([[scale, 0, 49.5], [0, -scale, 39.5], [0, 0, 1.0]])
    return FrontalView(matrix, None, (), np.zeros((0, 2)), np.zeros((0, 2)))


def test_the_same_pixels_are_the_same_numbers() -> None:
    picture = np.random.default_rng(0).integers(0, 65000, (3, 80, 100)).astype(np.uint16)
    made = rectified(picture, plain(), Grid((100.0, 80.0), 1.0))
    assert np.array_equal(made.planes, picture)


def test_what_a_clipped_sample_touches_is_clipped() -> None:
    picture = np.full((2, 80, 100), 1000, np.uint16)
    picture[0, 40, 50] = 65535
    made = rectified(picture, plain(), Grid((90.0, 70.0), 1.0), shift=(0.3, 0.2), full=65535.0)
    clipped = made.planes == 65535
    assert clipped.all(axis=0).sum() == 16  # the pixel, those around it, and half-way ones
    assert (clipped[0] == clipped[1]).all()


def test_larger_pixels_are_means() -> None:
    """Stripes of one pixel become their mean, with a hundredth of their contrast at most."""
    picture = np.tile(np.array([0.0, 1.0], np.float32), (1, 80, 50))
    made = rectified(picture, plain(), Grid((80.0, 60.0), 4.0))
    assert np.abs(made.planes - 0.5).max() < 0.01


def test_beyond_the_photograph_nothing_is_seen() -> None:
    made = rectified(np.full((1, 80, 100), 9, np.uint16), plain(), Grid((110.0, 70.0), 1.0))
    assert made.seen.mean() == pytest.approx(100 / 110)
    assert (made.planes[0][~made.seen] == 0).all()


# --- shifts


def ring(slope: float) -> tuple[list[np.ndarray], np.ndarray]:
    pictures, lamps = [], []
    for azimuth, elevation in [(45 * k, 35) for k in range(8)] + [(90 * k, 65) for k in range(4)]:
        a, e = np.radians([azimuth, elevation])
        lamps.append([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        pictures.append(relief.photograph(192, slope, azimuth, elevation))
    return pictures, np.array(lamps)


def light(picture: np.ndarray, move: np.ndarray) -> np.ndarray:
    moved = np.maximum(relief.shifted(picture, *move), 0.0)[8:-8, 8:-8]
    return np.ascontiguousarray(moved, dtype=np.float32)


def test_opposite_lamps_on_relief() -> None:
    """0.1 pixels are asked; slopes of 8 degrees, lamps at 35 degrees. Pairs alone fail here."""
    pictures, lamps = ring(8.0)
    moves = np.zeros((12, 2))
    moves[[0, 4]] = (0.8, -0.3), (-0.6, 0.5)  # two lamps opposite each other
    moved = [light(*pair) for pair in zip(pictures, moves, strict=True)]
    found = np.array([(one.x, one.y) for one in relit_shifts(moved, lamps)])
    assert np.linalg.norm(found - moves, axis=1).max() < 0.1
    pair = shift_between(moved[0], moved[4])
    assert pair.refused or np.hypot(pair.x + 1.4, pair.y - 0.8) > 0.1


def test_the_gauge_takes_what_lamps_explain_and_leaves_the_rest() -> None:
    lamps = ring(3.0)[1]
    slopes = lamps[:, :2] / lamps[:, 2:]
    explained = 0.2 + slopes @ np.array([[0.3, 0.1], [-0.2, 0.4]])
    assert np.abs(without_gauge(explained, lamps)).max() < 1e-9
    one = np.zeros((12, 2))
    one[3] = (1.0, -2.0)
    # Huber's weights leave a few hundredths of an outlier of hundreds of deviations.
    assert np.abs(without_gauge(explained + one, lamps) - one).max() < 0.1


def test_two_photographs_under_similar_lamps() -> None:
    """Lamps 40 degrees apart, slopes of 3 degrees: 0.1 pixels are asked."""
    first = relief.photograph(192, 3.0, 0, 45)
    second = relief.photograph(192, 3.0, 40, 45)
    found = shift_between(light(first, np.zeros(2)), light(second, np.array([0.37, -0.61])))
    assert not found.refused
    assert np.hypot(found.x - 0.37, found.y + 0.61) < 0.1


@pytest.mark.parametrize("width", [150, 208, 224, 225])
def test_phase_correlation_has_no_bias_at_any_width(width: int) -> None:
    """A picture and itself: OpenCV pads 224 to 225 and is then off by 0.5; its fit of the peak, a
    centroid, is exact for a symmetrical one."""
    picture = gradient_picture(light(relief.photograph(256, 3.0, 0, 45), np.zeros(2)))
    own = np.ascontiguousarray(picture[:160, :width])
    assert np.hypot(*phase_shift(own, own)) < 0.02


def test_pictures_with_nothing_in_common_are_not_shifted() -> None:
    noise = np.random.default_rng(2).uniform(0.2, 1.0, (2, 128, 128)).astype(np.float32)
    found = shift_between(*noise)
    assert found.refused
    assert (found.x, found.y) == (0.0, 0.0)
    flat = np.ones((64, 64), np.float32)
    assert shift_between(flat, flat).refused


# --- folders


def session(folder: Path, *tilts: float) -> Path:
    folder.mkdir()
    names = [f"p{number}.tif" for number in range(len(tilts))]
    for name, tilt in zip(names, tilts, strict=True):
        write_tiff16(folder / name, photograph(tilt))
    angles = np.arange(len(tilts)) * 2.1
    lamps = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles), np.full(len(tilts), 0.75**0.5)])
    write_lights(folder / "dome.lp", lamps.T, names)
    return folder


def test_the_command_makes_a_stack(tmp_path: Path) -> None:
    folder, out = session(tmp_path / "photos", 0.0, 30.0, 45.0), tmp_path / "aligned"
    LENS.save(tmp_path / "lens.json")
    words = ["align", str(folder), "--out", str(out), "--markers", EXACT, "--size", "200x150",
             "--lens", str(tmp_path / "lens.json"), "--refine", "--quiet"]  # fmt: skip
    assert main(words) == 0
    stack = impasto.read_stack(out)
    report = json.loads((out / "report" / "alignment.json").read_text())
    assert list(stack.samples.shape[2:]) == report["size_px"][::-1]
    assert report["pixel_mm"] * report["size_px"][0] == pytest.approx(200.0, abs=0.5)
    lamps = read_lights(folder / "dome.lp").directions
    assert np.abs(stack.rig.directions - lamps).max() < 1e-12
    eyes = np.array([camera(tilt).place for tilt in (0.0, 30.0, 45.0)])
    eyes /= np.linalg.norm(eyes, axis=1)[:, None]
    # 1 mm at 500 mm.
    assert np.abs(stack.rig.views - eyes).max() < 0.002
    assert report["marks_residual_px"] < 0.1
    assert abs(report["photographs"][2]["tilt_degrees"] - 45.0) < 0.2
    # All show the chessboard in one place: bright and dark differ by 0.8, noise and blur of
    # different perspectives are much less.
    planes = stack.samples[:, 0, 20:-20, 20:-20] / 65535.0
    assert np.abs(planes - planes.mean(axis=0)).mean() < 0.02
    assert cv2.imread(str(out / "report" / "alignment.png")).shape[1] > 1000
    assert not (out / "report" / "mask.png").exists()
    assert main(words) == 1  # nothing is overwritten


def test_rotated_photographs_of_one_camera_have_one_view(tmp_path: Path) -> None:
    """Also from in front, where a near camera sees each pixel from elsewhere."""
    folder = session(tmp_path / "photos", 0.0, 0.0)
    found = align(folder, tmp_path / "out", layout_from_markers(EXACT, PAINTING), lens=LENS)
    assert found.lights == "lights.csv"
    assert found.covered == 1.0
    first, second = impasto.read_stack(tmp_path / "out").rig.view_positions
    assert (first == second).all()
    pose = found.photographs[0].pose
    assert pose is not None
    # Six deviations, and what corners have in common: 0.02 pixels (docs/align.md) of more than 100
    # from the middle, as a share of the distance.
    place = camera(0.0).place
    limit = 6.0 * pose.place_sigma_mm + 0.02 / 100.0 * np.linalg.norm(place)
    assert (np.abs(first - place) < limit).all()


def test_a_code_of_clipped_samples_is_one(tmp_path: Path) -> None:
    folder = session(tmp_path / "photos", 0.0)
    layout = layout_from_markers(EXACT, PAINTING)
    with pytest.raises(ArgumentError, match="saturation: expected the code from which"):
        align(folder, tmp_path / "out", layout, saturation=float("nan"))
    with pytest.raises(ArgumentError, match="saturation: expected at most"):
        align(folder, tmp_path / "out", layout, saturation=65536)
    assert not (tmp_path / "out").exists()


def test_a_fixed_camera_shares_its_marks(tmp_path: Path) -> None:
    folder = session(tmp_path / "photos", 30.0, 30.0)
    hidden = photograph(30.0).copy()
    x, y = camera().pixel([(120, 95)])[0].astype(int)
    hidden[0, y - 30 : y + 30, x - 30 : x + 30] = 60000
    write_tiff16(folder / "p1.tif", hidden)
    layout = layout_from_markers(EXACT, PAINTING)
    with pytest.raises(ArgumentError, match=r"p1\.tif: marker 1 \(upper right\) of 4x4_50 not"):
        align(folder, tmp_path / "out", layout, lens=LENS)
    assert not (tmp_path / "out").exists()
    found = align(folder, tmp_path / "out", layout, lens=LENS, fixed_camera=True)
    for one in found.photographs:
        assert off_px(one.view, camera()).max() < 0.15


def test_a_photograph_that_a_fixed_camera_took_from_elsewhere_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rolled by one pixel: its corners are the others' one column on, found to 0.05 pixels."""
    folder = session(tmp_path / "photos", 30.0, 30.0, 30.0)
    write_tiff16(folder / "p2.tif", np.roll(photograph(30.0), 1, axis=2))
    words = ["align", str(folder), "--markers", EXACT, "--size", "200x150", "--fixed-camera"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "warning: p2.tif moved by " in said
    assert said.count("moved by") == 1
    report = json.loads((tmp_path / "out" / "report" / "alignment.json").read_text())
    moves = [one["move_px"] for one in report["photographs"]]
    assert moves[:2] == [None, None]
    assert moves[2] == pytest.approx([1.0, 0.0], abs=0.05)


def test_eight_bits_become_linear_light(tmp_path: Path) -> None:
    """sRGB code 188 is 0.5029 of full scale (IEC 61966-2-1); half a code of 16 bits is 8e-6."""
    folder = tmp_path / "photos"
    folder.mkdir()
    write_png8(folder / "a.png", np.full((80, 100), 188, np.uint8))
    points = {"a.png": {"upper left": (9.5, 9.5), "upper right": (89.5, 9.5),
                        "lower right": (89.5, 69.5), "lower left": (9.5, 69.5)}}  # fmt: skip
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"size_mm": [80, 60], "photographs": points, "kind": "exact"}))
    align(folder, tmp_path / "out", read_points(path))
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert np.abs(read_image(tmp_path / "out" / "a.tif") / 65535 - linear).max() < 1e-5


def test_a_painting_that_leaves_the_frame_has_a_mask(tmp_path: Path) -> None:
    folder = session(tmp_path / "photos", 30.0)
    layout = layout_from_markers(EXACT, PAINTING)
    wide = Layout((460.0, 150.0), layout.places, layout.dictionary)
    found = align(folder, tmp_path / "out", wide, lens=LENS, pixel_mm=1.0)
    mask = read_image(tmp_path / "out" / "report" / "mask.png")
    assert mask.shape == (1, 150, 460)
    assert 0.5 < found.covered < 1.0
    assert (mask > 0).mean() == pytest.approx(found.covered)


def test_another_session_is_aligned_by_features(tmp_path: Path) -> None:
    """A cleaned painting, brighter and with another contrast; 0.1 pixels of the reference."""
    noise = relief.smooth_noise(512, 4.0, 7)
    step = 200.0 / 360

    def painted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        at = (x / step + 256).astype(np.float32), (y / step + 256).astype(np.float32)
        return 0.35 + 0.07 * cv2.remap(
            noise.astype(np.float32), *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP
        )

    eye = camera(25.0)
    before = camera(0.0)
    marks = flat_scene.grid_of(3, 3, 60.0)
    names = tuple(f"point {number}" for number in range(9))
    view = frontal_view(marks, before.pixel(marks), names, PAINTING, LENS, "before")
    grid = Grid(PAINTING, 0.9)
    old = rectified(codes(before.photograph(painted, 2)), view, grid)
    reference = Reference(light_from(old.planes), grid, "before.tif")
    cleaned = 1.5 * eye.photograph(painted, 2) ** 0.8
    found = reference.view(light_from(codes(cleaned)), LENS, "after.tif")
    assert np.linalg.norm(found.mm(eye.pixel(POINTS)) - POINTS, axis=1).max() / 0.9 < 0.1
    with pytest.raises(GeometryError, match=r"other\.tif: \d+ features agree with before\.tif"):
        reference.view(light_from(photograph()), LENS, "other.tif")


# --- what is refused


def refused(*numbers: int, layout: Layout | None = None) -> str:
    picture = codes(camera().photograph(scene(*numbers), 2))
    with pytest.raises(ArgumentError) as caught:
        view_of(picture, layout or layout_from_markers(EXACT, PAINTING))
    return str(caught.value)


def test_a_marker_that_is_missing() -> None:
    said = refused(0, 1, 7, 3)
    assert "a.tif: marker 2 (lower right) of 4x4_50 not found (markers 7 are there)" in said


def test_a_marker_that_is_there_twice() -> None:
    assert "a.tif: marker 1 of 4x4_50 is seen 2 times" in refused(0, 1, 1, 3)


def test_a_marker_that_is_upside_down() -> None:
    quads = bits(0, 1, 2, 3)
    quads[2] = quads[2][::-1, ::-1]
    turned = flat_scene.together(
        flat_scene.chessboard(7, 5, 20.0, 0.3), flat_scene.framed(*PAINTING, SIDE, quads, 0.3)
    )
    picture = codes(camera().photograph(turned, 2))
    with pytest.raises(ArgumentError, match=r"a\.tif: marker 2 \(lower right\) is upside down"):
        view_of(picture, layout_from_markers(EXACT, PAINTING))


def test_markers_in_each_others_places() -> None:
    assert "or another marker has its place" in refused(1, 0, 2, 3)


def test_marks_that_contradict_each_other() -> None:
    layout = layout_from_markers("aruco:4x4_50:25mm", PAINTING)
    assert "marks contradict each other by" in refused(layout=layout)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ([(0, 0), (100, 0), (200, 0), (300, 0)], "lie on one line in the photograph"),
        ([(0, 0), (100, 50), (200, 100), (300, 0)], "lie on one line in the photograph"),
        ([(300, 50), (100, 50), (100, 200), (300, 200)], "its marks are mirrored"),
        ([(100, 50), (300, 200), (300, 50), (100, 200)], "behind the camera"),
    ],
)
def test_points_that_no_camera_shows(found: list[tuple[int, int]], said: str) -> None:
    mm = np.array([(-100, 75), (100, 75), (100, -75), (-100, -75)], float)
    names = ("upper left", "upper right", "lower right", "lower left")
    with pytest.raises(GeometryError, match=said) as caught:
        frontal_view(mm, np.array(found, float), names, PAINTING, None, "a.tif")
    assert str(caught.value).startswith("a.tif: ")


def test_too_few_marks() -> None:
    with pytest.raises(GeometryError, match="3 marks, but 4 are the least"):
        frontal_view(np.eye(3, 2), np.eye(3, 2), ("a", "b", "c"), PAINTING, None, "a.tif")


def test_points_outside_the_photograph_or_without_a_mark(tmp_path: Path) -> None:
    far = {"upper left": (-20, 5), "upper right": (400, 5), "lower right": (400, 300),
           "lower left": (5, 300)}  # fmt: skip
    layout = given(tmp_path, photographs={"default": far})
    with pytest.raises(ArgumentError, match=r"a\.tif: upper left at \(-20, 5\) lies outside"):
        view_of(photograph(), layout)
    layout = given(tmp_path, kind="disc")
    flat = codes(np.full(SIZE[::-1], 0.5))
    with pytest.raises(ArgumentError, match="no disc within 12 px"):
        view_of(flat, layout)
    layout = given(tmp_path, photographs={"b.tif": far})
    with pytest.raises(ArgumentError, match=r"neither a\.tif nor default"):
        view_of(photograph(), layout)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"size_mm": [200]}, "size_mm: expected two numbers"),
        ({"size_mm": [200, 0]}, "expected sizes above 0"),
        ({"photographs": {}}, "expected the pixels of each mark"),
        ({"photographs": {"a": {"upper left": [1, 2]}}}, "four points or more"),
        ({"kind": "dot"}, "kind: expected 'corner'"),
        ({"search_px": 0}, "search_px: expected 2 to 1000"),
        ({"colour": "red"}, "'colour' is not known"),
        ({"points_mm": dict.fromkeys("abcd", (0, 0))}, "is none of a, b, c, d"),
    ],
)
def test_files_of_points(changes: dict[str, object], said: str, tmp_path: Path) -> None:
    with pytest.raises(CorruptInputError, match=said):
        given(tmp_path, **changes)


@pytest.mark.parametrize(
    ("markers", "said"),
    [
        ("april", "expected aruco:4x4_50"),
        ("aruco:4x4_5", "no dictionary of markers"),
        ("aruco:4x4_50:0mm", "expected a side in mm, found '0'"),
        ("charuco:7x5", "expected a target such as"),
    ],
)
def test_other_markers(markers: str, said: str) -> None:
    with pytest.raises(ArgumentError, match=said):
        layout_from_markers(markers, PAINTING)
    with pytest.raises(ArgumentError, match="such as 400x300"):
        size_from("400")


def test_folders_and_options_that_do_not_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, layout = session(tmp_path / "photos", 0.0, 30.0), layout_from_markers(EXACT, PAINTING)
    small = Lens(**{**vars(LENS), "size": (4000, 3000)})
    with pytest.raises(ArgumentError, match=r"p0\.tif: 480 x 400 pixels, but the lens"):
        align(folder, tmp_path / "out", layout, lens=small)
    write_lights(folder / "dome.lp", np.array([[0, 0, 1.0]]), ["p0.tif"])
    with pytest.raises(ArgumentError, match=r"has no light of p1\.tif"):
        align(folder, tmp_path / "out", layout, lens=LENS)
    with pytest.raises(ArgumentError, match="holds no photographs"):
        align(tmp_path, tmp_path / "out", layout)
    assert main(["align", str(folder), "--out", str(tmp_path / "out"), "--markers", EXACT]) == 1
    assert "--markers and --size go together" in capsys.readouterr().err
    assert main(["align", str(folder), "--out", str(tmp_path / "out")]) == 1
    assert "give one of --markers, --points and --to" in capsys.readouterr().err
    words = ["--to", str(folder / "p0.tif")]
    assert main(["align", str(folder), "--out", str(tmp_path / "out"), *words]) == 1
    assert "is not known; give --pixel" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

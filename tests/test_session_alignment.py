"""``camera.lens`` and ``photographs.alignment``: the stack of what ``impasto align`` writes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import impasto
from impasto import ArgumentError, CorruptInputError, ImpastoError
from impasto.align import DepthMesh, align, layout_from_markers, read_points
from impasto.cli import main
from impasto.io import Session, read_lights, read_session, write_png8, write_session, write_tiff16
from impasto.io.depth_mesh import as_written
from impasto.jobs.photographs import open_photographs
from impasto.session import check_session
from test_align import EXACT, LENS, PAINTING, session
from test_session_file import same

REPORT = "aligned/report/alignment.json"


@pytest.fixture(scope="module")
def painting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of three tilts, their lights, the lens, and what ``align`` made of them."""
    home = tmp_path_factory.mktemp("altar")
    session(home / "photos", 0.0, 30.0, 45.0)
    LENS.save(home / "lens.json")
    words = ["align", str(home / "photos"), "--out", str(home / "aligned"), "--markers", EXACT,
             "--size", "200x150", "--lens", str(home / "lens.json"), "--quiet"]  # fmt: skip
    assert main(words) == 0
    return home


@pytest.fixture
def copy(painting: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(painting, tmp_path / "altar"))


def written(home: Path, **values: Any) -> Path:
    path = home / "session.toml"
    path.unlink(missing_ok=True)
    usual = {"images": "photos", "lights": "photos/dome.lp", "lens": "lens.json"}
    write_session(path, Session(**{**usual, "alignment": REPORT, **values}))
    return path


def refused(path: Path, kind: type[ImpastoError] = ArgumentError) -> str:
    with pytest.raises(kind) as caught:
        impasto.read_stack(path)
    return str(caught.value)


def pixel_mm(home: Path) -> float:
    return float(json.loads((home / REPORT).read_text())["pixel_mm"])


def test_a_session_is_the_stack_of_the_aligned_folder(painting: Path) -> None:
    """Samples, lights and views bit for bit; the session also knows the width of a pixel."""
    found = impasto.read_stack(written(painting))
    expected = impasto.read_stack(painting / "aligned", pitch_mm=pixel_mm(painting))
    same(found, expected)
    assert np.abs(found.rig.views - (0, 0, 1)).max() > 0.1  # the camera was not in front
    assert painting / "lens.json" in found.sources


def test_the_relief_of_an_alignment_is_taken_out_as_it_was(copy: Path) -> None:
    """That of a mesh, whose file lies beside the report; without it the session is refused."""
    x, y = np.mgrid[:5, :6]
    mesh = DepthMesh(PAINTING, 2.0 * np.sin(x + 0.5 * y), np.full((5, 6), np.nan))
    shutil.rmtree(copy / "aligned")
    layout = layout_from_markers(EXACT, PAINTING)
    align(copy / "photos", copy / "aligned", layout, lens=LENS, depth=as_written(mesh))
    found = impasto.read_stack(written(copy))
    same(found, impasto.read_stack(copy / "aligned", pitch_mm=pixel_mm(copy)))
    assert copy / "aligned/report/depth.csv" in found.sources
    window = impasto.read_stack(written(copy), region=(3, 5, 40, 60))
    assert (window.samples == found.samples[..., 3:43, 5:65]).all()
    (copy / "aligned/report/depth.csv").unlink()
    assert "depth.csv" in refused(written(copy))


@pytest.mark.parametrize("region", [(3, 5, 40, 60), (100, 0, 1, 200)])
def test_a_region_is_a_crop(region: tuple[int, int, int, int], painting: Path) -> None:
    """Also where it begins inside of the blocks that are resampled at a time."""
    path = written(painting)
    top, left, height, width = region
    whole = impasto.read_stack(path).samples
    part = impasto.read_stack(path, region=region).samples
    np.testing.assert_array_equal(part, whole[..., top : top + height, left : left + width])


def test_eight_bits_and_a_saturation_are_as_aligned(tmp_path: Path) -> None:
    """sRGB codes are resampled in linear light; codes from the saturation on are clipped."""
    rng, home = np.random.default_rng(3), tmp_path / "photos"
    home.mkdir()
    for name in ("a", "b", "c"):
        write_png8(home / f"{name}.png", rng.integers(20, 256, (80, 100, 3), dtype=np.uint8))
    corners = {"upper left": (9.5, 9.5), "upper right": (89.5, 11.5),
               "lower right": (88.5, 69.5), "lower left": (9.5, 70.5)}  # fmt: skip
    marks = tmp_path / "points.json"
    marks.write_text(
        json.dumps({"size_mm": [80, 60], "photographs": {"default": corners}, "kind": "exact"})
    )
    align(home, tmp_path / "aligned", read_points(marks), saturation=250)
    vectors = {f"{name}.png": (0.1 * i, 0.0, 1.0) for i, name in enumerate("abc")}
    path = written(tmp_path, lights=None, lens=None, directions=vectors, saturation=250.0)
    found = impasto.read_stack(path)
    level = np.rint(65535 * ((250 / 255 + 0.055) / 1.055) ** 2.4)
    lights = np.array(list(vectors.values()))
    expected = impasto.read_stack(tmp_path / "aligned", lights=lights, saturation=level)
    np.testing.assert_array_equal(found.samples, expected.samples)
    np.testing.assert_array_equal(found.saturation, expected.saturation)
    assert found.encoding == expected.encoding
    clipped = found.samples >= level
    assert 0.1 < clipped.mean() < 0.9


def test_the_lens_alone_keeps_the_pixels(painting: Path) -> None:
    """OpenCV's own undistortion with the same interpolation is the peer.

    OpenCV rounds places to 1/32 of a pixel, either way where they lie between two. The pictures
    have slopes of 0.4 of full scale in a pixel: 0.4 / 32 at most.
    """
    found = impasto.read_stack(written(painting, alignment=None)).samples
    x, y = cv2.initUndistortRectifyMap(
        LENS.matrix, LENS.coefficients, None, LENS.matrix, LENS.size, cv2.CV_32FC1
    )
    photograph = cv2.imread(str(painting / "photos" / "p1.tif"), cv2.IMREAD_UNCHANGED)
    peer = cv2.remap(photograph, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
    inside = (x > 4) & (x < LENS.size[0] - 5) & (y > 4) & (y < LENS.size[1] - 5)
    off = np.abs(found[1, 0].astype(float) - peer)[inside] / 65535.0
    assert inside.mean() > 0.8
    assert off.max() < 0.4 / 32
    moved = np.abs(photograph.astype(float) - peer)[inside] / 65535.0
    assert moved.max() > 0.5  # the lens is not idle


def test_frames_are_as_the_camera_saw_them(copy: Path) -> None:
    """Photographs of light L, fall-off V of the lens and black D: L V + D, divided by V.

    What is left is the resampling of V and L, smooth over 40 pixels or more, and rounding: half a
    code of 65535 for photograph, board and table, over at least 0.3 of full scale, 1e-4 in all.
    """
    width, height = LENS.size
    y, x = np.mgrid[:height, :width] / 60.0
    light = 0.4 + 0.2 * np.sin(x + 0.3) * np.cos(y)
    fall, black = 0.75 + 0.2 * np.cos(x / 3) * np.cos(y / 3), 0.02 + 0.01 * np.cos(y)
    for name in ("photos", "white"):
        (copy / name).mkdir(exist_ok=True)
    for i in range(3):
        codes = np.rint(65535 * (light * fall + black)).astype(np.uint16)[None]
        write_tiff16(copy / "photos" / f"p{i}.tif", codes)
        board = np.rint(65535 * (0.9 * fall + black)).astype(np.uint16)[None]
        write_tiff16(copy / "white" / f"p{i}.tif", board)
    write_tiff16(copy / "dark.tif", np.rint(65535 * black).astype(np.uint16)[None])
    lamps = read_lights(copy / "photos" / "dome.lp").directions
    found = impasto.read_stack(written(copy, dark="dark.tif", white="white"))
    path = written(copy, dark="dark.tif", white="white", region=(30, 40, 50, 60))
    part = impasto.read_stack(path)
    np.testing.assert_array_equal(part.samples, found.samples[..., 30:80, 40:100])
    write_session(
        copy / "plain.toml",
        Session(images="plain", lights="photos/dome.lp", lens="lens.json", alignment=REPORT),
    )
    (copy / "plain").mkdir()
    for i in range(3):
        plain = np.rint(65535 * light).astype(np.uint16)[None]
        write_tiff16(copy / "plain" / f"p{i}.tif", plain)
    truth = impasto.read_stack(copy / "plain.toml")
    for i in range(3):
        expected = truth.samples[i, 0, 5:-5, 5:-5] / 65535.0 / 0.9 * lamps[i, 2]
        assert np.abs(found.samples[i, 0, 5:-5, 5:-5] / expected - 1.0).max() < 1e-3


def test_a_job_and_a_fit_take_the_session(copy: Path) -> None:
    """Tiles that are resampled window by window make the bits of the whole."""
    path = written(copy)
    normals = impasto.fit_normals(impasto.read_stack(path)).normal
    again = impasto.fit_normals(impasto.read_stack(copy / "aligned")).normal
    np.testing.assert_array_equal(normals, again)
    # Without memory for the whole every window is resampled by itself.
    tiles = open_photographs(path, {}, 0, None)
    whole = impasto.read_stack(path)
    assert tiles.shape == whole.shape
    part = tiles.window(slice(30, 90), slice(50, 200))
    np.testing.assert_array_equal(part.samples, whole.samples[..., 30:90, 50:200])
    store = copy / "stack.zarr"
    assert main(["ingest", str(path), "--out", str(store), "--quiet"]) == 0
    np.testing.assert_array_equal(
        impasto.read_stack(store).samples, impasto.read_stack(path).samples
    )


# --- init and check


def test_init_finds_them_where_they_lie(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copy / "session.toml").unlink()
    assert main(["session", "init", str(copy)]) == 0
    out = capsys.readouterr().out
    found = read_session(copy)
    assert (found.lights, found.lens, found.alignment) == ("photos/dome.lp", "lens.json", REPORT)
    assert "lens lens.json" in out
    assert f"alignment {REPORT}" in out
    assert "pitch_mm" not in out
    assert found.size_mm == PAINTING
    assert {"lens.json", REPORT, "photos/p0.tif"} <= set(found.sha256)
    assert not any(name.startswith("aligned/p") for name in found.sha256)
    same(impasto.read_stack(copy), impasto.read_stack(written(copy)))
    (copy / "session.toml").unlink()
    assert main(["session", "init", str(copy)]) == 0
    assert main(["session", "check", str(copy)]) == 0
    (copy / "session.toml").unlink()
    LENS.save(copy / "lens 2.json")
    capsys.readouterr()
    assert main(["session", "init", str(copy)]) == 0
    assert "missing  camera.lens: lens 2.json and lens.json" in capsys.readouterr().out
    assert read_session(copy).lens is None
    assert read_session(copy).alignment is None  # it needs the lens


def test_a_check_knows_the_pixels_of_the_stack(copy: Path) -> None:
    mask = np.full((75, 100), 255, np.uint8)
    write_png8(copy / "mask.png", mask)
    path = written(copy, mask="mask.png", size_mm=PAINTING)
    found = check_session(path)
    grid = impasto.read_stack(written(copy)).shape
    assert found.shape == grid
    said = {one.code: one.message for one in found.of("error")}
    assert "mask.png has 100 x 75 pixels" in said["size"]
    found = check_session(written(copy, size_mm=PAINTING))
    assert [one.code for one in found.of("error", "warning")] == []


# --- what is refused


def test_files_that_do_not_belong_together(copy: Path) -> None:
    assert "was made with a lens; name its file as camera.lens" in refused(written(copy, lens=None))
    replace(LENS, residual_px=0.5).save(copy / "other.json")
    text = refused(written(copy, lens="other.json"))
    assert "line " in text
    assert "with another lens" in text
    assert "a pixel of the alignment is" in refused(written(copy, pitch_mm=5.0))
    assert "one code for all bands" in refused(written(copy, saturation=(1.0, 2.0)))
    assert '"auto" needs the photographs as they are' in refused(written(copy, encoding="auto"))
    small = replace(LENS, size=(100, 100))
    small.save(copy / "lens.json")
    assert "the lens was calibrated with 100 x 100" in refused(written(copy))


def test_a_photograph_that_was_not_aligned(copy: Path) -> None:
    shutil.copy(copy / "photos" / "p0.tif", copy / "photos" / "p9.tif")
    lamps = copy / "photos" / "dome.lp"
    lines = lamps.read_text().splitlines()
    lamps.write_text("\n".join(["4", *lines[1:], lines[1].replace("p0", "p9")]) + "\n")
    text = refused(written(copy))
    assert "photographs.alignment" in text
    assert "has no photograph p9.tif" in text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "something"}, "is not the report of an alignment"),
        ({"version": 2}, "is of version 2"),
        ({"size_px": [1, 2]}, "size_mm and pixel_mm make"),
        ({"photographs": [{"source": "p0.tif", "homography": [[1]], "shift_px": None}]}, "none"),
        ({"pixel_mm": "wide"}, "the report of an alignment"),
    ],
)
def test_a_report_that_is_damaged(change: dict[str, Any], said: str, copy: Path) -> None:
    path = copy / REPORT
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    text = refused(written(copy), CorruptInputError)
    assert "alignment.json" in text
    assert said in text


def test_values_that_only_files_can_have(copy: Path) -> None:
    """Brackets nested too deep, a camera that is nowhere, and pixels larger than a photograph."""
    path = copy / REPORT
    good = json.loads(path.read_text())
    path.write_text("[" * 100_000)
    assert "is not valid JSON" in refused(written(copy), CorruptInputError)
    path.write_text(json.dumps({**good, "photographs": [
        {**one, "camera_rotation": [[float("nan")] * 3] * 3} for one in good["photographs"]
    ]}))  # fmt: skip
    assert "no camera in front of the painting" in refused(written(copy), CorruptInputError)
    tilted = {"homography": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.1, 0.0, 1.0]]}
    photographs = [{**one, **tilted} for one in good["photographs"]]
    path.write_text(json.dumps({**good, "photographs": photographs}))
    # Its horizon is at x = -10 mm, across the painting.
    assert "does not show the whole plane" in refused(written(copy), CorruptInputError)
    path.write_text(json.dumps(good))
    matrix = LENS.matrix.copy()
    matrix[0, 2] = 1e8  # at this place the distortion moves points without bounds
    replace(LENS, matrix=matrix).save(copy / "lens.json")
    assert "check lens and alignment" in refused(written(copy))


def test_paths_are_confined_and_hashes_compared(copy: Path) -> None:
    shutil.move(copy / "lens.json", copy.parent / "lens.json")
    assert "leads outside the folder" in refused(written(copy, lens="../lens.json"))
    shutil.move(copy.parent / "lens.json", copy / "lens.json")
    path = written(copy, sha256={"lens.json": 64 * "0"})
    assert "is another file than when the session was written" in refused(path, CorruptInputError)
    assert "does not exist" in refused(written(copy, alignment="none.json"))

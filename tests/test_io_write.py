"""Maps and pictures out: read back exactly, same bytes every time, whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile

import impasto
from impasto.io import (
    atomic_path,
    read_image,
    write_exr,
    write_jpeg,
    write_json,
    write_png8,
    write_png16,
    write_tiff16,
    write_tiff32,
)
from impasto.io.npz import write_npz

RNG = np.random.default_rng(4)
MAP = RNG.normal(size=(3, 21, 34)).astype(np.float32)
MAP[:, 3, 4] = np.nan
SHARE = RNG.random((3, 21, 34))


def test_exr_planes_and_attributes(tmp_path: Path) -> None:
    path = tmp_path / "maps.exr"
    planes = {"normal.X": MAP[0], "normal.Y": MAP[1], "beta": MAP[2]}
    write_exr(path, planes, attributes={"impasto": "a varnished icon, été", "gamma": 0.25})
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = file.header(), file.channels()
        assert header["impasto"] == "a varnished icon, été"
        assert header["gamma"] == 0.25
        for name, plane in planes.items():
            np.testing.assert_array_equal(channels[name].pixels, plane)
    np.testing.assert_array_equal(read_image(path, layer="normal"), MAP[:2])


def test_png_of_integers_is_exact(tmp_path: Path) -> None:
    for write, dtype in ((write_png8, np.uint8), (write_png16, np.uint16)):
        picture = RNG.integers(0, np.iinfo(dtype).max, (3, 21, 34), dtype=dtype, endpoint=True)
        for shown in (picture, np.moveaxis(picture, 0, -1)):
            write(tmp_path / "p.png", shown)
            np.testing.assert_array_equal(read_image(tmp_path / "p.png"), picture)
        write(tmp_path / "p.png", picture[0])
        np.testing.assert_array_equal(read_image(tmp_path / "p.png"), picture[:1])


def test_floats_are_full_scale_and_nan_is_black(tmp_path: Path) -> None:
    shares = np.array([[0.0, 0.5, 1.0, -0.2, 1.7, np.nan, np.inf]])
    write_png8(tmp_path / "p.png", shares)
    assert read_image(tmp_path / "p.png").ravel().tolist() == [0, 128, 255, 0, 255, 0, 255]
    write_tiff16(tmp_path / "p.tif", shares)
    assert read_image(tmp_path / "p.tif").ravel().tolist() == [0, 32768, 65535, 0, 65535, 0, 65535]


def test_tiff(tmp_path: Path) -> None:
    write_tiff32(tmp_path / "m.tif", MAP, attributes={"units": "mm", "ü": 1})
    np.testing.assert_array_equal(read_image(tmp_path / "m.tif"), MAP)
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        assert json.loads(file.pages[0].description) == {"units": "mm", "ü": 1}
    six = np.concatenate([SHARE, SHARE])
    write_tiff16(tmp_path / "six.tif", six)
    found = read_image(tmp_path / "six.tif")
    # Rounding to 16 bits: half a code.
    np.testing.assert_allclose(found / 65535, six, rtol=0, atol=0.5 / 65535 + 1e-12)


def test_other_programs_read_the_pixels_of_rgb_tiffs(tmp_path: Path) -> None:
    # OpenCV returns wrong pixels, without an error, for RGB in one plane per band.
    codes = RNG.integers(0, 65535, (3, 21, 34), dtype=np.uint16, endpoint=True)
    write_tiff16(tmp_path / "p.tif", codes)
    write_tiff32(tmp_path / "m.tif", SHARE)
    for name, expected in (("p.tif", codes), ("m.tif", SHARE.astype(np.float32))):
        found = cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(np.moveaxis(found[..., ::-1], -1, 0), expected)
        np.testing.assert_array_equal(read_image(tmp_path / name), expected)


def test_a_name_of_another_format_is_refused(tmp_path: Path) -> None:
    for write, name in (
        (write_png8, "p.tif"),
        (write_png16, "p.jpg"),
        (write_jpeg, "p.png"),
        (write_tiff16, "p.png"),
        (write_tiff32, "p.exr"),
    ):
        with pytest.raises(impasto.ArgumentError, match=rf"writes .* ending in .* found .*{name}"):
            write(tmp_path / name, SHARE)
    with pytest.raises(impasto.ArgumentError, match=r"ending in \.exr, found .*p\.tif"):
        write_exr(tmp_path / "p.tif", {"a": MAP[0]})
    assert list(tmp_path.iterdir()) == []
    write_tiff16(tmp_path / "P.TIFF", SHARE)
    write_jpeg(tmp_path / "p.JPEG", SHARE)


def test_same_numbers_same_bytes(tmp_path: Path) -> None:
    for number in (1, 2):
        write_exr(tmp_path / f"{number}.exr", {"b": MAP[0], "a": MAP[1]}, attributes={"x": 1})
        write_png16(tmp_path / f"{number}.png", SHARE)
        write_tiff32(tmp_path / f"{number}.tif", MAP, attributes={"b": 1, "a": 2})
        write_json(tmp_path / f"{number}.json", {"b": 1, "a": [1.5, "ü"]})
    for kind in ("exr", "png", "tif", "json"):
        assert (tmp_path / f"1.{kind}").read_bytes() == (tmp_path / f"2.{kind}").read_bytes()
    assert (tmp_path / "1.json").read_text("utf-8").startswith('{\n  "a"')


def test_nothing_torn_when_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "map.exr"
    path.write_bytes(b"the old one")

    def half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_bytes(b"half of the new")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        half()
    assert path.read_bytes() == b"the old one"
    assert [p.name for p in tmp_path.iterdir()] == ["map.exr"]


@pytest.mark.skipif(os.name != "posix", reason="file modes are a POSIX matter")
def test_results_are_as_readable_as_other_files(tmp_path: Path) -> None:
    (tmp_path / "ordinary").write_bytes(b"")
    write_png8(tmp_path / "p.png", SHARE)
    assert (tmp_path / "p.png").stat().st_mode == (tmp_path / "ordinary").stat().st_mode


def test_wrong_calls_say_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "x"
    with pytest.raises(impasto.ArgumentError, match="planes"):
        write_exr(path, {})
    with pytest.raises(impasto.ArgumentError, match="one size"):
        write_exr(path, {"a": MAP[0], "b": MAP[0, :5]})
    with pytest.raises(impasto.ArgumentError, match="'compression'"):
        write_exr(path, {"a": MAP[0]}, attributes={"compression": 1.0})
    with pytest.raises(impasto.ArgumentError, match="uint16"):
        write_png16(path, np.zeros((4, 4), np.int64))
    with pytest.raises(impasto.ArgumentError, match="1 or 3"):
        write_png8(path, np.zeros((6, 4, 4)))
    with pytest.raises(impasto.ArgumentError, match="shape"):
        write_tiff32(path, np.zeros(4))
    with pytest.raises(impasto.ArgumentError, match="JSON"):
        write_json(path, {"x": float("nan")})
    assert list(tmp_path.iterdir()) == []


def test_a_jpeg_is_close_to_its_picture(tmp_path: Path) -> None:
    ramp = np.linspace(0.0, 1.0, 64, dtype=np.float32)
    picture = np.stack([np.tile(ramp, (32, 1)), np.full((32, 64), 0.5), np.tile(1 - ramp, (32, 1))])
    write_jpeg(tmp_path / "a.jpg", picture)
    again = read_image(tmp_path / "a.jpg")
    # Quality 92 quantises low frequencies in steps of about 3 codes; 6 is twice that.
    assert np.abs(again - 255.0 * picture).max() < 6
    with pytest.raises(impasto.ArgumentError, match="bands"):
        write_jpeg(tmp_path / "b.jpg", np.zeros((2, 8, 8), np.float32))


@pytest.mark.parametrize(
    ("name", "told"), [("", "found ''$"), ("a.zarr", "found 'a.zarr'; name it a.npz$")]
)
def test_a_name_that_is_no_archive_is_refused(name: str, told: str) -> None:
    with pytest.raises(impasto.ArgumentError, match=told):
        write_npz(Path(name), {})

"""RAW files of cameras: linear light in the camera's colours, the same for every exposure."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from impasto import CorruptInputError, MissingExtraError
from impasto.io import read_image, write_jpeg, write_lights
from impasto.io.images import list_images, open_picture, read_header
from raw_files import mosaic_of, write_dng

SIZE = (48, 64)


def halves(low: tuple[float, ...], high: tuple[float, ...]) -> NDArray[np.float64]:
    """Two flat colours beside each other."""
    light = np.empty((3, *SIZE))
    light[:, :, :32], light[:, :, 32:] = np.array(low)[:, None, None], np.array(high)[:, None, None]
    return light


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    path = tmp_path / "DSC_0001.DNG"
    write_dng(path, mosaic_of(halves((0.2, 0.5, 0.8), (0.0, 1.0, 0.05))))
    return path


def test_codes_are_linear_from_the_black_to_the_white_of_the_file(photograph: Path) -> None:
    """Flat colours are those of the sensor wherever the mosaic is interpolated among them."""
    found = read_image(photograph)
    assert (found.dtype, found.shape) == (np.uint16, (3, *SIZE))
    # The step of the sensor, 1 / 15488 of white, and that of the result.
    tolerance = 0.5 / 15488 + 1.0 / 65535
    for columns, colour in ((np.s_[4:26], (0.2, 0.5, 0.8)), (np.s_[38:60], (0.0, 1.0, 0.05))):
        for plane, expected in zip(found[:, 4:-4, columns], colour, strict=True):
            np.testing.assert_allclose(plane / 65535, expected, atol=tolerance)
    # What has reached white counts as clipped.
    assert (found[1, 4:-4, 38:60] == 65535).all()


def test_twice_the_light_is_twice_the_code(tmp_path: Path) -> None:
    """No level is taken from what a photograph shows, as programs for pictures do."""
    rng = np.random.default_rng(1)
    light = rng.uniform(0.1, 0.2, (3, SIZE[0] // 8, SIZE[1] // 8)).repeat(8, 1).repeat(8, 2)
    codes = []
    for factor in (1.0, 2.0, 4.0):
        write_dng(tmp_path / "one.dng", mosaic_of(factor * light))
        # Inside of the patches, three pixels from every edge.
        inner = read_image(tmp_path / "one.dng").reshape(3, SIZE[0] // 8, 8, SIZE[1] // 8, 8)
        codes.append(inner[:, :, 3:5, :, 3:5] / (65535.0 * factor))
    tolerance = 0.5 / 15488 + 1.0 / 65535
    np.testing.assert_allclose(codes[1], codes[0], atol=2 * tolerance)
    np.testing.assert_allclose(codes[2], codes[0], atol=2 * tolerance)


def test_pixels_stay_where_the_sensor_has_them(photograph: Path) -> None:
    upright = read_image(photograph)
    write_dng(photograph, mosaic_of(halves((0.2, 0.5, 0.8), (0.0, 1.0, 0.05))), orientation=6)
    header = read_header(photograph)
    assert (header.format, header.orientation, header.curve) == ("raw", 6, "linear")
    assert read_image(photograph).tobytes() == upright.tobytes()
    with open_picture(photograph) as picture:
        part = picture.read(slice(5, 9), slice(30, 40))
    assert part.tobytes() == upright[:, 5:9, 30:40].tobytes()


def test_a_folder_of_raw_files_is_a_stack(tmp_path: Path) -> None:
    """The JPEG that the camera has written beside each is none of its photographs."""
    lights = [(0.5, 0.0, 0.8), (0.0, 0.5, 0.8), (-0.5, 0.0, 0.8), (0.0, 0.0, 1.0)]
    for number in range(len(lights)):
        level = 0.1 * (number + 1)
        write_dng(tmp_path / f"DSC_{number:04}.dng", mosaic_of(np.full((3, *SIZE), level)))
        write_jpeg(tmp_path / f"DSC_{number:04}.JPG", np.zeros((3, *SIZE), np.uint8))
    assert [path.suffix for path in list_images(tmp_path)] == [".dng"] * 4
    names = [f"DSC_{number:04}" for number in range(4)]
    write_lights(
        tmp_path / "dirs.lp", impasto.Rig([impasto.DistantLight(one) for one in lights]), names
    )
    stack = impasto.read_stack(tmp_path / "dirs.lp")
    assert stack.samples.dtype == np.uint16
    assert stack.encoding.curve == "linear"
    assert [path.suffix for path in stack.sources[1:]] == [".dng"] * 4
    np.testing.assert_allclose(
        stack.samples[:, :, 20, 20] / 65535,
        np.repeat([[0.1], [0.2], [0.3], [0.4]], 3, axis=1),
        atol=0.5 / 15488 + 1.0 / 65535,
    )


@pytest.mark.parametrize("kept", [0, 8, 300, 1000, 4000])
def test_a_file_that_ends_too_early_is_named(
    kept: int, photograph: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """And LibRaw, which would write to stderr and go on, is not heard."""
    photograph.write_bytes(photograph.read_bytes()[:kept])
    with pytest.raises(CorruptInputError, match=r"DSC_0001\.DNG"):
        read_image(photograph)
    assert capfd.readouterr().err == ""


def test_a_size_that_no_file_of_this_length_holds_is_refused(tmp_path: Path) -> None:
    """Before any room is made: 40,000 x 40,000 pixels in 7 kB."""
    path = tmp_path / "large.dng"
    write_dng(path, mosaic_of(halves((0.2, 0.5, 0.8), (0.0, 1.0, 0.05))))
    data = bytearray(path.read_bytes())
    for tag in (b"\x00\x01\x04\x00\x01\x00\x00\x00", b"\x01\x01\x04\x00\x01\x00\x00\x00"):
        at = data.index(tag) + len(tag)
        data[at : at + 4] = (40_000).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(CorruptInputError, match=r"large\.dng"):
        read_image(path)


def test_without_rawpy_its_extra_is_named(
    photograph: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(MissingExtraError, match=r"RAW file .* needs rawpy.*impasto\[raw\]"):
        read_image(photograph)

"""Photographs: every kind read exactly, every truncation refused by name."""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile

import impasto
from impasto._internal import regular
from impasto.io import read_header, read_image

RNG = np.random.default_rng(3)
RGB16 = RNG.integers(0, 65536, (3, 40, 50), dtype=np.uint16)
RGB8 = (RGB16 >> 8).astype(np.uint8)
RGB32 = RNG.random((3, 40, 50), dtype=np.float32)
SMOOTH = np.rint(128 + 100 * np.sin(np.add.outer(np.arange(120), np.arange(160)) / 20)).astype(
    np.uint8
)


def exr(path: Path, channels: dict[str, np.ndarray], compression: object = None) -> Path:
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION if compression is None else compression,
        "type": OpenEXR.scanlineimage,
    }
    OpenEXR.File(header, {k: np.ascontiguousarray(v) for k, v in channels.items()}).write(str(path))
    return path


def jpeg(path: Path, *, progressive: bool = False, orientation: int | None = None) -> Path:
    flags = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]
    data = cv2.imencode(".jpg", SMOOTH, flags)[1].tobytes()
    if orientation is not None:
        tag = struct.pack("<HHIHH", 274, 3, 1, orientation, 0)
        exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + tag + struct.pack("<I", 0)
        data = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    path.write_bytes(data)
    return path


def interleaved(planes: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.moveaxis(planes, 0, -1))


@pytest.mark.parametrize("planes", [RGB8, RGB16], ids=["8 bit", "16 bit"])
def test_png_rgb_and_grey(tmp_path: Path, planes: np.ndarray) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), interleaved(planes[::-1]))
    np.testing.assert_array_equal(read_image(path), planes)
    cv2.imwrite(str(path), planes[0])
    np.testing.assert_array_equal(read_image(path), planes[:1])


def test_png_alpha_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), interleaved(np.concatenate([RGB8[::-1], RGB8[:1]])))
    np.testing.assert_array_equal(read_image(path), RGB8)


def test_png_grey_with_alpha_is_one_band(tmp_path: Path) -> None:
    rows = b"".join(b"\0" + np.stack([row, row], -1).tobytes() for row in RGB8[0])

    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    path = tmp_path / "grey.png"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", 50, 40, 8, 4, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )
    np.testing.assert_array_equal(read_image(path), RGB8[:1])


@pytest.mark.parametrize("planes", [RGB8, RGB16, RGB32], ids=["u8", "u16", "f32"])
@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("layout", ["contig", "separate", "pages", "grey", "alpha", "tiles"])
def test_tiff(tmp_path: Path, planes: np.ndarray, compression: str | None, layout: str) -> None:
    path = tmp_path / "a.tif"
    options: dict[str, object] = {"compression": compression}
    expected = planes
    if layout == "contig":
        tifffile.imwrite(path, interleaved(planes), photometric="rgb", **options)
    elif layout == "separate":
        tifffile.imwrite(path, planes, photometric="rgb", planarconfig="separate", **options)
    elif layout == "pages":
        tifffile.imwrite(path, planes, photometric="minisblack", **options)
    elif layout == "grey":
        expected = planes[:1]
        tifffile.imwrite(path, planes[0], photometric="minisblack", **options)
    elif layout == "alpha":
        four = interleaved(np.concatenate([planes, planes[:1]]))
        tifffile.imwrite(path, four, photometric="rgb", extrasamples=["unassalpha"], **options)
    else:
        tifffile.imwrite(path, interleaved(planes), photometric="rgb", tile=(16, 16), **options)
    found = read_image(path)
    assert found.dtype == planes.dtype
    np.testing.assert_array_equal(found, expected)


def test_tiff_lzw_as_photoshop_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "lzw.tif"
    cv2.imwrite(str(path), interleaved(RGB16[::-1]), [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    np.testing.assert_array_equal(read_image(path), RGB16)


def test_tiff_of_six_bands_in_one_file(tmp_path: Path) -> None:
    six = np.concatenate([RGB16, RGB16[::-1]])
    tifffile.imwrite(tmp_path / "six.tif", six, photometric="minisblack")
    np.testing.assert_array_equal(read_image(tmp_path / "six.tif"), six)


def test_exr_float_half_grey(tmp_path: Path) -> None:
    path = exr(tmp_path / "a.exr", dict(zip("RGB", RGB32, strict=True)))
    np.testing.assert_array_equal(read_image(path), RGB32)
    half = RGB32.astype(np.float16)
    path = exr(tmp_path / "h.exr", dict(zip("RGBA", [*half, half[0]], strict=True)))
    found = read_image(path)
    assert found.dtype == np.float16
    np.testing.assert_array_equal(found, half)
    path = exr(tmp_path / "y.exr", {"Y": RGB32[0]})
    np.testing.assert_array_equal(read_image(path), RGB32[:1])


def test_exr_layers(tmp_path: Path) -> None:
    layers = {f"{layer}.{c}": RGB32[i] for layer in ("lit", "dark") for i, c in enumerate("RGB")}
    path = exr(tmp_path / "l.exr", layers)
    np.testing.assert_array_equal(read_image(path, layer="lit"), RGB32)
    with pytest.raises(impasto.ArgumentError, match="layer="):
        read_image(path)
    with pytest.raises(impasto.ArgumentError, match="'sun'"):
        read_image(path, layer="sun")


def test_exr_bands_by_wavelength(tmp_path: Path) -> None:
    names = ["T.1000,000000nm", "T.450,000000nm", "T.550,000000nm"]
    path = exr(tmp_path / "s.exr", dict(zip(names, RGB32, strict=True)))
    np.testing.assert_array_equal(read_image(path), RGB32[[1, 2, 0]])


def test_jpeg_grey_and_colour(tmp_path: Path) -> None:
    for progressive in (False, True):
        found = read_image(jpeg(tmp_path / "a.jpg", progressive=progressive))
        assert found.shape == (1, 120, 160)
        # Quality 95 of a smooth ramp: quantisation steps of at most 5 codes, halved, plus the
        # rounding of the transform.
        assert np.abs(found[0].astype(int) - SMOOTH).max() <= 4
    cv2.imwrite(str(tmp_path / "c.jpg"), interleaved(np.stack([SMOOTH * 0, SMOOTH, SMOOTH])))
    found = read_image(tmp_path / "c.jpg")
    assert found[0].mean() > 100  # OpenCV writes blue first, so the zero plane is blue
    assert found[2].mean() < 10


def test_exif_orientation_is_reported_and_never_applied(tmp_path: Path) -> None:
    path = jpeg(tmp_path / "turned.jpg", orientation=6)
    assert read_header(path).orientation == 6
    upright = read_image(jpeg(tmp_path / "upright.jpg"))
    np.testing.assert_array_equal(read_image(path), upright)


def originals(folder: Path) -> dict[str, Path]:
    """One file of every kind that can be cut short."""
    cv2.imwrite(str(folder / "png.png"), interleaved(RGB16))
    tifffile.imwrite(folder / "plain.tif", RGB16, photometric="rgb", planarconfig="separate")
    tifffile.imwrite(
        folder / "deflate.tif", interleaved(RGB16), photometric="rgb", tile=(16, 16), compression=8
    )
    cv2.imwrite(str(folder / "lzw.tif"), interleaved(RGB16))
    return {
        "jpeg": jpeg(folder / "base.jpg"),
        "progressive jpeg": jpeg(folder / "progressive.jpg", progressive=True),
        "png": folder / "png.png",
        "tiff": folder / "plain.tif",
        "tiled tiff": folder / "deflate.tif",
        "lzw tiff": folder / "lzw.tif",
        "exr": exr(folder / "zip.exr", dict(zip("RGB", RGB32, strict=True))),
        "raw exr": exr(folder / "raw.exr", {"Y": RGB32[0]}, OpenEXR.NO_COMPRESSION),
    }


KINDS = ["jpeg", "progressive jpeg", "png", "tiff", "tiled tiff", "lzw tiff", "exr", "raw exr"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.5, 0.9, 0.99])
def test_truncated_file_is_refused_by_name(
    tmp_path: Path, kind: str, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = originals(tmp_path)[kind]
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(impasto.CorruptInputError) as caught:
        read_image(path)
    assert path.name in str(caught.value)
    # No library may scribble on the terminal about it.
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", ["jpeg", "progressive jpeg", "png", "exr", "raw exr"])
def test_last_byte_counts(tmp_path: Path, kind: str) -> None:
    path = originals(tmp_path)[kind]
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(impasto.CorruptInputError, match=path.name):
        read_image(path)


def test_damaged_png_is_refused(tmp_path: Path) -> None:
    path = originals(tmp_path)["png"]
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(impasto.CorruptInputError, match="checksum"):
        read_image(path)


def test_a_damaged_exr_chunk_is_refused_and_stdout_stays_clean(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    ramp = np.tile(np.linspace(0, 1, 50, dtype=np.float32), (40, 1))
    path = exr(tmp_path / "a.exr", dict.fromkeys("RGB", ramp))
    data = bytearray(path.read_bytes())
    for at in range(len(data) - 40, len(data) - 10):
        data[at] ^= 0x5A
    path.write_bytes(data)
    with pytest.raises(impasto.CorruptInputError, match=r"a\.exr: is damaged"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_a_damaged_jpeg_is_refused_by_name(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = jpeg(tmp_path / "a.jpg")
    read_image(path)
    data = path.read_bytes()
    # Entropy-coded bytes taken out: the decoder runs into the end of the picture.
    path.write_bytes(data[: len(data) // 2] + data[len(data) // 2 + 200 :])
    with pytest.raises(impasto.CorruptInputError, match=r"a\.jpg: is damaged \(Corrupt JPEG"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_a_tiff_on_a_disk_that_fails_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of its reads fails; tifffile leaves out pages that it cannot read."""
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as file:
        for plane in RGB16:
            file.write(plane, photometric="minisblack", compression="zlib", metadata=None)
    wanted = read_image(path)
    left = 0

    class Failing(regular.Handle):
        """A handle that from one step on cannot be read."""

        def read(self, *size: Any) -> bytes:
            self._step()
            return super().read(*size)

        def readinto(self, buffer: Any) -> int:
            self._step()
            return super().readinto(buffer)

        def _step(self) -> None:
            nonlocal left
            left -= 1
            if left == 0:
                other = os.open(os.devnull, os.O_WRONLY)
                os.dup2(other, self.fileno())
                os.close(other)

    monkeypatch.setattr(regular, "Handle", Failing)
    failed = 0
    while left <= 0:
        failed += 1
        left = failed
        with contextlib.suppress(impasto.ArgumentError):
            np.testing.assert_array_equal(read_image(path), wanted)
            assert left > 0, "an error was passed over"
    assert failed > 9


def test_unfinished_tiff_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sparse.tif"
    tifffile.imwrite(path, RGB16[0], photometric="minisblack", rowsperstrip=8)
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[0].tags["StripOffsets"].overwrite([0, *file.pages[0].dataoffsets[1:]])
    with pytest.raises(impasto.CorruptInputError, match="did not finish"):
        read_image(path)


def test_wrong_ending_and_strange_content(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(originals(tmp_path)["png"].read_bytes())
    assert read_header(path).format == "png"
    path.write_bytes(b"FUJIFILMCCD-RAW 0201")
    with pytest.raises(impasto.CorruptInputError, match="RAW"):
        read_image(path)
    with pytest.raises(impasto.ArgumentError, match=r"nowhere\.png"):
        read_image(tmp_path / "nowhere.png")
    with pytest.raises(impasto.ArgumentError, match=tmp_path.name):
        read_image(tmp_path)


def bombs(folder: Path) -> dict[str, Path]:
    png = bytearray(originals(folder)["png"].read_bytes())
    png[16:24] = struct.pack(">II", 400_000, 400_000)
    png[29:33] = struct.pack(">I", zlib.crc32(png[12:29]))
    (folder / "bomb.png").write_bytes(png)
    data = bytearray(jpeg(folder / "bomb.jpg").read_bytes())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", 65_500, 65_500)
    (folder / "bomb.jpg").write_bytes(data)
    tifffile.imwrite(folder / "bomb.tif", RGB16[0], photometric="minisblack", compression=8)
    with tifffile.TiffFile(folder / "bomb.tif", mode="r+b") as file:
        for tag in ("ImageWidth", "ImageLength", "RowsPerStrip"):
            file.pages[0].tags[tag].overwrite(60_000)
    path = exr(folder / "bomb.exr", {"Y": RGB32[0]})
    raw = bytearray(path.read_bytes())
    for key in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = raw.index(key) + len(key) + 4
        raw[at : at + 16] = struct.pack("<4i", 0, 0, 2**30, 2**30)
    path.write_bytes(raw)
    return {kind: folder / f"bomb.{kind}" for kind in ("png", "jpg", "tif", "exr")}


@pytest.mark.parametrize("kind", ["png", "jpg", "tif", "exr"])
def test_impossible_sizes_are_refused_before_decoding(tmp_path: Path, kind: str) -> None:
    path = bombs(tmp_path)[kind]
    with pytest.raises(impasto.ImpastoError, match=r"bomb\.") as caught:
        read_image(path)
    assert isinstance(caught.value, impasto.ArgumentError | impasto.CorruptInputError)


def test_max_pixels(tmp_path: Path) -> None:
    path = originals(tmp_path)["png"]
    with pytest.raises(impasto.ArgumentError, match="max_pixels"):
        read_image(path, max_pixels=1000)
    assert read_image(path, max_pixels=2000).shape == (3, 40, 50)


@pytest.mark.parametrize(
    ("photometric", "word"), [("cielab", "Lab"), ("miniswhite", "white-is-zero")]
)
def test_colours_that_are_not_light_are_refused(
    tmp_path: Path, photometric: str, word: str
) -> None:
    picture = interleaved(RGB8) if photometric == "cielab" else RGB8[0]
    tifffile.imwrite(tmp_path / "odd.tif", picture, photometric=photometric)
    with pytest.raises(impasto.CorruptInputError, match=word):
        read_image(tmp_path / "odd.tif")


def test_icon_photographs_are_whole(data: Path) -> None:
    found = read_image(data / "icon_rti" / "image01.jpg")
    assert (found.shape, found.dtype) == ((3, 395, 402), np.uint8)

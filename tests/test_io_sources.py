"""Windows of files: the bits of a crop of the whole, from the parts of the file that hold them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

import impasto
from impasto.io import Source, open_source, read_image

RNG = np.random.default_rng(20)
SHAPE = (3, 61, 83)
CODES = RNG.integers(0, 65536, SHAPE, dtype=np.uint16)
# Two windows inside tiles of 16 pixels, some across them, the corners, the whole.
WINDOWS = (
    (slice(2, 9), slice(17, 30)),
    (slice(15, 17), slice(15, 49)),
    (slice(0, 1), slice(0, 1)),
    (slice(60, 61), slice(82, 83)),
    (slice(30, 61), slice(70, 83)),
    (None, slice(40, 41)),
    (slice(5, 40), None),
    (None, None),
)


def numbers(dtype: str, bands: int = 3) -> np.ndarray:
    """Noise in 8, 16 bits or floats, also negative ones."""
    planes = np.concatenate([CODES, CODES[::-1]])[:bands]
    if dtype.startswith("u"):
        return (planes >> (16 - 8 * np.dtype(dtype).itemsize)).astype(dtype)
    return ((planes.astype(np.float64) - 20000.0) / 3000.0).astype(dtype)


def interleaved(planes: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.moveaxis(planes, 0, -1))


def agrees(path: Path, expected: np.ndarray, **options: Any) -> None:
    """Every window of the source is that of an array, bit for bit."""
    with open_source(path, **options) as source:
        assert source.shape == expected.shape
        assert source.dtype == expected.dtype
        for rows, columns in WINDOWS:
            found = source.read(rows, columns)
            assert found.dtype == expected.dtype
            assert found.flags.c_contiguous
            assert found.flags.writeable
            wanted = expected[:, rows or slice(None), columns or slice(None)]
            np.testing.assert_array_equal(found, wanted)
            # The same, into a part of a larger array.
            larger = np.zeros((2, wanted.shape[0] + 1, *wanted.shape[1:]), expected.dtype)
            source.read_into(larger[1, :-1], rows, columns)
            np.testing.assert_array_equal(larger[1, :-1], wanted)
            assert not larger[0].any()
            assert not larger[1, -1].any()


PACKED: dict[str, dict[str, Any]] = {
    "plain": {},
    "deflate": {"compression": "zlib"},
    "differences": {"compression": "zlib", "predictor": 2},
    "lzma": {"compression": "lzma"},
}


@pytest.mark.parametrize("parts", [{"tile": (16, 32)}, {"rowsperstrip": 7}, {"rowsperstrip": 61}])
@pytest.mark.parametrize(
    ("dtype", "packing"),
    [
        (dtype, packing)
        for dtype in ("uint8", "uint16", "float16", "float32")
        for packing in PACKED
        # tifffile writes differences of integers alone.
        if packing != "differences" or dtype.startswith("u")
    ],
)
def test_tiff(tmp_path: Path, dtype: str, parts: dict[str, Any], packing: str) -> None:
    packed = PACKED[packing]
    planes = numbers(dtype)
    path = tmp_path / "a.tif"
    for order, big, planar in (("<", False, "contig"), (">", True, "separate")):
        data = interleaved(planes) if planar == "contig" else planes
        tifffile.imwrite(
            path, data, photometric="rgb", planarconfig=planar, byteorder=order, bigtiff=big,
            **parts, **packed,
        )  # fmt: skip
        agrees(path, planes)


def test_tiff_of_64_bits_pages_and_extra_samples(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    six = numbers("float64", 6)
    tifffile.imwrite(path, six, photometric="minisblack", compression="zlib", rowsperstrip=5)
    agrees(path, six.astype(np.float32))
    four = interleaved(numbers("uint16", 4))
    options: dict[str, Any] = {"photometric": "rgb", "tile": (16, 16), "compression": "zlib"}
    tifffile.imwrite(path, four, extrasamples=["unassalpha"], **options)
    agrees(path, numbers("uint16"))
    tifffile.imwrite(path, four, extrasamples=["unspecified"], **options)
    agrees(path, numbers("uint16", 4))


def test_tiff_predictor_of_floats(tmp_path: Path) -> None:
    """Written by hand from TIFF Technical Note 3, read back by libtiff as well."""
    planes = numbers("float32")
    rows = interleaved(planes).astype(">f4")
    split = rows.view(np.uint8).reshape(61, 83 * 3, 4).transpose(0, 2, 1).reshape(61, -1, 3)
    steps = np.diff(split, axis=1, prepend=np.zeros((61, 1, 3), np.uint8))
    path = tmp_path / "a.tif"
    strips = [zlib.compress(steps[first : first + 8].tobytes()) for first in range(0, 61, 8)]
    options: dict[str, Any] = {"photometric": "rgb", "compression": 8, "rowsperstrip": 8}
    whole = {"shape": (61, 83, 3), "dtype": np.int32, "predictor": 2}
    tifffile.imwrite(path, iter(strips), **whole, **options)
    overwrite(path, Predictor=3, SampleFormat=(3, 3, 3))
    np.testing.assert_array_equal(cv2.imread(str(path), -1), interleaved(planes[::-1]))
    agrees(path, planes)


def overwrite(path: Path, **tags: Any) -> None:
    with tifffile.TiffFile(path, mode="r+b") as file:
        for name, value in tags.items():
            file.pages[0].tags[name].overwrite(value)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("rows", [7, 61])
@pytest.mark.parametrize("predictor", [1, 2])
def test_tiff_lzw(tmp_path: Path, dtype: str, rows: int, predictor: int) -> None:
    path = tmp_path / "a.tif"
    flags = [cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_ROWSPERSTRIP, rows]
    planes = numbers(dtype)
    cv2.imwrite(
        str(path), interleaved(planes[::-1]), [*flags, cv2.IMWRITE_TIFF_PREDICTOR, predictor]
    )
    agrees(path, planes)


def test_tiff_lzw_of_six_planes(tmp_path: Path) -> None:
    """The strips of OpenCV's grey pictures, put together as planes."""
    planes, strips = numbers("uint8", 6), []
    for plane in planes:
        cv2.imwrite(
            str(tmp_path / "one.tif"),
            plane,
            [cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_ROWSPERSTRIP, 16],
        )
        with tifffile.TiffFile(tmp_path / "one.tif") as file:
            page = file.pages[0]
            predictor = int(page.predictor)
            strips += [
                file.filehandle.read_array("u1", count, offset=offset).tobytes()
                for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True)
            ]
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, iter(strips), shape=planes.shape, dtype=np.uint8, photometric="minisblack",
        planarconfig="separate", compression=8, rowsperstrip=16, predictor=predictor,
    )  # fmt: skip
    overwrite(path, Compression=5)
    agrees(path, planes)
    # libtiff returns what it can of a damaged strip.
    with tifffile.TiffFile(path) as file:
        damaged(path, file.pages[0].dataoffsets[0] + 100, 200)
    with pytest.raises(impasto.CorruptInputError, match=r"a\.tif: is damaged: strip 0 cannot"):
        read_image(path)


@pytest.mark.parametrize("compression", ["packbits", "jpeg"])
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_tiff_by_libtiff_of_pillow(tmp_path: Path, compression: str, mode: str) -> None:
    """Rows of equal codes, which PackBits packs; JPEG with its tables apart."""
    y, x = np.mgrid[:61, :83]
    picture = np.stack([y * 4, x * 3, (x + y) // 20 * 20], -1).astype(np.uint8)
    path = tmp_path / "a.tif"
    # 278: rows of a strip.
    one = Image.fromarray(picture).convert(mode)
    quality = {"quality": 90} if compression == "jpeg" else {}
    one.save(path, compression=compression, tiffinfo={278: 16}, **quality)
    with Image.open(path) as opened:
        expected = np.asarray(opened.convert(mode)).reshape(61, 83, -1)
    agrees(path, np.moveaxis(expected, -1, 0))


def test_tiff_of_jpeg_tiles(tmp_path: Path) -> None:
    y, x = np.mgrid[:64, :96]
    smooth = (128 + 60 * np.sin(x / 9) + 50 * np.cos(y / 7)).astype(np.uint8)
    tiles = [smooth[a : a + 32, b : b + 32] for a in (0, 32) for b in (0, 32, 64)]
    packed = [cv2.imencode(".jpg", tile)[1].tobytes() for tile in tiles]
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, iter(packed), shape=SHAPE[1:], dtype=np.uint8, photometric="minisblack",
        tile=(32, 32), compression=8,
    )  # fmt: skip
    overwrite(path, Compression=7)
    decoded = [cv2.imdecode(np.frombuffer(data, np.uint8), -1) for data in packed]
    expected = np.vstack([np.hstack(decoded[:3]), np.hstack(decoded[3:])])[:61, :83]
    agrees(path, expected[None])


EXR = [name.removesuffix("_COMPRESSION") for name in dir(OpenEXR) if name.endswith("_COMPRESSION")]


@pytest.mark.parametrize("compression", EXR)
@pytest.mark.parametrize("tiled", [False, True], ids=["rows", "tiles"])
def test_exr(tmp_path: Path, compression: str, tiled: bool) -> None:
    path = tmp_path / "a.exr"
    header: dict[str, Any] = {
        "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
        "type": OpenEXR.tiledimage if tiled else OpenEXR.scanlineimage,
        # Its first pixel is none of (0, 0), and higher than many blocks of rows.
        "dataWindow": (np.array([-7, 13], np.int32), np.array([75, 2 * 366 + 12], np.int32)),
    }
    if tiled:
        header["tiles"] = tiles(16, 32)
    y, x = np.mgrid[: 2 * 366, :83]
    # Some compressions lose the last bits of noise: the library's whole reading is the measure.
    waves = np.stack([np.sin(x / 5 + y / 9), np.cos(y / 3), x * y / 900]).astype(np.float32)
    try:
        OpenEXR.File(header, dict(zip("RGB", waves, strict=True))).write(str(path))
    except Exception as error:
        pytest.skip(f"this OpenEXR does not write {compression}: {error}")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        expected = np.stack([file.channels()[name].pixels for name in "RGB"])
    with open_source(path) as source:
        for top, bottom in ((0, 1), (31, 33), (255, 257), (500, 732), (0, 732)):
            found = source.read(slice(top, bottom), slice(15, 49))
            np.testing.assert_array_equal(found, expected[:, top:bottom, 15:49])


def tiles(width: int, height: int, mode: Any = None) -> Any:
    description = OpenEXR.TileDescription()
    description.xSize, description.ySize = width, height
    if mode is not None:
        description.mode = mode
    return description


def test_exr_of_several_parts_and_kinds(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    half = numbers("float16")
    single = numbers("float32")
    kind = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    parts = [
        OpenEXR.Part(
            {**kind, "name": "a"}, {f"lit.{c}": half[i] for i, c in enumerate("RGB")}, "a"
        ),
        OpenEXR.Part(
            {"type": OpenEXR.tiledimage, "tiles": tiles(16, 16), "name": "b"},
            {f"dark.{c}": single[i] for i, c in enumerate("RGB")},
            "b",
        ),
    ]
    OpenEXR.File(parts).write(str(path))
    agrees(path, half, layer="lit")
    agrees(path, single, layer="dark")
    with pytest.raises(impasto.ArgumentError, match="layer="):
        open_source(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_png_and_jpeg_are_decoded_once(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), interleaved(numbers("uint8")[::-1]))
    calls: list[int] = []
    decode: Callable[..., Any] = cv2.imdecode
    monkeypatch.setattr(cv2, "imdecode", lambda *given: (calls.append(1), decode(*given))[1])
    expected = np.moveaxis(cv2.imread(str(path), -1)[..., ::-1], -1, 0)
    agrees(path, expected)
    assert len(calls) == 1


def test_arrays(tmp_path: Path) -> None:
    planes = numbers("float32").astype(">f4")
    np.save(tmp_path / "a.npy", planes)
    agrees(tmp_path / "a.npy", planes.astype(np.float32))
    np.save(tmp_path / "flat.npy", CODES[0])
    agrees(tmp_path / "flat.npy", CODES[:1])
    path = tmp_path / "a.npz"
    np.savez(path, samples=np.stack([CODES, CODES[::-1]]), other=CODES[1])
    agrees(path, CODES[::-1], index=1)
    agrees(path, CODES[1:2], member="other")
    for options, word in (
        ({"member": "none"}, "has no array 'none'"),
        ({"index": 2}, "more observations"),
        ({}, "shape"),
    ):
        with pytest.raises(impasto.ArgumentError, match=word):
            open_source(path, **options)
    np.savez_compressed(path, samples=CODES)
    with pytest.raises(impasto.ArgumentError, match=r"numpy\.savez"):
        open_source(path)
    np.save(tmp_path / "a.npy", np.asfortranarray(CODES))
    with pytest.raises(impasto.ArgumentError, match="ascontiguousarray"):
        open_source(tmp_path / "a.npy")


def test_a_window_lies_inside_the_picture(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", CODES)
    with open_source(tmp_path / "a.npy") as source:
        assert isinstance(source, Source)
        for rows in (slice(0, 62), slice(-1, 4), slice(5, 5), slice(0, 8, 2)):
            with pytest.raises(impasto.ArgumentError, match=r"^rows: .*<= 61"):
                source.read(rows)
        for wrong in (np.empty((3, 2, 83), np.uint16), np.empty((3, 1, 83), np.uint8)):
            with pytest.raises(impasto.ArgumentError, match=r"^out: .*\(3, 1, 83\)"):
                source.read_into(wrong, slice(0, 1))


def damaged(path: Path, at: int, count: int) -> None:
    data = bytearray(path.read_bytes())
    data[at : at + count] = bytes(255 - byte for byte in data[at : at + count])
    path.write_bytes(data)


@pytest.mark.parametrize("suffix", [".tif", ".exr"])
def test_nothing_else_is_decoded(tmp_path: Path, suffix: str) -> None:
    """A tile that is damaged stops the windows that touch it and no other."""
    path = tmp_path / f"a{suffix}"
    if suffix == ".tif":
        tifffile.imwrite(path, interleaved(CODES), photometric="rgb", tile=(32, 32), compression=8)
        with tifffile.TiffFile(path) as file:
            at = file.pages[0].dataoffsets[1]
    else:
        header = {"type": OpenEXR.tiledimage, "tiles": tiles(32, 32)}
        # Noise would be stored as it is, and nobody could say that it is damaged.
        smooth = np.add.outer(np.arange(61.0), np.arange(83.0)).astype(np.float32)
        header["compression"] = OpenEXR.ZIP_COMPRESSION
        OpenEXR.File(header, {"Y": smooth}).write(str(path))
        # The table of 2 x 3 chunks ends where the first chunk begins.
        data = path.read_bytes()
        first = next(
            n
            for n in range(data.index(b"screenWindowWidth"), len(data))
            if struct.unpack_from("<Q", data, n) == (n + 48,)
        )
        at = struct.unpack_from("<Q", data, first + 8)[0] + 20
    before = read_image(path)
    damaged(path, at + 10, 30)
    with open_source(path) as source:
        assert source.grid == (32, 32)
        np.testing.assert_array_equal(source.read(slice(0, 32), slice(0, 32)), before[:, :32, :32])
        np.testing.assert_array_equal(source.read(slice(32, 61)), before[:, 32:])
        with pytest.raises(impasto.CorruptInputError, match=rf"a\{suffix}.*(tile 1|damaged)"):
            source.read(slice(31, 33), slice(31, 33))
    with pytest.raises(impasto.CorruptInputError, match=rf"a\{suffix}"):
        read_image(path)


STACK = RNG.integers(0, 65536, (3, 3, 20, 30), dtype=np.uint16)


@pytest.mark.parametrize("save_arrays", [np.savez, np.savez_compressed])
def test_a_region_of_an_archive_is_a_part_of_its_stack(tmp_path: Path, save_arrays: Any) -> None:
    lamps = [impasto.PointLight((100.0 * i, 50.0, 300.0)) for i in range(3)]
    inside = RNG.random((20, 30)) < 0.7
    stack = impasto.Stack(STACK, lights=impasto.Rig(lamps, pitch_mm=0.5), mask=inside)
    impasto.io.write_stack(tmp_path / "s.npz", stack)
    with np.load(tmp_path / "s.npz") as arrays:
        save_arrays(tmp_path / "again.npz", **arrays)
    expected = stack[3:14, 7:20]
    found = impasto.read_stack(tmp_path / "again.npz", region=(3, 7, 11, 13))
    np.testing.assert_array_equal(found.samples, expected.samples)
    np.testing.assert_array_equal(found.mask, expected.mask)
    assert found.rig.origin == expected.rig.origin != (0.0, 0.0)
    np.testing.assert_array_equal(found.rig.vectors, expected.rig.vectors)
    with pytest.raises(impasto.ArgumentError, match=r"^region: .*20 rows and 30 columns"):
        impasto.read_stack(tmp_path / "again.npz", region=(3, 7, 18, 13))
    np.savez(tmp_path / "lost.npz", lights=np.eye(3))
    with pytest.raises(impasto.CorruptInputError, match="'samples'"):
        impasto.read_stack(tmp_path / "lost.npz", region=(0, 0, 2, 2))

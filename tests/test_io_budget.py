"""Hostile files and paths: memory within a budget, words at once, no command to a terminal."""

from __future__ import annotations

import json
import logging
import os
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile

import impasto
import processes
from impasto.cli import main
from impasto.colour.session import read_display
from impasto.io import (
    open_source,
    read_camera,
    read_image,
    read_lights,
    read_spectra,
    read_stack,
)

LP = "3\n{0}0.png 0 0 1\n{0}1.png 0.5 0 0.8\n{0}2.png 0 0.5 0.8\n"


def exr_of_a_huge_tile(path: Path, width: int, height: int) -> None:
    """A picture of 8 x 8 pixels, one tile, which claims to be far larger."""
    tile = OpenEXR.TileDescription()
    tile.xSize, tile.ySize = 16, 16
    header = {"type": OpenEXR.tiledimage, "tiles": tile, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"Y": np.eye(8, dtype=np.float32)}).write(str(path))
    data = bytearray(path.read_bytes())
    at = data.index(b"tiles\0tiledesc\0") + 15 + 4
    data[at : at + 8] = struct.pack("<II", width, height)
    path.write_bytes(data)


def zeros(count: int) -> bytes:
    """A zlib stream of ``count`` times 16 MiB of zeros; its checksum is wrong."""
    stream = zlib.compressobj(9, wbits=-15)
    block = stream.compress(bytes(1 << 24)) + stream.flush(zlib.Z_FULL_FLUSH)
    return b"\x78\xda" + block * count + zlib.compressobj(wbits=-15).flush() + bytes(4)


def tiff_of_zeros(path: Path, compression: int, tile: int = 0, claim: int = 0) -> None:
    """A picture of 64 x 64 whose only strip or tile inflates to 2 GiB."""
    options: dict[str, Any] = {"tile": (tile, tile)} if tile else {"rowsperstrip": 64}
    tifffile.imwrite(
        path, iter([zeros(128)]), shape=(64, 64), dtype=np.uint16, compression=8, **options
    )
    with tifffile.TiffFile(path, mode="r+b") as file:
        tags = file.pages[0].tags
        tags["Compression"].overwrite(compression)
        if claim:
            tags["TileWidth"].overwrite(claim)
            tags["TileLength"].overwrite(claim)


def npz_of_a_claim(path: Path) -> None:
    """An archive whose array claims 80 GB and has none."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000), }"
    header = header.ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("samples.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header)
        archive.writestr("lights.npy", b"")


def npz_of_zeros(path: Path) -> None:
    """An archive whose deflated array inflates to 2 GB by a claim that its bytes cannot keep."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("samples.npy", bytes(1 << 16))
    data = bytearray(path.read_bytes())
    for signature, at in ((b"PK\3\4", 22), (b"PK\1\2", 24)):
        start = data.index(signature) + at
        data[start : start + 4] = struct.pack("<I", 2_000_000_000)
    path.write_bytes(data)


WATCHED = """
import json, resource, sys
import impasto
from impasto.cli import main
from impasto.colour.session import read_display
from impasto.io import read_image
read_image(sys.argv[1])
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
found = []
for path in sys.argv[2:]:
    before = peak()
    try:
        said = str((impasto.read_stack if path.endswith("npz") else read_image)(path).shape)
    except impasto.ImpastoError as error:
        said = f"{type(error).__name__}: {error}"
    found.append((said, peak() - before))
print(json.dumps(found))
"""


def found_by(program: str, *arguments: object) -> Any:
    # Memory that is given back is given back to the system.
    return json.loads(processes.run(program, *map(str, arguments), MALLOC_MMAP_THRESHOLD_="131072"))


@pytest.mark.skipif(sys.platform != "linux", reason="counts memory as Linux does")
def test_bombs_take_no_memory(tmp_path: Path) -> None:
    small = tmp_path / "small.exr"
    OpenEXR.File(
        {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION},
        {"Y": np.eye(8, dtype=np.float32)},
    ).write(str(small))
    exr_of_a_huge_tile(tmp_path / "tile.exr", 10_000, 10_000)
    exr_of_a_huge_tile(tmp_path / "wide.exr", 2**31 - 1, 2**31 - 1)
    tiff_of_zeros(tmp_path / "strip.tif", 8)
    tiff_of_zeros(tmp_path / "old.tif", 32946)
    tiff_of_zeros(tmp_path / "tile.tif", 8, 4096)
    tiff_of_zeros(tmp_path / "huge.tif", 8, 64, 1 << 20)
    npz_of_a_claim(tmp_path / "claim.npz")
    npz_of_zeros(tmp_path / "zeros.npz")
    expected = {
        # The tile has no more pixels than the picture.
        "tile.exr": "(1, 8, 8)",
        "wide.exr": "(1, 8, 8)",
        "strip.tif": "strip 0 cannot be decoded (it holds more than the 8192 bytes",
        "old.tif": "strip 0 cannot be decoded (it holds more than the 8192 bytes",
        "tile.tif": "(1, 64, 64)",
        "huge.tif": "claims tiles of 1048576 x 1048576 pixels",
        "claim.npz": "claims an array (100000, 100000) of float64",
        "zeros.npz": "refused as damaged or hostile",
    }
    assert (tmp_path / "tile.exr").stat().st_size < 500
    found = found_by(WATCHED, small, *(tmp_path / name for name in expected))
    for (name, words), (said, megabytes) in zip(expected.items(), found, strict=True):
        assert words in said, name
        # A tile of 4096 x 4096 codes has 32 MiB; nothing else needs more than a few.
        assert megabytes < 64, name


LIMITED = """
import json, resource, sys
from impasto.io import read_image
paths = sys.argv[1:]
for path in paths:
    read_image(path)
found = {}
for path in paths:
    for margin in (1, 5, 9, 20):
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (used + margin * 1_000_000, hard))
        try:
            read_image(path)
            said = "read"
        except BaseException as error:
            said = type(error).__name__
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
        found.setdefault(path.rpartition("/")[2], []).append(said)
print(json.dumps(found))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as Linux does")
def test_too_little_memory_is_no_damage(tmp_path: Path) -> None:
    codes = np.random.default_rng(1).integers(0, 65536, (900, 900, 3), dtype=np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), codes, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    cv2.imwrite(str(tmp_path / "a.jpg"), (codes >> 8).astype(np.uint8))
    tifffile.imwrite(tmp_path / "plain.tif", codes, photometric="rgb")
    options: dict[str, Any] = {"compression": 8, "compressionargs": {"level": 1}}
    tifffile.imwrite(tmp_path / "strip.tif", codes, photometric="rgb", rowsperstrip=900, **options)
    cv2.imwrite(str(tmp_path / "lzw.tif"), codes, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    planes = {name: np.float32(codes[..., i]) for i, name in enumerate("RGB")}
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    found = found_by(LIMITED, *sorted(tmp_path.iterdir()))
    assert len(found) == 6
    for name, outcomes in found.items():
        assert set(outcomes) <= {"read", "MemoryError"}, (name, outcomes)
        assert "MemoryError" in outcomes, name


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes by name")
@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    ("read", "name"),
    [
        (read_image, "a.tif"),
        (open_source, "a.exr"),
        (read_stack, "a.lp"),
        (read_stack, "a.npz"),
        (read_lights, "a.lp"),
        (read_camera, "a.csv"),
        (read_spectra, "a.csv"),
        (impasto.Environment.read, "a.hdr"),
        (read_display, "a.json"),
    ],
)
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, read: Any, name: str) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(impasto.ArgumentError, match=r"is a pipe, not a file; give the name"):
        read(path)
    path.unlink()
    path.symlink_to(os.devnull)
    with pytest.raises(impasto.ArgumentError, match="is a device, not a file"):
        read(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(impasto.ArgumentError, match=r"folder|has no light file|neither"):
        read(path)
    with pytest.raises(impasto.ArgumentError, match=r"NUL|does not exist"):
        read(f"{tmp_path}/a\0{name}")


def test_names_do_not_command_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    evil = "\x1b[2J\x1b]0;x\x07\r\u202e\x9b"
    shown = r"\x1b[2J\x1b]0;x\x07\r\u202e\x9b"
    folder = tmp_path / evil
    folder.mkdir()
    for index in range(3):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((8, 8), 50 * index + 20, np.uint8))
    cv2.imwrite(str(folder / f"spare{evil}.png"), np.zeros((8, 8), np.uint8))
    (folder / "a.lp").write_text(LP.format(""), encoding="utf-8")
    with caplog.at_level(logging.INFO, "impasto.io"):
        stack = read_stack(folder)
    texts = [str(note) for note in stack.notes] + caplog.messages
    assert any(f"spare{shown}" in text for text in texts)
    (folder / f"{evil}.tif").write_bytes(b"II*\0 and nothing more")
    with pytest.raises(impasto.CorruptInputError) as caught:
        read_image(folder / f"{evil}.tif")
    assert f"{shown}.tif" in str(caught.value)
    assert main(["fit", str(folder), "--out", str(tmp_path / f"out{evil}")]) == 0
    main(["doctor", str(folder)])
    assert main(["render", str(folder), "--out", str(tmp_path / "pictures")]) == 1
    seen = capsys.readouterr()
    for text in (*texts, str(caught.value), seen.out, seen.err):
        assert not any(mark in text for mark in "\x1b\x07\r\u202e\x9b")
    assert r"\x1b[2J" in seen.err

"""Read photographs as band-planar arrays; errors name the file."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images.exr import ExrSource
from impasto.io.images.exr_structure import exr_parts
from impasto.io.images.header import MAX_PIXELS, ImageHeader, check_size, truncated
from impasto.io.images.jpeg import jpeg_header
from impasto.io.images.native_stderr import NO_MEMORY, captured_lines
from impasto.io.images.picture import Picture, WholePicture
from impasto.io.images.png import png_header
from impasto.io.images.raw import RAW_SUFFIXES, open_raw
from impasto.io.images.tiff import open_tiff
from impasto.io.notes import few

_DAMAGE_OF_JPEG = b"Corrupt JPEG data|Premature end of JPEG"
JPEG_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe"})
IMAGE_SUFFIXES = JPEG_SUFFIXES | RAW_SUFFIXES | {".png", ".tif", ".tiff", ".exr"}


def read_image(
    path: str | Path, *, layer: str | None = None, max_pixels: int = MAX_PIXELS
) -> NDArray[Any]:
    """Read one photograph.

    The structure of the file is checked to its end before a pixel is decoded. EXIF orientation is
    never applied: rows and columns are those of the sensor, as in every light file. An alpha
    channel is dropped.

    Parameters
    ----------
    path
        JPEG, PNG (8 or 16 bit), TIFF (8, 16 bit or float), OpenEXR (half or float), or RAW of a
        camera, which is developed: linear, in the camera's colours, with neither white balance nor
        noise reduction, from the black to the white that the file states (0 to 65535).
    layer
        For OpenEXR with several layers: the one to read.
    max_pixels
        Larger pictures are refused before anything is allocated.

    Returns
    -------
    ndarray
        ``(band, y, x)``: uint8, uint16, float16 or float32; bands in the order red, green, blue.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or no picture at all.
    ArgumentError
        Not found, too large, or a ``layer`` that is not there.
    MissingExtraError
        RAW, and rawpy is not installed.
    """
    return load_image(path, layer=layer, max_pixels=max_pixels)[1]


def read_header(path: str | Path, *, max_pixels: int = MAX_PIXELS) -> ImageHeader:
    """Check the structure of an image file to its end and return its header.

    Raises
    ------
    CorruptInputError
        The file is empty, truncated, damaged or not an image of a known kind.
    ArgumentError
        The file cannot be opened, is none, or is larger than ``max_pixels`` allows.
    """
    with closing(RegularFile(Path(path))) as file:
        return _structure(file, max_pixels)[0]


def open_picture(
    path: str | Path, *, layer: str | None = None, max_pixels: int = MAX_PIXELS
) -> Picture:
    """A picture file as a source of windows, for the same files as :func:`read_image`.

    The structure of the file is checked to its end. What :meth:`~impasto.io.Source.read` returns
    is bit for bit the same part of what :func:`read_image` returns: of TIFF and OpenEXR only the
    strips, tiles or blocks of rows that a window touches are read and decoded; JPEG, PNG and RAW
    are decoded whole, once.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or no picture at all; damage of pixels is found when they are read.
    ArgumentError
        Not found, no file, too large, or a ``layer`` that is not there.
    """
    file = RegularFile(Path(path))
    try:
        with damage_of(file.path, "a picture"):
            return _structure(file, max_pixels)[1](layer)
    except BaseException:
        file.close()
        raise


def load_image(
    path: str | Path, *, layer: str | None = None, max_pixels: int = MAX_PIXELS
) -> tuple[ImageHeader, NDArray[Any]]:
    """As :func:`read_image`, with the header."""
    with open_picture(path, layer=layer, max_pixels=max_pixels) as picture:
        return picture.header, picture.read()


def _structure(
    file: RegularFile, max_pixels: int
) -> tuple[ImageHeader, Callable[[str | None], Picture]]:
    """The checked header, and what makes a source of it for a layer."""
    path = file.path
    if not file.size:
        raise CorruptInputError(path, "is empty (0 bytes): copy it again from the camera")
    first = file.at(0, min(8, file.size))

    def check(header: ImageHeader) -> None:
        check_size(header, file.size, max_pixels)

    if path.suffix.lower() in RAW_SUFFIXES:  # most of them are TIFF by their first bytes
        raw = open_raw(file)
        check(raw.header)
        return raw.header, lambda layer: raw
    if first[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}:
        picture = open_tiff(file, check)
        return picture.header, lambda layer: picture
    try:
        if first.startswith(b"\x76\x2f\x31\x01"):
            parts, header = exr_parts(file)
            check(header)
            return header, lambda layer: ExrSource(file, header, parts, layer)
        data = file.content()
        if first.startswith(b"\xff\xd8"):
            header = jpeg_header(path, data)
        elif first.startswith(b"\x89PNG\r\n\x1a\n"):
            header = png_header(path, data)
        else:
            raise CorruptInputError(
                path,
                "is not a JPEG, PNG, TIFF or OpenEXR picture (its first bytes are "
                f"{first.hex(' ')}), and its name is not that of a camera's RAW file",
            )
    except (struct.error, IndexError) as error:
        raise truncated(path, "its header") from error
    check(header)
    bands = 1 if header.channels <= 2 else 3
    return header, lambda layer: WholePicture(
        file, header, bands, partial(_decode, header, data, bands)
    )


def _decode(header: ImageHeader, data: bytes, bands: int) -> NDArray[Any]:
    """JPEG and PNG by OpenCV; IMREAD_UNCHANGED also leaves the orientation alone."""
    import cv2

    path = header.path
    try:
        # libjpeg decodes as much as it can of a damaged file and reports that on stderr only.
        with captured_lines(_DAMAGE_OF_JPEG + b"|" + NO_MEMORY) as said:
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError(f"{path}: {error}") from error
        raise CorruptInputError(path, f"cannot be decoded ({error})") from error
    if said and re.search(NO_MEMORY.decode(), said[0]):
        raise MemoryError(f"{path}: {said[0]}")
    if said:
        raise CorruptInputError(path, f"is damaged ({said[0]}); copy it again from the camera")
    if decoded is None:
        raise CorruptInputError(path, "cannot be decoded: it is damaged; copy it again")
    array: NDArray[Any] = np.asarray(decoded)
    if array.shape[:2] != (header.height, header.width):
        raise CorruptInputError(
            path,
            f"is damaged: the header says {header.width} x {header.height}, "
            f"{array.shape[1]} x {array.shape[0]} pixels were found",
        )
    # Blue first; OpenCV converts grey with alpha to four channels.
    array = array.reshape(header.height, header.width, -1)[..., :3]
    return np.moveaxis(array[..., ::-1] if bands == 3 else array[..., :1], -1, 0)


def decoded_jpeg(path: Path, data: bytes, width: int, height: int) -> NDArray[np.uint8]:
    """``(y, x)``: a grey JPEG inside another file, of a size that this states.

    Raises
    ------
    CorruptInputError
        Damaged, or of another size.
    """
    if not data.startswith(b"\xff\xd8"):
        raise CorruptInputError(path, "is damaged: a plane is no JPEG")
    header = jpeg_header(path, data)
    if (header.width, header.height, header.channels) != (width, height, 1):
        raise CorruptInputError(
            path,
            f"is damaged: a plane has {header.width} x {header.height} pixels of "
            f"{header.channels} channels, expected {width} x {height} of 1",
        )
    found: NDArray[np.uint8] = np.array(_decode(header, data, 1)[0])
    return found


def list_images(folder: Path) -> list[Path]:
    """The pictures of a folder in natural order: photo2 before photo10.

    A JPEG that a camera has written beside its RAW file is not one more photograph.
    """
    found = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES
        and not path.name.startswith(".")
        and path.is_file()
    ]
    raw = {path.stem for path in found if path.suffix.lower() in RAW_SUFFIXES}
    found = [p for p in found if p.suffix.lower() not in JPEG_SUFFIXES or p.stem not in raw]
    return sorted(found, key=lambda path: natural_key(path.name))


def photographs_in(folder: Path) -> list[Path]:
    """The pictures of a folder that must have some, in natural order.

    Raises
    ------
    ArgumentError
        No folder, or none in it: the message names the folders below that have some.
    """
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    paths = list_images(folder)
    if not paths:
        raise ArgumentError(f"path: {folder} holds no photographs{photographs_below(folder)}")
    return paths


def photographs_below(folder: Path) -> str:
    """Words for the end of a message: which folders in this one hold photographs; or none."""
    homes = sorted((home for home in folder.iterdir() if home.is_dir()), key=lambda one: one.name)
    there = [home.name for home in homes if not home.name.startswith(".") and list_images(home)]
    if not there:
        return ""
    if len(there) == 1:
        return f"; {there[0]} in it does: give that folder"
    return f"; {few(there)} in it do: give one of them"


def natural_key(name: str) -> tuple[Any, ...]:
    """Sort key that reads runs of digits as numbers."""
    parts = re.split(r"(\d+)", name.casefold())
    return (*[(int(p) if p.isdigit() else -1, p) for p in parts], name)

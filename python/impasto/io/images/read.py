"""Read photographs as band-planar arrays; errors name the file."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import CorruptInputError
from impasto.io.images.exr import decode_exr, exr_header
from impasto.io.images.header import MAX_PIXELS, ImageHeader, check_size, read_bytes, truncated
from impasto.io.images.jpeg import jpeg_header
from impasto.io.images.native_stderr import captured_lines
from impasto.io.images.png import png_header
from impasto.io.images.tiff import decode_tiff, tiff_header

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".png", ".tif", ".tiff", ".exr"})


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
        JPEG, PNG (8 or 16 bit), TIFF (8, 16 bit or float) or OpenEXR (half or float).
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
    """
    return load_image(path, layer=layer, max_pixels=max_pixels)[1]


def read_header(path: str | Path, *, max_pixels: int = MAX_PIXELS) -> ImageHeader:
    """Check the structure of an image file to its end and return its header.

    Raises
    ------
    CorruptInputError
        The file is empty, truncated, damaged or not an image of a known kind.
    ArgumentError
        The file cannot be opened, or is larger than ``max_pixels`` allows.
    """
    path = Path(path)
    data = read_bytes(path)
    return header_of(path, data, max_pixels=max_pixels)


def header_of(path: Path, data: bytes, *, max_pixels: int = MAX_PIXELS) -> ImageHeader:
    """As :func:`read_header`, for bytes already read."""
    if not data:
        raise CorruptInputError(path, "is empty (0 bytes): copy it again from the camera")
    try:
        if data.startswith(b"\xff\xd8"):
            header = jpeg_header(path, data)
        elif data.startswith(b"\x89PNG\r\n\x1a\n"):
            header = png_header(path, data)
        elif data[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}:
            header = tiff_header(path, data, lambda h: check_size(h, len(data), max_pixels))
        elif data.startswith(b"\x76\x2f\x31\x01"):
            header = exr_header(path, data)
        else:
            raise CorruptInputError(
                path,
                "is not a JPEG, PNG, TIFF or OpenEXR picture (its first bytes are "
                f"{data[:8].hex(' ')}); convert camera RAW to linear 16-bit TIFF first",
            )
    except (struct.error, IndexError) as error:
        raise truncated(path, "its header") from error
    check_size(header, len(data), max_pixels)
    return header


def load_image(
    path: str | Path, *, layer: str | None = None, max_pixels: int = MAX_PIXELS
) -> tuple[ImageHeader, NDArray[Any]]:
    """As :func:`read_image`, with the header."""
    path = Path(path)
    data = read_bytes(path)
    header = header_of(path, data, max_pixels=max_pixels)
    if header.format == "exr":
        planes = decode_exr(path, data, layer)
    elif header.format == "tiff":
        planes = decode_tiff(path, data)
    else:
        planes = _decode(path, data, grey=header.channels <= 2)
    if planes.shape[1:] != (header.height, header.width):
        raise CorruptInputError(
            path,
            f"is damaged: the header says {header.width} x {header.height}, "
            f"{planes.shape[2]} x {planes.shape[1]} pixels were found",
        )
    if planes.dtype == np.float64:
        planes = planes.astype(np.float32)
    return header, planes


def _decode(path: Path, data: bytes, *, grey: bool) -> NDArray[Any]:
    """JPEG and PNG by OpenCV; IMREAD_UNCHANGED also leaves the orientation alone."""
    import cv2

    try:
        # libjpeg decodes as much as it can of a damaged file and reports that on stderr only.
        with captured_lines(b"Corrupt JPEG data|Premature end of JPEG") as damage:
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise CorruptInputError(path, f"cannot be decoded ({error})") from error
    if damage:
        raise CorruptInputError(path, f"is damaged ({damage[0]}); copy it again from the camera")
    if decoded is None:
        raise CorruptInputError(path, "cannot be decoded: it is damaged; copy it again")
    array: NDArray[Any] = np.asarray(decoded)
    if array.ndim == 2:
        return np.ascontiguousarray(array[None])
    # OpenCV converts grey with alpha to four channels, blue first.
    order = [0] if grey else [2, 1, 0]
    return np.ascontiguousarray(np.moveaxis(array[..., order], -1, 0))


def list_images(folder: Path) -> list[Path]:
    """The pictures of a folder in natural order: photo2 before photo10."""
    found = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES
        and not path.name.startswith(".")
        and path.is_file()
    ]
    return sorted(found, key=lambda path: natural_key(path.name))


def natural_key(name: str) -> tuple[Any, ...]:
    """Sort key that reads runs of digits as numbers."""
    parts = re.split(r"(\d+)", name.casefold())
    return (*[(int(p) if p.isdigit() else -1, p) for p in parts], name)

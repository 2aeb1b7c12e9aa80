"""What a picture claims to be, and whether its file can hold that, before a pixel is decoded.

Libraries fill the missing rest of a truncated JPEG or TIFF with grey or zeros and say nothing;
here the structure of the file is walked to its end first.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impasto.errors import ArgumentError, CorruptInputError

MAX_PIXELS = 1 << 31
"""Pictures with more pixels than this are refused (about 46 000 x 46 000)."""

_RATIO = 1100
"""Deflate cannot expand by more than 1032; a header claiming more than that is a bomb."""
_HARMLESS_BYTES = 1 << 26
"""Claims below 64 MiB are decoded whatever the ratio: a flat picture compresses well."""


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """The claims of an image file that passed the structural checks.

    Parameters
    ----------
    format
        ``"jpeg"``, ``"png"``, ``"tiff"`` or ``"exr"``.
    width, height
        In pixels, as stored (EXIF orientation is not applied).
    channels
        Number of stored channels, alpha included.
    dtype
        Of the decoded samples.
    orientation
        EXIF orientation 1..8; 1 where the file does not say.
    """

    path: Path
    format: str
    width: int
    height: int
    channels: int
    dtype: np.dtype[np.generic]
    orientation: int = 1

    @property
    def nbytes(self) -> int:
        """Bytes of the decoded picture."""
        return self.width * self.height * self.channels * self.dtype.itemsize


def read_header(path: str | Path, *, max_pixels: int = MAX_PIXELS) -> ImageHeader:
    """Check an image file's structure to its end and return what it claims to hold.

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


def read_bytes(path: Path) -> bytes:
    """The file's bytes, with an error that names it."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ArgumentError(f"{path}: cannot be read ({error.strerror or error})") from error


def header_of(path: Path, data: bytes, *, max_pixels: int = MAX_PIXELS) -> ImageHeader:
    """As :func:`read_header`, for bytes already read."""
    if not data:
        raise CorruptInputError(path, "is empty (0 bytes): copy it again from the camera")
    try:
        if data.startswith(b"\xff\xd8"):
            header = _jpeg(path, data)
        elif data.startswith(b"\x89PNG\r\n\x1a\n"):
            header = _png(path, data)
        elif data[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}:
            from impasto.io.tiff import tiff_header

            header = tiff_header(path, data, lambda h: check_size(h, len(data), max_pixels))
        elif data.startswith(b"\x76\x2f\x31\x01"):
            from impasto.io.exr import exr_header

            header = exr_header(path, data)
        else:
            raise CorruptInputError(
                path,
                "is no JPEG, PNG, TIFF or OpenEXR picture (its first bytes are "
                f"{data[:8].hex(' ')}); convert camera RAW to linear 16-bit TIFF first",
            )
    except (struct.error, IndexError) as error:
        raise truncated(path, "its header") from error
    check_size(header, len(data), max_pixels)
    return header


def truncated(path: Path, what: str) -> CorruptInputError:
    """The error of a file that ends too early."""
    return CorruptInputError(
        path, f"is truncated: the file ends inside {what}; copy it again from the camera"
    )


def check_size(header: ImageHeader, file_bytes: int, max_pixels: int) -> None:
    """Refuse sizes that no honest file of that length can hold, before anything is allocated."""
    if header.width < 1 or header.height < 1:
        raise CorruptInputError(
            header.path, f"claims a size of {header.width} x {header.height} pixels"
        )
    claim = f"{header.width} x {header.height} x {header.channels} {header.dtype}"
    if header.nbytes > _HARMLESS_BYTES and header.nbytes > _RATIO * file_bytes:
        raise CorruptInputError(
            header.path,
            f"claims {claim} samples ({header.nbytes / 1e9:.1f} GB) in a file of {file_bytes} "
            "bytes: refused as damaged or hostile",
        )
    if header.width * header.height > max_pixels:
        raise ArgumentError(
            f"{header.path}: {claim} is more than max_pixels={max_pixels}; cut the picture into "
            "tiles, or raise max_pixels"
        )


# A marker that ends entropy-coded data: not a stuffed zero, a restart or a fill byte.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_STANDALONE = frozenset({0x01, *range(0xD0, 0xD8)})
_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})


def _jpeg(path: Path, data: bytes) -> ImageHeader:
    """Walk the segments and scans to the end-of-image marker."""
    at, frame, orientation = 2, None, 1
    while True:
        if at + 2 > len(data):
            raise truncated(path, "the picture (no end-of-image marker)")
        if data[at] != 0xFF:
            raise CorruptInputError(path, f"is damaged: no JPEG marker at byte {at}")
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        if marker in _STANDALONE:
            at += 2
            continue
        if marker == 0xD9:
            break
        (length,) = struct.unpack_from(">H", data, at + 2)
        if length < 2:
            raise CorruptInputError(path, f"is damaged: a JPEG segment of length {length}")
        if marker in _FRAMES:
            precision, height, width, channels = struct.unpack_from(">BHHB", data, at + 4)
            if precision != 8:
                raise CorruptInputError(
                    path, f"is a JPEG of {precision} bits, which cannot be read: use TIFF or PNG"
                )
            frame = (width, height, channels)
        elif marker == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            orientation = _exif_orientation(data[at + 10 : at + 2 + length])
        at += 2 + length
        if marker == 0xDA:
            found = _MARKER.search(data, at)
            if found is None:
                raise truncated(path, "the picture (no end-of-image marker)")
            at = found.start()
    if frame is None:
        raise CorruptInputError(path, "is a JPEG without a picture")
    width, height, channels = frame
    if channels == 4:
        raise CorruptInputError(
            path, "is a CMYK JPEG, made for printing: export the photograph as RGB"
        )
    return ImageHeader(path, "jpeg", width, height, channels, np.dtype(np.uint8), orientation)


def _exif_orientation(block: bytes) -> int:
    """Tag 274 of a TIFF-structured EXIF block; 1 where it is absent or damaged."""
    try:
        order = {b"II": "<", b"MM": ">"}[block[:2]]
        (ifd,) = struct.unpack_from(order + "I", block, 4)
        (count,) = struct.unpack_from(order + "H", block, ifd)
        for index in range(count):
            tag, _, _, value = struct.unpack_from(order + "HHIH", block, ifd + 2 + 12 * index)
            if tag == 274 and 1 <= value <= 8:
                return int(value)
    except (KeyError, struct.error):
        pass  # EXIF damage does not touch the pixels
    return 1


_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}


def _png(path: Path, data: bytes) -> ImageHeader:
    """Walk the chunks, with their checksums, to IEND; count the compressed rows."""
    at = 8
    claim: tuple[int, int, int, int] | None = None
    transparent = False
    orientation = 1
    while True:
        if at + 12 > len(data):
            raise truncated(path, "the picture (no IEND chunk)")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        if end + 4 > len(data):
            raise truncated(path, f"the {kind.decode('latin-1')} chunk")
        (checksum,) = struct.unpack_from(">I", data, end)
        if zlib.crc32(memoryview(data)[at + 4 : end]) != checksum:
            raise CorruptInputError(
                path,
                f"is damaged: the checksum of its {kind.decode('latin-1')} chunk at byte {at} "
                "is wrong; copy it again from the camera",
            )
        if claim is None:
            if kind != b"IHDR":
                raise CorruptInputError(path, "is damaged: a PNG starts with IHDR")
            claim = struct.unpack_from(">IIBB", data, at + 8)
        elif kind == b"tRNS":
            transparent = True
        elif kind == b"eXIf":
            orientation = _exif_orientation(data[at + 8 : end])
        elif kind == b"IEND":
            break
        at = end + 4
    width, height, depth, colour = claim
    if colour not in _PNG_CHANNELS:
        raise CorruptInputError(path, f"is damaged: PNG colour type {colour}")
    channels = _PNG_CHANNELS[colour] + transparent
    dtype = np.dtype(np.uint16 if depth == 16 else np.uint8)
    return ImageHeader(path, "png", width, height, channels, dtype, orientation)

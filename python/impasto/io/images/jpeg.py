"""Structural check of a JPEG file before decoding."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from impasto.errors import CorruptInputError
from impasto.io.images.header import ImageHeader, exif_orientation, truncated
from impasto.io.images.profile import jpeg_curve

# A marker that ends entropy-coded data: not a stuffed zero, a restart or a fill byte.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_STANDALONE = frozenset({0x01, *range(0xD0, 0xD8)})
_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})


def jpeg_header(path: Path, data: bytes) -> ImageHeader:
    """Walk the segments and scans to the end-of-image marker."""
    at, frame, orientation = 2, None, 1
    profile: dict[int, bytes] = {}
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
            orientation = exif_orientation(data[at + 10 : at + 2 + length])
        elif marker == 0xE2 and data[at + 4 : at + 16] == b"ICC_PROFILE\0":
            profile[data[at + 16]] = data[at + 18 : at + 2 + length]
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
    dtype, curve = np.dtype(np.uint8), jpeg_curve(profile)
    return ImageHeader(path, "jpeg", width, height, channels, dtype, orientation, curve)

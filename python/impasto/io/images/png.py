"""Structural check of a PNG file before decoding."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from impasto.errors import CorruptInputError
from impasto.io.images.header import ImageHeader, exif_orientation, truncated
from impasto.io.images.profile import png_curve

_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}


def png_header(path: Path, data: bytes) -> ImageHeader:
    """Walk the chunks, with their checksums, to IEND; count the compressed rows."""
    at = 8
    claim: tuple[int, int, int, int] | None = None
    transparent = False
    orientation = 1
    stated: dict[bytes, bytes] = {}
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
            orientation = exif_orientation(data[at + 8 : end])
        elif kind in {b"iCCP", b"sRGB", b"gAMA"}:
            stated[kind] = data[at + 8 : end]
        elif kind == b"IEND":
            break
        at = end + 4
    width, height, depth, colour = claim
    if colour not in _PNG_CHANNELS:
        raise CorruptInputError(path, f"is damaged: PNG colour type {colour}")
    channels = _PNG_CHANNELS[colour] + transparent
    dtype = np.dtype(np.uint16 if depth == 16 else np.uint8)
    curve = png_curve(stated)
    return ImageHeader(path, "png", width, height, channels, dtype, orientation, curve)

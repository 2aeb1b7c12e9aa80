"""The header of a picture, and whether its file can hold what it claims, before decoding.

Libraries fill the missing rest of a truncated JPEG or TIFF with grey or zeros and say nothing;
here the structure of the file is walked to its end first.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.budget import check_claim

MAX_PIXELS = 1 << 31
"""Pictures with more pixels than this are refused (about 46 000 x 46 000)."""


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """The claims of an image file that passed the structural checks.

    Parameters
    ----------
    format
        ``"jpeg"``, ``"png"``, ``"tiff"``, ``"exr"`` or ``"raw"``.
    width, height
        In pixels, as stored (EXIF orientation is not applied).
    channels
        Number of stored channels, alpha included.
    dtype
        Of the decoded samples.
    orientation
        EXIF orientation 1..8; 1 where the file does not say.
    curve
        Tone curve of the file's colour profile: ``"linear"``, ``"srgb"``, a gamma such as
        ``"2.2"``, or ``"other"``; empty where the file has no profile.
    """

    path: Path
    format: str
    width: int
    height: int
    channels: int
    dtype: np.dtype[np.generic]
    orientation: int = 1
    curve: str = ""

    @property
    def nbytes(self) -> int:
        """Bytes of the decoded picture."""
        return self.width * self.height * self.channels * self.dtype.itemsize


def truncated(path: Path, what: str) -> CorruptInputError:
    """The error of a file that ends too early."""
    return CorruptInputError(
        path, f"is truncated: the file ends inside {what}; copy it again from the camera"
    )


def check_size(header: ImageHeader, file_bytes: int, max_pixels: int) -> None:
    """Refuse sizes that no file of this length can hold, before anything is allocated."""
    if header.width < 1 or header.height < 1:
        raise CorruptInputError(
            header.path, f"claims a size of {header.width} x {header.height} pixels"
        )
    claim = f"{header.width} x {header.height} x {header.channels} {header.dtype}"
    check_claim(header.path, header.nbytes, file_bytes, f"{claim} samples")
    if header.width * header.height > max_pixels:
        raise ArgumentError(
            f"{header.path}: {claim} is more than max_pixels={max_pixels}; cut the picture into "
            "tiles, or raise max_pixels"
        )


def exif_orientation(block: bytes) -> int:
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
        pass  # damaged EXIF does not affect the pixels
    return 1

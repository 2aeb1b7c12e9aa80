"""The structure of TIFF pictures, checked to the end before a pixel is decoded."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError, ImpastoError
from impasto.io.budget import HARMLESS_BYTES
from impasto.io.images.header import ImageHeader, truncated
from impasto.io.images.profile import profile_curve
from impasto.io.images.tiff_source import TiffSource, segment_size

_LIBRARY, _SILENT = logging.getLogger("tifffile"), logging.NullHandler()
_DTYPES = frozenset({"uint8", "uint16", "float16", "float32", "float64"})
_LARGEST_TILE = 4
"""How many times the picture a tile may hold."""
_COLOURS = {0: "white-is-zero", 3: "palette", 5: "CMYK", 6: "YCbCr", 8: "Lab", 32803: "raw mosaic"}


def open_tiff(file: RegularFile, check: Callable[[ImageHeader], None]) -> TiffSource:
    """The picture of a TIFF or BigTIFF file; the source closes the file.

    Every strip or tile must lie inside the file: tifffile fills missing ones with zeros, which
    would look like shadow. ``check`` sees the header before the tables of strips are walked.
    """
    import tifffile

    # What it says of odd files goes to a program's log, not to the terminal.
    _LIBRARY.addHandler(_SILENT)
    path = file.path
    try:
        with file.given_to_a_library():
            opened = tifffile.TiffFile(file.handle, offset=0)
            pages = _pages(path, opened)
            header = _header(path, pages)
            check(header)
            for page in pages:
                _check_tile(path, page)
                _check_page(path, page, file.size)
            return TiffSource(file, header, pages)
    except (ImpastoError, MemoryError):
        raise
    except Exception as error:  # tifffile raises many kinds of exceptions
        raise CorruptInputError(path, f"cannot be read as TIFF ({error})") from error


def _header(path: Path, pages: list[Any]) -> ImageHeader:
    first = pages[0]
    dtype = np.dtype(first.dtype) if first.dtype is not None else None
    if dtype is None or dtype.name not in _DTYPES:
        raise CorruptInputError(
            path,
            f"holds {first.bitspersample}-bit samples ({dtype}); expected 8 or 16-bit "
            "integers or floats",
        )
    photometric = int(first.photometric)
    if photometric in _COLOURS and not (photometric == 6 and int(first.compression) == 7):
        raise CorruptInputError(
            path,
            f"has {_COLOURS[photometric]} colours; save the photograph as grey or RGB",
        )
    if int(first.imagedepth or 1) != 1:
        raise CorruptInputError(path, "holds a volume, not a photograph")
    return ImageHeader(
        path,
        "tiff",
        int(first.imagewidth),
        int(first.imagelength),
        int(first.samplesperpixel) * len(pages),
        dtype,
        _orientation(first),
        _curve(first),
    )


def _pages(path: Path, file: Any) -> list[Any]:
    """The pages of full size and equal kind: bands stored page by page."""
    if not file.pages:
        raise CorruptInputError(path, "is a TIFF without a picture")
    first = file.pages[0].aspage()
    pages = [first]
    for index in range(1, len(file.pages)):
        page = file.pages[index].aspage()
        same = (page.imagewidth, page.imagelength, page.dtype, page.samplesperpixel) == (
            first.imagewidth,
            first.imagelength,
            first.dtype,
            first.samplesperpixel,
        )
        # Reduced and mask pages (bit 0 and 2 of NewSubfileType) are previews, not bands.
        if same and not int(page.subfiletype or 0) & 0b101:
            pages.append(page)
    return pages


def _check_page(path: Path, page: Any, file_bytes: int) -> None:
    offsets, counts = page.dataoffsets, page.databytecounts
    if not offsets or len(offsets) != len(counts):
        raise truncated(path, "its table of strips")
    length, width = segment_size(page)
    needed = -(-int(page.imagelength) // length) * -(-int(page.imagewidth) // width)
    needed *= int(page.samplesperpixel) if int(page.planarconfig or 1) == 2 else 1
    if len(offsets) < needed:
        raise truncated(path, f"its table of strips ({len(offsets)} of {needed} are listed)")
    for offset, count in zip(offsets, counts, strict=True):
        if offset <= 0 or count <= 0:
            raise CorruptInputError(
                path, "has an empty strip or tile: its writer did not finish; export it again"
            )
        if offset + count > file_bytes:
            raise truncated(
                path, f"the pixels (a strip ends at byte {offset + count} of {file_bytes})"
            )
    if int(page.compression) == 1 and sum(counts) < page.nbytes:
        raise truncated(path, f"the pixels ({sum(counts)} of {page.nbytes} bytes are stored)")


def _check_tile(path: Path, page: Any) -> None:
    """A tile may be larger than a small picture, but not by any size that its writer likes."""
    length, width = segment_size(page)
    claimed = length * width * int(page.samplesperpixel) * np.dtype(page.dtype).itemsize
    if claimed > max(HARMLESS_BYTES, _LARGEST_TILE * int(page.nbytes)):
        raise CorruptInputError(
            path,
            f"claims tiles of {width} x {length} pixels ({claimed / 1e9:.1f} GB) for a picture of "
            f"{page.imagewidth} x {page.imagelength}: refused as damaged or hostile",
        )


def _orientation(page: Any) -> int:
    tag = page.tags.get(274)
    value = int(tag.value) if tag is not None else 1
    return value if 1 <= value <= 8 else 1


def _curve(page: Any) -> str:
    """The tone curve of the profile, tag 34675; empty if there is none."""
    tag = page.tags.get(34675)
    return profile_curve(bytes(tag.value)) if tag is not None else ""

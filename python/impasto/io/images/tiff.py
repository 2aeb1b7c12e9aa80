"""TIFF pictures: structure, decoding, writing."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import CorruptInputError, ImpastoError
from impasto.io.images.header import ImageHeader, truncated
from impasto.io.images.profile import profile_curve

_DTYPES = frozenset({"uint8", "uint16", "float16", "float32", "float64"})
_GREY, _RGB = 1, 2
_COLOURS = {0: "white-is-zero", 3: "palette", 5: "CMYK", 6: "YCbCr", 8: "Lab", 32803: "raw mosaic"}


@contextmanager
def _opened(path: Path, data: bytes) -> Iterator[Any]:
    """A TiffFile on bytes in memory; errors of the library name the file."""
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            yield file
    except ImpastoError:
        raise
    except Exception as error:  # tifffile raises many kinds of exceptions
        raise CorruptInputError(path, f"cannot be read as TIFF ({error})") from error


def tiff_header(
    path: Path, data: bytes, check: Callable[[ImageHeader], None] | None = None
) -> ImageHeader:
    """Sizes, and whether every strip or tile lies inside the file.

    tifffile fills missing strips with zeros, which would look like shadow.
    """
    with _opened(path, data) as file:
        pages = _pages(path, file)
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
        header = ImageHeader(
            path,
            "tiff",
            int(first.imagewidth),
            int(first.imagelength),
            int(first.samplesperpixel) * len(pages),
            dtype,
            _orientation(first),
            _curve(first),
        )
        if check is not None:
            check(header)
        for page in pages:
            _check_page(path, page, len(data))
        return header


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
    needed = int(np.prod(page.chunked)) if page.chunked else 1
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


def _orientation(page: Any) -> int:
    tag = page.tags.get(274)
    value = int(tag.value) if tag is not None else 1
    return value if 1 <= value <= 8 else 1


def _curve(page: Any) -> str:
    """The tone curve of the profile, tag 34675; empty if there is none."""
    tag = page.tags.get(34675)
    return profile_curve(bytes(tag.value)) if tag is not None else ""


def decode_tiff(path: Path, data: bytes) -> NDArray[Any]:
    """All bands ``(band, y, x)`` without alpha and other extra samples."""
    with _opened(path, data) as file:
        planes = []
        for page in _pages(path, file):
            planes += _page_bands(page, _page_array(path, page, data))
    return np.ascontiguousarray(np.stack(planes))


def _page_array(path: Path, page: Any, data: bytes) -> NDArray[Any]:
    try:
        array: NDArray[Any] = page.asarray()
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        # LZW and JPEG inside TIFF: tifffile needs an add-on; OpenCV decodes them with libtiff.
        array = _by_opencv(path, data, error)
    return array


def _by_opencv(path: Path, data: bytes, error: ValueError) -> NDArray[Any]:
    import cv2

    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise CorruptInputError(
            path, f"has a compression that cannot be read ({error}); save it with deflate or none"
        ) from error
    array: NDArray[Any] = np.asarray(decoded)
    if array.ndim == 3:
        array = array[..., [2, 1, 0, *range(3, array.shape[2])]]
    return array


def _page_bands(page: Any, array: NDArray[Any]) -> list[NDArray[Any]]:
    array = np.squeeze(array) if array.ndim > 3 else array
    if array.ndim == 2:
        return [array]
    # PlanarConfiguration 2 stores (band, y, x); 1 stores (y, x, band).
    planar = int(page.planarconfig or 1) == 2 and array.shape[1:] == (
        page.imagelength,
        page.imagewidth,
    )
    bands = array if planar else np.moveaxis(array, -1, 0)
    extra = len(page.extrasamples or ())
    alpha = any(int(sample) in {1, 2} for sample in page.extrasamples or ())
    kept = len(bands) - extra if alpha else len(bands)
    return list(bands[:kept])

"""A TIFF picture as a source: only the strips and tiles that a window touches are decoded."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import damage_of
from impasto._internal.pools import Pool
from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError, ImpastoError
from impasto.io.images.header import ImageHeader
from impasto.io.images.picture import Picture
from impasto.io.images.tiff_codecs import (
    DEFLATE,
    JPEG,
    LZMA,
    NONE,
    Layout,
    SegmentError,
    decoded_by_opencv,
    decoded_rows,
    inflated,
    one_strip,
)

_AT_ONCE = 1 << 18
"""Bytes that are read at once where nothing is compressed: the cache has them while bands are taken
apart."""
_FEW = 4
"""Segments for which no threads are started."""


class TiffSource(Picture):
    """The bands of all pages of a TIFF file, without alpha and other extra samples.

    Parameters
    ----------
    file
        Closed by the source.
    header
        Checked.
    pages
        Pages of tifffile, of one size and kind.
    """

    def __init__(self, file: RegularFile, header: ImageHeader, pages: Sequence[Any]) -> None:
        super().__init__(file, header)
        self._pages = [_Page(file, page) for page in pages]

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`~impasto.io.Source`."""
        bands = sum(page.kept for page in self._pages)
        return bands, self.header.height, self.header.width

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of a strip or tile; one pixel where nothing is compressed."""
        page = self._pages[0]
        return (1, 1) if page.plain else (page.length, page.width)

    def _read_into(self, out: NDArray[Any], top: int, left: int) -> None:
        if out.dtype != self.header.dtype:
            super()._read_into(out, top, left)
            return
        # Without a picture of its own in between.
        self.check_open()
        with damage_of(self.header.path, "a picture"):
            self._fill(out, top, left)

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        out = np.empty((self.shape[0], bottom - top, right - left), self.header.dtype)
        self._fill(out, top, left)
        return out.astype(self.dtype, copy=False)

    def _fill(self, out: NDArray[Any], top: int, left: int) -> None:
        first = 0
        for page in self._pages:
            page.fill(out[first : first + page.kept], top, left)
            first += page.kept


@dataclass(slots=True)
class _Page:
    file: RegularFile
    page: Any
    length: int = field(init=False)
    width: int = field(init=False)
    layout: Layout = field(init=False)
    kept: int = field(init=False)
    plain: bool = field(init=False)
    _usual: bool = field(init=False)

    def __post_init__(self) -> None:
        page = self.page
        samples = int(page.samplesperpixel)
        extra = len(page.extrasamples or ())
        alpha = any(int(sample) in {1, 2} for sample in page.extrasamples or ())
        self.kept = samples - extra if alpha else samples
        self.length, self.width = segment_size(page)
        self.layout = Layout(
            self.width,
            1 if self._separate else samples,
            np.dtype(page.dtype).newbyteorder(page.parent.byteorder),
            int(page.compression),
            int(page.predictor or 1),
            int(page.fillorder or 1) == 2,
        )
        bits = page.bitspersample
        self._usual = isinstance(bits, int) and bits == 8 * self.layout.dtype.itemsize
        unchanged = self.layout.predictor == 1 and not self.layout.reversed_bits
        self.plain = self._usual and unchanged and self.layout.compression == NONE

    @property
    def _separate(self) -> bool:
        return int(self.page.planarconfig or 1) == 2 and int(self.page.samplesperpixel) > 1

    def fill(self, out: NDArray[Any], top: int, left: int) -> None:
        """Decode into ``(band, y, x)`` what lies from ``top`` and ``left`` on."""
        bottom, right = top + out.shape[1], left + out.shape[2]
        down = -(-int(self.page.imagelength) // self.length)
        across = -(-int(self.page.imagewidth) // self.width)
        tasks: list[tuple[int, int, int, NDArray[Any]]] = []
        planes = [out[band : band + 1] for band in range(self.kept)] if self._separate else [out]
        for plane, target in enumerate(planes):
            for y in range(top // self.length, -(-bottom // self.length)):
                row = (plane * down + y) * across
                touched = range(left // self.width, -(-right // self.width))
                tasks += [(row + x, y, x, target) for x in touched]

        def decode(task: tuple[int, int, int, NDArray[Any]]) -> None:
            index, y, x, target = task
            y0, x0 = y * self.length, x * self.width
            first, end = max(top - y0, 0), min(bottom - y0, self.length)
            columns = max(left - x0, 0), min(right - x0, self.width)
            part = target[:, :, x0 + columns[0] - left : x0 + columns[1] - left]
            # A whole picture may be one strip.
            rows = max(1, _AT_ONCE // self.layout.row_bytes) if self.plain else self.length
            for start in range(first, end, rows):
                stop = min(start + rows, end)
                block = self._segment(index, y0, (start, stop), columns)[..., : len(target)]
                part[:, y0 + start - top : y0 + stop - top] = block.transpose(2, 0, 1)

        _run(decode, tasks, 1 if self.plain else workers())

    def _segment(
        self, index: int, y0: int, rows: tuple[int, int], columns: tuple[int, int]
    ) -> NDArray[Any]:
        """``(y, x, sample)`` of part of a strip or tile."""
        offset, count = int(self.page.dataoffsets[index]), int(self.page.databytecounts[index])
        layout = self.layout
        if self.plain:
            start = offset + rows[0] * layout.row_bytes + columns[0] * layout.pixel_bytes
            wanted = (columns[1] - columns[0]) * layout.pixel_bytes
            raw = self.file.rows(start, layout.row_bytes, rows[1] - rows[0], wanted)
            return raw.view(layout.dtype).reshape(len(raw), -1, layout.samples)
        data = self.file.at(offset, count)
        stored = (
            self.length if self.page.is_tiled else min(self.length, int(self.page.imagelength) - y0)
        )
        try:
            if self._usual and layout.known:
                # Some writers fill up the last strip: as many bytes as a whole one are no damage.
                most = stored if rows[1] < stored else self.length
                found: NDArray[Any] = decoded_rows(layout, data, *rows, most)
            else:
                found = self._by_library(data, index, stored)[rows[0] : rows[1]]
            return found[:, columns[0] : columns[1]]
        except (MemoryError, ImpastoError):
            raise
        except Exception as error:  # tifffile and its codecs raise many kinds of exceptions
            raise CorruptInputError(
                self.file.path,
                f"is damaged: {'tile' if self.page.is_tiled else 'strip'} {index} cannot be "
                f"decoded ({error}); copy it again",
            ) from error

    def _by_library(self, data: bytes, index: int, stored: int) -> NDArray[Any]:
        """What tifffile decodes with its add-on, or OpenCV."""
        if self.layout.compression in DEFLATE or self.layout.compression == LZMA:
            # Packed samples are at most as long as whole ones.
            most = self.length * self.layout.row_bytes
            inflated(data, self.layout.compression, most, 0, most)
        try:
            found: NDArray[Any] = self.page.decode(
                data, index, jpegtables=self.page.jpegtables, jpegheader=self.page.jpegheader
            )[0]
        except ValueError as error:
            if "imagecodecs" not in str(error):
                raise
            return self._by_opencv(data, stored, error)
        planes: NDArray[Any] = found[0]
        return planes

    def _by_opencv(self, data: bytes, stored: int, error: ValueError) -> NDArray[Any]:
        if self.layout.compression != JPEG or self.layout.dtype != np.uint8:
            raise CorruptInputError(
                self.file.path,
                f"has a compression that cannot be read ({error}); save it with deflate or none, "
                "or install imagecodecs",
            ) from error
        samples = self.layout.samples
        colours = 1 if samples == 1 else int(self.page.photometric)
        tags = {258: 8, 259: JPEG, 262: colours, 277: samples}
        picture = one_strip(data, self.width, stored, tags, self.page.jpegtables or b"")
        array = decoded_by_opencv(picture)
        if array.shape[:2] != (stored, self.width):
            raise SegmentError(f"it holds {array.shape[1]} x {array.shape[0]} pixels")
        return array.reshape(stored, self.width, samples)


def segment_size(page: Any) -> tuple[int, int]:
    """Rows and columns of a tile, or of a strip."""
    if page.is_tiled:
        return int(page.tilelength), int(page.tilewidth)
    rows = int(page.rowsperstrip or page.imagelength)
    return max(1, min(rows, int(page.imagelength))), int(page.imagewidth)


def workers() -> int:
    """Threads that decode beside each other: half of the cores, which is tifffile's choice."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not available on every system
        cores = os.cpu_count() or 1
    return max(1, cores // 2)


def _run(decode: Callable[[Any], None], tasks: list[Any], threads: int) -> None:
    if threads == 1 or len(tasks) <= _FEW:
        for task in tasks:
            decode(task)
        return
    with Pool(min(threads, len(tasks))) as pool:
        for _ in pool.map(decode, tasks):
            pass

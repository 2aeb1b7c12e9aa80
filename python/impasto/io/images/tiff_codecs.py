"""Strips and tiles of TIFF files, decoded one by one and never to more than they should hold.

TIFF 6.0 (1992); Technical Note 3 (2005) for the predictor of floating-point numbers.
"""

from __future__ import annotations

import lzma
import re
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.io.images.native_stderr import NO_MEMORY, captured_lines

NONE, LZW, JPEG, PACKBITS = 1, 5, 7, 32773
DEFLATE = frozenset({8, 32946})
LZMA = 34925
_PIECE = 1 << 22
"""Bytes that are decompressed at once where they are not wanted."""
_SAID = b"global grfmt_tiff|global loadsave|JPEG data|end of JPEG"
_DAMAGE = re.compile("TIFF_Error|can't read data|Corrupt JPEG data|Premature end of JPEG")
_DIFFERENCES, _FLOATS = 2, 3
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class SegmentError(ValueError):
    """A strip or tile that cannot be decoded; the reader adds the file's name."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How the samples of one strip or tile are packed.

    Parameters
    ----------
    width
        Pixels of a row.
    samples
        Of a pixel.
    dtype
        With the file's byte order.
    predictor
        1: none, 2: horizontal differences, 3: those of floating-point numbers.
    """

    width: int
    samples: int
    dtype: np.dtype[Any]
    compression: int
    predictor: int
    reversed_bits: bool

    @property
    def pixel_bytes(self) -> int:
        """Bytes of one pixel."""
        return self.samples * self.dtype.itemsize

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return self.width * self.pixel_bytes

    @property
    def known(self) -> bool:
        """Whether :func:`decoded_rows` decodes it."""
        return self.compression in {NONE, LZW, PACKBITS, LZMA, *DEFLATE} and self.predictor in {
            1,
            _DIFFERENCES,
            _FLOATS if self.dtype.kind == "f" else 1,
        }


def decoded_rows(
    layout: Layout, data: bytes, first: int, end: int, stored: int
) -> NDArray[np.generic]:
    """Rows ``first`` to ``end`` of a strip or tile of ``stored`` rows: ``(y, x, sample)``.

    Raises
    ------
    SegmentError
        It is damaged, or holds far more than ``stored`` rows.
    """
    if layout.reversed_bits:
        data = data.translate(_REVERSED)
    skip, wanted = first * layout.row_bytes, (end - first) * layout.row_bytes
    if layout.compression in DEFLATE or layout.compression == LZMA:
        raw = inflated(data, layout.compression, skip, wanted, stored * layout.row_bytes)
    elif layout.compression == NONE:
        raw = data[skip : skip + wanted]
    else:
        raw = _by_libtiff(layout, data, end)[skip:]
    if len(raw) < wanted:
        raise SegmentError(f"it holds {skip + len(raw)} of {skip + wanted} bytes")
    return _unpredicted(layout, raw, end - first)


def inflated(data: bytes, compression: int, skip: int, wanted: int, most: int) -> bytes:
    """``wanted`` bytes after the first ``skip``; the checksum counts where all are wanted.

    Raises
    ------
    SegmentError
        Damaged, or longer than ``most`` bytes.
    """
    stream = _Deflate(data) if compression in DEFLATE else _Lzma(data)
    try:
        _skip(stream, skip)
        found = stream.more(wanted)
        while len(found) < wanted and (piece := stream.more(wanted - len(found))):
            found += piece
        if skip + wanted < most or stream.ended:
            return found
        # To its end, where the checksum is; some writers fill the last strip up.
        if _skip(stream, most - skip - wanted + 1) > most - skip - wanted:
            raise SegmentError(
                f"it holds more than the {most} bytes that it should: damaged or hostile"
            )
        if not stream.ended:
            raise SegmentError("it ends too early")
    except (zlib.error, lzma.LZMAError, EOFError) as error:
        raise SegmentError(str(error)) from error
    return found


class _Deflate:
    def __init__(self, data: bytes) -> None:
        self._stream = zlib.decompressobj()
        self._left = data

    def more(self, most: int) -> bytes:
        """At most so many bytes; none at the end."""
        if self._stream.eof or most <= 0:
            return b""
        found = self._stream.decompress(self._left, most)
        self._left = self._stream.unconsumed_tail
        return found

    @property
    def ended(self) -> bool:
        return self._stream.eof


class _Lzma:
    def __init__(self, data: bytes) -> None:
        self._stream = lzma.LZMADecompressor()
        self._left = data

    def more(self, most: int) -> bytes:
        """At most so many bytes; none at the end."""
        if self._stream.eof or most <= 0:
            return b""
        found = self._stream.decompress(self._left, most)
        self._left = b""
        return found

    @property
    def ended(self) -> bool:
        return self._stream.eof


def _skip(stream: _Deflate | _Lzma, count: int) -> int:
    """Decompress ``count`` bytes and forget them; how many there were."""
    done = 0
    while done < count and (piece := stream.more(min(_PIECE, count - done))):
        done += len(piece)
    return done


def _unpredicted(layout: Layout, raw: bytes, rows: int) -> NDArray[np.generic]:
    shape = (rows, layout.width, layout.samples)
    native = layout.dtype.newbyteorder("=")
    if layout.predictor == _FLOATS:
        size = layout.dtype.itemsize
        # Differences of bytes, a pixel apart; then all first bytes of a row, all second ones ...
        steps = np.frombuffer(raw, np.uint8).reshape(rows, size * layout.width, layout.samples)
        planes = steps.cumsum(axis=1, dtype=np.uint8).reshape(rows, size, -1)
        numbers = np.ascontiguousarray(planes.transpose(0, 2, 1)).view(f">f{size}")
        return numbers.reshape(shape).astype(native)
    values = np.frombuffer(raw, layout.dtype).reshape(shape).astype(native, copy=False)
    if layout.predictor == 1:
        return values
    whole = np.dtype(f"u{native.itemsize}")
    return values.view(whole).cumsum(axis=1, dtype=whole).view(native)


def _by_libtiff(layout: Layout, data: bytes, rows: int) -> bytes:
    """LZW and PackBits: OpenCV's libtiff decodes bytes, a picture of one strip of grey codes."""
    # Codes of 16 bits: those of 8 go through a picture with four times the bytes.
    deep = layout.row_bytes % 2 == 0
    width = layout.row_bytes // 2 if deep else layout.row_bytes
    tags = {258: 16 if deep else 8, 259: layout.compression, 262: 1, 277: 1}
    picture = decoded_by_opencv(one_strip(data, width, rows, tags))
    return picture.astype("<u2" if deep else np.uint8, copy=False).tobytes()


def one_strip(
    data: bytes, width: int, rows: int, tags: dict[int, int], tables: bytes = b""
) -> bytes:
    """A TIFF file of one strip with ``tags`` of one number; ``tables`` are those of a JPEG."""
    fields: dict[int, tuple[int, int, int]] = {
        256: (4, 1, width),
        257: (4, 1, rows),
        278: (4, 1, rows),
        279: (4, 1, len(data)),
        **{tag: (4, 1, value) for tag, value in tags.items()},
    }
    samples = tags[277]
    after = 8 + 2 + 12 * (len(fields) + 1 + bool(tables)) + 4
    depths = struct.pack(f"<{samples}H", *[tags[258]] * samples)
    if samples > 2:
        fields[258] = (3, samples, after)
    if tables:
        fields[347] = (7, len(tables), after + len(depths))
    fields[273] = (4, 1, after + len(depths) + len(tables))
    head = struct.pack("<2sHIH", b"II", 42, 8, len(fields))
    entries = [struct.pack("<HHII", tag, *fields[tag]) for tag in sorted(fields)]
    return b"".join([head, *entries, b"\0\0\0\0", depths, tables, data])


def decoded_by_opencv(picture: bytes) -> NDArray[Any]:
    """The samples ``(y, x)`` or ``(y, x, sample)`` of a picture file, red first."""
    import cv2

    try:
        # libtiff decodes as much as it can of a damaged strip and reports that on stderr only.
        with captured_lines(b"|".join((_SAID, NO_MEMORY))) as said:
            decoded = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError(str(error)) from error
        raise SegmentError(str(error)) from error
    if short := [line for line in said if re.search(NO_MEMORY.decode(), line)]:
        raise MemoryError(short[0])
    if damage := [line for line in said if _DAMAGE.search(line)]:
        raise SegmentError(damage[0])
    if decoded is None:
        raise SegmentError("it cannot be decoded")
    array: NDArray[Any] = np.asarray(decoded)
    if array.ndim == 3:
        array = array[..., [2, 1, 0, *range(3, array.shape[2])]]
    return array

"""The structure of OpenEXR files: headers, and where every chunk lies, before a pixel is decoded.

"OpenEXR File Layout", openexr.com (3.4).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError
from impasto.io.budget import HARMLESS_BYTES
from impasto.io.images.header import ImageHeader, truncated

HALF = 1
_PIXEL_BYTES = {0: 4, HALF: 2, 2: 4}
_ROWS_PER_CHUNK = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256, 256, 32, 256, 1)
"""None, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB, HTJ2K256, HTJ2K32, LJ2K, ZSTD."""
_LONGEST_HEADER = 1 << 24
_HEADS = (1 << 16, 1 << 20, 1 << 26)
"""Bytes in which the header is looked for, one after the other; then the whole file."""
_TOO_MANY = 64
"""A chunk that holds more than so many times the picture is no chunk of it."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of a part: the kind of its numbers and its distance in x and y."""

    kind: int
    sampling: tuple[int, int]


@dataclass(frozen=True, slots=True)
class ExrPart:
    """One part of a file.

    Parameters
    ----------
    attributes
        Type and bytes by name, as stored.
    multipart
        Whether its chunks begin with the number of the part.
    chunks
        Where each chunk begins in the file; of tiles with levels, those of full size.
    """

    attributes: dict[str, tuple[str, bytes]]
    channels: dict[str, Channel]
    multipart: bool
    chunks: NDArray[np.uint64]

    @property
    def window(self) -> tuple[int, int, int, int]:
        """First column, first row, last column, last row."""
        return _window(self.attributes)

    @property
    def height(self) -> int:
        """Rows."""
        return self.window[3] - self.window[1] + 1

    @property
    def width(self) -> int:
        """Columns."""
        return self.window[2] - self.window[0] + 1

    @property
    def tile(self) -> tuple[int, int] | None:
        """Rows and columns of a tile, at most those of the part; None: blocks of rows."""
        if "tiles" not in self.attributes:
            return None
        width, height, _ = struct.unpack("<IIB", self.attributes["tiles"][1])
        return min(max(height, 1), self.height), min(max(width, 1), self.width)

    @property
    def block(self) -> tuple[int, int]:
        """Rows and columns of a chunk."""
        tile = self.tile
        return tile or (min(_rows_per_chunk(self.attributes), self.height), self.width)

    @property
    def pixel_bytes(self) -> int:
        """Bytes of one pixel of all channels."""
        return sum(_PIXEL_BYTES[channel.kind] for channel in self.channels.values())

    @property
    def nbytes(self) -> int:
        """Bytes of the decoded part."""
        return self.width * self.height * self.pixel_bytes


def exr_parts(file: RegularFile) -> tuple[list[ExrPart], ImageHeader]:
    """All parts, and the header of the first.

    Raises
    ------
    CorruptInputError
        A damaged header, or a chunk that does not lie inside the file.
    """
    path = file.path
    try:
        found, at, multipart = _read_headers(file)
        parts = []
        for attributes in found:
            channels = _channels(path, attributes)
            count, level = _chunk_count(path, attributes)
            if count > file.size // 8 or at + 8 * count > file.size:
                raise truncated(path, "its table of chunks")
            offsets = np.frombuffer(file.at(at, 8 * count), "<u8")[:level]
            at += 8 * count
            parts.append(ExrPart(attributes, channels, multipart, offsets))
        header = _header(path, parts[0])
        if header.width > 0 and header.height > 0:
            for part in parts:
                _check_chunks(file, part)
        return parts, header
    except (KeyError, ValueError, IndexError, struct.error) as error:
        if isinstance(error, CorruptInputError):
            raise
        raise CorruptInputError(path, f"has a damaged OpenEXR header ({error})") from error


def _header(path: Path, part: ExrPart) -> ImageHeader:
    kinds = {channel.kind for channel in part.channels.values()}
    dtype = np.dtype(np.float16 if kinds == {HALF} else np.float32)
    return ImageHeader(path, "exr", part.width, part.height, len(part.channels), dtype)


def _read_headers(file: RegularFile) -> tuple[list[dict[str, tuple[str, bytes]]], int, bool]:
    for head in _HEADS:
        if head >= file.size:
            break
        try:
            return _headers(file.path, file.at(0, head))
        except (CorruptInputError, struct.error, IndexError):
            continue  # it may be longer
    return _headers(file.path, file.content())


def _headers(path: Path, data: bytes) -> tuple[list[dict[str, tuple[str, bytes]]], int, bool]:
    version = struct.unpack_from("<I", data, 4)[0]
    multipart = bool(version & 0x1000)
    at, parts = 8, []
    while True:
        attributes: dict[str, tuple[str, bytes]] = {}
        while data[at] != 0:
            name, at = _word(path, data, at)
            kind, at = _word(path, data, at)
            (size,) = struct.unpack_from("<i", data, at)
            at += 4
            if size < 0 or size > _LONGEST_HEADER or at + size > len(data):
                raise truncated(path, f"its header (attribute {name!r})")
            attributes[name] = (kind, data[at : at + size])
            at += size
        at += 1
        if attributes:
            parts.append(attributes)
        if not multipart or not attributes:
            break
        if data[at] == 0:
            at += 1
            break
    if not parts:
        raise CorruptInputError(path, "is an OpenEXR file without a picture")
    if version & 0x800 or any(b"deep" in part.get("type", ("", b""))[1] for part in parts):
        raise CorruptInputError(path, "is a deep OpenEXR file, which holds no photograph")
    return parts, at, multipart


def _word(path: Path, data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at, at + 256)
    if end < 0:
        raise truncated(path, "its header")
    return data[at:end].decode("utf-8", "replace"), end + 1


def _channels(path: Path, attributes: dict[str, tuple[str, bytes]]) -> dict[str, Channel]:
    data, at = attributes["channels"][1], 0
    found: dict[str, Channel] = {}
    while data[at] != 0:
        end = data.index(0, at)
        kind, _, across, down = struct.unpack_from("<iiii", data, end + 1)
        found[data[at:end].decode("utf-8", "replace")] = Channel(kind, (across, down))
        at = end + 17
    if not found or any(channel.kind not in _PIXEL_BYTES for channel in found.values()):
        raise CorruptInputError(path, "has a damaged OpenEXR channel list")
    return found


def _window(attributes: dict[str, tuple[str, bytes]]) -> tuple[int, int, int, int]:
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"][1])
    return x0, y0, x1, y1


def _rows_per_chunk(attributes: dict[str, tuple[str, bytes]]) -> int:
    return _ROWS_PER_CHUNK[attributes["compression"][1][0]]


def _chunk_count(path: Path, attributes: dict[str, tuple[str, bytes]]) -> tuple[int, int]:
    """How many chunks the part has, and how many of these are of full size."""
    x0, y0, x1, y1 = _window(attributes)
    width, height = x1 - x0 + 1, y1 - y0 + 1
    stated = 0
    if "chunkCount" in attributes:
        (stated,) = struct.unpack("<i", attributes["chunkCount"][1])
    compression = attributes["compression"][1][0]
    if compression >= len(_ROWS_PER_CHUNK):
        raise CorruptInputError(
            path,
            f"has the OpenEXR compression {compression}, which is not known; save it with ZIP",
        )
    if "tiles" not in attributes:
        level = -(-height // _rows_per_chunk(attributes))
    else:
        tile_x, tile_y, _ = struct.unpack("<IIB", attributes["tiles"][1])
        level = -(-width // max(tile_x, 1)) * -(-height // max(tile_y, 1))
    level = max(level, 0)
    if stated and stated < level:
        raise truncated(path, f"its table of chunks ({stated} of {level} are listed)")
    # Smaller levels come after those of full size.
    return max(stated, level), level


def _check_chunks(file: RegularFile, part: ExrPart) -> None:
    rows, columns = part.block
    size = rows * columns * part.pixel_bytes
    if size > max(HARMLESS_BYTES, _TOO_MANY * file.size, 4 * part.nbytes):
        raise CorruptInputError(
            file.path, f"claims chunks of {size} bytes: refused as damaged or hostile"
        )
    head = chunk_head(part)
    for offset in part.chunks.tolist():
        if offset == 0:
            raise CorruptInputError(
                file.path, "misses part of the picture: its writer did not finish"
            )
        if offset + head > file.size:
            raise truncated(file.path, "the pixels")
        (count,) = struct.unpack("<i", file.at(offset + head - 4, 4))
        if count < 0 or offset + head + count > file.size:
            raise truncated(file.path, "the pixels")


def chunk_head(part: ExrPart) -> int:
    """Bytes before the pixels of a chunk: number of the part, place, size."""
    return 4 * part.multipart + (16 if part.tile is not None else 4) + 4

"""OpenEXR pictures as sources: a window is decoded from the chunks that it touches.

The library's binding reads files whole. It is given a smaller file: the header, with the window's
size, and the window's chunks as they are.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from contextlib import redirect_stdout
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.regular import RegularFile
from impasto.errors import CorruptInputError
from impasto.io.budget import check_claim
from impasto.io.images.exr_channels import pick_channels
from impasto.io.images.exr_structure import HALF, ExrPart, chunk_head
from impasto.io.images.header import ImageHeader
from impasto.io.images.native_stderr import NO_MEMORY, captured_lines
from impasto.io.images.picture import Picture

_AT_ONCE = 1 << 26
"""Bytes of the pixels that are decoded at once, unless one row of chunks has more."""
_NO_MEMORY = re.compile(NO_MEMORY.decode())
_BLOCKS = frozenset({6, 7})
"""B44 and B44A, which store all channels but half as they are."""
_NO_ZEROS = frozenset({1, 4}) | _BLOCKS
"""These, RLE and PIZ."""
_ZEROS = 16
"""Bytes at the end of a chunk: more than a block of B44. Writers leave one at most."""
_COPIED = (
    *("channels", "compression", "lineOrder"),
    *("pixelAspectRatio", "screenWindowCenter", "screenWindowWidth"),
)


class ExrSource(Picture):
    """The channels of one layer, which may lie in several parts.

    float16 if every one of them is half, else float32.

    Parameters
    ----------
    file
        Closed by the source.
    parts
        All parts; only those with a wanted channel are read.
    layer
        Picks the channels ``layer.*``; None: R, G, B, else Y, else the only layer.
    """

    def __init__(
        self, file: RegularFile, header: ImageHeader, parts: list[ExrPart], layer: str | None
    ) -> None:
        super().__init__(file, header)
        place: dict[str, ExrPart] = {}
        for part in parts:
            for name in part.channels:
                place.setdefault(name, part)
        self._channels = [
            (name, place[name]) for name in pick_channels(header.path, list(place), layer)
        ]
        used = [part for _, part in self._channels]
        sizes = {
            (part.width, part.height, part.channels[name].sampling) for name, part in self._channels
        }
        if len(sizes) != 1 or self._sampling != (1, 1):
            names = ", ".join(name for name, _ in self._channels)
            raise CorruptInputError(header.path, f"channels {names} differ in size")
        for part in used:
            check_claim(header.path, part.nbytes, file.size, f"{part.width} x {part.height} pixels")
        half = all(part.channels[name].kind == HALF for name, part in self._channels)
        self._dtype = np.dtype(np.float16 if half else np.float32)
        self._whole = any(
            channel.sampling != (1, 1) for part in used for channel in part.channels.values()
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`~impasto.io.Source`."""
        return len(self._channels), self._part.height, self._part.width

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the chosen channels."""
        return self._dtype

    @property
    def grid(self) -> tuple[int, int]:
        """A tile or a block of rows; the whole of a part that has channels of another size."""
        return (self._part.height, self._part.width) if self._whole else self._part.block

    @property
    def _part(self) -> ExrPart:
        return self._channels[0][1]

    @property
    def _sampling(self) -> tuple[int, int]:
        name, part = self._channels[0]
        return part.channels[name].sampling

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        out = np.empty((len(self._channels), bottom - top, right - left), self._dtype)
        for part in {id(part): part for _, part in self._channels}.values():
            wanted = [
                (band, name) for band, (name, own) in enumerate(self._channels) if own is part
            ]
            for y0, x0, planes in self._decoded(part, top, bottom, left, right):
                for band, name in wanted:
                    plane = planes[name]
                    a, b = max(top, y0), min(bottom, y0 + plane.shape[0])
                    c, d = left - x0, right - x0
                    out[band, a - top : b - top] = plane[a - y0 : b - y0, c:d]
        return out

    def _decoded(
        self, part: ExrPart, top: int, bottom: int, left: int, right: int
    ) -> Iterator[tuple[int, int, dict[str, NDArray[Any]]]]:
        """Row and column of the first pixel, and all channels, of each group of chunks."""
        rows, columns = (part.height, part.width) if self._whole else part.block
        first_x, last_x = left // columns, (right - 1) // columns
        across = (last_x - first_x + 1) * columns
        group = max(1, _AT_ONCE // max(rows * across * part.pixel_bytes, 1))
        for y in range(top // rows, -(-bottom // rows), group):
            end = min(y + group, -(-bottom // rows))
            y0, x0 = y * rows, first_x * columns
            box = (y0, x0, min(end * rows, part.height), min((last_x + 1) * columns, part.width))
            yield y0, x0, self._channels_of(part, _cut(self._file, part, box))

    def _channels_of(self, part: ExrPart, data: bytes) -> dict[str, NDArray[Any]]:
        import OpenEXR

        path = self.header.path
        try:
            # The binding omits channels that it cannot decode, and warns on both streams.
            with (
                redirect_stdout(io.StringIO()),
                captured_lines(b"EXR_ERR|ojph error") as said,
                OpenEXR.File(io.BytesIO(data), separate_channels=True) as file,
            ):
                found = {
                    name: np.array(channel.pixels)
                    for own in file.parts
                    for name, channel in own.channels.items()
                }
        except MemoryError:
            raise
        except Exception as error:  # the binding raises bare RuntimeError, ValueError and others
            if _NO_MEMORY.search(str(error)):
                raise MemoryError(f"{path}: {error}") from error
            raise CorruptInputError(path, f"cannot be read as OpenEXR ({error})") from error
        missing = part.channels.keys() - found.keys()
        if missing and any(_NO_MEMORY.search(line) for line in said):
            raise MemoryError(f"{path}: {said[0]}")
        if missing:
            raise CorruptInputError(
                path,
                f"is damaged: its pixels (channels {', '.join(sorted(missing))}) cannot be decoded",
            )
        return found


def _cut(file: RegularFile, part: ExrPart, box: tuple[int, int, int, int]) -> bytes:
    """A file of one part with the chunks of a box: first row and column, last ones + 1."""
    top, left, bottom, right = box
    rows, columns = part.block
    across = -(-part.width // columns)
    chunks = []
    head = chunk_head(part)
    for y in range(top // rows, -(-bottom // rows)):
        for x in range(left // columns, -(-right // columns)):
            offset = int(part.chunks[y * across + x])
            (count,) = struct.unpack("<i", file.at(offset + head - 4, 4))
            chunk = file.at(offset, head + count)[4 * part.multipart :]
            if part.tile is not None:
                _check_place(file, chunk, (x, y, 0, 0))
                place = struct.pack("<4i", x - left // columns, y - top // rows, 0, 0)
                chunk = place + chunk[16:]
            else:
                _check_place(file, chunk, (part.window[1] + y * rows,))
            shape = min(rows, part.height - y * rows), min(columns, part.width - x * columns)
            _check_end(file, part, chunk, count, shape)
            chunks.append(chunk)
    x0, y0 = part.window[0] + left, part.window[1] + top
    window = struct.pack("<4i", x0, y0, x0 + right - left - 1, y0 + bottom - top - 1)
    attributes = {key: part.attributes[key] for key in _COPIED if key in part.attributes}
    attributes |= {"dataWindow": ("box2i", window), "displayWindow": ("box2i", window)}
    if part.tile is not None:
        size = struct.pack("<IIB", min(columns, right - left), min(rows, bottom - top), 0)
        attributes["tiles"] = ("tiledesc", size)
    # Bit 9: tiles; bit 10: names of up to 255 bytes.
    header = [struct.pack("<II", 20000630, 2 | 0x400 | 0x200 * (part.tile is not None))]
    for name, (kind, value) in attributes.items():
        header.append(f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value)
    start = b"".join([*header, b"\0"])
    sizes = [len(chunk) for chunk in chunks]
    offsets = len(start) + 8 * len(chunks) + np.cumsum([0, *sizes[:-1]])
    return b"".join([start, offsets.astype("<u8").tobytes(), *chunks])


def _check_end(
    file: RegularFile, part: ExrPart, chunk: bytes, count: int, shape: tuple[int, int]
) -> None:
    """A copy that was not finished has zeros at its end, which three compressions decode.

    They never write that many: a run of equal bytes is a number in RLE, a run of equal codes one in
    PIZ, and a block of zeros in B44 would be NaN, which it does not store.
    """
    compression = part.attributes["compression"][1][0]
    own = part.channels.values()
    raw = count >= shape[0] * shape[1] * part.pixel_bytes  # what does not shrink is not compressed
    apart = any(channel.sampling != (1, 1) for channel in own)
    apart |= compression in _BLOCKS and any(channel.kind != HALF for channel in own)
    if compression not in _NO_ZEROS or raw or apart or count < _ZEROS:
        return
    if not any(chunk[-_ZEROS:]):
        raise CorruptInputError(
            file.path, "is damaged: its pixels end in zeros that no writer leaves; copy it again"
        )


def _check_place(file: RegularFile, chunk: bytes, expected: tuple[int, ...]) -> None:
    """The table and the chunk agree where the chunk lies."""
    found = struct.unpack_from(f"<{len(expected)}i", chunk)
    if found != expected:
        raise CorruptInputError(
            file.path, f"is damaged: a chunk is of {found} where {expected} is listed"
        )

"""OpenEXR pictures: structure, decoding, layers."""

from __future__ import annotations

import io
import re
import struct
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images.header import ImageHeader, truncated
from impasto.io.images.native_stderr import captured_lines

_PIXEL_BYTES = {0: 4, 1: 2, 2: 4}
_ROWS_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256}
_LONGEST_HEADER = 1 << 24


@dataclass(frozen=True, slots=True)
class _Part:
    attributes: dict[str, tuple[str, bytes]]

    @property
    def window(self) -> tuple[int, int, int, int]:
        x0, y0, x1, y1 = struct.unpack("<4i", self.attributes["dataWindow"][1])
        return x0, y0, x1, y1

    @property
    def channels(self) -> dict[str, tuple[int, int, int]]:
        """Pixel type (0 uint, 1 half, 2 float) and x, y sampling by name."""
        data, at = self.attributes["channels"][1], 0
        found: dict[str, tuple[int, int, int]] = {}
        while data[at] != 0:
            end = data.index(0, at)
            kind, _, xs, ys = struct.unpack_from("<iiii", data, end + 1)
            found[data[at:end].decode("utf-8", "replace")] = (kind, xs, ys)
            at = end + 17
        return found

    @property
    def tiled(self) -> bool:
        return "tiles" in self.attributes

    def chunks(self) -> int:
        """The number of chunks of the part."""
        if "chunkCount" in self.attributes:
            count: int = struct.unpack("<i", self.attributes["chunkCount"][1])[0]
            return count
        x0, y0, x1, y1 = self.window
        width, height = x1 - x0 + 1, y1 - y0 + 1
        if not self.tiled:
            rows = _ROWS_PER_CHUNK.get(self.attributes["compression"][1][0], 1)
            return -(-height // rows)
        tile_x: int
        tile_y: int
        mode: int
        tile_x, tile_y, mode = struct.unpack("<IIB", self.attributes["tiles"][1])
        if mode & 0xF:
            return -1  # mip or rip levels: the library counts them
        return -(-width // max(tile_x, 1)) * -(-height // max(tile_y, 1))


def exr_header(path: Path, data: bytes) -> ImageHeader:
    """Sizes of the first part, and whether every chunk lies inside the file."""
    try:
        return _checked_header(path, data)
    except (KeyError, ValueError) as error:
        if isinstance(error, CorruptInputError):
            raise
        raise CorruptInputError(path, f"has a damaged OpenEXR header ({error})") from error


def _checked_header(path: Path, data: bytes) -> ImageHeader:
    parts, at, multipart = _parts(path, data)
    part = parts[0]
    x0, y0, x1, y1 = part.window
    channels = part.channels
    kinds = {kind for kind, _, _ in channels.values()}
    if not channels or not kinds <= set(_PIXEL_BYTES):
        raise CorruptInputError(path, "has a damaged OpenEXR channel list")
    header = ImageHeader(
        path,
        "exr",
        x1 - x0 + 1,
        y1 - y0 + 1,
        len(channels),
        np.dtype(np.float16 if kinds == {1} else np.float32),
    )
    if header.width > 0 and header.height > 0:
        _check_chunks(path, data, parts, at, multipart)
    return header


def _parts(path: Path, data: bytes) -> tuple[list[_Part], int, bool]:
    version = struct.unpack_from("<I", data, 4)[0]
    if version & 0x800:
        raise CorruptInputError(path, "is a deep OpenEXR file, which holds no photograph")
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
            parts.append(_Part(attributes))
        if not multipart or not attributes:
            break
        if data[at] == 0:
            at += 1
            break
    if not parts:
        raise CorruptInputError(path, "is an OpenEXR file without a picture")
    return parts, at, multipart


def _word(path: Path, data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at, at + 256)
    if end < 0:
        raise truncated(path, "its header")
    return data[at:end].decode("utf-8", "replace"), end + 1


def _check_chunks(path: Path, data: bytes, parts: list[_Part], at: int, multipart: bool) -> None:
    for part in parts:
        count = part.chunks()
        if count < 0:
            return
        if count > len(data) // 8 or at + 8 * count > len(data):
            raise truncated(path, "its table of chunks")
        offsets = np.frombuffer(data, "<u8", count, at)
        at += 8 * count
        head = (16 if part.tiled else 4) + (4 if multipart else 0)
        for offset in offsets.tolist():
            if offset == 0:
                raise CorruptInputError(
                    path, "misses part of the picture: its writer did not finish"
                )
            if offset + head + 4 > len(data):
                raise truncated(path, "the pixels")
            (size,) = struct.unpack_from("<i", data, offset + head)
            if size < 0 or offset + head + 4 + size > len(data):
                raise truncated(path, "the pixels")


def decode_exr(path: Path, data: bytes, layer: str | None = None) -> NDArray[Any]:
    """Bands ``(band, y, x)``, float16 if every chosen channel is half, else float32.

    ``layer`` picks the channels ``layer.*``; without it: R, G, B, else Y, else the only layer.
    """
    import OpenEXR

    promised = {name for part in _parts(path, data)[0] for name in part.channels}
    try:
        channels: dict[str, NDArray[Any]] = {}
        # The binding omits channels that it cannot decode, and warns on both streams.
        with (
            redirect_stdout(io.StringIO()),
            captured_lines(b"EXR_ERR"),
            OpenEXR.File(io.BytesIO(data), separate_channels=True) as file,
        ):
            for part in file.parts:
                for name, channel in part.channels.items():
                    channels.setdefault(name, np.array(channel.pixels))
    except Exception as error:  # the binding raises bare RuntimeError, ValueError and others
        raise CorruptInputError(path, f"cannot be read as OpenEXR ({error})") from error
    missing = promised - channels.keys()
    if missing:
        raise CorruptInputError(
            path,
            f"is damaged: its pixels (channels {', '.join(sorted(missing))}) cannot be decoded",
        )
    names = pick_channels(path, list(channels), layer)
    planes = [channels[name] for name in names]
    shapes = {plane.shape for plane in planes}
    if len(shapes) != 1:
        raise CorruptInputError(path, f"channels {', '.join(names)} differ in size")
    half = all(plane.dtype == np.float16 for plane in planes)
    dtype = np.float16 if half else np.float32
    return np.stack([plane.astype(dtype, copy=False) for plane in planes])


_ALPHA = frozenset({"A", "AR", "AG", "AB"})


def pick_channels(path: Path, names: list[str], layer: str | None) -> list[str]:
    """The channels of one layer in band order: R, G, B first, then by number in the name."""
    layers: dict[str, list[str]] = {}
    for name in names:
        prefix, _, last = name.rpartition(".")
        # "T.380,000000nm" of spectral files: the layer is T and the rest a wavelength.
        if last not in _ALPHA:
            layers.setdefault(prefix, []).append(name)
    if not layers:
        raise CorruptInputError(path, "holds no channel but alpha")
    if layer is None:
        plain = set(layers.get("", ()))
        if {"R", "G", "B"} <= plain:
            return ["R", "G", "B"]
        if "Y" in plain:
            return ["Y"]
        if len(layers) > 1:
            raise ArgumentError(
                f"{path}: holds the layers {sorted(name or '(unnamed)' for name in layers)}; "
                "choose one with layer="
            )
        layer = next(iter(layers))
    if layer not in layers:
        raise ArgumentError(f"{path}: has no layer {layer!r}, only {sorted(layers)}")
    return sorted(layers[layer], key=_band_order)


def _band_order(name: str) -> tuple[Any, ...]:
    last = name.rpartition(".")[2]
    fixed = {"R": 0, "G": 1, "B": 2, "X": 0, "Y": 1, "Z": 2}.get(last.upper())
    if fixed is not None:
        return (0, fixed, name)
    digits = re.sub(r"(\d),(\d)", r"\1.\2", name)
    return (1, *[float(n) for n in re.findall(r"\d+(?:\.\d+)?", digits)], name)

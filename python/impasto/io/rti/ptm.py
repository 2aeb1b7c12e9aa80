"""Polynomial texture maps in ``.ptm`` [@malzbender2001polynomial], version 1.2 of the format.

ASCII lines: ``PTM_1.2``, the format, width, height, six scales, six biases (integers); then the
planes, the lowest row first. A coefficient of a polynomial whose value is 0 to 255 is
``(code - bias) * scale``, for u^2, v^2, u v, u, v, 1.
"""

from __future__ import annotations

import io
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of
from impasto._internal.damage import damage_of
from impasto._internal.regular import RegularFile
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.files import atomic_bytes
from impasto.io.images import MAX_PIXELS
from impasto.io.rti.bases import Basis
from impasto.io.rti.image import RelightableImage
from impasto.io.rti.ptm_jpeg import read_jpeg_planes

Body = Literal["rgb", "lrgb"]
ORDER = (5, 3, 4, 0, 2, 1)
"""Where 1, u, v, u^2, u v, v^2 stand in the file."""
LARGEST = 1e12
"""Of scales and biases: pictures have values about 1, and those of files stay below 1e4."""
_LONGEST = 4096
"""Bytes of one line of the header."""
_KNOWN = {
    "PTM_FORMAT_RGB": "rgb",
    "PTM_FORMAT_LRGB": "lrgb",
    "PTM_FORMAT_JPEG_RGB": "rgb",
    "PTM_FORMAT_JPEG_LRGB": "lrgb",
}


class Header:
    """Words and lines of the text in front of the planes."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.file = io.BytesIO(data)
        self._words: list[str] = []

    def line(self) -> str:
        """The next line that holds anything."""
        while True:
            raw = self.file.readline(_LONGEST)
            if not raw.endswith(b"\n"):
                raise CorruptInputError(self.path, "is truncated: the file ends inside the header")
            text = raw.decode("latin-1").strip()
            if text:
                return text

    def word(self) -> str:
        """The next word, on whatever line it stands."""
        while not self._words:
            self._words = self.line().split()
        return self._words.pop(0)

    def numbers(self, count: int, kind: type[float] | type[int]) -> list[float]:
        """So many numbers, on as many lines as they take."""
        return [kind(self.word()) for _ in range(count)]

    def rest(self) -> bytes:
        """The bytes behind the header."""
        return self.file.read()


def read_ptm(path: str | Path) -> RelightableImage:
    """Read a ``.ptm``.

    Raw and JPEG planes, of red, green and blue or of luminance and colour, are read.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or no polynomial texture map.
    ArgumentError
        Not found, a kind that is not read, or larger than pictures may be.
    """
    path = Path(path)
    with closing(RegularFile(path)) as file:
        data = file.content()
    with damage_of(path, "a polynomial texture map"):
        return _parsed(path, data)


def _parsed(path: Path, data: bytes) -> RelightableImage:
    header = Header(path, data)
    version = header.line()
    if not version.startswith("PTM_"):
        raise CorruptInputError(path, "is no polynomial texture map: it does not begin with PTM_")
    kind = header.line()
    if kind not in _KNOWN:
        raise ArgumentError(
            f"{path}: holds {kind[:40]}, which is not read; known are {', '.join(_KNOWN)}"
        )
    width, height = (int(one) for one in header.numbers(2, int))
    check_pixels(path, width, height)
    scale = np.array(header.numbers(6, float))
    bias = np.array(header.numbers(6, int), dtype=np.float64)
    check_scales(path, scale, bias)
    luminance = _KNOWN[kind] == "lrgb"
    if "JPEG" in kind:
        planes = read_jpeg_planes(header, width, height, 9 if luminance else 18)
        channels = 1 if luminance else 3
        coded = planes[: 6 * channels].reshape(channels, 6, height, width)
        colour = planes[6:] if luminance else None
    else:
        early = luminance and float(version.removeprefix("PTM_")) < 1.2
        coded, colour = _raw(path, header.rest(), width, height, luminance, early)
    # Per channel in the file, per function in memory.
    ordered = np.moveaxis(coded[:, list(ORDER)], 0, 1)
    channels = ordered.shape[1]
    stored = ordered.reshape(6 * channels, height, width)[:, ::-1]
    factor = np.repeat(scale[list(ORDER)], channels) / 255.0
    notes: tuple[str, ...] = ()
    if not scale.any():
        notes = ("all six scales are 0: the program that wrote the file left them out, and every "
                 "picture of it is black",)  # fmt: skip
    return RelightableImage(
        planes=np.ascontiguousarray(stored),
        scale=factor,
        bias=-factor * np.repeat(bias[list(ORDER)], channels),
        basis=Basis("ptm", 6),
        colourspace="lrgb" if luminance else "rgb",
        format=f"{version} {kind}",
        colour=None if colour is None else np.ascontiguousarray(colour[:, ::-1]),
        notes=notes,
    )


def check_scales(path: Path, *numbers: NDArray[np.floating[Any]]) -> None:
    """Refuse scales that are none: pictures are computed from them in single precision."""
    if not all(np.isfinite(one).all() and (np.abs(one) <= LARGEST).all() for one in numbers):
        what = "has a scale, a bias or a component that is no number, or one"
        raise CorruptInputError(path, f"{what} beyond {LARGEST:g}")


def check_pixels(path: Path, width: int, height: int) -> None:
    """Refuse sizes that no picture has, before anything is allocated."""
    if width < 1 or height < 1:
        raise CorruptInputError(path, f"claims a size of {width} x {height} pixels")
    if width * height > MAX_PIXELS:
        claimed = " x ".join(f"{one}"[:12] for one in (width, height))  # a header has any digits
        raise ArgumentError(f"{path}: {claimed} pixels are more than {MAX_PIXELS}")


def _raw(
    path: Path, body: bytes, width: int, height: int, luminance: bool, early: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """``(channel, 6, y, x)`` codes in the order of the file, and the colour."""
    pixels = width * height
    expected = pixels * (9 if luminance else 18)
    if len(body) < expected:
        raise CorruptInputError(
            path,
            f"is truncated: {width} x {height} pixels take {expected} bytes, {len(body)} are there",
        )
    codes = np.frombuffer(body, np.uint8, expected)
    if not luminance:
        blocks = codes.reshape(3, height, width, 6)
        return np.moveaxis(blocks, -1, 1), None
    if early:
        together = codes.reshape(height, width, 9)
        return np.moveaxis(together[..., :6], -1, 0)[None], np.moveaxis(together[..., 6:], -1, 0)
    polynomial = codes[: 6 * pixels].reshape(height, width, 6)
    colour = codes[6 * pixels :].reshape(height, width, 3)
    return np.moveaxis(polynomial, -1, 0)[None], np.moveaxis(colour, -1, 0)


def write_ptm(path: str | Path, image: RelightableImage) -> None:
    """Write a ``.ptm`` with raw planes, which every viewer reads.

    Parameters
    ----------
    path
        The file to write (replaced atomically).
    image
        A polynomial, ``rgb`` or ``lrgb``. The file has one scale and one whole bias per function:
        those of its channels must agree, as :func:`quantised` makes them with ``shared=True`` and
        ``whole=True``.

    Raises
    ------
    ArgumentError
        Other functions, or scales that the file cannot hold.
    """
    one_of(image.basis.kind, ("ptm",), "image.basis.kind")
    one_of(image.colourspace, ("rgb", "lrgb"), "image.colourspace")
    channels = 1 if image.colour is not None else 3
    scale, bias = shared_terms(image, channels)
    # (code - whole) * scale: the whole bias that the file holds must be the one that is meant.
    whole = np.where(scale == 0.0, 0.0, -bias / np.where(scale == 0.0, 1.0, scale))
    if np.abs(whole - np.rint(whole)).max() > 1e-6 or not ((whole > -0.5) & (whole < 255.5)).all():
        raise ArgumentError("image.bias: .ptm holds whole biases from 0 to 255; quantise it so")
    rows, columns = image.shape
    place = np.argsort(ORDER)
    coded = image.planes.reshape(6, channels, rows, columns)[place[np.arange(6)]]
    body = np.moveaxis(coded[..., ::-1, :], (1, 0), (0, -1))
    text = (
        f"PTM_1.2\nPTM_FORMAT_{'LRGB' if channels == 1 else 'RGB'}\n{columns}\n{rows}\n"
        f"{' '.join(f'{255.0 * one:.9g}' for one in scale[place])}\n"
        f"{' '.join(str(round(one)) for one in whole[place])}\n"
    )
    parts = [text.encode("ascii"), np.ascontiguousarray(body).tobytes()]
    if image.colour is not None:
        parts.append(np.ascontiguousarray(np.moveaxis(image.colour[:, ::-1], 0, -1)).tobytes())
    atomic_bytes(path, b"".join(parts))


def shared_terms(
    image: RelightableImage, channels: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scale and bias per function, where all channels have the same.

    Raises
    ------
    ArgumentError
        They differ.
    """
    scale, bias = (one.reshape(-1, channels) for one in (image.scale, image.bias))
    if (scale != scale[:, :1]).any() or (bias != bias[:, :1]).any():
        raise ArgumentError(
            "image.scale: .ptm and .rti hold one scale and one bias per function, the channels' "
            "differ; quantise them together"
        )
    return scale[:, 0], bias[:, 0]

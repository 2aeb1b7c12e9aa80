"""The tone curve that a file states: an ICC profile (ICC.1:2022), or the chunks of PNG for it."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding

OTHER = "other"
"""The curve of a profile that no :class:`~impasto.Encoding` describes."""

_CLOSE = 0.002
"""Half a code of 8 bits: a curve this close, in linear light, is the same one."""
_LARGEST = 1 << 22
"""Bytes of a profile that is decompressed; those of cameras and editors have at most 1 MB."""
_CODES = np.linspace(0.0, 1.0, 256)
_PARAMETERS = (1, 3, 4, 5, 7)
"""How many numbers each type of parametric curve has."""


def profile_curve(profile: bytes) -> str:
    """The tone curve of an ICC profile.

    Parameters
    ----------
    profile
        The whole profile.

    Returns
    -------
    str
        ``"linear"``, ``"srgb"``, a gamma such as ``"2.2"``, or :data:`OTHER` for every other curve
        and for profiles that are damaged or have no curve per channel.
    """
    try:
        curves = _curves(profile)
    except (struct.error, ValueError, IndexError):
        return OTHER
    names = {_name(curve) for curve in curves}
    return names.pop() if len(names) == 1 else OTHER


def jpeg_curve(parts: dict[int, bytes]) -> str:
    """The tone curve of a JPEG from the numbered parts of its profile; empty if there is none."""
    return profile_curve(b"".join(parts[number] for number in sorted(parts))) if parts else ""


def png_curve(chunks: dict[bytes, bytes]) -> str:
    """The tone curve of a PNG from its chunks iCCP, sRGB and gAMA; empty if it has none of them."""
    if b"iCCP" in chunks:
        return profile_curve(_inflated(chunks[b"iCCP"]))
    if b"sRGB" in chunks:
        return "srgb"
    if len(chunks.get(b"gAMA", b"")) != 4:
        return ""
    gamma = struct.unpack(">I", chunks[b"gAMA"])[0] / 100_000
    # Writers of sRGB pictures are told to write 1 / 2.2 for readers that know only gAMA.
    return "srgb" if gamma == 0.45455 else _name(_CODES ** (1.0 / gamma)) if gamma > 0 else OTHER


def _inflated(chunk: bytes) -> bytes:
    """The profile of an iCCP chunk: a name, a zero, the method 0, deflated bytes."""
    _, _, rest = chunk.partition(b"\0")
    try:
        return zlib.decompressobj().decompress(rest[1:], _LARGEST)
    except zlib.error:
        return b""


def _curves(profile: bytes) -> list[NDArray[np.float64]]:
    """Linear light of 256 codes for each channel that has a curve."""
    (count,) = struct.unpack_from(">I", profile, 128)
    tags = {}
    for index in range(min(count, 1000)):
        name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * index)
        tags[name] = profile[offset : offset + size]
    names = (b"kTRC",) if profile[16:20] == b"GRAY" else (b"rTRC", b"gTRC", b"bTRC")
    if not all(name in tags for name in names):
        return []
    return [_sampled(tags[name]) for name in names]


def _sampled(tag: bytes) -> NDArray[np.float64]:
    kind = tag[:4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        values = np.array(struct.unpack_from(f">{count}H", tag, 12), dtype=np.float64)
        if count == 0:
            return _CODES
        if count == 1:
            return np.asarray(_CODES ** (values[0] / 256.0))
        return np.interp(_CODES, np.linspace(0.0, 1.0, count), values / 65535.0)
    if kind != b"para":
        raise ValueError("no curve")
    (function,) = struct.unpack_from(">H", tag, 8)
    numbers = struct.unpack_from(f">{_PARAMETERS[function]}i", tag, 12)
    g, a, b, c, d, e, f = _completed([number / 65536.0 for number in numbers])
    bright = np.maximum(a * _CODES + b, 0.0) ** g + e
    return np.where(d <= _CODES, bright, c * _CODES + f)


def _completed(numbers: list[float]) -> tuple[float, ...]:
    """g, a, b, c, d, e, f of any type: ``(a x + b)^g + e`` from d on, ``c x + f`` below."""
    count = len(numbers)
    if count == 1:
        return (numbers[0], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if count < 5:
        g, a, b = numbers[:3]
        constant = numbers[3] if count == 4 else 0.0
        return (g, a, b, 0.0, -b / a if a else 0.0, constant, constant)
    return (*numbers, 0.0, 0.0) if count == 5 else tuple(numbers)


def _name(light: NDArray[np.float64]) -> str:
    """The encoding whose curve this is."""
    middle = float(light[128])
    gamma = np.log(middle) / np.log(_CODES[128]) if 0.0 < middle < 1.0 else 0.0
    names = ["linear", "srgb"]
    names += [f"{rounded:g}" for rounded in (round(gamma, 1), round(gamma, 3))]
    possible = [name for name in names if name in {"linear", "srgb"} or 0.2 <= float(name) <= 5.0]
    for name in possible:
        if np.abs(Encoding(name).decode(_CODES) - light).max() < _CLOSE:
            return name
    return OTHER

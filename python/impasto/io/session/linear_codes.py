"""One photograph as linear codes of 16 bits or floats, for what mixes neighbouring pixels.

Resampling needs linear light: a mean of sRGB codes is not the code of the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import positive, reachable
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import MAX_PIXELS, ImageHeader, load_image
from impasto.io.images.profile import OTHER
from impasto.io.tone_curve import named_curve


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph.

    Attributes
    ----------
    planes
        ``(band, y, x)``: linear codes, uint16 (of full scale 65535) or float32.
    full
        The code from which samples are clipped; None for floats.
    """

    planes: NDArray[Any]
    full: float | None


def read_photograph(
    path: Path,
    encoding: str | None = None,
    saturation: float | None = None,
    *,
    layer: str | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Photograph:
    """Read one photograph as linear codes.

    Without ``encoding``, 8 bits have the curve of their profile, else sRGB; all others are linear.
    8-bit codes become 16 bits by a table, so that neighbours are mixed in linear light. Codes from
    ``saturation`` on (default: the largest) are clipped.
    """
    header, codes = load_image(path, layer=layer, max_pixels=max_pixels)
    table, full = linear_table(header, encoding, saturation)
    if codes.dtype.kind == "f":
        return Photograph(codes.astype(np.float32), full)
    return Photograph(codes if table is None else table[codes], full)


def linear_table(
    header: ImageHeader, encoding: str | None, saturation: float | None
) -> tuple[NDArray[np.uint16] | None, float | None]:
    """What makes linear codes of a file's; None where they are, and the code of clipped ones."""
    if saturation is not None:
        saturation = clipping_code(saturation, header)
    if header.dtype.kind == "f":
        if encoding not in {None, "linear"}:
            raise ArgumentError(f"encoding: {header.path.name} holds floats, which are linear")
        return None, saturation
    top = full_scale(header)
    curve = stored_curve(header, encoding)
    clipped = float(top) if saturation is None else saturation
    if header.dtype == np.uint16 and Encoding(curve, float(top)).curve == "linear":
        return None, clipped
    linear = Encoding(curve, float(top)).decode(np.arange(top + 1))
    table = np.rint(65535.0 * np.clip(linear, 0.0, 1.0)).astype(np.uint16)
    return table, float(table[int(np.clip(clipped, 0, top))])


def clipping_code(saturation: float, header: ImageHeader) -> float:
    """The code from which samples are clipped, if it is one of the file."""
    code = positive(saturation, "saturation", "the code from which samples are clipped")
    if header.dtype.kind == "u":
        reachable(np.array([code]), full_scale(header))
    return code


def full_scale(header: ImageHeader) -> int:
    """The largest code of a file's integers."""
    dtype: np.dtype[Any] = header.dtype
    return int(np.iinfo(dtype).max)


def stored_curve(header: ImageHeader, encoding: str | None) -> str:
    """The tone curve of a file: the one given, else of 8 bits that of the profile or sRGB."""
    if encoding is not None:
        return named_curve(encoding)
    if header.dtype != np.uint8:
        return "linear"
    return header.curve if header.curve not in {"", OTHER} else "srgb"

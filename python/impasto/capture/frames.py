"""Photographs of a capture as the checks see them: linear light, clipped pixels, EXIF, hash."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.io.images import read_header, read_image
from impasto.io.images.exif import Exif, read_exif
from impasto.io.session_toml import sha256_of

Image = NDArray[np.float32]

CELLS = 32
"""Cells of a thumbnail along the shorter side."""
CLIPPED = 0.99
"""Share of full scale from which a code counts as clipped: lossy files do not reach it exactly."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A photograph that was read whole.

    Attributes
    ----------
    light
        ``(y, x)``: mean of the bands, linear, full scale 1; 8-bit files without a profile as sRGB.
    clipped
        Share of the pixels of which a band is clipped.
    kind
        Format, width, height, channels and type, which all photographs of a capture share.
    sha256
        Of the file.
    exif
        What the camera has written into it.
    """

    light: Image
    clipped: float
    kind: tuple[str, int, int, int, str]
    sha256: str
    exif: Exif

    @property
    def level(self) -> float:
        """Mean light."""
        return float(self.light.mean(dtype=np.float64))

    def thumbnail(self) -> NDArray[np.float64]:
        """``(cells,)``: means of square blocks, 32 or more along the shorter side."""
        rows, columns = self.light.shape
        block = max(1, min(rows, columns) // CELLS)
        inner = self.light[: rows // block * block, : columns // block * block]
        cells = inner.reshape(rows // block, block, columns // block, block)
        return np.asarray(cells.mean(axis=(1, 3), dtype=np.float64)).ravel()


def read_picture(path: Path) -> Picture:
    """Read a photograph to its end.

    Raises
    ------
    CorruptInputError
        Truncated, damaged or no picture at all.
    MissingExtraError
        RAW, and rawpy is not installed.
    """
    header = read_header(path)
    samples = read_image(path)
    whole = samples.dtype.kind == "u"
    full = float(np.iinfo(samples.dtype).max) if whole else 1.0
    curve = header.curve
    if curve in {"", "other"}:
        curve = "srgb" if samples.dtype == np.uint8 else "linear"
    clipped = (samples >= CLIPPED * full).any(axis=0).mean()
    encoding = Encoding(curve, full)
    # A table takes a fiftieth of the time of a tone curve at every sample.
    linear = encoding.decode(np.arange(full + 1.0))[samples] if whole else encoding.decode(samples)
    light = linear.mean(axis=0)
    return Picture(
        np.asarray(light, np.float32),
        float(clipped),
        (header.format, header.width, header.height, header.channels, str(header.dtype)),
        sha256_of(path),
        read_exif(path),
    )

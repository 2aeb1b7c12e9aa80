"""Small RAW files: DNG, written by tifffile from the tags of Adobe's specification."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

BLACK, WHITE = 512, 16000
RGGB = ((0, 1), (1, 2))
"""The colour of each pixel of a block of two rows and columns: red, green, blue."""


def mosaic_of(light: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Codes of a sensor with a Bayer mosaic for linear light ``(3, y, x)``, 1 for white."""
    codes = np.rint(BLACK + light * (WHITE - BLACK)).astype(np.uint16)
    mosaic = np.empty(light.shape[1:], np.uint16)
    for row, colours in enumerate(RGGB):
        for column, colour in enumerate(colours):
            mosaic[row::2, column::2] = codes[colour, row::2, column::2]
    return mosaic


def write_dng(
    path: Path,
    mosaic: NDArray[np.uint16],
    *,
    orientation: int = 1,
    white: int = WHITE,
    more: Sequence[tuple[Any, ...]] = (),
) -> None:
    """A mosaic as a DNG of version 1.4, with more tags as tifffile takes them."""
    ones = tuple(number for row in np.eye(3) for one in row for number in (int(one), 1))
    tags: list[tuple[Any, ...]] = [
        (50706, "B", 4, (1, 4, 0, 0), True),  # DNGVersion
        (50708, "s", 0, "simulated", True),  # UniqueCameraModel
        (33421, "H", 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, "B", 4, sum(RGGB, ()), True),  # CFAPattern
        (50714, "H", 1, (BLACK,), True),  # BlackLevel
        (50717, "I", 1, (white,), True),  # WhiteLevel
        (50721, "2i", 9, ones, True),  # ColorMatrix1
        (50778, "H", 1, (21,), True),  # CalibrationIlluminant1: D65
        (50728, "2I", 3, (1, 2, 1, 1, 7, 10), True),  # AsShotNeutral: a white that is none
        (274, "H", 1, (orientation,), True),
        *more,
    ]
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags, metadata=None)

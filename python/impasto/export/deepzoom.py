"""Deep Zoom pyramids [@deepzoom]: one picture as tiles at all scales, written tile by tile.

``name.dzi`` says how large the picture is; ``name_files/LEVEL/COLUMN_ROW.png`` are its tiles. Level
0 is one pixel, and each further level twice as large, sizes rounded up.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.export.stored import tile_window
from impasto.io.files import atomic_bytes
from impasto.io.images.write import write_png8

TILE = 256
"""Rows and columns of a tile: a power of two, from which viewers count levels."""
NAMESPACE = "http://schemas.microsoft.com/deepzoom/2008"
Codes = NDArray[np.uint8]
Tiles = Callable[[int, Window], Mapping[str, Codes]]
"""Makes a window of a scale (pixels of the painting, along a side, for one): codes by name."""


def levels_of(shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Level and factor of all scales, from the largest to the one that a single tile holds."""
    top = math.ceil(math.log2(max(shape)))
    lowest = min(int(math.log2(TILE)), top)
    return [(level, 1 << (top - level)) for level in range(top, lowest - 1, -1)]


def scaled_shape(shape: tuple[int, int], factor: int) -> tuple[int, int]:
    """``(y, x)`` of a scale."""
    return -(-shape[0] // factor), -(-shape[1] // factor)


def tile_path(folder: Path, name: str, level: int, row: int, column: int) -> Path:
    """Where a tile lies."""
    return folder / f"{name}_files" / str(level) / f"{column}_{row}.png"


def write_pyramids(
    folder: Path,
    names: tuple[str, ...],
    shape: tuple[int, int],
    tiles: Tiles,
    done: Callable[[int, int], Any] | None = None,
) -> None:
    """Write a pyramid for each name.

    Parameters
    ----------
    folder
        It exists.
    names
        Of what ``tiles`` makes.
    shape
        ``(y, x)`` of the picture.
    tiles
        Makes the codes ``(plane, y, x)`` of a window.
    done
        Called with the tiles that are written and all of them.
    """
    scales = levels_of(shape)
    sizes = [scaled_shape(shape, factor) for _, factor in scales]
    total = sum(-(-rows // TILE) * -(-columns // TILE) for rows, columns in sizes)
    count = 0
    for (level, factor), (rows, columns) in zip(scales, sizes, strict=True):
        for name in names:
            tile_path(folder, name, level, 0, 0).parent.mkdir(parents=True, exist_ok=True)
        for row in range(-(-rows // TILE)):
            for column in range(-(-columns // TILE)):
                made = tiles(factor, tile_window((rows, columns), TILE, row, column))
                for name in names:
                    write_png8(tile_path(folder, name, level, row, column), made[name])
                count += 1
                if done is not None:
                    done(count, total)
    for name in names:
        atomic_bytes(folder / f"{name}.dzi", _description(shape))


def _description(shape: tuple[int, int]) -> bytes:
    image = ET.Element("Image", xmlns=NAMESPACE, Format="png", Overlap="0", TileSize=str(TILE))
    ET.SubElement(image, "Size", Width=str(shape[1]), Height=str(shape[0]))
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(image) + b"\n"

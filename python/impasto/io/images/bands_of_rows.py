"""Pictures of any size into tiled TIFF, while they are made."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.io.files import atomic_path

TIFF_TILE = 256
"""Rows and columns of a tile of the file; pictures come in so many rows."""
CLASSIC = 2**32 - 2**25
"""Bytes from which on a file is a BigTIFF: places in a TIFF have 32 bits."""


def write_tiff_rows(
    path: str | Path,
    rows: Iterable[NDArray[Any]],
    shape: tuple[int, int],
    *,
    planes: int,
    dtype: type[np.generic],
    icc: bytes | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> None:
    """Write a tiled TIFF (deflate) from bands of 256 rows, none of which is kept.

    The file appears whole or not at all. It is a BigTIFF where it may exceed 4 GiB.

    Parameters
    ----------
    path
        The file to write; its name ends in ``.tif`` or ``.tiff``.
    rows
        ``(planes, 256, x)``, the last one as many rows as are left.
    shape
        ``(y, x)`` of the picture.
    planes
        1 for grey, 3 for RGB.
    dtype
        uint16 or float32.
    icc
        The profile of the display whose codes these are.
    attributes
        They become JSON in the image description, as in :func:`impasto.io.write_tiff16`.

    Raises
    ------
    ArgumentError
        Another suffix.
    """
    import tifffile

    check_suffix(path)
    height, width = shape
    pixels = (height, width, planes) if planes > 1 else (height, width)
    text = json.dumps(dict(attributes), sort_keys=True) if attributes else None
    size = height * width * planes * np.dtype(dtype).itemsize
    with (
        atomic_path(path) as temporary,
        tifffile.TiffWriter(temporary, bigtiff=size > CLASSIC) as file,
    ):
        file.write(
            _tiles(rows, planes),
            shape=pixels,
            dtype=np.dtype(dtype),
            tile=(TIFF_TILE, TIFF_TILE),
            photometric="rgb" if planes > 1 else "minisblack",
            planarconfig="contig" if planes > 1 else None,
            compression="zlib",
            description=text,
            metadata=None,
            software=False,
            iccprofile=icc,
            maxworkers=1,
        )


def check_suffix(path: str | Path) -> None:
    """Refuse the name of another format, before hours of work.

    Raises
    ------
    ArgumentError
        It does not end in ``.tif`` or ``.tiff``.
    """
    if Path(path).suffix.lower() not in {".tif", ".tiff"}:
        raise ArgumentError(f"path: expected a name ending in .tif, found {path}")


def _tiles(rows: Iterable[NDArray[Any]], planes: int) -> Iterator[NDArray[Any]]:
    """Whole tiles from left to right; beyond the border they hold 0."""
    for band in rows:
        for left in range(0, band.shape[2], TIFF_TILE):
            part = band[:, :, left : left + TIFF_TILE]
            tile = np.zeros((TIFF_TILE, TIFF_TILE, planes), band.dtype)
            tile[: part.shape[1], : part.shape[2]] = np.moveaxis(part, 0, -1)
            yield tile if planes > 1 else tile[..., 0]

"""Segments of a painting from a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.io.images import read_image

MOST_PARTS = 256
"""A picture with more colours is blurred or compressed."""


def read_labels(path: str | Path) -> NDArray[np.int64]:
    """Read the segments of a painting from a picture in which each has its own grey or colour.

    Parameters
    ----------
    path
        PNG or TIFF of 8 or 16 bits. JPEG blurs the borders: its colours are too many.

    Returns
    -------
    ndarray
        ``(y, x)`` for ``fit_sbrdf(segments=)``: the grey code, or red, green and blue as the digits
        of one number (in base 256 where codes have 8 bits); -1, of no part, where the picture is
        black.

    Raises
    ------
    ArgumentError
        Not found, all black, more than 256 colours, or no whole numbers.
    CorruptInputError
        Truncated, damaged or no picture at all.
    """
    planes = read_image(path)
    if planes.dtype.kind != "u":
        raise ArgumentError(f"{path}: holds {planes.dtype}; segments need whole codes, as in a PNG")
    base = np.iinfo(planes.dtype).max + 1
    labels = np.zeros(planes.shape[1:], dtype=np.int64)
    for plane in planes:
        labels = labels * base + plane
    count = np.count_nonzero(np.unique(labels))
    if count == 0:
        raise ArgumentError(f"{path}: is entirely black, and black belongs to no segment")
    if count > MOST_PARTS:
        raise ArgumentError(
            f"{path}: has {count} colours, for at most {MOST_PARTS} segments; save it as a PNG "
            "with hard edges"
        )
    return np.where(labels == 0, np.int64(-1), labels)

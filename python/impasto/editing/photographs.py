"""Photographs as pictures of a page: whole and reduced, and parts of them pixel for pixel."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate import linear_photograph
from impasto.calibrate.tones import grey_from, light_from
from impasto.errors import ArgumentError
from impasto.io.images import open_picture

SIDE = 2048
"""Pixels of the longer side from which a whole photograph is reduced."""
TILE = 512
"""Rows and columns of a tile."""
KEPT = 2
"""Decoded photographs in memory: going to the next one and back decodes nothing."""


class Photographs:
    """Grey pictures of photographs, with the tone that detectors and their reports see.

    Parameters
    ----------
    paths
        The files.
    encoding
        Their tone curve; None: 8-bit files are sRGB, others linear.
    """

    def __init__(self, paths: Sequence[Path], encoding: str | None = None) -> None:
        self.paths = list(paths)
        self.encoding = encoding
        self._kept: OrderedDict[int, NDArray[np.uint8]] = OrderedDict()

    def described(self) -> list[dict[str, Any]]:
        """Name, columns and rows of each, for the page."""
        described = []
        for path in self.paths:
            with open_picture(path) as picture:
                _, rows, columns = picture.shape
            described.append({"name": path.name, "columns": columns, "rows": rows})
        return described

    def light(self, number: int) -> NDArray[np.float32]:
        """``(y, x)`` linear light of a photograph, white about 1."""
        return light_from(linear_photograph(self.paths[number], self.encoding))

    def grey(self, number: int) -> NDArray[np.uint8]:
        """``(y, x)`` of a photograph."""
        if not 0 <= number < len(self.paths):
            raise IndexError(number)
        if number not in self._kept:
            self._kept[number] = grey_from(self.light(number))
        self._kept.move_to_end(number)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return self._kept[number]

    def picture(self, number: int) -> bytes:
        """A whole photograph as PNG, reduced to 2048 pixels where it is larger."""
        import cv2

        grey = self.grey(number)
        scale = SIDE / max(grey.shape)
        if scale < 1.0:
            size = [max(1, round(side * scale)) for side in grey.shape[::-1]]
            grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
        return _png(grey)

    def tile(self, number: int, column: int, row: int) -> bytes:
        """The tile in a column and row of tiles as PNG."""
        grey = self.grey(number)
        part = grey[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
        if part.size == 0:
            raise IndexError(column)
        return _png(part)


def _png(grey: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".png", grey)
    if not done:
        raise ArgumentError(f"a picture of {grey.shape[1]} x {grey.shape[0]} pixels is no PNG")
    return data.tobytes()

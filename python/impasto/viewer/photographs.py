"""Photographs beside the page's pictures: what the split slider shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import picked
from impasto._internal.png import png
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.stack import Stack

USUAL = 4
"""Photographs that are shown unless a caller chooses."""
LARGEST = 1600
"""Columns or rows of a photograph on the page."""


class Photographs:
    """Some photographs of a stack as pictures of the display, each with its light.

    Parameters
    ----------
    stack
        None: there are no photographs.
    shown
        Numbers of photographs; None: :data:`USUAL`, evenly among all.
    bands
        Of the result that the page shows; None: it is shown by spectra.
    sampled
        Whether the page shows samples of them otherwise.

    Raises
    ------
    ArgumentError
        Photographs in bands that are no colours of a display, where they are not sampled either.
    """

    def __init__(
        self, stack: Stack | None, shown: Any, bands: int | None, *, sampled: bool
    ) -> None:
        self._numbers: list[int] = []
        self._stack = stack
        if stack is None:
            return
        count, own = stack.shape[:2]
        if bands is None or own not in {1, 3} or own != bands:
            if sampled and shown is None:
                return
            raise ArgumentError(
                f"stack: photographs in {own} bands are compared with a result in the same one or "
                "three bands, shown without spectra"
            )
        evenly = np.unique(np.linspace(0, count - 1, min(count, USUAL)).round().astype(int))
        self._numbers = picked(evenly if shown is None else shown, count, "shown", "photograph")

    def __len__(self) -> int:
        return len(self._numbers)

    @property
    def records(self) -> list[dict[str, Any]]:
        """For the page: number, light and intensity of each."""
        return [self._record(number) for number in self._numbers]

    def _record(self, number: int) -> dict[str, Any]:
        assert self._stack is not None
        light = self._stack.rig.lights[number]
        place = getattr(light, "position", None)
        return {
            "number": int(number),
            "direction": [float(value) for value in light.direction],
            "position": None if place is None else [float(value) for value in place],
            "falloff": bool(getattr(light, "falloff", False)),
            "intensity": float(light.intensity),
        }

    def png(self, index: int) -> bytes:
        """A photograph as the display shows it, 8-bit sRGB.

        Raises
        ------
        IndexError
            There is none of that number.
        """
        if self._stack is None:
            raise IndexError(f"no photograph {index}")
        linear = self._stack.linear(self._numbers[index])
        codes = Encoding("srgb", 255.0).encode(np.nan_to_num(linear, nan=0.0))
        picture: NDArray[np.uint8] = np.rint(np.moveaxis(codes, 0, -1)).astype(np.uint8)
        if picture.shape[-1] == 1:
            picture = np.repeat(picture, 3, axis=-1)
        return png(_small(picture))


def _small(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    share = LARGEST / max(picture.shape[:2])
    if share >= 1.0:
        return picture
    rows, columns = (max(1, round(share * size)) for size in picture.shape[:2])
    found = cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(found, dtype=np.uint8)

"""Small pictures of a comparison, gathered tile by tile as means over blocks of pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.io.results import SavedMaps

Floats = NDArray[np.float64]

LARGEST = 1200
"""Rows or columns of an overview at most."""
PLANES = {
    "before": 3, "after": 3, "angle": 1, "delta_e": 1, "log_beta_ratio": 1,
    "changed": 3, "compared": 1,
}  # fmt: skip
"""Planes of an overview, and how many each has."""


@dataclass(frozen=True, eq=False)
class Overview:
    """Both paintings and the maps, reduced; NaN where no pixel of a block is known.

    Attributes
    ----------
    before, after
        ``(3, y, x)`` linear sRGB of the diffuse colours.
    angle
        ``(1, y, x)`` radians.
    delta_e
        ``(1, y, x)`` CIEDE2000.
    log_beta_ratio
        ``(1, y, x)`` mean natural logarithm of the ratio of beta, each within 0.1 to 10.
    changed
        ``(3, y, x)`` shares of compared pixels with a significant change of normal, colour, gloss.
    compared
        ``(1, y, x)`` share of compared pixels.
    step
        Pixels of the painting, along a side, for one.
    """

    before: NDArray[np.float32]
    after: NDArray[np.float32]
    angle: NDArray[np.float32]
    delta_e: NDArray[np.float32]
    log_beta_ratio: NDArray[np.float32]
    changed: NDArray[np.float32]
    compared: NDArray[np.float32]
    step: int

    def arrays(self) -> dict[str, NDArray[Any]]:
        """For a file, under names that begin with ``overview.``."""
        return {f"overview.{one.name}": np.asarray(getattr(self, one.name)) for one in fields(self)}

    @classmethod
    def of(cls, maps: SavedMaps) -> Overview:
        """The overview of a file; sizes and types are checked."""
        size = maps.array("overview.compared", np.float32, (1, None, None)).shape[1:]
        planes = {
            name: maps.array(f"overview.{name}", np.float32, (count, *size))
            for name, count in PLANES.items()
        }
        return cls(**planes, step=int(maps.array("overview.step", np.int64, ())))


def step_of(shape: tuple[int, int]) -> int:
    """Pixels of a painting, along a side, for one of its overview."""
    return max(-(-max(shape) // LARGEST), 1)


class OverviewSums:
    """Sums over blocks; a tile begins at a multiple of the step."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.step = step_of(shape)
        size = -(-shape[0] // self.step), -(-shape[1] // self.step)
        self._sums = {name: np.zeros((count, *size)) for name, count in PLANES.items()}
        self._counts = {name: np.zeros((count, *size)) for name, count in PLANES.items()}

    def add(self, part: Window, planes: Mapping[str, NDArray[Any]]) -> None:
        """Add a tile's planes ``(count, y, x)``."""
        for name, plane in planes.items():
            values = plane.astype(np.float64)
            known = np.isfinite(values)
            for into, of in (
                (self._sums, np.where(known, values, 0.0)),
                (self._counts, known.astype(np.float64)),
            ):
                found = self._blocks(of)
                rows, columns = (
                    slice(one.start // self.step, one.start // self.step + size)
                    for one, size in zip(part, found.shape[1:], strict=True)
                )
                into[name][:, rows, columns] += found

    def _blocks(self, planes: Floats) -> Floats:
        across, down = range(0, planes.shape[2], self.step), range(0, planes.shape[1], self.step)
        rows = np.add.reduceat(planes, list(down), axis=1)
        return np.asarray(np.add.reduceat(rows, list(across), axis=2))

    def overview(self) -> Overview:
        """The means."""
        found = {}
        for name, total in self._sums.items():
            count = self._counts[name]
            mean = np.full(total.shape, np.nan)
            np.divide(total, count, out=mean, where=count > 0)
            found[name] = mean.astype(np.float32)
        return Overview(**found, step=self.step)

"""The table of a comparison, and where it changed most, gathered tile by tile."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.comparison.entries import Area, Changed, Compared, Quantity
from impasto.comparison.measures import SUMS, Measures, measured, planes_of
from impasto.comparison.tiles import Tile

Floats = NDArray[np.float64]

MOST_SAMPLES = 1 << 20
"""Pixels whose medians and percentiles are taken, evenly spread; all of a smaller painting."""
UNITS = {"normal": "degrees", "colour": "dE00", "gloss": "ratio of beta"}
"""Quantities and their units."""


def cells_of(shape: tuple[int, int], cells: int) -> tuple[int, int, int]:
    """Rows and columns of a grid, and pixels of a square cell's side."""
    side = max(-(-max(shape) // cells), 1)
    return -(-shape[0] // side), -(-shape[1] // side), side


@dataclass(eq=False)
class Summary:
    """Sums over tiles.

    Parameters
    ----------
    shape
        Of the painting before.
    cells
        Cells of the grid along the longer side.
    regions
        ``(y, x)`` codes of regions, below 0: none; None: the grid is used.
    """

    shape: tuple[int, int]
    cells: int
    regions: NDArray[np.int64] | None = None
    _samples: dict[str, list[Floats]] = field(default_factory=dict)
    _tested: dict[str, list[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._codes = np.zeros(0, np.int64) if self.regions is None else np.unique(self.regions)
        self._codes = self._codes[self._codes >= 0]
        down, across, self._side = cells_of(self.shape, self.cells)
        self._across = across
        count = down * across if self.regions is None else len(self._codes)
        self._sums = np.zeros((len(SUMS), count))
        self._boxes = np.tile(np.array([*self.shape, 0, 0]), (count, 1))
        self._statuses = np.zeros(256, np.int64)
        pixels = self.shape[0] * self.shape[1]
        self._step = max(int(np.ceil(np.sqrt(pixels / MOST_SAMPLES))), 1)

    def add(self, part: Window, tile: Tile) -> None:
        """Add what a window has."""
        maps = tile.maps
        self._statuses += np.bincount(maps["status"].ravel(), minlength=256)
        values = {
            "normal": np.degrees(maps["angle"]),
            "colour": maps["delta_e"],
            "gloss": maps["beta_ratio"],
        }
        first = tuple(-one.start % self._step for one in part)
        every = (slice(first[0], None, self._step), slice(first[1], None, self._step))
        for name, plane in values.items():
            tested = tile.tested.get(name)
            count, marked = self._tested.setdefault(name, [0, 0])
            if tested is not None:
                count += int(tested.sum())
                marked += int((tested & ((maps["changed"] & Changed[name.upper()]) > 0)).sum())
                self._tested[name] = [count, marked]
            for key, numbers in ((name, plane), (f"{name} least", tile.detectable.get(name))):
                if numbers is not None:
                    sample = np.asarray(numbers[every], np.float64)
                    self._samples.setdefault(key, []).append(sample[~np.isnan(sample)])
        self._add_areas(part, maps)

    def _add_areas(self, part: Window, maps: dict[str, NDArray[Any]]) -> None:
        y, x = np.mgrid[part[0], part[1]]
        if self.regions is None:
            index = (y // self._side) * self._across + x // self._side
            own = np.ones(y.shape, np.bool_)
        else:
            codes = self.regions[part]
            own = codes >= 0
            index = np.searchsorted(self._codes, np.maximum(codes, 0))
            index = np.minimum(index, max(len(self._codes) - 1, 0))
        if not len(self._boxes):
            return
        count = len(self._boxes)
        place = index[own]
        for axis, plane in ((0, y), (1, x)):
            np.minimum.at(self._boxes[:, axis], place, plane[own])
            np.maximum.at(self._boxes[:, 2 + axis], place, plane[own] + 1)
        self._sums += measured(place, count, [plane[own] for plane in planes_of(maps)])

    @property
    def compared(self) -> dict[str, int]:
        """Pixels per status, by name; those that do not occur are left out."""
        return {one.name.lower(): int(self._statuses[one]) for one in Compared
                if self._statuses[one]}  # fmt: skip

    @property
    def comparable(self) -> int:
        """Pixels that could be compared."""
        return int(self._statuses[: Compared.OUTSIDE].sum())

    def quantities(self) -> tuple[Quantity, ...]:
        """A row for each."""
        return tuple(
            Quantity(
                name=name,
                unit=unit,
                median=self._quantile(name, 0.5),
                high=self._quantile(name, 0.95),
                detectable=self._quantile(f"{name} least", 0.5),
                tested=self._tested[name][0],
                significant=self._tested[name][1] / max(self._tested[name][0], 1),
            )
            for name, unit in UNITS.items()
        )

    def areas(self) -> tuple[Area, ...]:
        """Those with compared pixels; the largest shares of changed pixels come first."""
        found = []
        for number, (sums, box) in enumerate(zip(self._sums.T, self._boxes, strict=True)):
            if not sums[0]:
                continue
            measures = Measures.of(sums)
            top, left, bottom, right = (int(value) for value in box)
            found.append(
                Area(
                    name=self._name(number),
                    top=top,
                    left=left,
                    rows=bottom - top,
                    columns=right - left,
                    pixels=measures.pixels,
                    normal=measures.normal,
                    colour=measures.colour,
                    gloss=measures.gloss,
                    changed=measures.changed,
                )
            )
        return tuple(sorted(found, key=lambda area: -max(area.changed)))

    def _name(self, number: int) -> str:
        if self.regions is not None:
            return str(int(self._codes[number]))
        row, column = divmod(number, self._across)
        return f"{_letters(column)}{row + 1}"

    def _quantile(self, name: str, share: float) -> float:
        values = np.concatenate(self._samples.get(name, [np.zeros(0)]))
        if not values.size:
            return float("nan")
        # Between two infinite ratios there is no number: the lower one stands.
        if np.isfinite(values).all():
            return float(np.quantile(values, share))
        return float(np.quantile(values, share, method="lower"))


def _letters(number: int) -> str:
    """A to Z, AA to ZZ, and so on, as columns of a sheet."""
    head, last = divmod(number, 26)
    return (_letters(head - 1) if head else "") + chr(ord("A") + last)

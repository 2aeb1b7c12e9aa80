"""Maps between pixels: cubic convolution with six points, which is exact for cubics.

Keys' kernel of six points [@keys1981cubic] is a polynomial of few terms, so that a pixel has the
same bits in whatever tile it is computed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
REACH = 3
"""Pixels on each side that a value between pixels needs."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Where the pixels of a tile lie in a window of a frame.

    Attributes
    ----------
    row, column
        ``(n,)`` whole numbers: the pixel of the window that is above and left.
    down, right
        ``(n,)`` how far behind it the place is, 0 to 1.
    shape
        Rows and columns of the window.
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    down: Floats
    right: Floats
    shape: tuple[int, int]

    @classmethod
    def at(cls, x: Floats, y: Floats, shape: tuple[int, int]) -> Samples:
        """Places in columns and rows of the window."""
        column, row = np.floor(x), np.floor(y)
        return cls(row.astype(np.intp), column.astype(np.intp), y - row, x - column, shape)

    @property
    def nearest(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column of the nearest pixel, inside of the window."""
        height, width = self.shape
        row = self.row + (self.down >= 0.5)
        column = self.column + (self.right >= 0.5)
        return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)

    def picked(self, planes: NDArray[np.generic]) -> NDArray[np.generic]:
        """``(..., n)``: the nearest pixels of maps ``(..., y, x)``."""
        row, column = self.nearest
        return planes[..., row, column]

    def interpolated(
        self, planes: NDArray[np.float32], known: NDArray[np.bool_] | None = None
    ) -> Floats:
        """``(k, n)``: values of maps ``(k, y, x)``.

        Where one of the 36 pixels is unknown or outside, those of the four nearest that are known
        are interpolated bilinearly; where the nearest pixel is unknown, the value is NaN.

        Parameters
        ----------
        planes
            Maps; NaN where unknown.
        known
            ``(y, x)``; default: where no map is NaN.
        """
        there = np.asarray(np.isfinite(planes).all(axis=0) if known is None else known)
        # A border of unknown pixels, so that no place needs to be held against the edges.
        edge = ((REACH, REACH), (REACH, REACH))
        whole = np.pad(np.where(there, planes, np.float32(0.0)), ((0, 0), *edge))
        flat = np.ascontiguousarray(whole.reshape(len(planes), -1).T, dtype=np.float64)
        known = np.pad(there, edge).reshape(-1)
        across = there.shape[1] + 2 * REACH
        base = (self.row + REACH) * across + self.column + REACH
        clean = bool(known[base].all()) and self._within(there)
        inside = np.ones(len(base), np.bool_)
        total = np.zeros((len(base), len(planes)))
        rights = _kernel(self.right)
        for i, down in enumerate(_kernel(self.down)):
            for j, right in enumerate(rights):
                product = down * right
                used = product != 0.0
                if not used.any():
                    continue
                index = base + ((i - 2) * across + (j - 2))
                total += product[:, None] * flat[index]
                if not clean:
                    inside &= known[index] | ~used
        found = np.ascontiguousarray(total.T)
        if not inside.all():
            at = np.flatnonzero(~inside)
            found[:, at] = self._bilinear(flat, known, base, across, at)
        row, column = self.nearest
        found[:, ~there[row, column]] = np.nan
        return found

    def _within(self, there: NDArray[np.bool_]) -> bool:
        """Whether all pixels that are needed exist and are known."""
        height, width = there.shape
        rows, columns = self.row, self.column
        fits = rows.min() >= REACH - 1 and columns.min() >= REACH - 1
        fits &= rows.max() < height - REACH and columns.max() < width - REACH
        return bool(fits and there.all())

    def alike(self, codes: NDArray[np.uint8], planes: NDArray[np.float32]) -> Floats:
        """``(k, n)``: bilinear values of those of four pixels that have the nearest one's code."""
        height, width = self.shape
        flat, code = planes.reshape(len(planes), -1).astype(np.float64), codes.reshape(-1)
        row, column = self.nearest
        own = code[row * width + column]
        total, weights = np.zeros((len(planes), len(own))), np.zeros((len(planes), len(own)))
        for i, weight in enumerate((1.0 - self.down, self.down)):
            for j, other in enumerate((1.0 - self.right, self.right)):
                index, fine = self._index(self.row + i, self.column + j, height, width)
                share = weight * other * (fine & (code[index] == own))
                value = flat[:, index]
                counted = np.isfinite(value) * share
                total += np.where(counted > 0.0, value, 0.0) * counted
                weights += counted
        with np.errstate(invalid="ignore"):
            return np.asarray(total / np.where(weights > 0.0, weights, np.nan))

    def _bilinear(
        self,
        flat: Floats,
        known: NDArray[np.bool_],
        base: NDArray[np.intp],
        across: int,
        at: NDArray[np.intp],
    ) -> Floats:
        """Values ``(k, n)`` of some places from those of the four nearest pixels that are known."""
        down, right = self.down[at], self.right[at]
        total, weights = np.zeros((len(at), flat.shape[1])), np.zeros(len(at))
        for i, weight in enumerate((1.0 - down, down)):
            for j, other in enumerate((1.0 - right, right)):
                index = base[at] + (i * across + j)
                share = weight * other * known[index]
                total += share[:, None] * flat[index]
                weights += share
        return np.asarray((total / np.where(weights > 0.0, weights, np.nan)[:, None]).T)

    @staticmethod
    def _index(
        row: NDArray[np.intp], column: NDArray[np.intp], height: int, width: int
    ) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        fine = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        index = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
        return index, fine


def _kernel(t: Floats) -> tuple[Floats, ...]:
    """Weights of the pixels 2 before to 3 behind, ``t`` behind the middle one."""
    return tuple(
        piece(distance)
        for piece, distance in (
            (_far, t + 2.0), (_middle, t + 1.0), (_near, t),
            (_near, 1.0 - t), (_middle, 2.0 - t), (_far, 3.0 - t),
        )
    )  # fmt: skip


def _near(s: Floats) -> Floats:
    # All three pieces are factored by their roots: exactly 0 at whole numbers but 0.
    return (s - 1.0) * ((4.0 * s - 3.0) * s - 3.0) / 3.0


def _middle(s: Floats) -> Floats:
    return (s - 1.0) * (s - 2.0) * (15.0 - 7.0 * s) / 12.0


def _far(s: Floats) -> Floats:
    return (s - 2.0) * (s - 3.0) * (s - 3.0) / 12.0

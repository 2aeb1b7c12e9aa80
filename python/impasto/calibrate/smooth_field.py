"""A smooth field of light over a picture, by robust least squares, and what is not smooth.

The logarithm of block means is a polynomial of fourth order in x and y, fitted by iteratively
reweighted least squares with Tukey's weights [@holland1977robust], so that a shadow or a spot is
not followed but found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BLOCKS = 24
"""Along the longer side."""
ORDER = 4
ROUNDS = 30
TUKEY = 4.685
"""Standard deviations from which a block counts for nothing: 95 % efficiency."""
FLOOR = 1e-5
"""Least scale of residuals: rounding of block means."""


@dataclass(frozen=True, eq=False)
class SmoothField:
    """Light over a picture.

    Parameters
    ----------
    middle
        In the middle of the picture.
    sigma
        Its relative standard deviation.
    field
        ``(rows, columns)`` of blocks, smooth.
    residual
        ``(rows, columns)``: logarithm of measured over smooth light.
    scale
        Robust standard deviation of the residuals.
    """

    middle: float
    sigma: float
    field: Floats
    residual: Floats
    scale: float


def block_grid(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of blocks for a picture of so many rows and columns."""
    side = max(1.0, max(shape) / BLOCKS)
    return max(1, round(shape[0] / side)), max(1, round(shape[1] / side))


def block_means(plane: NDArray[np.floating]) -> Floats:
    """``(rows, columns)``: means of blocks of a picture ``(y, x)``."""
    shape = plane.shape[0], plane.shape[1]
    rows, columns = (
        _edges(size, count) for size, count in zip(shape, block_grid(shape), strict=True)
    )
    sums = np.add.reduceat(np.add.reduceat(plane, rows[:-1], axis=0), columns[:-1], axis=1)
    return np.asarray(sums / np.outer(np.diff(rows), np.diff(columns)), dtype=np.float64)


def _edges(size: int, count: int) -> NDArray[np.intp]:
    return np.linspace(0, size, count + 1).astype(np.intp)


def block_centres(size: int, count: int) -> Floats:
    """``(count,)``: pixels from the middle of an axis; blocks differ in width by one pixel."""
    edges = _edges(size, count)
    return np.asarray((edges[:-1] + edges[1:] - size) / 2.0)


def smooth_field(means: Floats, shape: tuple[int, int]) -> SmoothField:
    """The smooth field of positive block means ``(rows, columns)`` of a picture ``(y, x)``."""
    rows, columns = means.shape
    y, x = np.meshgrid(
        *(block_centres(n, k) / max(1.0, n / 2) for n, k in zip(shape, means.shape, strict=True)),
        indexing="ij",
    )
    powers = [(i, j) for i in range(ORDER + 1) for j in range(ORDER + 1 - i)]
    # Fewer rows than powers determine no polynomial of them.
    powers = [(i, j) for i, j in powers if i < columns and j < rows]
    design = np.stack([(x**i * y**j).ravel() for i, j in powers], axis=1)
    value = np.log(means).ravel()
    weight = np.ones_like(value)
    scale = FLOOR
    for _ in range(ROUNDS):
        root = np.sqrt(weight)
        found, *_ = np.linalg.lstsq(design * root[:, None], value * root, rcond=None)
        residual = value - design @ found
        scale = max(1.4826 * float(np.median(np.abs(residual))), FLOOR)
        ratio = residual / (TUKEY * scale)
        weight = np.where(np.abs(ratio) < 1.0, (1.0 - ratio * ratio) ** 2, 0.0)
    left = residual.reshape(rows, columns)
    variance = float((weight * residual**2).sum() / max(weight.sum() - len(powers), 1.0))
    covariance = np.linalg.pinv((design * weight[:, None]).T @ design)
    # Neighbours that are alike tell less than their number.
    alike = _inflation(left, 1) * _inflation(left, 0)
    return SmoothField(
        float(np.exp(found[0])),
        float(np.sqrt(variance * covariance[0, 0] * alike)),
        np.exp((design @ found).reshape(rows, columns)),
        left,
        scale,
    )


def _inflation(residual: Floats, axis: int) -> float:
    """(1 + rho) / (1 - rho), where neighbours correlate by rho [@bartlett1946theory]."""
    size = residual.shape[axis]
    if size < 3:
        return 1.0
    reach = TUKEY * 1.4826 * np.median(np.abs(residual))
    kept = np.clip(residual, -reach, reach)
    one, other = np.take(kept, range(size - 1), axis), np.take(kept, range(1, size), axis)
    power = float((kept * kept).mean())
    rho = float((one * other).mean()) / power if power > 0.0 else 0.0
    rho = min(max(rho, 0.0), 0.9)
    return (1.0 + rho) / (1.0 - rho)

"""Tables of ASTM E2022 and their adjustment of ASTM E308, written from the standards.

Interpolation by Lagrange polynomials inside a sum over the 1 nm grid: of third degree between inner
samples, of second degree in the first and the last interval.
"""

from __future__ import annotations

import numpy as np


def lagrange(nodes: np.ndarray, at: float) -> np.ndarray:
    """Weight of each node's sample in the polynomial through all of them."""
    weights = np.ones(len(nodes))
    for index, node in enumerate(nodes):
        others = np.delete(nodes, index)
        weights[index] = np.prod((at - others) / (node - others))
    return weights


def operator(grid: np.ndarray, products: np.ndarray) -> np.ndarray:
    """``(3, n)``: XYZ of samples on ``grid``; ``products (3, 421)``: observer times light per nm.

    Y of a perfect white is 1.
    """
    step = grid[1] - grid[0]
    nodes = np.arange(360.0, 780.5, step)
    table = np.zeros((3, len(nodes)))
    for nanometre, product in zip(np.arange(360.0, 780.5), products.T, strict=True):
        at = min(nanometre, nodes[-1])
        left = min(int((at - 360.0) // step), len(nodes) - 2)
        if left == 0:
            chosen = slice(0, 3)
        elif left == len(nodes) - 2:
            chosen = slice(len(nodes) - 3, len(nodes))
        else:
            chosen = slice(left - 1, left + 3)
        table[:, chosen] += product[:, None] * lagrange(nodes[chosen], at)
    # Samples that were not measured take the value of the nearest that was.
    found = np.zeros((3, len(grid)))
    for node, column in zip(nodes, table.T, strict=True):
        found[:, int(np.abs(grid - node).argmin())] += column
    return found / products[1].sum()

"""Heights of a mesh from those of tiles: a penalised spline [@eilers1996psplines].

Sparse least squares of cubic B-splines with a penalty on second differences (the discrete bending
energy of a thin plate). Generalised cross-validation [@craven1979smoothing] says how strong the
penalty is. Iteratively reweighted least squares [@holland1977robust] count outliers less: Huber's
weights [@huber1964] among the photographs of one tile and to begin with among tiles, then Tukey's
biweight, so that outliers have no say in the penalty. Standard deviations are those of the Bayesian
reading of the penalty [@wahba1983bayesian].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.depth_mesh import DepthMesh, basis, node_values
from impasto.errors import GeometryError

Floats = NDArray[np.float64]

HUBER, TUKEY = 1.345, 4.685
"""Deviations from which weights fall, and at which they are 0: 95 % efficient."""
ROUNDS = 12
"""Reweightings among photographs, and among tiles."""
REDESCENDING = 4
"""The reweighting among tiles from which on Tukey's weights count."""
CHOICES = (0, 8)
"""Reweightings among tiles at which the penalty is chosen."""
PROBES = 32
"""Random vectors for a trace: errors of some percent are nothing beside decades of penalties."""
PENALTIES = 10.0 ** np.arange(-6.0, 4.0)
"""Candidates, as shares of the information of the tiles."""
CHUNK = 512
"""Columns of the inverse that are held at a time."""
LEAST = 1e-12
"""Share of the largest weight below which a tile counts for nothing."""


def combined(heights: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The height of each tile from all photographs, by iteratively reweighted least squares.

    Parameters
    ----------
    heights, weights
        ``(photograph, tile)`` heights in mm and inverse variances; weight 0 where there is none.

    Returns
    -------
    tuple
        ``(tile,)`` heights, and weights: their inverse variances, scaled by how far the photographs
        of a tile differ where that is more than they say.
    """
    own = np.array(weights, dtype=np.float64)
    for _ in range(ROUNDS):
        total = own.sum(axis=0)
        mean = (own * heights).sum(axis=0) / np.where(total > 0.0, total, 1.0)
        off = np.sqrt(weights) * np.abs(heights - mean)
        own = weights * np.minimum(1.0, HUBER / np.maximum(off, 1e-12))
    total = own.sum(axis=0)
    count = np.maximum((weights > 0.0).sum(axis=0) - 1, 1)
    spread = (own * np.square(heights - mean)).sum(axis=0) / count
    return mean, total / np.maximum(spread, 1.0)


@dataclass(frozen=True, eq=False)
class MeshFit:
    """A mesh, and how it was fitted.

    Attributes
    ----------
    mesh
        With its standard deviations.
    penalty
        The one that was chosen.
    freedom
        Effective number of parameters, estimated to some percent.
    residual_mm
        Root mean square of what is left at the tiles, weighted.
    """

    mesh: DepthMesh
    penalty: float
    freedom: float
    residual_mm: float


def fitted_mesh(
    places: Floats,
    heights: Floats,
    weights: Floats,
    size_mm: tuple[float, float],
    shape: tuple[int, int],
    shared: float = 1.0,
) -> MeshFit:
    """The mesh that fits heights of tiles best.

    Parameters
    ----------
    places
        ``(n, 2)`` of the tiles, mm.
    heights, weights
        ``(n,)`` mm and inverse variances, which are not believed where tiles differ more.
    size_mm
        Width and height of the painting.
    shape
        Rows and columns of nodes.
    shared
        How many tiles a measurement is counted in, where windows of tiles overlap.

    Raises
    ------
    GeometryError
        Fewer than three tiles that say anything.
    """
    known = weights > LEAST * max(float(weights.max(initial=0.0)), 1e-300)
    if known.sum() < 3:
        raise GeometryError(
            f"depth: {int(known.sum())} of {len(weights)} tiles have structure that two views "
            "share; the painting needs texture, the photographs different views"
        )
    places, heights, weights = places[known], heights[known], weights[known]
    equations = _Equations(places, size_mm, shape)
    own, penalty = weights, 0.0
    for turn in range(ROUNDS):
        if turn in CHOICES:
            penalty = _best_penalty(equations, heights, own)
        left = heights - equations.solved(heights, own, penalty)[0]
        off = np.sqrt(weights) * np.abs(left)
        scale = max(1.4826 * float(np.median(off)), 1e-9)
        if turn < REDESCENDING:
            own = weights * np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-12))
        else:
            own = weights * np.square(np.maximum(1.0 - np.square(off / (TUKEY * scale)), 0.0))
    predicted, coefficients, factors = equations.solved(heights, own, penalty)
    freedom = equations.freedom(own, factors)
    squares = float((own * np.square(heights - predicted)).sum())
    # Windows that overlap err alike, so that little is left of their errors: never below 1.
    count = int((own > 0.0).sum())
    variance = shared * max(squares / max(count - freedom, 1.0), 1.0)
    depth, spread = equations.nodes(coefficients, factors)
    mesh = DepthMesh(size_mm, depth, np.sqrt(variance) * spread)
    return MeshFit(mesh, penalty, freedom, float(np.sqrt(squares / own.sum())))


class _Equations:
    """The sparse equations of tiles and of the penalty; unknown are the coefficients."""

    def __init__(self, places: Floats, size_mm: tuple[float, float], shape: tuple[int, int]):
        from scipy import sparse

        rows, columns = self.shape = shape
        across, right = _four((places[:, 0] / size_mm[0] + 0.5) * (columns - 1), columns)
        down, below = _four((0.5 - places[:, 1] / size_mm[1]) * (rows - 1), rows)
        each = (down[:, :, None] * across[:, None, :]).reshape(len(places), -1)
        where = (below[:, :, None] * columns + right[:, None, :]).reshape(len(places), -1)
        starts = np.arange(len(places) + 1) * each.shape[1]
        size = rows * columns
        self.tiles: Any = sparse.csr_array(
            (each.ravel(), where.ravel(), starts), shape=(len(places), size)
        )
        step_x, step_y = size_mm[0] / (columns - 1), size_mm[1] / (rows - 1)
        one_x, one_y = sparse.eye_array(columns), sparse.eye_array(rows)
        parts = (
            sparse.kron(one_y, _differences(columns, 2)) / step_x**2,
            sparse.kron(_differences(rows, 2), one_x) / step_y**2,
            np.sqrt(2.0)
            * sparse.kron(_differences(rows, 1), _differences(columns, 1))
            / (step_x * step_y),
        )
        bending = sum(part.T @ part for part in parts)
        self.bending: Any = sparse.csc_array(bending / bending.diagonal().mean())
        self.values: Any = sparse.csr_array(
            sparse.kron(sparse.csr_array(node_values(rows)), sparse.csr_array(node_values(columns)))
        )

    def solved(
        self, heights: Floats, weights: Floats, penalty: float
    ) -> tuple[Floats, Floats, Any]:
        """Heights that the mesh has at the tiles, its coefficients, and the factors."""
        from scipy import sparse
        from scipy.sparse.linalg import splu

        weighted = self.tiles.T @ sparse.diags_array(weights)
        share = float(weights.sum()) / self.bending.shape[0]
        # A trace of unity: where neither tiles nor bending hold a node, zero is the answer.
        rest = 1e-9 * share * sparse.eye_array(self.bending.shape[0])
        factors = splu(
            sparse.csc_array(weighted @ self.tiles + penalty * share * self.bending + rest)
        )
        coefficients = factors.solve(weighted @ heights)
        return self.tiles @ coefficients, coefficients, factors

    def freedom(self, weights: Floats, factors: Any) -> float:
        """Trace of the matrix that makes fitted heights of measured ones.

        By random vectors of ones and minus ones [@hutchinson1990trace].
        """
        random = np.random.default_rng(0)
        probes = random.choice((-1.0, 1.0), (self.tiles.shape[1], PROBES))
        shown = self.tiles.T @ (weights[:, None] * (self.tiles @ probes))
        return float((probes * factors.solve(shown)).sum() / PROBES)

    def nodes(self, coefficients: Floats, factors: Any) -> tuple[Floats, Floats]:
        """``(y, x)`` heights at the nodes, and their standard deviations for a unit variance."""
        spread = np.sqrt(self._variances(self.values, factors))
        return (self.values @ coefficients).reshape(self.shape), spread.reshape(self.shape)

    @staticmethod
    def _variances(rows: Any, factors: Any) -> Floats:
        """``b' M^-1 b`` of each row b, some columns of the inverse at a time."""
        found = np.empty(rows.shape[0])
        for start in range(0, len(found), CHUNK):
            part = rows[start : start + CHUNK].toarray()
            found[start : start + CHUNK] = np.einsum("ni,in->n", part, factors.solve(part.T))
        return found


def _best_penalty(equations: _Equations, heights: Floats, weights: Floats) -> float:
    """The penalty with the least score of generalised cross-validation."""
    scores = []
    for penalty in PENALTIES.tolist():
        predicted, _, factors = equations.solved(heights, weights, penalty)
        freedom = equations.freedom(weights, factors)
        left = max(int((weights > 0.0).sum()) - freedom, 1e-3)
        squares = float((weights * np.square(heights - predicted)).sum())
        scores.append(squares / left**2)
    return float(PENALTIES[int(np.argmin(scores))])


def _four(places: Floats, count: int) -> tuple[Floats, NDArray[np.int64]]:
    """``(n, 4)``: the B-splines that are not 0 at places, and which ones they are."""
    width = min(4, count)
    first = np.clip(np.floor(places).astype(int) - 1, 0, count - width)
    which = first[:, None] + np.arange(width)
    return np.take_along_axis(basis(places, count), which, axis=1), which


def _differences(count: int, order: int) -> Any:
    """Sparse ``(count - order, count)``: first or second differences."""
    from scipy import sparse

    stencil = [-1.0, 1.0] if order == 1 else [1.0, -2.0, 1.0]
    return sparse.diags_array(
        stencil, offsets=list(range(order + 1)), shape=(max(count - order, 0), count)
    )

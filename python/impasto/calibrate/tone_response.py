"""The response of a camera from codes of known relative light, monotone, by least squares.

A sample n of group g (a patch series in one band, a place in an exposure series) has the code c_n
and the light s_g e_n: e_n is known, the scale s_g is not. The response f, with
f(c_n) = o + s_g e_n, is a chain of straight lines over equal steps of the code, with a small third
difference (after Debevec and Malik [@debevec1997recovering], who take logarithms; here f itself, so
that black has a place) and increments of 0 or more [@lawson1974nnls]. Generalised cross-validation
[@golub1979gcv] says how smooth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.sensitivities import non_negative

Floats = NDArray[np.float64]

KNOTS = 49
SMOOTHNESS = tuple(10.0**power for power in np.arange(-3.0, 4.1, 0.5))
CODE_SIGMA = 1e-3
"""Errors of codes as a share of full scale, and ..."""
LIGHT_SIGMA = 5e-3
"""... of light, relative; only their ratio matters, for the residuals say how large both are."""
ROUNDS = 5
NEARLY = 1.05
"""The smoothest response whose cross-validation error is within this factor of the least."""
MOST_FREE = 0.6
"""Largest share of the samples that the unknowns may use up."""
FIRM = 1e4
"""Weight of the equation that fixes the scale."""


@dataclass(frozen=True, eq=False)
class Response:
    """A response.

    Parameters
    ----------
    codes, light, sigma
        ``(knot,)``: equal steps of the code from 0 to 1, the light, 1 at the largest code, and its
        standard deviation where the scale is that of the largest code that was used.
    black
        Light of code black; 0 where none was given.
    scales
        ``(group,)`` light of each group's e = 1.
    residual
        ``(n,)`` predicted over measured light, less 1.
    smoothness
        Weight of the third difference.
    """

    codes: Floats
    light: Floats
    sigma: Floats
    black: float
    scales: Floats
    residual: Floats
    smoothness: float

    def __call__(self, codes: Floats) -> Floats:
        """Light of codes."""
        return np.interp(codes, self.codes, self.light)


def fit_response(
    codes: Floats, light: Floats, group: NDArray[np.intp], black: float | None = None
) -> Response:
    """The smooth monotone response that explains all groups.

    Parameters
    ----------
    codes
        ``(n,)`` shares of full scale, not clipped.
    light
        ``(n,)`` relative within each group.
    group
        ``(n,)`` from 0 on.
    black
        The code of no light.
    """
    count = int(group.max()) + 1
    steps = _steps(codes)
    fixed = _steps(np.array([codes.max()]))[0]
    cells = steps.shape[1]
    size = cells + count + (black is not None)
    data = np.zeros((len(codes), size))
    data[:, :cells] = steps
    data[np.arange(len(codes)), cells + group] = -light
    ends = [np.append(fixed, np.zeros(size - cells))]
    if black is not None:
        data[:, -1] = -1.0
        ends.append(np.append(_steps(np.array([black]))[0], np.zeros(size - cells)))
        ends[-1][-1] = -1.0
    bend = np.zeros((cells - 2, size))
    bend[:, :cells] = np.diff(np.eye(cells), 2, axis=0)
    firm = FIRM * np.array(ends)
    wanted = np.append(FIRM, np.zeros(len(ends) - 1))
    weight = np.full(len(codes), 1.0 / CODE_SIGMA)
    found = np.zeros(size)
    for _ in range(ROUNDS):
        chosen = _smoothest(weight[:, None] * data, bend, firm, wanted)
        system = np.concatenate([weight[:, None] * data, np.sqrt(chosen) * bend * cells, firm])
        right = np.concatenate([np.zeros(len(codes) + len(bend)), wanted])
        found = non_negative(system, right, np.ones(size, dtype=bool))
        slope = np.maximum(found[:cells] * cells, 1e-3)[_cell(codes, cells)]
        value = np.maximum(steps @ found[:cells], 1e-6)
        weight = 1.0 / np.hypot(CODE_SIGMA * slope, LIGHT_SIGMA * value)
    miss = weight * (data @ found)
    covariance = _covariance(system, found, miss, len(codes), weight[:, None] * data)
    chain = np.tril(np.ones((cells + 1, cells)), -1)
    reach = chain @ covariance[:cells, :cells] @ chain.T
    curve = chain @ found[:cells]
    top = curve[-1]
    own = data[:, :cells] @ found[:cells] - (found[-1] if black is not None else 0.0)
    predicted = own - data @ found
    return Response(
        np.linspace(0.0, 1.0, cells + 1),
        curve / top,
        np.sqrt(np.maximum(np.diag(reach), 0.0)) / top,
        float(found[-1] / top) if black is not None else 0.0,
        found[cells : cells + count] / top,
        predicted / np.maximum(own, 1e-9) - 1.0,
        chosen,
    )


def _cell(codes: Floats, cells: int) -> NDArray[np.intp]:
    return np.clip((codes * cells).astype(np.intp), 0, cells - 1)


def _steps(codes: Floats) -> Floats:
    """``(n, cell)``: which share of each cell's increment lies below a code."""
    cells = KNOTS - 1
    return np.clip(codes[:, None] * cells - np.arange(cells), 0.0, 1.0)


def _smoothest(data: Floats, bend: Floats, firm: Floats, wanted: Floats) -> float:
    """By generalised cross-validation, without the bounds."""
    scores = []
    cells = bend.shape[0] + 2
    fixed = data.T @ data + firm.T @ firm
    for one in SMOOTHNESS:
        matrix = fixed + one * cells**2 * (bend.T @ bend)
        matrix += 1e-12 * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
        solved = np.linalg.solve(matrix, np.column_stack([firm.T @ wanted, data.T]))
        freedom = float((data * solved[:, 1:].T).sum())
        squares = float(np.square(data @ solved[:, 0]).sum())
        # With few samples a curve through all of them has no error that could be validated.
        spent = freedom > MOST_FREE * len(data)
        scores.append(np.inf if spent else len(data) * squares / (len(data) - freedom) ** 2)
    if not np.isfinite(min(scores)):
        return float(SMOOTHNESS[-1])
    allowed = NEARLY * min(scores)
    return float(SMOOTHNESS[int(np.flatnonzero(np.array(scores) <= allowed)[-1])])


def _covariance(system: Floats, found: Floats, miss: Floats, count: int, data: Floats) -> Floats:
    """Of all unknowns, those at their bound fixed; the smoothness counts as knowledge."""
    free = found > 0.0
    inverse = np.linalg.pinv(system[:, free].T @ system[:, free], hermitian=True)
    freedom = float(np.einsum("ij,jk,ik->", data[:, free], inverse, data[:, free]))
    variance = float(miss @ miss) / max(count - freedom, 1.0)
    covariance = np.zeros((len(found), len(found)))
    covariance[np.ix_(free, free)] = variance * inverse
    return covariance

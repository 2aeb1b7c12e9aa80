"""Errors of colours and gloss by the Cramer-Rao bound [@rao1945information].

The photographs of a pixel depend on its tilt, its diffuse part, the light that has no direction,
and strengths and widths of its lobes. Columns of what they show of each come from the renderer; the
inverse of their products, times the variance of the residuals, bounds the covariance. Widths and
light of no direction are not free: what a fit knows of them from the whole painting counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.result import Sbrdf
from impasto.surface import Lobe, Surface

Planes = NDArray[np.float64]

STEP = 0.05
"""Of the logarithm of a width, for a difference quotient."""
BLOCK = 2048
"""Pixels whose matrices are inverted together: a cache holds them."""
TILT = 0.01
"""Radians, the same of a normal."""
EMPTY = 1e-12
"""Of the largest square of a column: smaller ones are nothing that photographs show."""
RIDGE = 1e-6
"""Added to columns of unit length: what nothing determines has an error, if a large one."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Standard deviations ``(y, x)``.

    Attributes
    ----------
    diffuse
        Of the diffuse part in one band.
    beta
        Of the sum of the lobes' strengths in the mean of the bands; NaN where the gloss is that of
        the whole painting.
    shape
        ``(lobe, y, x)`` of the logarithm of each lobe's last shape number, where the normal was
        given to the fit; otherwise the fit's own.
    """

    diffuse: Planes
    beta: Planes
    shape: Planes


def bounds_of(
    part: Sbrdf,
    deviation: Planes,
    gamma_sigma: NDArray[np.float32] | None,
    given_normal: Planes | None = None,
) -> Bounds:
    """The bounds of a part of a result.

    Widths have the errors of the fit, which knows from other pixels how wide lobes are; light of no
    direction is taken to be as strong as it is in the part (root mean square), not anything. A
    pixel without a lobe has the error that the median lobe of the part would have: what would have
    been seen.

    Parameters
    ----------
    part
        The result.
    deviation
        ``(y, x)`` standard deviation of the residuals.
    gamma_sigma
        ``(lobe, y, x)`` standard deviation of the logarithm of the lobes' last shape number; None:
        the gloss is that of the whole painting, and known.
    given_normal
        ``(y, x)`` standard deviation, radians, of normals that lobes were fitted about and did not
        change; shapes were then free. None: normals were fitted with the lobes.
    """
    base = _one_band(part.surface(), part.shape)
    bands = len(part.bands)
    count = 0 if gamma_sigma is None else len(base.lobes)
    if count:
        base = replace(base, lobes=tuple(_with_shape(lobe) for lobe in base.lobes))
    dark = np.zeros((1, *part.shape), np.float32)

    def shown(surface: Surface) -> NDArray[np.float32]:
        return surface.predict(part.rig)[:, 0]

    bare = replace(base, lobes=(), ambient=None)
    black = replace(bare, diffuse=dark)
    # Every band has its own of these ...
    columns = [_Column(shown(replace(bare, diffuse=dark + np.float32(1.0))))]
    columns += [_Column(shown(replace(black, lobes=(replace(one, strength=1.0),))))
                for one in base.lobes[:count]]  # fmt: skip
    ridge = [np.zeros(part.shape)] * len(columns)
    level = 0.0 if base.ambient is None else _root_mean_square(base.ambient)
    if level > 0.0:
        columns.append(_Column(np.ones_like(columns[0].shown)))
        ridge.append((deviation / level) ** 2)
    # ... and these are shared.
    apart = len(columns)
    tilts = []
    for axis in (0, 1):
        up, down = (shown(replace(base, normal=normal)) for normal in _tilted(base.normal, axis))
        tilts.append(_Column(up, down, TILT))
    widths = []
    for lobe in base.lobes[:count]:
        wide, narrow = (
            shown(replace(black, lobes=(replace(lobe, shape=_scaled(lobe.shape, factor)),)))
            for factor in (np.exp(STEP), np.exp(-STEP))
        )
        widths.append(_Column(wide, narrow, STEP))
    columns += tilts if given_normal is None else widths
    ridge += [np.zeros(part.shape)] * (len(columns) - apart)
    if given_normal is None:
        fixed = list(zip(widths, () if gamma_sigma is None else gamma_sigma, strict=True))
    else:
        fixed = [(column, given_normal) for column in tilts]
    problem = _Problem(columns, np.stack(ridge), deviation, fixed, apart, count, bands)
    variance, spread, free = problem.solved()
    if given_normal is not None:
        shape = np.sqrt(free)
    else:
        shape = np.zeros((0, *part.shape)) if gamma_sigma is None else gamma_sigma.astype(float)
    return Bounds(
        diffuse=np.sqrt(variance),
        beta=np.sqrt(spread) if count else np.full(part.shape, np.nan),
        shape=shape,
    )


@dataclass(frozen=True, eq=False)
class _Column:
    """What photographs ``(observation, y, x)`` show of an unknown.

    Attributes
    ----------
    shown
        Of an unknown of 1; or, with ``less``, of one that is larger by ``step``.
    less
        Of one that is smaller by ``step``.
    """

    shown: NDArray[np.float32]
    less: NDArray[np.float32] | None = None
    step: float = 0.5

    def of(self, at: slice) -> Planes:
        """``(observation, n)``: of some pixels, counted row by row."""
        found = self.shown.reshape(len(self.shown), -1)[:, at].astype(np.float64)
        if self.less is not None:
            found -= self.less.reshape(len(self.less), -1)[:, at]
            found /= 2.0 * self.step
        return found


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares of every pixel.

    Attributes
    ----------
    columns
        Of the unknowns: the first is the diffuse part, then come ``count`` strengths of lobes; from
        ``apart`` on they are those of all bands.
    prior
        ``(k, y, x)``: added to their squares.
    deviation
        ``(y, x)``: standard deviation of the residuals.
    fixed
        Columns of what is given, with its standard deviation ``(y, x)``.
    apart, count, bands
        How many.
    """

    columns: list[_Column]
    prior: Planes
    deviation: Planes
    fixed: list[tuple[_Column, NDArray[Any]]]
    apart: int
    count: int
    bands: int

    def solved(self) -> tuple[Planes, Planes, Planes]:
        """Variances of the diffuse part, of the sum of strengths, and of what all bands share.

        The first two are those of one band ``(y, x)``, the last ``(k - apart, y, x)``.
        """
        shape, pixels = self.deviation.shape, self.deviation.size
        found = np.empty((2 + len(self.columns) - self.apart, pixels))
        for start in range(0, pixels, BLOCK):
            at = slice(start, min(start + BLOCK, pixels))
            found[:, at] = self._of(at)
        planes = found.reshape(-1, *shape)
        return planes[0], planes[1], planes[2:]

    def _of(self, at: slice) -> Planes:
        """All of them ``(..., n)`` of some pixels."""
        apart, bands = self.apart, self.bands
        columns = [one.of(at) for one in self.columns]
        prior = self.prior.reshape(len(self.prior), -1)[:, at]
        products = _products(columns)
        whole = _inverse(products, prior)
        alone = _inverse(products[:apart, :apart], prior[:apart])
        strengths = slice(1, 1 + self.count)
        diffuse = alone[0, 0] + (whole[0, 0] - alone[0, 0]) / bands
        strength = whole[strengths, strengths].sum(axis=(0, 1)) / bands
        shared = np.diagonal(whole).T[apart:] / bands
        found: Planes = np.stack([diffuse, strength, *shared])
        found *= self.deviation.reshape(-1)[at] ** 2
        for column, sigma in self.fixed:
            # By how much unknowns move with what was given: least squares of its column on theirs.
            given = column.of(at)
            moved = np.stack([_product(one, given) for one in columns])
            pull = np.einsum("ijn,jn->in", whole, moved)
            pull *= np.nan_to_num(sigma.reshape(-1)[at])
            found += np.stack([pull[0], pull[strengths].sum(axis=0), *pull[apart:]]) ** 2
        return found


def _root_mean_square(planes: NDArray[np.float32]) -> float:
    known = planes[np.isfinite(planes)].astype(np.float64)
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _product(one: Planes, other: Planes) -> Planes:
    """``(n,)``: the sum over observations of two columns ``(observation, n)``."""
    return np.asarray(np.einsum("on,on->n", one, other))


def _products(columns: list[Planes]) -> Planes:
    """``(k, k, n)``: of every two columns."""
    found = np.empty((len(columns), len(columns), columns[0].shape[1]))
    for i, one in enumerate(columns):
        for j, other in enumerate(columns[: i + 1]):
            found[i, j] = found[j, i] = _product(one, other)
    return found


def _inverse(products: Planes, prior: Planes) -> Planes:
    """``(k, k, n)``: that of the products of columns; NaN where unknown.

    ``prior (k, n)``: added to their squares.
    """
    finite = np.isfinite(products).all(axis=(0, 1)) & np.isfinite(prior).all(axis=0)
    even = np.where(finite, products, np.eye(len(products))[..., None])
    size = np.diagonal(even).T
    # What photographs show nothing of has an error without bounds, and no say.
    empty = size < EMPTY * size.max(axis=0)
    scale = np.sqrt(np.where(empty, 1.0, size))
    outer = scale[:, None] * scale
    even /= outer
    even[empty[:, None] | empty] = 0.0
    added = np.where(finite, prior, 0.0) / scale**2 + np.where(empty, 1.0, RIDGE)
    for at, more in enumerate(added):
        even[at, at] += more
    inverse = inverse_of(even)
    inverse /= outer
    inverse[:, :, ~finite] = np.nan
    return inverse


def inverse_of(matrices: Planes) -> Planes:
    """Inverses of positive definite matrices ``(k, k, n)``, all together.

    Gauss-Jordan elimination, which needs no pivoting where matrices are positive definite
    [@higham2002accuracy]. LAPACK takes them one after the other, and several times as long.
    """
    found = np.array(matrices, np.float64)
    for at in range(len(found)):
        pivot = 1.0 / found[at, at]
        row = found[at] * pivot
        column = found[:, at].copy()
        found -= column[:, None] * row
        found[at] = row
        found[:, at] = -column * pivot
        found[at, at] = pivot
    return found


def _one_band(surface: Surface, shape: tuple[int, int]) -> Surface:
    """The same surface in the mean of its bands."""
    ambient = surface.ambient
    return replace(
        surface,
        diffuse=surface.diffuse.mean(axis=0, keepdims=True),
        lobes=tuple(replace(lobe, strength=_mean(lobe.strength, shape)) for lobe in surface.lobes),
        ambient=None if ambient is None else ambient.mean(axis=0, keepdims=True),
    )


def _mean(strength: Any, shape: tuple[int, int]) -> Any:
    return strength.mean(axis=0) if np.ndim(strength) == 3 else np.broadcast_to(
        np.float32(strength) if np.ndim(strength) == 0 else strength, shape
    ).copy()  # fmt: skip


def _with_shape(lobe: Lobe) -> Lobe:
    """The lobe with the median shape where a pixel has none; a usual one if none has any."""
    planes = []
    for plane, usual in zip(lobe.shape, (0.2,) if len(lobe.shape) == 1 else (-1.0, 1.0, 30.0),
                            strict=True):  # fmt: skip
        known = plane[np.isfinite(plane)] if isinstance(plane, np.ndarray) else np.zeros(0)
        middle = float(np.median(known)) if known.size else usual
        planes.append(np.where(np.isfinite(plane), plane, np.float32(middle)).astype(np.float32))
    return replace(lobe, shape=tuple(planes))


def _scaled(shape: tuple[Any, ...], factor: float) -> tuple[Any, ...]:
    """A shape whose last number, width or exponent, is multiplied."""
    return (*shape[:-1], (shape[-1] * np.float32(factor)))


def _tilted(normal: NDArray[np.float32], axis: int) -> tuple[Any, Any]:
    """Normals tilted to either side, right and left or up and down."""
    found = []
    for sign in (1.0, -1.0):
        moved = normal.astype(np.float64)
        moved[axis] += sign * TILT
        found.append((moved / np.linalg.norm(moved, axis=0)).astype(np.float32))
    return found[0], found[1]

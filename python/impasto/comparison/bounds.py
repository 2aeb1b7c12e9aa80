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

    def shown(surface: Surface) -> Planes:
        return surface.predict(part.rig)[:, 0].astype(np.float64)

    bare = replace(base, lobes=(), ambient=None)
    black = replace(bare, diffuse=dark)
    # Every band has its own of these ...
    columns = [shown(replace(bare, diffuse=dark + np.float32(1.0)))]
    columns += [shown(replace(black, lobes=(replace(one, strength=1.0),)))
                for one in base.lobes[:count]]  # fmt: skip
    ridge = [np.zeros(part.shape)] * len(columns)
    level = 0.0 if base.ambient is None else _root_mean_square(base.ambient)
    if level > 0.0:
        columns.append(np.ones_like(columns[0]))
        ridge.append((deviation / level) ** 2)
    # ... and these are shared.
    apart = len(columns)
    tilts = []
    for up, down in (_tilted(base.normal, 0), _tilted(base.normal, 1)):
        one, other = (shown(replace(base, normal=normal)) for normal in (up, down))
        tilts.append((one - other) / (2.0 * TILT))
    widths = []
    for lobe in base.lobes[:count]:
        wide, narrow = (
            shown(replace(black, lobes=(replace(lobe, shape=_scaled(lobe.shape, factor)),)))
            for factor in (np.exp(STEP), np.exp(-STEP))
        )
        widths.append((wide - narrow) / (2.0 * STEP))
    columns += tilts if given_normal is None else widths
    ridge += [np.zeros(part.shape)] * (len(columns) - apart)
    table, prior = np.stack(columns, axis=-1), np.stack(ridge, axis=-1)
    whole = _inverse(table, prior)
    alone = _inverse(table[..., :apart], prior[..., :apart])
    variance = deviation**2 * (alone[..., 0, 0] + (whole[..., 0, 0] - alone[..., 0, 0]) / bands)
    strengths = slice(1, 1 + count)
    spread = deviation**2 * whole[..., strengths, strengths].sum(axis=(2, 3)) / bands
    free = deviation[..., None] ** 2 * np.diagonal(whole, axis1=2, axis2=3)[..., apart:] / bands
    if given_normal is None:
        fixed = list(zip(widths, () if gamma_sigma is None else gamma_sigma, strict=True))
    else:
        fixed = [(column, given_normal) for column in tilts]
    for column, sigma in fixed:
        # By how much unknowns move with what was given: least squares of its column on theirs.
        moved = np.einsum("oyxi,oyx->yxi", table, column)
        pull = np.einsum("yxij,yxj->yxi", whole, moved) * np.nan_to_num(sigma)[..., None]
        variance = variance + pull[..., 0] ** 2
        spread = spread + pull[..., strengths].sum(axis=-1) ** 2
        free = free + pull[..., apart:] ** 2
    if given_normal is not None:
        shape = np.moveaxis(np.sqrt(free), -1, 0)
    else:
        shape = np.zeros((0, *part.shape)) if gamma_sigma is None else gamma_sigma.astype(float)
    return Bounds(
        diffuse=np.sqrt(variance),
        beta=np.sqrt(spread) if count else np.full(part.shape, np.nan),
        shape=shape,
    )


def _root_mean_square(planes: NDArray[np.float32]) -> float:
    known = planes[np.isfinite(planes)].astype(np.float64)
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _inverse(table: Planes, prior: Planes) -> Planes:
    """``(y, x, k, k)``: of the products of columns ``(observation, y, x, k)``; NaN where unknown.

    ``prior (y, x, k)``: added to their squares.
    """
    information = np.einsum("oyxi,oyxj->yxij", table, table)
    finite = np.isfinite(information).all(axis=(2, 3)) & np.isfinite(prior).all(axis=2)
    unit = np.eye(table.shape[-1])
    information = np.where(finite[..., None, None], information, unit)
    size = np.diagonal(information, axis1=2, axis2=3)
    # What photographs show nothing of has an error without bounds, and no say.
    empty = size < EMPTY * size.max(axis=2, keepdims=True)
    scale = np.sqrt(np.where(empty, 1.0, size))
    outer = scale[..., :, None] * scale[..., None, :]
    even = np.where(empty[..., :, None] | empty[..., None, :], 0.0, information / outer)
    added = np.where(finite[..., None], prior, 0.0) / scale**2 + np.where(empty, 1.0, RIDGE)
    inverse = np.linalg.inv(even + unit * added[..., None]) / outer
    return np.where(finite[..., None, None], inverse, np.nan)


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

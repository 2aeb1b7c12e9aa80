"""The curl test for mirrored or rotated light directions.

Normals belong to a height, so the slopes p = -nx/nz, q = -ny/nz satisfy dq/dx = dp/dy. Lights that
are mirrored or rotated in the plane of the picture give normals that are mirrored or rotated in
place, and these are not the slopes of any height. Lights rotated by an angle a rotate the slopes
by a; rotated back, their curl is cos(a) C - sin(a) D with C = dq/dx - dp/dy and
D = dp/dx + dq/dy of the measured slopes. Lights mirrored in y and then rotated by a give
cos(a) C' - sin(a) D' with C' = dq/dx + dp/dy and D' = dp/dx - dq/dy. So six sums over the picture
test every rotation and every mirroring at once. Rotation by 180 degrees only changes the sign of
the curl; :mod:`impasto.doctor.falloff` detects it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.doctor.sampled_tiles import SampledTiles

Floats = NDArray[np.float64]

_BLUR = 1.5
"""Standard deviation in pixels. Noise has as much curl as divergence; relief is wider."""
_STEEPEST = 3.0
_BLOCK = 16
_GROUPS = 20
RATIO, SIGMAS = 1.3, 3.0
"""Hypotheses are distinguished if their curls differ by this factor and by this many standard
errors."""


@dataclass(frozen=True, eq=False)
class Curl:
    """Squared curl under every rotation and mirroring.

    Attributes
    ----------
    sums
        ``(block, 2, 3)``: sums of CC, CD, DD in blocks of pixels, unmirrored and mirrored.
    """

    sums: Floats

    @property
    def known(self) -> bool:
        """Whether there are enough pixels with relief for the test."""
        return len(self.sums) >= 4 and bool((self.sums.sum(axis=0)[:, [0, 2]] > 0).all())

    def of(self, rotation_deg: float, mirrored: bool) -> float:
        """Squared curl if the given lights are the true ones, rotated (and mirrored in y)."""
        return float(_energy(self.sums.sum(axis=0)[int(mirrored)], rotation_deg))

    def best_rotation(self, mirrored: bool) -> float:
        """The rotation with the least curl, -90 to 90 degrees; 180 degrees more has the same."""
        cc, cd, dd = self.sums.sum(axis=0)[int(mirrored)]
        values, vectors = np.linalg.eigh(np.array([[cc, -cd], [-cd, dd]]))
        c, s = vectors[:, int(values.argmin())]
        turn = float(np.degrees(np.arctan2(s, c)))
        return (turn + 90.0) % 180.0 - 90.0

    def beats(self, one: tuple[float, bool], other: tuple[float, bool]) -> bool:
        """Whether ``one`` (rotation, mirrored) has significantly less curl than ``other``."""
        groups = np.stack(
            [
                self.sums[i :: min(_GROUPS, len(self.sums))].sum(axis=0)
                for i in range(min(_GROUPS, len(self.sums)))
            ]
        )
        total = groups.sum(axis=0)
        left_out = total - groups

        def log_ratio(sums: Floats) -> Floats:
            first = _energy(sums[..., int(one[1]), :], one[0])
            second = _energy(sums[..., int(other[1]), :], other[0])
            return np.log(np.maximum(second, 1e-300) / np.maximum(first, 1e-300))

        value, parts = float(log_ratio(total)), log_ratio(left_out)
        count = len(groups)
        # Jackknife over groups of blocks that are spread over the picture.
        error = float(np.sqrt((count - 1) / count * ((parts - parts.mean()) ** 2).sum()))
        return value > np.log(RATIO) and value > SIGMAS * error


def measure_curl(sampled: SampledTiles, surface: Floats) -> Curl:
    """Sum up the curl of a surface ``(3, n)`` fitted to sampled tiles."""
    tiles, height, width = sampled.tiles
    fields = _smooth(surface.reshape(3, tiles, height, width))
    with np.errstate(divide="ignore", invalid="ignore"):
        known = fields[2] > 0.1 * np.linalg.norm(fields, axis=0)
        p = np.where(known, np.clip(-fields[0] / fields[2], -_STEEPEST, _STEEPEST), np.nan)
        q = np.where(known, np.clip(-fields[1] / fields[2], -_STEEPEST, _STEEPEST), np.nan)
    px, py, qx, qy = _along_x(p), _along_y(p), _along_x(q), _along_y(q)
    pairs = ((qx - py, px + qy), (qx + py, px - qy))
    products = np.stack([[c * c, c * d, d * d] for c, d in pairs])
    return Curl(_block_sums(products))


def _energy(sums: Floats, rotation_deg: float) -> Floats:
    c, s = np.cos(np.radians(rotation_deg)), np.sin(np.radians(rotation_deg))
    cc, cd, dd = sums[..., 0], sums[..., 1], sums[..., 2]
    return np.asarray(c * c * cc - 2.0 * c * s * cd + s * s * dd)


def _along_x(field: Floats) -> Floats:
    """Differences to the right, at the centre of each 2 x 2 pixels of ``(..., y, x)``."""
    right, left = field[..., :, 1:], field[..., :, :-1]
    return np.asarray(((right - left)[..., :-1, :] + (right - left)[..., 1:, :]) / 2.0)


def _along_y(field: Floats) -> Floats:
    """Differences upwards; rows run down."""
    up, down = field[..., :-1, :], field[..., 1:, :]
    return np.asarray(((up - down)[..., :-1] + (up - down)[..., 1:]) / 2.0)


def _smooth(fields: Floats) -> Floats:
    """Gaussian filter over the last two axes; unknown values have weight 0 and stay unknown."""
    reach = int(np.ceil(2.5 * _BLUR))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / _BLUR) ** 2)
    known = np.isfinite(fields).all(axis=0)
    weight = _convolved(np.asarray(known, dtype=np.float64), kernel)
    smooth = _convolved(np.where(known, fields, 0.0), kernel)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(known, smooth / weight, np.nan))


def _convolved(field: Floats, kernel: Floats) -> Floats:
    for axis in (-2, -1):
        size = field.shape[axis]
        out = np.zeros_like(field)
        reach = len(kernel) // 2
        moved, target = np.moveaxis(field, axis, 0), np.moveaxis(out, axis, 0)
        for shift, weight in enumerate(kernel, start=-reach):
            if abs(shift) < size:
                first, last = max(0, -shift), min(size, size - shift)
                target[first:last] += weight * moved[first + shift : last + shift]
        field = out
    return field


def _block_sums(products: Floats) -> Floats:
    """``(block, 2, 3)`` sums over squares of pixels; blocks without any known pixel are left out.

    ``products`` is ``(2, 3, tile, y, x)``.
    """
    tiles, height, width = products.shape[2:]
    down, across = -(-height // _BLOCK), -(-width // _BLOCK)
    row = np.arange(height) // _BLOCK
    column = np.arange(width) // _BLOCK
    label = (
        np.arange(tiles)[:, None, None] * (down * across)
        + row[None, :, None] * across
        + column[None, None, :]
    )
    known = np.isfinite(products).all(axis=(0, 1))
    count = np.bincount(label[known], minlength=tiles * down * across)
    flat = products.reshape(6, *products.shape[2:])
    sums = np.stack(
        [np.bincount(label[known], weights=plane[known], minlength=len(count)) for plane in flat],
        axis=1,
    )
    return np.asarray(sums[count > 0].reshape(-1, 2, 3))

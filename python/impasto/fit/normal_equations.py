"""Normal equations of a rig and of the surfaces of many pixels, in numbers of the rig alone.

The unknowns of a pixel appear in its own samples only: they are eliminated by their Schur
complement [@triggs2000bundle]. For photographs held out, the elimination follows those fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RIDGE = 1e-4
"""Relative addition to the diagonal of the equations of a pixel, which what is not determined makes
singular."""
_BLOCK = 128
"""Pixels whose derivatives are in memory at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Weighted errors of samples ``(n, band, obs)``, and their derivatives.

    ``shared`` ``(n, band, obs, s)`` by unknowns of the pixel in all bands, ``own`` ``(n, band, obs,
    o)`` by those of a band, ``place`` ``(n, band, obs, q)`` by free inverse distances, ``lamp``
    ``(n, band, obs)`` by the logarithm of the photograph's own strength, None where strengths are
    given. The unknowns of a pixel are the shared ones, then those of each band.
    """

    error: Array
    shared: Array
    own: Array
    place: Array
    lamp: Array | None

    def of(self, pixels: slice, photographs: NDArray[np.bool_]) -> Linear:
        """Some pixels in some photographs."""
        use = slice(None) if photographs.all() else photographs
        parts = (self.error, self.shared, self.own, self.place, self.lamp)
        return Linear(*(None if one is None else one[pixels][:, :, use] for one in parts))  # type: ignore[arg-type]

    def weighted(self, weight: Array) -> Linear:
        """With a weight ``(n,)`` for each pixel."""
        root = np.sqrt(weight)[:, None, None]
        lamp = None if self.lamp is None else self.lamp * root
        wide = root[..., None]
        return Linear(
            self.error * root, self.shared * wide, self.own * wide, self.place * wide, lamp
        )

    def squares(self, photographs: NDArray[np.bool_]) -> Array:
        """``(n, q)`` sums of squares of the derivatives of each pixel by numbers of the rig."""
        places = (self.place**2).sum(axis=(1, 2))
        if self.lamp is None:
            return np.asarray(places)
        lamps = np.zeros((len(places), len(photographs)))
        lamps[:, photographs] = (self.lamp**2).sum(axis=1)
        return np.concatenate([places, lamps], axis=1)

    def by_pixel(self, photographs: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Sums of products: pixel by pixel, and pixel by rig with the errors last.

        Numbers of the rig are the inverse distances, the strengths of all lamps, those of the
        ``photographs`` here among them, and the error as one more column.
        """
        pixel = np.concatenate([self.shared, self.own], axis=-1)
        along = pixel.swapaxes(2, 3)
        among = self._arrow(along @ pixel)
        by_rig = self._column(along @ self._dense)
        if self.lamp is None:
            return among, by_rig
        at, ends, size = self._places(photographs)
        both = np.zeros((*by_rig.shape[:2], size))
        both[..., ends] = by_rig
        # A strength changes its own photograph alone.
        both[..., at] = self._column(along * self.lamp[:, :, None])
        return among, both

    def by_rig(self, photographs: NDArray[np.bool_]) -> Array:
        """The same, rig by rig."""
        flat = self._dense.reshape(len(self.error), -1, self._dense.shape[-1])
        among = _sum_of_products(flat, flat)
        if self.lamp is None:
            return among
        at, ends, size = self._places(photographs)
        total = np.zeros((size, size))
        total[np.ix_(ends, ends)] = among
        total[at, at] = (self.lamp**2).sum(axis=(0, 1))
        cross = (self._dense * self.lamp[..., None]).sum(axis=(0, 1))
        total[np.ix_(at, ends)], total[np.ix_(ends, at)] = cross, cross.T
        return total

    @property
    def _dense(self) -> Array:
        """What every photograph has: derivatives by inverse distances, and the error."""
        return np.concatenate([self.place, self.error[..., None]], axis=-1)

    def _places(self, photographs: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Any, int]:
        """Columns of the strengths, those of the rest, and how many there are."""
        places = self.place.shape[-1]
        size = places + len(photographs) + 1
        return places + np.flatnonzero(photographs), np.r_[0:places, size - 1], size

    def _column(self, products: Array) -> Array:
        """``(n, band, s + o, k)``, the products in each band, for all unknowns of the pixel."""
        shared = self.shared.shape[-1]
        own = products[:, :, shared:].reshape(len(products), -1, products.shape[-1])
        return np.concatenate([products[:, :, :shared].sum(axis=1), own], axis=1)

    def _arrow(self, products: Array) -> Array:
        """The same of the unknowns by each other: those of different bands have no product."""
        count, bands, _, _ = products.shape
        shared, own = self.shared.shape[-1], self.own.shape[-1]
        size = shared + bands * own
        matrix = np.zeros((count, size, size))
        matrix[:, :shared, :shared] = products[:, :, :shared, :shared].sum(axis=1)
        for band in range(bands):
            at = slice(shared + band * own, shared + (band + 1) * own)
            matrix[:, at, at] = products[:, band, shared:, shared:]
            matrix[:, at, :shared] = products[:, band, shared:, :shared]
            matrix[:, :shared, at] = products[:, band, :shared, shared:]
        return matrix


def eliminated(linear: Linear, held: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Normal equations of the rig without the unknowns of the pixels.

    The pixels follow the rig as the photographs say that are fitted, all or those not ``held``;
    the errors are those of the photographs held. With all, this is the Schur complement.
    """
    count = len(linear.error)
    blocks = [slice(at, at + _BLOCK) for at in range(0, count, _BLOCK)]
    size = 1 + linear.place.shape[-1] + (0 if linear.lamp is None else len(held))
    total = np.zeros((size, size))
    if held.all():
        for block in blocks:
            total += _Followed.of(linear, block, held).equations(linear.of(block, held), held)
    else:
        parts = [_Followed.of(linear, block, held) for block in blocks]
        weight = bounded(np.concatenate([part.leverage for part in parts]))
        for block, part in zip(blocks, parts, strict=True):
            shown = linear.of(block, held).weighted(weight[block])
            total += part.weighted(weight[block]).equations(shown, held)
    return total[:-1, :-1].copy(), total[:-1, -1].copy()


def bounded(leverage: Array) -> Array:
    """Weights ``(n,)`` of pixels: bounded influence [@krasker1982bounded], as Mallows weighs.

    A few pixels whose lobe the fitted photographs hardly determine would follow the rig without
    bound, and the rig hardly move.
    """
    usual = np.median(leverage, axis=0)
    usual = np.where(usual > 0.0, usual, np.inf)
    return np.asarray(1.0 / np.maximum((leverage / usual).max(axis=1), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Followed:
    """Products of some pixels, and how their unknowns ``follow`` the rig, ``(n, p, q)``.

    ``alone`` ``(n, q)``: squares of the derivatives by the rig if nothing followed. The first
    ``places`` numbers of the rig are inverse distances.
    """

    pixel: Array
    by_rig: Array
    follow: Array
    alone: Array
    places: int

    @classmethod
    def of(cls, linear: Linear, pixels: slice, held: NDArray[np.bool_]) -> _Followed:
        """Of the pixels' photographs."""
        part = linear.of(pixels, held)
        shown = part.by_pixel(held)
        to_fit = shown if held.all() else linear.of(pixels, ~held).by_pixel(~held)
        # What shows in the photographs held alone, as a highlight may, does not follow.
        both = shown[0] if held.all() else shown[0] + to_fit[0]
        scale = np.sqrt(np.einsum("nkk->nk", both))
        scale[scale == 0.0] = 1.0
        among = to_fit[0] / (scale[:, :, None] * scale[:, None])
        along = to_fit[1] / scale[..., None]
        if not held.all():
            along[..., -1] = 0.0  # they are at their least squares
        follow = np.linalg.solve(among + _RIDGE * np.eye(scale.shape[1]), along)
        return cls(*shown, follow / scale[..., None], part.squares(held), linear.place.shape[-1])

    def weighted(self, weight: Array) -> _Followed:
        """With a weight ``(n,)`` for each pixel, which changes nothing of how it follows."""
        wide = weight[:, None, None]
        return replace(
            self,
            pixel=self.pixel * wide,
            by_rig=self.by_rig * wide,
            alone=self.alone * weight[:, None],
        )

    def equations(self, shown: Linear, photographs: NDArray[np.bool_]) -> Array:
        """Normal equations, the errors last; ``shown``: the pixels in these photographs."""
        # F'B + B'F - F'PF is H + H' with H = F'(B - PF / 2): one product for all lamps, not two.
        half = _sum_of_products(self.follow, self.by_rig - 0.5 * (self.pixel @ self.follow))
        return shown.by_rig(photographs) - half - half.T

    @property
    def leverage(self) -> Array:
        """``(n, k)`` sums of squares of the derivatives of each pixel's errors.

        By every free inverse distance, and by all strengths together.
        """
        apart = self.pixel @ self.follow - 2.0 * self.by_rig
        squares = (self.follow * apart).sum(axis=1)[:, :-1] + self.alone
        places, lamps = np.split(squares, [self.places], axis=1)
        return np.column_stack([places, lamps.sum(axis=1)])


def solved(matrix: Array, right: Array, row: Array, use: NDArray[np.bool_]) -> Array:
    """The least squares step of the numbers in ``use``, 0 of the others.

    ``row @ step = 0`` where the row is not 0 (Lagrange multiplier).
    """
    scale = np.sqrt(np.maximum(np.diag(matrix)[use], np.finfo(np.float64).tiny))
    system, right = matrix[np.ix_(use, use)] / np.outer(scale, scale), right[use] / scale
    row = row[use] / scale
    if row.any():
        row = row[None] / np.linalg.norm(row)
        system = np.block([[system, row.T], [row, np.zeros((1, 1))]])
        right = np.append(right, 0.0)
    step = np.zeros(len(use))
    step[use] = np.linalg.lstsq(system, right, rcond=None)[0][: len(scale)] / scale
    return step


def _sum_of_products(one: Array, other: Array) -> Array:
    """The sum over pixels of ``one.T @ other``, ``(n, k, q)`` and ``(n, k, r)`` to ``(q, r)``.

    Pixel by pixel: BLAS divides a large product among its threads, and the bits of the sum would
    depend on their number.
    """
    total = np.zeros((one.shape[2], other.shape[2]))
    for left, right in zip(one, other, strict=True):
        total += left.T @ right
    return total

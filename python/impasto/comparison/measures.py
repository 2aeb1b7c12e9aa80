"""How much an area of a comparison changed: sums over its pixels, and means of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.comparison.entries import RATIOS, Changed, Compared

SUMS = ("pixels", "angle", "coloured", "delta_e", "lobed", "log_beta", "normal", "colour", "gloss")
"""What is added up over an area."""


@dataclass(frozen=True)
class Measures:
    """What an area has.

    Attributes
    ----------
    pixels
        Pixels that were compared.
    normal, colour, gloss
        Means of the angle (degrees) and of dE00, and the geometric mean of the ratio of beta.
    changed
        Shares of compared pixels whose normal, colour and gloss changed significantly.
    """

    pixels: int
    normal: float
    colour: float
    gloss: float
    changed: tuple[float, float, float]

    @classmethod
    def of(cls, sums: NDArray[np.float64]) -> Measures:
        """From the sums of :data:`SUMS`; there is a pixel at least."""
        one = dict(zip(SUMS, sums.tolist(), strict=True))
        return cls(
            pixels=int(one["pixels"]),
            normal=one["angle"] / one["pixels"],
            colour=_divided(one["delta_e"], one["coloured"]),
            gloss=float(np.exp(_divided(one["log_beta"], one["lobed"]))),
            changed=(
                one["normal"] / one["pixels"],
                one["colour"] / one["pixels"],
                one["gloss"] / one["pixels"],
            ),
        )


def planes_of(maps: Mapping[str, NDArray[Any]]) -> tuple[NDArray[Any], ...]:
    """Planes ``(y, x)`` in the order of :data:`SUMS`, 0 where nothing is known."""
    fine = maps["status"] < Compared.OUTSIDE
    beta, colour, changed = maps["beta_ratio"], maps["delta_e"], maps["changed"]
    lobed = fine & ~np.isnan(beta)
    coloured = fine & np.isfinite(colour)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (
            fine, np.where(fine, np.degrees(maps["angle"]), 0.0),
            coloured, np.where(coloured, colour, 0.0),
            lobed, np.where(lobed, np.log(np.clip(beta, *RATIOS)), 0.0),
            *((fine & ((changed & flag) > 0)) for flag in Changed),
        )  # fmt: skip


def measured(
    place: NDArray[np.integer[Any]], count: int, planes: Sequence[NDArray[Any]]
) -> NDArray[np.float64]:
    """``(sum, count)``: sums of planes over the pixels of each place."""
    flat = place.ravel()
    return np.stack(
        [np.bincount(flat, plane.ravel().astype(np.float64), count) for plane in planes]
    )


def _divided(total: float, count: float) -> float:
    return total / count if count else float("nan")

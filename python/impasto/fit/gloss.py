"""The gloss of a whole painting in two numbers, whatever the kind of result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.16, 0.84)
"""One standard deviation to either side, where numbers are normally distributed."""


@dataclass(frozen=True)
class Gloss:
    """One (beta, gamma) for a painting and how far to trust or to spread it.

    Attributes
    ----------
    beta
        Strength relative to the white board (six-band paper eq. 1); 0 where there is no highlight.
    gamma
        Half-width of the facets in radians; NaN where there is no highlight.
    beta_range, gamma_range
        The middle 68 %: of the estimate's uncertainty (``source="fit"``: one standard deviation of
        its logarithm to either side), or of the pixels (``source="pixels"``: 16 % and 84 %
        quantiles). NaN where unknown.
    share
        ``"fit"``: share of the pixels that agree with the pair, ``describes`` of a
        :class:`~impasto.PooledSbrdf`; ``"pixels"``: share of the estimated pixels with a lobe.
    source
        ``"fit"``: one lobe was fitted to all pixels. ``"pixels"``: medians over the estimated
        pixels that have a lobe, each by the lobe that reflects most in all (strength times squared
        width), its strength being the mean over the bands.
    """

    beta: float
    gamma: float
    beta_range: tuple[float, float]
    gamma_range: tuple[float, float]
    share: float
    source: Literal["fit", "pixels"]

    def __str__(self) -> str:
        if self.beta == 0.0:
            return "no highlight"
        low, high = (math.degrees(angle) for angle in self.gamma_range)
        return (
            f"beta {self.beta:.3g} ({self.beta_range[0]:.3g} to {self.beta_range[1]:.3g}), "
            f"gamma {math.degrees(self.gamma):.3g}° ({low:.3g}° to {high:.3g}°)"
        )


def fitted_gloss(beta: float, gamma: float, covariance: NDArray[Any], share: float) -> Gloss:
    """The pair of a pooled fit; ``covariance (2, 2)`` is that of (log beta, log gamma)."""
    if not beta > 0.0:
        return no_gloss("fit", share)
    deviations = [math.sqrt(float(variance)) for variance in np.diag(covariance)]

    def around(value: float, deviation: float) -> tuple[float, float]:
        if not deviation < 300.0:  # beyond it exp leaves the range of a double
            return 0.0, math.inf
        return value * math.exp(-deviation), value * math.exp(deviation)

    return Gloss(
        beta=float(beta),
        gamma=float(gamma),
        beta_range=around(float(beta), deviations[0]),
        gamma_range=around(float(gamma), deviations[1]),
        share=float(share),
        source="fit",
    )


def gloss_of_pixels(
    strength: NDArray[Any], width: NDArray[Any], estimated: NDArray[np.bool_]
) -> Gloss:
    """Medians over pixels.

    Parameters
    ----------
    strength, width
        ``(lobe, y, x)``: beta and gamma of each lobe; not above 0 or NaN where there is none.
    estimated
        ``(y, x)``.
    """
    there = (strength > 0.0) & np.isfinite(width) & estimated
    energy = np.where(there, strength * width**2, -np.inf)
    most = energy.argmax(axis=0)[None]
    has = there.any(axis=0)
    count = int(np.count_nonzero(estimated))
    if not has.any():
        return no_gloss("pixels", 0.0 if count else math.nan)
    pair = [np.take_along_axis(map_, most, axis=0)[0][has] for map_ in (strength, width)]
    (beta_low, beta, beta_high), (low, gamma, high) = (
        np.quantile(values.astype(np.float64), (QUANTILES[0], 0.5, QUANTILES[1])).tolist()
        for values in pair
    )
    return Gloss(
        beta=beta,
        gamma=gamma,
        beta_range=(beta_low, beta_high),
        gamma_range=(low, high),
        share=int(np.count_nonzero(has)) / count,
        source="pixels",
    )


def no_gloss(source: Literal["fit", "pixels"], share: float) -> Gloss:
    """What is said of a painting without a highlight."""
    unknown = (math.nan, math.nan)
    return Gloss(0.0, math.nan, unknown, unknown, float(share), source)

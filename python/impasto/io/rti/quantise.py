"""Coefficients as planes of 8-bit codes with a scale and a bias each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.io.rti.bases import Basis, Floats
from impasto.io.rti.image import Coding, RelightableImage

_LEAST = 1e-6
"""Range of a plane that is constant: its scale must not be 0."""


def quantised(
    coefficients: NDArray[np.float32],
    basis: Basis,
    *,
    shared: bool = False,
    whole: bool = False,
    coding: Coding = "srgb",
    **options: Any,
) -> RelightableImage:
    """Round coefficients to the 256 codes between their least and their greatest.

    Parameters
    ----------
    coefficients
        ``(function, 3, y, x)``; NaN becomes the code of 0, or the nearest to it.
    basis
        The functions, in that order.
    shared
        Whether the three channels of a function have the same scale and bias, as ``.ptm`` and
        ``.rti`` need.
    whole
        Whether 0 falls on a whole code (the bias of ``.ptm``).
    coding, **options
        Of :class:`RelightableImage`.

    Returns
    -------
    RelightableImage
        Every coefficient within half a step of what was given: a step is 1/255 of the range, or
        1/254 where ``whole`` widens it.

    Raises
    ------
    ArgumentError
        A shape that does not fit the functions.
    """
    if coefficients.ndim != 4 or coefficients.shape[:2] != (basis.terms, 3):
        raise ArgumentError(
            f"coefficients: expected ({basis.terms}, 3, y, x), found shape {coefficients.shape}"
        )
    known = np.isfinite(coefficients)
    axes = (1, 2, 3) if shared else (2, 3)
    zero = np.float32(0.0)
    low = np.min(coefficients, axis=axes, where=known, initial=np.inf)
    high = np.max(coefficients, axis=axes, where=known, initial=-np.inf)
    empty = ~np.isfinite(low)
    low, high = (np.where(empty, zero, one).astype(np.float64) for one in (low, high))
    if shared:
        low, high = (np.repeat(one[:, None], 3, axis=1) for one in (low, high))
    scale, bias = _whole(low, high) if whole else _between(low, high)
    codes = np.rint(
        (np.where(known, coefficients, zero) - bias[..., None, None]) / scale[..., None, None]
    )
    planes = np.clip(codes, 0, 255).astype(np.uint8)
    return RelightableImage(
        planes=planes.reshape(-1, *planes.shape[2:]),
        scale=scale.reshape(-1),
        bias=bias.reshape(-1),
        basis=basis,
        coding=coding,
        **options,
    )


def _between(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    scale = np.maximum(high - low, _LEAST) / 255.0
    return scale, low


def _whole(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Scales for which 0 falls on a whole code from 0 to 255, and the biases."""
    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    scale = np.maximum(high - low, _LEAST) / 254.0
    return scale, -np.ceil(-low / scale - 1e-9) * scale

"""Photographs as grey pictures for detectors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.highlight import luma
from impasto.encoding import Encoding

BRIGHT = 99.5
"""Percentile of the light that becomes white: highlights count for nothing."""
ROOT = 2.2


def light_from(codes: NDArray[Any], curve: Encoding | None = None) -> NDArray[np.float32]:
    """Linear light ``(y, x)``, white about 1, from codes ``(band, y, x)``.

    An edge lies in the middle of its slope in linear light, not in codes of a tone curve. Without a
    curve, codes of 8 bits are sRGB and others linear.
    """
    if curve is None and codes.dtype == np.uint8:
        curve = Encoding("srgb", 255.0)
    light = luma(codes if curve is None else curve.decode(codes))
    light = np.clip(np.nan_to_num(light, nan=0.0, posinf=0.0), 0.0, None)
    top = float(np.percentile(light, BRIGHT))
    return np.minimum(light / max(top, 1e-12), 4.0).astype(np.float32)


def grey_from(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """8 bits of what :func:`light_from` returns, through a tone curve that keeps the dark half."""
    return np.rint(255.0 * np.minimum(light, 1.0) ** (1.0 / ROOT)).astype(np.uint8)

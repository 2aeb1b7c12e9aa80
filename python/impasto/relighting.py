"""How far what a fit expects is from photographs that it did not see."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.stack import Stack


def full_scale(stack: Stack) -> NDArray[np.float32]:
    """``(band, 1, 1)`` linear light from which the camera sees no more; infinite if unknown."""
    if stack.saturation is None:
        return np.full((stack.shape[1], 1, 1), np.inf, np.float32)
    top = (stack.saturation - stack.black) * stack.scale
    return np.asarray(top[:, None, None], dtype=np.float32)


def relative_error(
    shown: NDArray[Any], truth: NDArray[Any], top: NDArray[np.float32] | float = np.inf
) -> float:
    """Root mean square of the differences over that of the truth, both cut off at ``top``.

    What the fit does not know counts as black; what the photographs do not know (NaN, or +inf
    without a ``top``) does not count. Where all photographs are black it is 0 if black is what was
    expected, else infinite; where they know nothing at all, NaN.
    """
    real = np.minimum(truth, top).astype(np.float64)
    seen = np.isfinite(real)
    if not seen.any():
        return float("nan")
    expected = np.clip(np.nan_to_num(shown, nan=0.0, posinf=np.inf), 0.0, top)[seen]
    real = real[seen]
    missed, there = float(((expected - real) ** 2).sum()), float((real**2).sum())
    if there == 0.0:
        return 0.0 if missed == 0.0 else float("inf")
    return float(np.sqrt(missed / there))

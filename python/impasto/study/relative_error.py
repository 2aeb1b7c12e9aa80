"""The relative error of a prediction of held-out photographs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.stack import Stack


def full_scale(stack: Stack) -> NDArray[np.float32]:
    """``(band, 1, 1)`` linear light at which the camera clips; infinite if unknown."""
    if stack.saturation is None:
        return np.full((stack.shape[1], 1, 1), np.inf, np.float32)
    top = (stack.saturation - stack.black) * stack.scale
    return np.asarray(top[:, None, None], dtype=np.float32)


def relative_error(
    shown: NDArray[Any], truth: NDArray[Any], top: NDArray[np.float32] | float = np.inf
) -> float:
    """Root mean square error over the root mean square of the truth, both clipped at ``top``.

    Parameters
    ----------
    shown
        The prediction; NaN, where there is none, counts as black.
    truth
        The photographs; samples that are NaN, or +inf without a ``top``, do not count.
    top
        Linear light at which both are clipped, as from :func:`full_scale`.

    Returns
    -------
    float
        Infinite if all photographs are black and the prediction is not, 0 if it is; NaN if no
        sample counts.
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

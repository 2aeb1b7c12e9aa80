"""Arrays in another precision, without numpy's warnings.

Damaged files hold NaN that signal, and numbers that only a long double has; processors raise a flag
where these are converted, of which numpy warns. They become NaN and infinity, for which whoever
converts an array looks anyway.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


def quiet_cast() -> np.errstate:
    """What surrounds a conversion."""
    return np.errstate(invalid="ignore", over="ignore")


def contiguous(values: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """An array of a type, C-contiguous; the array itself where it is that already.

    A number alone becomes ``(1,)``.
    """
    with quiet_cast():
        return np.ascontiguousarray(values, dtype=dtype)

"""Quarter turns of vectors about the axis that points to the viewer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError


def quarter_turns_of(value: Any) -> int:
    """0 to 3 quarter turns counterclockwise, from any whole number."""
    if not is_whole(value):
        raise ArgumentError(f"quarter_turns: expected a whole number, found {value!r}")
    return int(value) % 4


def rotated_vector(vector: tuple[float, float, float], turns: int) -> tuple[float, float, float]:
    """A vector after quarter turns counterclockwise about z."""
    x, y, z = vector
    for _ in range(turns):
        x, y = -y, x
    return x, y, z


def rotated_rows(vectors: NDArray[np.float64], turns: int) -> NDArray[np.float64]:
    """Vectors ``(n, 3)`` after quarter turns counterclockwise about z."""
    return np.array(
        [rotated_vector((x, y, z), turns) for x, y, z in vectors.tolist()], dtype=np.float64
    )

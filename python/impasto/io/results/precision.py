"""Maps in half precision: which of them a store may keep so, and what readers get.

Half precision has 11 bits: a colour changes by 0.05 % of itself, a normal by 0.024 degrees at
most. Numbers below 2**-14 have fewer bits and change by 2**-25, 3e-8, at most. The largest number
is 65504.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError

Precision: TypeAlias = Literal["single", "half"]
PRECISIONS = ("single", "half")
HALF = {"normal", "albedo", "diffuse", "ambient", "specular", "gamma", "residual", "sigma"}
"""Maps whose numbers are parts of unit vectors, light relative to the white board, or angles; also
those of photometric stereo (``normals.albedo``) and strengths and widths of the smaller scales."""
LEVEL = {"strength", "gamma"}
"""The same of the lobes of a smaller scale, ``levels/2/lobe1.strength``."""


def checked_precision(precision: Any) -> Precision:
    """``"single"`` or ``"half"``.

    Raises
    ------
    ArgumentError
        Anything else.
    """
    one_of(precision, PRECISIONS, "precision")
    found: Precision = precision
    return found


def to_store(name: str, plane: NDArray[Any], precision: Precision) -> NDArray[Any]:
    """A map, in half precision if that is asked for and enough for it.

    Raises
    ------
    ArgumentError
        A number beyond 65504.
    """
    if precision == "single" or plane.dtype != np.float32 or not _fits(name):
        return plane
    half = _converted(plane, np.float16)
    lost = (half.view(np.uint16) & 0x7FFF) == 0x7C00  # isinf, in a third of its time
    if lost.any() and (found := np.abs(plane[lost & np.isfinite(plane)])).size:
        raise ArgumentError(
            f"precision: {name} holds {found.max():g}, and half precision reaches to 65504; use "
            'precision="single" (--precision single), or give photographs relative to a white board'
        )
    return half


def from_store(name: str, found: NDArray[Any]) -> NDArray[Any]:
    """A map as computations take it: single precision, normals with a length of 1.

    What is half precision by itself, residuals and photographs, stays so.
    """
    if found.dtype != np.float16 or not _fits(name):
        return found
    single = _converted(found, np.float32)
    if name.rsplit(".", 1)[-1].rsplit("/", 1)[-1] == "normal":
        single /= np.sqrt(np.einsum("a...,a...->...", single, single))
    return single


def _converted(plane: NDArray[Any], dtype: type[np.floating[Any]]) -> NDArray[Any]:
    """Half to single precision or back, to the nearest; OpenCV does in vectors what numpy does."""
    if plane.size == 0:
        return plane.astype(dtype)
    import cv2

    # Rows of the last axis: what has more axes would be channels.
    rows = np.ascontiguousarray(plane).reshape(-1, plane.shape[-1])
    found = cv2.multiply(rows, 1.0, dtype=cv2.CV_16F if dtype is np.float16 else cv2.CV_32F)
    return np.asarray(found).reshape(plane.shape)


def _fits(name: str) -> bool:
    last = name.rsplit("/", 1)[-1].rsplit(".", 1)[-1]
    return last in (HALF | LEVEL if name.startswith("levels/") else HALF)

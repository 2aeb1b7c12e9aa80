"""Tone curves between linear light and the codes of a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError


@dataclass(frozen=True, slots=True)
class Encoding:
    """A tone curve between linear light (white board 1.0) and a file's coded values.

    Parameters
    ----------
    curve
        ``"linear"``, ``"srgb"`` (IEC 61966-2-1) or a gamma such as ``"2.2"``.
    white
        The coded value of full scale: 255, 65535, or 1.0 for float files.
    """

    curve: str = "linear"
    white: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "curve", str(self.curve).lower())
        if self.curve not in {"linear", "srgb"}:
            try:
                gamma = float(self.curve.removeprefix("gamma:").removeprefix("gamma"))
            except ValueError:
                gamma = float("nan")
            if not 0.2 <= gamma <= 5.0:
                raise ArgumentError(
                    f'encoding: expected "linear", "srgb", a gamma from 0.2 to 5 or "auto", '
                    f"found {self.curve!r}"
                )
            object.__setattr__(self, "curve", f"{gamma:g}")
        if not (np.isfinite(self.white) and self.white > 0):
            raise ArgumentError(f"white: expected a positive full-scale code, found {self.white}")

    def decode(self, coded: ArrayLike) -> NDArray[np.float32]:
        """Linear light from coded values, any shape; full scale becomes 1.0."""
        value = np.asarray(coded, dtype=np.float64) / self.white
        if self.curve == "linear":
            return np.asarray(value, dtype=np.float32)
        magnitude = np.abs(value)
        if self.curve == "srgb":
            linear = np.where(
                magnitude <= 0.04045, magnitude / 12.92, ((magnitude + 0.055) / 1.055) ** 2.4
            )
        else:
            linear = magnitude ** float(self.curve)
        return np.asarray(np.copysign(linear, value), dtype=np.float32)

    def encode(self, linear: ArrayLike, *, clip: bool = True) -> NDArray[np.float32]:
        """Coded values from linear light, clipped to 0 .. ``white``, not rounded.

        With ``clip=False`` light above full scale follows the curve beyond ``white``.
        """
        value = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0 if clip else None)
        if self.curve == "srgb":
            value = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
        elif self.curve != "linear":
            value = value ** (1.0 / float(self.curve))
        return np.asarray(value * self.white, dtype=np.float32)

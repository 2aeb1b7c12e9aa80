"""Tone curves between linear light and the codes of a file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.casts import quiet_cast
from impasto.errors import ArgumentError

POINTS = "points:"
"""Begins a measured curve."""


def curve_of_points(codes: ArrayLike, light: ArrayLike) -> str:
    """The curve that joins points of a measured one, as :class:`Encoding` takes it.

    Parameters
    ----------
    codes, light
        ``(n,)`` shares of full scale, from 0 to 1.

    Raises
    ------
    ArgumentError
        Points that do not rise, or do not begin with 0,0 and end with 1,1.
    """
    pairs = zip(np.ravel(codes).tolist(), np.ravel(light).tolist(), strict=True)
    curve = POINTS + " ".join(f"{code:.9g},{value:.9g}" for code, value in pairs)
    _points(curve)
    return curve


@lru_cache(maxsize=16)
def _points(curve: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    try:
        pairs = [pair.split(",") for pair in curve.removeprefix(POINTS).split()]
        codes, light = np.array(pairs, dtype=np.float64).T
    except ValueError as error:
        raise ArgumentError(f"encoding: expected points as 0,0 0.5,0.21 1,1 ({error})") from error
    ends = (codes[0], light[0], codes[-1], light[-1]) == (0.0, 0.0, 1.0, 1.0)
    # No differences: those of infinite points are no numbers. NaN do not rise.
    rises = (codes[1:] > codes[:-1]).all() and (light[1:] >= light[:-1]).all()
    if len(codes) < 2 or not ends or not rises:
        raise ArgumentError(
            "encoding: points of a tone curve rise from 0,0 to 1,1, found "
            f"{curve.removeprefix(POINTS)[:60]!r}"
        )
    return codes, light


def _joined(
    value: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Straight lines through points; the last one goes on."""
    slope = (y[-1] - y[-2]) / max(float(x[-1] - x[-2]), 1e-12)
    inside = np.interp(value, x, y)
    return np.asarray(np.where(value > 1.0, 1.0 + (value - 1.0) * slope, inside))


@dataclass(frozen=True, slots=True)
class Encoding:
    """A tone curve between linear light (white board 1.0) and a file's coded values.

    Parameters
    ----------
    curve
        ``"linear"``, ``"srgb"`` (IEC 61966-2-1), a gamma such as ``"2.2"``, or points of a measured
        curve, ``"points:0,0 0.5,0.21 1,1"``: code and light as shares of full scale, from 0,0 to
        1,1, rising, joined by straight lines.
    white
        The coded value of full scale: 255, 65535, or 1.0 for float files.
    """

    curve: str = "linear"
    white: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "curve", str(self.curve).lower())
        if self.curve.startswith(POINTS):
            _points(self.curve)
        elif self.curve not in {"linear", "srgb"}:
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

    @property
    def name(self) -> str:
        """The curve for people: that of points is ``"measured"``."""
        return "measured" if self.curve.startswith(POINTS) else self.curve

    @quiet_cast()
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
        elif self.curve.startswith(POINTS):
            codes, light = _points(self.curve)
            linear = _joined(magnitude, codes, light)
        else:
            linear = magnitude ** float(self.curve)
        return np.asarray(np.copysign(linear, value), dtype=np.float32)

    @quiet_cast()
    def encode(self, linear: ArrayLike, *, clip: bool = True) -> NDArray[np.float32]:
        """Coded values from linear light, clipped to 0 .. ``white``, not rounded.

        With ``clip=False`` light above full scale follows the curve beyond ``white``.
        """
        found = np.asarray(linear)
        # Single precision is as exact as what is returned.
        precise = found if found.dtype == np.float32 else found.astype(np.float64, copy=False)
        value = np.asarray(np.clip(precise, 0.0, 1.0 if clip else None))
        if self.curve == "srgb":
            # In place: a new array for every step takes as long as the power.
            straight = 12.92 * value
            np.power(value, 1 / 2.4, out=value)
            value *= 1.055
            value -= 0.055
            np.copyto(value, straight, where=straight <= 12.92 * 0.0031308)
        elif self.curve.startswith(POINTS):
            codes, light = _points(self.curve)
            value = _joined(value, light, codes)
        elif self.curve != "linear":
            value = value ** (1.0 / float(self.curve))
        value *= self.white
        return np.asarray(value, dtype=np.float32)

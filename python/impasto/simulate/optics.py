"""What a lens does to a photograph: distortion, blur and vignetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import number, numbers
from impasto.errors import ArgumentError
from impasto.simulate.fields import Field, blur

OVERSHOOT = 25.0 / 16.0
"""Most that cubic convolution along rows and columns magnifies an error: the largest sum of
magnitudes of its weights, 5/4 along each."""

_STEPS = 30
"""Newton's method halves no error less than once a step: 30 steps are beyond single precision."""


@dataclass(frozen=True, slots=True)
class Optics:
    """A lens with faults; the default has none.

    The light of a photograph is distorted first, then blurred, then weakened towards the corners.
    Radii are shares of half the diagonal of the picture.

    Parameters
    ----------
    vignetting
        Share of the light that is missing in the corners, 0 to below 1, by the cos^4 law
        [@reiss1945cos4]: ``1 / (1 + (c r)^2)^2``.
    distortion
        ``(k1, k2)`` of radial distortion [@brown1971close]: what lies at radius r is seen at
        ``r (1 + k1 r^2 + k2 r^4)``. k1 below 0 is a barrel, above 0 a cushion. Beyond the
        painting its edge is repeated.
    blur
        Standard deviation of a Gaussian point spread function in pixels.

    Raises
    ------
    ArgumentError
        A number out of range; a distortion that shows two places of the painting in one.
    """

    vignetting: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0

    def __post_init__(self) -> None:
        share = number(self.vignetting, "vignetting", "a share from 0 to below 1")
        if not 0.0 <= share < 1.0:
            raise ArgumentError(f"vignetting: expected a share from 0 to below 1, found {share!r}")
        pair = numbers(self.distortion, "distortion", "two numbers (k1, k2)")
        if pair.shape != (2,) or not np.isfinite(pair).all():
            raise ArgumentError(
                f"distortion: expected two numbers (k1, k2), found {self.distortion!r}"
            )
        k1, k2 = float(pair[0]), float(pair[1])
        object.__setattr__(self, "distortion", (k1, k2))
        # Seen radii rise with true ones as far as the corner sees, and a little farther.
        radius = np.linspace(0.0, 2.0, 2001)
        seen = radius * (1.0 + k1 * radius**2 + k2 * radius**4)
        reach = int(np.searchsorted(np.maximum.accumulate(seen), 1.0)) + 1
        if reach > len(radius) - 1 or (np.diff(seen[: reach + 1]) <= 0.0).any():
            raise ArgumentError(
                f"distortion: ({k1:g}, {k2:g}) folds the picture within its corners, or magnifies "
                "them more than twice; expected smaller numbers"
            )
        sigma = number(self.blur, "blur", "pixels from 0 on")
        if not 0.0 <= sigma <= 100.0:
            raise ArgumentError(f"blur: expected 0 to 100 pixels, found {sigma!r}")

    @property
    def distorts(self) -> bool:
        """Whether there is any distortion."""
        return self.distortion != (0.0, 0.0)

    def flat(self, shape: tuple[int, int]) -> Field:
        """``(y, x)``: the share of the light that arrives, 1 in the middle."""
        x, y = _positions(shape)
        falloff = 1.0 / np.sqrt(1.0 - self.vignetting) - 1.0
        return np.asarray((1.0 + falloff * (x * x + y * y)) ** -2, dtype=np.float32)

    def sources(self, shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Column and row ``(y, x)`` of the painting that each pixel of the photograph shows."""
        x, y = _positions(shape)
        k1, k2 = self.distortion
        seen = np.hypot(x, y)
        radius = seen.copy()
        for _ in range(_STEPS):
            square = radius * radius
            excess = radius * (1.0 + square * (k1 + k2 * square)) - seen
            step = excess / (1.0 + square * (3.0 * k1 + 5.0 * k2 * square))
            radius -= step
            if np.abs(step).max() <= 1e-12:
                break
        factor = np.divide(radius, seen, out=np.ones_like(seen), where=seen > 0.0)
        half = 0.5 * np.hypot(*shape)
        rows, columns = shape
        return factor * x * half + 0.5 * (columns - 1), factor * y * half + 0.5 * (rows - 1)

    def displacement(self, shape: tuple[int, int]) -> tuple[float, float]:
        """The farthest that distortion moves a pixel along rows and along columns, in pixels."""
        if not self.distorts:
            return 0.0, 0.0
        x, y = self.sources(shape)
        rows, columns = np.indices(shape)
        return float(np.abs(x - columns).max()), float(np.abs(y - rows).max())

    def distorted(self, light: Field) -> Field:
        """Light ``(band, y, x)`` where the lens shows it, by cubic convolution."""
        if not self.distorts:
            return light
        return _resampled(light, *self.sources((light.shape[1], light.shape[2])))

    def blurred(self, light: Field) -> Field:
        """Light ``(band, y, x)`` spread by the point spread function."""
        if self.blur == 0.0:
            return light
        return np.stack([blur(plane, self.blur) for plane in light])

    def moved(self, shape: tuple[int, int]) -> float:
        """Most that distortion changes a pixel of a picture of values from 0 to 1.

        Moved by a share t of a pixel, the weights of cubic convolution [@keys1981cubic] differ by
        ``s(t) = t + 4 t^2 - 3 t^3`` in sum of magnitudes from those of the pixel itself, and their
        magnitudes sum up to ``1 + t - t^2``. Differences of weights sum up to 0, so that a picture
        within 0 and 1 changes by at most half of the sum of their magnitudes. Displacements beyond
        half a pixel may change anything.
        """
        x, y = self.displacement(shape)
        if max(x, y) > 0.5:
            return 1.0
        both = _differs(x) * (1.0 + y - y * y) + _differs(y)
        return min(0.5 * both, 1.0)

    def spread(self) -> float:
        """Most that blur changes a pixel of a picture of values from 0 to 1: what it loses."""
        if self.blur == 0.0:
            return 0.0
        side = 2 * int(np.ceil(6.0 * self.blur)) + 9
        point = np.zeros((side, side), dtype=np.float32)
        point[side // 2, side // 2] = 1.0
        shown = blur(point, self.blur).astype(np.float64)
        shown[side // 2, side // 2] = 0.0
        return float(shown.sum())


def _differs(t: float) -> float:
    return t + 4.0 * t**2 - 3.0 * t**3


def _positions(shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """``(y, x)`` columns and rows from the middle, as shares of half the diagonal."""
    rows, columns = shape
    half = 0.5 * np.hypot(rows, columns)
    y, x = np.indices(shape, dtype=np.float64)
    return (x - 0.5 * (columns - 1)) / half, (y - 0.5 * (rows - 1)) / half


def _weights(t: NDArray[np.float64]) -> list[Field]:
    """Of the four neighbours of a place a share t past the second: Keys' kernel, a = -1/2."""
    square, cube = t * t, t * t * t
    return [
        np.asarray(weight, dtype=np.float32)
        for weight in (
            -0.5 * t + square - 0.5 * cube,
            1.0 - 2.5 * square + 1.5 * cube,
            0.5 * t + 2.0 * square - 1.5 * cube,
            -0.5 * square + 0.5 * cube,
        )
    ]


def _resampled(light: Field, x: NDArray[np.float64], y: NDArray[np.float64]) -> Field:
    """Light ``(band, y, x)`` at columns ``x`` and rows ``y`` by cubic convolution."""
    rows, columns = light.shape[1:]
    left, top = np.floor(x), np.floor(y)
    across, down = _weights(x - left), _weights(y - top)
    at = [np.clip(left.astype(np.int64) + i, 0, columns - 1) for i in range(-1, 3)]
    out = np.zeros_like(light)
    for j, vertical in enumerate(down):
        row = np.clip(top.astype(np.int64) + j - 1, 0, rows - 1)
        for column, horizontal in zip(at, across, strict=True):
            out += (vertical * horizontal) * light[:, row, column]
    # The kernel overshoots beside highlights; there is no light below none.
    return np.maximum(out, np.float32(0.0))

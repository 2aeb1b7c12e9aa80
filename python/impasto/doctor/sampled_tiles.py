"""The pixels that are examined: bounded memory for a stack of any size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.casts import quiet_cast
from impasto.lights import PointLight
from impasto.rig import Rig
from impasto.stack import Stack

Floats = NDArray[np.float64]

_TILES = 3
"""Tiles along each side of a large picture."""
_SAMPLES = 12_000_000
"""Samples kept in memory (48 MB as float32) ..."""
_MOST, _FEWEST = 40_000, 2_500
"""... and the bounds on the number of pixels that follows from it."""
_BRIGHT = 0.1
"""Least share of a bright pixel's light: black cloth around an object is no part of it."""


@dataclass(frozen=True, eq=False)
class SampledTiles:
    """Tiles of a stack at full resolution, evenly spread over the painting.

    The curl of a surface needs neighbouring pixels, and the relief of paint has no low
    frequencies.

    Attributes
    ----------
    grey
        ``(obs, n)`` float32: mean of the bands in linear light, divided by the intensity of the
        light; NaN where a band is clipped, not finite or outside the mask, and in pixels that
        are nearly black in most photographs.
    lights
        ``(obs, 3)`` directions, or ``(obs, n, 3)`` for point lights: direction at each pixel times
        fall-off, so that a Lambert surface shows ``lights . albedo normal``.
    tiles
        ``(tile, y, x)``: the shape of the n pixels.
    x, y
        ``(n,)`` position on the painting, x right, y up, the longer side from -0.5 to 0.5.
    inside
        ``(n,)``: whether the mask holds the pixel and it is not nearly black.
    """

    grey: NDArray[np.float32]
    lights: Floats
    tiles: tuple[int, int, int]
    x: Floats
    y: Floats
    inside: NDArray[np.bool_]

    @classmethod
    def of(
        cls, stack: Stack, *, photographs: Sequence[int] | None = None, most: int = _MOST
    ) -> SampledTiles:
        """Cut the tiles out of a stack, or out of some of its photographs.

        ``most`` bounds the number of pixels.
        """
        picked = range(len(stack.rig)) if photographs is None else photographs
        _, bands, height, width = stack.shape
        budget = min(int(np.clip(_SAMPLES // (len(picked) * bands), _FEWEST, _MOST)), most)
        rows, columns, tile = _places(height, width, budget, stack.mask)
        at_y = (rows[:, None, None] + np.arange(tile[0])[None, :, None]).repeat(tile[1], 2)
        at_x = (columns[:, None, None] + np.arange(tile[1])[None, None, :]).repeat(tile[0], 1)
        at_y, at_x = at_y.ravel(), at_x.ravel()
        inside = np.ones(len(at_y), bool) if stack.mask is None else stack.mask[at_y, at_x]
        rig = stack.rig if photographs is None else stack.rig.take(picked)
        grey = np.empty((len(picked), len(at_y)), dtype=np.float32)
        for row, index in enumerate(picked):
            values = linear(stack, stack.samples[index][:, at_y, at_x])
            with np.errstate(invalid="ignore", over="ignore"):  # near the largest float32
                mean = values.mean(axis=0) / np.float32(rig.intensities[row])
            mean[~(np.isfinite(mean) & inside)] = np.nan
            grey[row] = mean
        inside &= _bright(grey)
        grey[:, ~inside] = np.nan
        side = max(height, width)
        return cls(
            grey=grey,
            lights=_lights(rig, (height, width), at_y, at_x),
            tiles=(len(rows), *tile),
            x=(at_x - (width - 1) / 2) / side,
            y=((height - 1) / 2 - at_y) / side,
            inside=inside,
        )


def linear(stack: Stack, stored: NDArray[np.generic]) -> NDArray[np.float32]:
    """Stored samples ``(band, ...)`` of one observation as linear light, clipped ones +inf."""
    shape = (-1, *[1] * (stored.ndim - 1))
    values = stored.astype(np.float32)
    with quiet_cast():
        black, scale = (one.reshape(shape).astype(np.float32) for one in (stack.black, stack.scale))
        result = (values - black) * scale
        if stack.saturation is not None:
            # In single precision, as the numerics compare: 0.9 is less there.
            result[values >= stack.saturation.reshape(shape).astype(np.float32)] = np.inf
    return np.asarray(result, dtype=np.float32)


def _places(
    height: int, width: int, budget: int, mask: NDArray[np.bool_] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[int, int]]:
    """Top rows and left columns of the tiles, and their common size."""
    top, left, bottom, right = 0, 0, height, width
    if mask is not None and mask.any():
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        top, bottom = int(rows[0]), int(rows[-1]) + 1
        left, right = int(columns[0]), int(columns[-1]) + 1
    if (bottom - top) * (right - left) <= budget:
        return np.array([top]), np.array([left]), (bottom - top, right - left)
    side = int(np.sqrt(budget / _TILES**2))
    tile = (min(side, bottom - top), min(side, right - left))
    # A narrow strip has room for fewer rows of tiles; tiles must not overlap.
    down = min(_TILES, (bottom - top) // tile[0])
    across = min(_TILES, (right - left) // tile[1])
    starts_y = np.linspace(top, bottom - tile[0], down).astype(np.int64)
    starts_x = np.linspace(left, right - tile[1], across).astype(np.int64)
    grid_y, grid_x = np.meshgrid(starts_y, starts_x, indexing="ij")
    return grid_y.ravel(), grid_x.ravel(), tile


def _bright(grey: NDArray[np.float32]) -> NDArray[np.bool_]:
    """``(n,)``: all pixels that are not nearly black in most photographs."""
    # Clipped samples are bright: they count as the largest.
    middle = np.sort(grey, axis=0)[len(grey) // 2]
    known = middle[np.isfinite(middle)]
    if len(known) == 0:
        return np.ones(grey.shape[1], bool)
    return np.asarray(~(middle < _BRIGHT * np.percentile(known, 95)))


def _lights(
    rig: Rig, size: tuple[int, int], at_y: NDArray[np.int64], at_x: NDArray[np.int64]
) -> Floats:
    if not any(isinstance(light, PointLight) for light in rig.lights):
        return rig.directions
    height, width = size
    pitch = float(rig.pitch_mm or 1.0)
    points = np.stack(
        [(at_x - (width - 1) / 2) * pitch, ((height - 1) / 2 - at_y) * pitch, 0.0 * at_x], axis=1
    )
    lights = np.empty((len(rig), len(points), 3))
    for index, light in enumerate(rig.lights):
        if isinstance(light, PointLight):
            towards = np.array(light.position) - points
            distance = np.linalg.norm(towards, axis=1, keepdims=True)
            distance[distance == 0.0] = np.inf  # a lamp on the pixel itself does not light it
            lights[index] = towards / distance
            if light.falloff:
                lights[index] *= (np.linalg.norm(light.position) / distance) ** 2
        else:
            lights[index] = light.direction
    return lights

"""Diffuse colours as the RGB-camera paper has them: the mean of the outputs that are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impasto.fit.normals import Normals
from impasto.lights import Light, PointLight
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status
from impasto.surface import Surface


def with_mean_albedo(
    stack: Stack, normals: Normals, *, w1: float, w2: float, threads: int | None = None
) -> Normals:
    """The same normals with the albedo of sections 4.2 and 4.3 of the RGB-camera paper.

    The outputs of the kept lights are averaged (section 4.2), and the mean is corrected for the
    slant of the surface and for the white board (eq. 8). Of an average over lights, that is a
    division by the average of ``irradiance (N.L)`` over the same lights. Least squares, the albedo
    of :func:`impasto.fit_normals`, weights bright outputs more.

    Parameters
    ----------
    stack
        The photographs.
    normals
        Their normals. Pixels with fewer than four kept outputs (status ``RELAXED``) and pixels
        that were not estimated keep their albedo.
    w1, w2
        An output is kept from ``w2`` to ``w1`` times the pixel's mean over the lights (section
        3.2), both relative to the irradiance and averaged over the bands.
    threads
        None means every allowed core.
    """
    count, _, height, width = stack.shape
    rig, shape = stack.rig.here, (height, width)
    total, seen = np.zeros(shape), np.zeros(shape)
    for index in range(count):
        relative = _relative(stack, rig, index)
        usable = np.isfinite(relative)
        total += np.where(usable, relative, 0.0)
        seen += usable
    mean = total / np.maximum(seen, 1.0)
    white = Surface(normals.normal, np.ones((1, *shape), np.float32))
    light, output = np.zeros(shape), np.zeros(stack.shape[1:])
    for index in range(count):
        relative = _relative(stack, rig, index)
        # False for NaN.
        kept = (relative >= w2 * mean) & (relative <= w1 * mean)
        lit = white.predict(rig.take([index]), threads=threads)[0, 0]
        light += np.where(kept, lit, 0.0)
        output += np.where(kept, stack.linear(index), 0.0)
    fine = (normals.status == Status.FITTED) & (light > 0.0)
    albedo = np.divide(output, light, out=np.zeros_like(output), where=fine)
    return replace(normals, albedo=np.where(fine, albedo.astype(np.float32), normals.albedo))


def _relative(stack: Stack, rig: Rig, index: int) -> NDArray[np.float64]:
    """One photograph relative to its irradiance, averaged over the bands; NaN where unusable."""
    value = stack.linear(index).mean(axis=0, dtype=np.float64)
    value /= _irradiance(rig.lights[index], rig.pitch_mm, stack.shape[2:])
    return np.where(np.isfinite(value), value, np.nan)


def _irradiance(
    light: Light, pitch_mm: float | None, shape: tuple[int, ...]
) -> NDArray[np.float64] | float:
    """Of a plane that faces the light, relative to the white board in the middle."""
    if not isinstance(light, PointLight) or not light.falloff:
        return light.intensity
    rows, columns = shape
    pitch = pitch_mm or 0.0
    x = (np.arange(columns) - (columns - 1) / 2) * pitch - light.position[0]
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch - light.position[1]
    squared = x[None] ** 2 + y[:, None] ** 2 + light.position[2] ** 2
    return np.asarray(light.intensity * np.sum(np.square(light.position)) / squared)

"""The painting as a mesh of triangles, in mm: a flat panel, or its relief."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.export.source import Map, Source
from impasto.height import integrate_normals
from impasto.level import Level, as_level, level_of_height

MOST_POINTS = 4_000_000
"""Of a mesh: programs for meshes hold some hundred bytes for each."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A mesh over a grid of points.

    Attributes
    ----------
    points
        ``(point, 3)`` float32: x right, y up, z towards the viewer, the origin in the middle of the
        painting; rows of points from the top.
    texture
        ``(point, 2)`` float32: the place in a picture, its upper left corner being (0, 0).
    triangles
        ``(triangle, 3)`` uint32, counterclockwise as seen by the viewer.
    """

    points: NDArray[np.float32]
    texture: NDArray[np.float32]
    triangles: NDArray[np.uint32]

    def scaled(self, factor: float) -> Grid:
        """With lengths in another unit."""
        return replace(self, points=self.points * np.float32(factor))


def panel(source: Source) -> Grid:
    """Two triangles of the painting's size."""
    height, width = source.size_mm
    return _grid(np.zeros((2, 2), np.float32), height, width, edge=True)


def relief(source: Source, *, height: Map | None = None) -> Grid:
    """One point per pixel, at its height, in the middle of the pixel.

    Parameters
    ----------
    source
        The painting.
    height
        ``(y, x)`` mm; default: :func:`height_of`.

    Raises
    ------
    ArgumentError
        More than :data:`MOST_POINTS` pixels.
    """
    rows, columns = source.shape
    if rows * columns > MOST_POINTS:
        raise ArgumentError(
            f"result: a mesh of {columns} x {rows} points is too large for programs that read it; "
            "export a smaller scale or a part"
        )
    if min(rows, columns) < 2:
        raise ArgumentError("result: a mesh needs at least 2 x 2 pixels")
    tall, wide = source.size_mm
    return _grid(height_of(source)[0] if height is None else height, tall, wide, edge=False)


def height_of(source: Source, level: bool | Level = False) -> tuple[Map, Level | None]:
    """``(y, x)`` mm towards the viewer: the height that it has, else its normals, integrated.

    About its mean; without the width of a pixel in pixels. 0 where unknown. With ``level`` about
    the plane of the panel, as :func:`impasto.integrate_normals`, and that plane.
    """
    own, pitch = source.result, source.pitch_mm or 1.0
    lit = own.surface()
    found = lit.height
    if found is None:
        plane = as_level(level, lit.normal)
        found = integrate_normals(lit.normal, pitch, level=False if plane is None else plane)
    else:
        plane = level_of_height(found, pitch) if level is True else as_level(level, lit.normal)
        if plane is not None:
            found = np.asarray(found - plane.surface(lit.shape, pitch), dtype=np.float32)
    found = np.asarray(found, dtype=np.float32)
    known = np.isfinite(found)
    mean = np.float32(found[known].mean(dtype=np.float64)) if known.any() else np.float32(0.0)
    return np.where(known, found - mean, np.float32(0.0)), plane


def _grid(height: Map, tall: float, wide: float, *, edge: bool) -> Grid:
    rows, columns = height.shape
    # From edge to edge, or from the middle of the first pixel to that of the last.
    u, v = (
        np.linspace(0.0, 1.0, count) if edge else (np.arange(count) + 0.5) / count
        for count in (columns, rows)
    )
    x, y = np.meshgrid((u - 0.5) * wide, (0.5 - v) * tall)
    points = np.stack([x, y, height], axis=-1).reshape(-1, 3).astype(np.float32)
    texture = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2).astype(np.float32)
    corner = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    triangles = np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3)
    return Grid(points, texture, np.ascontiguousarray(triangles))

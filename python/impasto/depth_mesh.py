"""The depth mesh of a painting: heights at nodes of a natural cubic spline [@deboor1978splines].

A point at height h above the plane of the marks is seen where the ray from the camera through it
meets that plane: beside its place, on the line that leads away from the camera (plane plus
parallax [@irani1996parallax]). A picture that is rectified with the mesh is looked up there, in the
same resampling as lens and perspective, as in the third paper [@snel].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import is_whole, numbers
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DepthMesh:
    """Heights above the plane of the marks.

    Parameters
    ----------
    size_mm
        Width and height of the painting: nodes lie on its border and evenly between.
    depth_mm
        ``(y, x)`` heights at the nodes, towards the viewer, from the upper left; 2 nodes or more
        along each side.
    sigma_mm
        ``(y, x)`` standard deviations; NaN where unknown.
    """

    size_mm: tuple[float, float]
    depth_mm: Floats
    sigma_mm: Floats

    def __post_init__(self) -> None:
        depth = numbers(self.depth_mm, "depth_mm", "(y, x) heights in mm")
        sigma = numbers(self.sigma_mm, "sigma_mm", "(y, x) standard deviations in mm")
        if depth.ndim != 2 or min(depth.shape) < 2 or not np.isfinite(depth).all():
            raise ArgumentError(
                f"depth_mm: expected finite heights of 2 x 2 nodes or more, found shape "
                f"{depth.shape}"
            )
        if sigma.shape != depth.shape:
            raise ArgumentError(f"sigma_mm: expected shape {depth.shape}, found {sigma.shape}")
        object.__setattr__(self, "depth_mm", depth)
        object.__setattr__(self, "sigma_mm", sigma)

    def __repr__(self) -> str:
        rows, columns = self.depth_mm.shape
        low, high = float(self.depth_mm.min()), float(self.depth_mm.max())
        return f"<DepthMesh {columns} x {rows} nodes, {low:.2f} to {high:.2f} mm>"

    @property
    def nodes_mm(self) -> tuple[Floats, Floats]:
        """Places x of the columns from the left, and y of the rows from the top."""
        return nodes_mm(self.size_mm, (self.depth_mm.shape[0], self.depth_mm.shape[1]))

    def on_grid(self, x_mm: ArrayLike, y_mm: ArrayLike) -> Floats:
        """``(y, x)`` heights in mm at the crossings of columns and rows; beyond, of the border."""
        down, across = self._bases(x_mm, y_mm)
        return np.asarray(down @ self._coefficients @ across.T)

    def at(self, mm: ArrayLike) -> Floats:
        """``(...)`` heights in mm at places ``(..., 2)``."""
        places = np.asarray(mm, dtype=np.float64)
        flat = places.reshape(-1, 2)
        down, across = self._bases(flat[:, 0], flat[:, 1])
        found = np.einsum("pj,ji,pi->p", down, self._coefficients, across, optimize=True)
        return np.asarray(found.reshape(places.shape[:-1]))

    @property
    def _coefficients(self) -> Floats:
        rows, columns = self.depth_mm.shape
        half = np.linalg.solve(node_values(rows), self.depth_mm)
        return np.asarray(np.linalg.solve(node_values(columns), half.T).T)

    def _bases(self, x_mm: ArrayLike, y_mm: ArrayLike) -> tuple[Floats, Floats]:
        rows, columns = self.depth_mm.shape
        x, y = np.asarray(x_mm, np.float64), np.asarray(y_mm, np.float64)
        across = (x / self.size_mm[0] + 0.5) * (columns - 1)
        down = (0.5 - y / self.size_mm[1]) * (rows - 1)
        return basis(down, rows), basis(across, columns)


@dataclass(frozen=True, eq=False)
class Parallax:
    """The relief of a painting as one camera sees it.

    Parameters
    ----------
    mesh
        The relief.
    camera_mm
        ``(3,)`` the place of the camera.
    """

    mesh: DepthMesh
    camera_mm: Floats

    def on_grid(self, x_mm: Floats, y_mm: Floats) -> Floats:
        """``(y, x, 2)``: where on the plane the camera sees the surface above a grid, in mm."""
        grid = np.stack(np.meshgrid(x_mm, y_mm), axis=-1)
        return seen_at(grid, self.mesh.on_grid(x_mm, y_mm), self.camera_mm)


def seen_at(mm: ArrayLike, depth_mm: ArrayLike, camera_mm: ArrayLike) -> Floats:
    """``(..., 2)``: where on the plane z = 0 a camera sees points above ``mm``.

    Parameters
    ----------
    mm
        ``(..., 2)`` places in mm.
    depth_mm
        ``(...)`` their heights.
    camera_mm
        ``(3,)`` place of the camera, above all of them.
    """
    places, depth = np.asarray(mm, np.float64), np.asarray(depth_mm, np.float64)
    x, y, z = np.asarray(camera_mm, np.float64).tolist()
    return np.asarray(places + (depth / (z - depth))[..., None] * (places - (x, y)))


def parallax_slope(mm: ArrayLike, depth_mm: ArrayLike, camera_mm: ArrayLike) -> Floats:
    """``(..., 2)``: the derivative of :func:`seen_at` by the height, in mm per mm."""
    places, depth = np.asarray(mm, np.float64), np.asarray(depth_mm, np.float64)
    x, y, z = np.asarray(camera_mm, np.float64).tolist()
    return np.asarray((z / (z - depth) ** 2)[..., None] * (places - (x, y)))


def nodes_mm(size_mm: tuple[float, float], shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Of ``shape[1]`` columns of nodes x from the left, of ``shape[0]`` rows y from the top."""
    width, height = size_mm
    rows, columns = shape
    return (
        np.linspace(-width / 2, width / 2, columns),
        np.linspace(height / 2, -height / 2, rows),
    )


def shape_of_mesh(size_mm: tuple[float, float], spacing_mm: float) -> tuple[int, int]:
    """Rows and columns of nodes no farther apart than a spacing."""
    columns, rows = (max(2, 1 + int(np.ceil(side / spacing_mm - 1e-9))) for side in size_mm)
    return rows, columns


def basis(places: Floats, count: int) -> Floats:
    """``(n, count)``: uniform cubic B-splines at places in units of the distance between nodes.

    The coefficients beyond either end continue the last two on a line: the curve then has no
    curvature there (a natural spline). Places beyond the ends have the value of the end.
    """
    if not is_whole(count) or count < 2:
        raise ArgumentError(f"count: expected 2 nodes or more, found {count!r}")
    inside = np.clip(places, 0.0, count - 1.0)
    cell = np.minimum(inside.astype(int), count - 2)
    t = inside - cell
    weights = (
        np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3])
        / 6.0
    )
    wide = np.zeros((len(t), count + 2))
    rows = np.arange(len(t))
    for offset in range(4):
        wide[rows, cell + offset] = weights[offset]
    found = wide[:, 1:-1].copy()
    found[:, 0] += 2.0 * wide[:, 0]
    found[:, 1] -= wide[:, 0]
    found[:, -1] += 2.0 * wide[:, -1]
    found[:, -2] -= wide[:, -1]
    return np.asarray(found)


def node_values(count: int) -> Floats:
    """``(count, count)``: from the coefficients of the B-splines to the values at the nodes."""
    return basis(np.arange(count, dtype=np.float64), count)

"""The relief of a painting from several views: plane plus parallax [@irani1996parallax].

All photographs are compared with the most frontal one, rectified with the mesh as far as it is
known: what is left along the epipolar lines of many views is a correction of the heights (multiple
baselines [@okutomi1993multibaseline]). Windows and distances between nodes shrink from round to
round. Memory holds the reference, one photograph, and two numbers for each tile of each photograph.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto._internal.extras import need
from impasto.align.depth_fit import combined, fitted_mesh
from impasto.align.disparity import OVERLAP, Disparities, Tiles, disparities, tiles_of
from impasto.align.photographs import LINEAR
from impasto.align.pose import Pose
from impasto.calibrate.tones import light_from
from impasto.depth_mesh import DepthMesh, Parallax, parallax_slope, shape_of_mesh
from impasto.errors import ArgumentError, GeometryError
from impasto.frontal_view import FrontalView
from impasto.io.session.linear_codes import Photograph
from impasto.rectification import Grid, rectified

Floats = NDArray[np.float64]

ROUNDS = ((33, 2.0), (25, 1.5), (17, 1.0), (17, 1.0))
"""Rows and columns of the windows, and distances between nodes in those of the last mesh."""
SPACING = 12.0
"""Default distance between the last nodes, in pixels: 1.4 tiles, so that errors can be told."""
NODES = 6000
"""Nodes at most: their standard deviations take the inverse of a matrix of as many rows."""
MOST = 48
"""Photographs that are compared: more views of the same relief add little."""
LARGEST = 4e6
"""Pixels that are compared: of a larger picture, larger ones."""
LEAST_ANGLE = np.radians(5.0)
"""Least angle between the reference and another view."""


@dataclass(frozen=True, eq=False)
class FoundDepth:
    """The relief, and what it explains.

    Attributes
    ----------
    mesh
        The heights.
    reference
        Number of the photograph that the others were compared with.
    photographs
        Numbers of those others.
    before_px, after_px
        ``(photograph,)``: root mean squares of the disparities along the epipolar lines, on a flat
        painting and on the mesh, in pixels of ``pixel_mm``; NaN where nothing was found.
    across_px
        ``(photograph,)``: the same across the lines, which no relief explains.
    pixel_mm
        Width of the pixels that were compared.
    """

    mesh: DepthMesh
    reference: int
    photographs: tuple[int, ...]
    before_px: Floats
    after_px: Floats
    across_px: Floats
    pixel_mm: float

    @property
    def left_px(self) -> tuple[float, float]:
        """Root mean squares over all photographs, before and after."""
        before, after = (
            float(np.sqrt(np.nanmean(np.square(one)))) for one in (self.before_px, self.after_px)
        )
        return before, after


def find_depth(
    read: Callable[[int], Photograph],
    views: Sequence[FrontalView],
    cameras: Sequence[Pose],
    grid: Grid,
    *,
    spacing_mm: float | None = None,
    advance: Callable[[int, int], None] | None = None,
) -> FoundDepth:
    """The heights of a painting from photographs of different views.

    Parameters
    ----------
    read
        Gives the photograph of a number; each is read five times at most.
    views, cameras
        How each shows the painting, and where its camera stood.
    grid
        The pixels of the result.
    spacing_mm
        Largest distance between nodes; default: 12 pixels, or what makes 6000 nodes.
    advance
        Called with steps done and all.

    Raises
    ------
    ArgumentError
        More than 6000 nodes.
    GeometryError
        Views that differ by less than 5 degrees, or a painting without structure.
    MissingExtraError
        SciPy is not installed.
    """
    need("scipy.sparse", "depth", "the depth of a painting")
    grown = float(np.sqrt(grid.rows * grid.columns / LARGEST))
    coarse = grid if grown <= 1.0 else Grid(grid.size_mm, grid.pixel_mm * grown)
    least = float(np.sqrt(grid.size_mm[0] * grid.size_mm[1] / NODES))
    spacing = max(SPACING * coarse.pixel_mm, least)
    if spacing_mm is not None:
        spacing = length_mm(spacing_mm, "mesh")
        if spacing < least:
            raise ArgumentError(
                f"mesh: nodes {spacing:g} mm apart are more than {NODES} on this painting; give "
                f"{least:.3g} mm or more"
            )
    eyes = np.array([one.view for one in cameras])
    reference = int(eyes[:, 2].argmax())
    chosen = spread_views(eyes, reference, MOST)
    if not chosen:
        raise GeometryError(
            "depth: all photographs show the painting from one direction, within "
            f"{np.degrees(LEAST_ANGLE):.0f} degrees; the relief needs views from several sides"
        )
    comparison = _Comparison(read, views, cameras, coarse, reference, chosen)
    steps = (len(ROUNDS) + 1) * (len(chosen) + 1)

    def stepped(done: int) -> None:
        if advance is not None:
            advance(done, steps)

    mesh: DepthMesh | None = None
    before = np.empty(0)
    for turn, (window, share) in enumerate(ROUNDS):
        places, found = comparison.made(mesh, window, turn * (len(chosen) + 1), stepped)
        if mesh is None:
            before = _rms(found)
        start = np.zeros(len(places)) if mesh is None else mesh.at(places)
        heights, weights = combined(
            np.array([start + one.height_mm for one in found]),
            np.array([one.weight for one in found]),
        )
        shape = shape_of_mesh(grid.size_mm, share * spacing)
        mesh = fitted_mesh(places, heights, weights, grid.size_mm, shape, OVERLAP**2).mesh
    assert mesh is not None
    _, found = comparison.made(mesh, ROUNDS[-1][0], len(ROUNDS) * (len(chosen) + 1), stepped)
    return FoundDepth(
        mesh, reference, tuple(chosen), before, _rms(found),
        np.array([one.across_px for one in found]), coarse.pixel_mm,
    )  # fmt: skip


def spread_views(eyes: Floats, reference: int, most: int) -> list[int]:
    """Numbers of views that lie far from each other and from a reference.

    Farthest-point sampling [@gonzalez1985clustering]: each is the one that is farthest from all
    that were chosen before.

    Parameters
    ----------
    eyes
        ``(n, 3)`` unit vectors to the cameras.
    reference
        Number of the view that the others are compared with.
    most
        How many at most; views nearer than 5 degrees to the reference are left out.
    """
    apart = np.linalg.norm(eyes - eyes[reference], axis=1)
    # The chord of a small angle is the angle.
    possible = np.flatnonzero(apart >= LEAST_ANGLE)
    nearest = apart[possible].copy()
    chosen: list[int] = []
    while len(chosen) < min(most, len(possible)):
        one = int(nearest.argmax())
        chosen.append(int(possible[one]))
        own = np.linalg.norm(eyes[possible] - eyes[possible[one]], axis=1)
        nearest = np.minimum(nearest, own)
        nearest[one] = -1.0
    return sorted(chosen)


def _rms(found: Sequence[Disparities]) -> Floats:
    """``(photograph,)`` root mean squares along the epipolar lines."""
    squares = []
    for one in found:
        known = one.along_px[one.weight > 0.0]
        squares.append(float(np.square(known).mean()) if known.size else np.nan)
    return np.sqrt(squares)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """The photographs that are compared with the reference."""

    read: Callable[[int], Photograph]
    views: Sequence[FrontalView]
    cameras: Sequence[Pose]
    grid: Grid
    reference: int
    chosen: Sequence[int]

    def made(
        self, mesh: DepthMesh | None, window: int, start: int, stepped: Callable[[int], None]
    ) -> tuple[Floats, list[Disparities]]:
        """Places ``(tile, 2)`` in mm, and what each photograph says of them."""
        light, seen = self._rectified(self.reference, mesh)
        stepped(start + 1)
        tiles = tiles_of(light, seen, window)
        places = self.grid.mm(*tiles.pixels.astype(np.float64).T)
        depth = np.zeros(len(places)) if mesh is None else mesh.at(places)
        found = []
        for done, number in enumerate(self.chosen, 1):
            found.append(self._one(number, mesh, tiles, places, depth))
            stepped(start + 1 + done)
        return places, found

    def _one(
        self, number: int, mesh: DepthMesh | None, tiles: Tiles, places: Floats, depth: Floats
    ) -> Disparities:
        own, other = (
            parallax_slope(places, depth, self.cameras[index].place_mm)
            for index in (number, self.reference)
        )
        # Rows run down.
        slope = (own - other) * (1.0, -1.0) / self.grid.pixel_mm
        return disparities(tiles, *self._rectified(number, mesh), slope)

    def _rectified(
        self, number: int, mesh: DepthMesh | None
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        parallax = None if mesh is None else Parallax(mesh, self.cameras[number].place_mm)
        made = rectified(
            self.read(number).planes, self.views[number], self.grid,
            parallax=parallax, interpolation="cubic",
        )  # fmt: skip
        return light_from(made.planes, LINEAR), made.seen

"""``alignment.json``, the report of ``impasto align``, as what photographs are resampled by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import FARTHEST_MM, length_mm
from impasto._internal.damage import damage_of
from impasto.depth_mesh import DepthMesh
from impasto.errors import CorruptInputError
from impasto.io.depth_mesh import read_depth
from impasto.io.json_file import read_kind
from impasto.rectification import Grid

KIND = "impasto alignment"
LARGEST = 1e9
"""Of numbers of a homography and of a shift, and of pixels that show corners of the painting."""
DEPTH = "depth.csv"
"""The mesh of the relief, beside the report."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where photographs show the plane of the painting.

    Parameters
    ----------
    path
        The file.
    grid
        The pixels of the frontal picture.
    lens
        Model and residual of the lens that it was made with; None without a lens.
    homographies
        ``(3, 3)`` from mm to pixels behind the lens, by the photograph's file name in lower case.
    shifts
        Pixels of the frontal picture to the right and below, by the same names.
    cameras
        By the same names; None without a lens.
    depth
        The relief that was taken out; None of a flat painting.
    """

    path: Path
    grid: Grid
    lens: tuple[str, float] | None
    homographies: dict[str, NDArray[np.float64]]
    shifts: dict[str, tuple[float, float]]
    cameras: dict[str, CameraPlace | None]
    depth: DepthMesh | None

    @property
    def files(self) -> tuple[Path, ...]:
        """The report, and the mesh of the relief beside it if there is one."""
        return (self.path,) if self.depth is None else (self.path, self.path.parent / DEPTH)


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """Where the camera of a photograph stood.

    Parameters
    ----------
    place_mm
        ``(3,)`` from the middle of the painting.
    rotation
        ``(3, 3)`` from the frame of the painting to that of the camera (right, down, forward).
    """

    place_mm: NDArray[np.float64]
    rotation: NDArray[np.float64]


def read_alignment(path: Path) -> Alignment:
    """Read the report of an alignment.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No such report, or one with numbers missing.
    """
    what = "the report of an alignment"
    content = read_kind(path, KIND, what, "impasto align (as report/alignment.json)")
    with damage_of(path, what):
        return _alignment(path, content)


def _alignment(path: Path, content: dict[str, Any]) -> Alignment:
    width, height = (length_mm(float(side), "size_mm") for side in content["size_mm"])
    grid = Grid((width, height), length_mm(float(content["pixel_mm"]), "pixel_mm"))
    size = [grid.columns, grid.rows]
    if size != content["size_px"]:
        raise CorruptInputError(
            path, f"size_px: {content['size_px']}, but size_mm and pixel_mm make {size}"
        )
    lens = content["lens"]
    homographies, shifts = {}, {}
    cameras: dict[str, CameraPlace | None] = {}
    for one in content["photographs"]:
        name = str(one["source"])
        matrix = np.array(one["homography"], dtype=np.float64)
        x, y = (float(value) for value in one["shift_px"] or (0.0, 0.0))
        usable = matrix.shape == (3, 3) and (np.abs([*matrix.ravel(), x, y]) <= LARGEST).all()
        if not usable or abs(np.linalg.det(matrix)) == 0.0:
            raise CorruptInputError(path, f"{name}: its homography or shift is none")
        x_mm, y_mm = np.array([[-1, 1, 1, -1], [1, 1, -1, -1]]) * [[width / 2], [height / 2]]
        across, down, away = matrix @ np.stack([x_mm, y_mm, np.ones(4)])
        # The camera is on one side of all corners, and sees them at pixels of some size.
        same_side = (away > 0.0).all() or (away < 0.0).all()
        if not same_side or (np.abs([across, down]) > LARGEST * np.abs(away)).any():
            raise CorruptInputError(
                path, f"{name}: by its homography it does not show the whole plane of the painting"
            )
        key = name.casefold()
        homographies[key], shifts[key] = matrix, (x, y)
        cameras[key] = None if lens is None else _camera(path, one)
    made_with = None if lens is None else (str(lens["model"]), float(lens["residual_px"]))
    depth = None
    if content["depth"] is not None:
        read = read_depth(path.parent / DEPTH)
        # Places of nodes are rounded in their file, the size of the painting is not here.
        depth = replace(read, size_mm=grid.size_mm)
    return Alignment(path, grid, made_with, homographies, shifts, cameras, depth)


def _camera(path: Path, one: dict[str, Any]) -> CameraPlace:
    place = np.array(one["camera_mm"], dtype=np.float64)
    rotation = np.array(one["camera_rotation"], dtype=np.float64)
    shaped = place.shape == (3,) and rotation.shape == (3, 3)
    known = shaped and (np.abs(place) <= FARTHEST_MM).all() and np.isfinite(rotation).all()
    if not known or place[2] < 1.0 / FARTHEST_MM:
        raise CorruptInputError(path, f"{one['source']}: it has no camera in front of the painting")
    return CameraPlace(place, rotation)

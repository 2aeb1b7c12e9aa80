"""The files of an aligned stack: photographs block by block, and the lights with their views."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.align.pose import Pose
from impasto.align.refinement import Shift
from impasto.depth_mesh import Parallax
from impasto.frontal_view import FrontalView, cameras_of
from impasto.io.images.write import write_tiff16, write_tiff32
from impasto.io.lights import LightFile
from impasto.io.lights.write import write_lights
from impasto.io.session.linear_codes import Photograph
from impasto.rectification import Grid, Rectified, rectified_rows

Floats = NDArray[np.float64]


def write_photograph(
    path: Path,
    photograph: Photograph,
    view: FrontalView,
    grid: Grid,
    shift: Shift | None,
    parallax: Parallax | None,
    covered: NDArray[np.bool_],
) -> float:
    """Write one aligned photograph; returns the share of the painting that it shows.

    Blocks of rows and columns are resampled one after the other: beside the photograph and its
    result, memory holds the places of one block. ``covered`` ``(y, x)`` loses what is not shown.
    """
    moved = (0.0, 0.0) if shift is None else (shift.x, shift.y)
    planes = np.empty((len(photograph.planes), grid.rows, grid.columns), photograph.planes.dtype)
    top, shown = 0, 0
    part: Rectified
    for part in rectified_rows(
        photograph.planes, view, grid, shift=moved, parallax=parallax, full=photograph.full
    ):
        rows = slice(top, top + part.planes.shape[1])
        planes[:, rows] = part.planes
        covered[rows] &= part.seen
        shown += int(part.seen.sum())
        top = rows.stop
    attributes: dict[str, Any] = {"pixel_mm": grid.pixel_mm}
    write = write_tiff16 if planes.dtype == np.uint16 else write_tiff32
    write(path, planes, attributes=attributes)
    return shown / (grid.rows * grid.columns)


def write_stack_lights(
    folder: Path, file: LightFile | None, names: list[str], cameras: list[Pose] | None, grid: Grid
) -> str:
    """Write the lights with the cameras that the lens shows; returns the name, empty for none.

    Each pixel then has its own direction to the camera (:class:`impasto.PointView`). Positions of
    near lamps are kept: in ``lights.csv`` beside the cameras, else in ``lights.dome``, whose lamps
    follow in the order of the photographs.
    """
    if file is None:
        return ""
    width_mm = grid.columns * grid.pixel_mm
    own = replace(file, names=tuple(names), pitch_mm=grid.pixel_mm, width_mm=width_mm)
    places = None
    if own.views is None and cameras is not None:
        places = cameras_of([one.place_mm for one in cameras])
    if places is not None:
        views = places / np.linalg.norm(places, axis=1, keepdims=True)
        own = replace(own, views=views, view_positions=places)
    plain = "lights.lp" if own.positions is None else "lights.dome"
    name = plain if own.views is None else "lights.csv"
    write_lights(folder / name, own)
    if file.intensities is not None:
        rows = np.atleast_2d(file.intensities.T).T.tolist()
        text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
        (folder / "light_intensities.txt").write_text(text, encoding="utf-8")
    return name

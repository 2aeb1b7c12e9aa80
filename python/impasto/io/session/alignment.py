"""``alignment.json``, the report of ``impasto align``, as what photographs are resampled by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto._internal.damage import damage_of
from impasto.errors import CorruptInputError
from impasto.io.files import read_text
from impasto.rectification import Grid

KIND = "impasto alignment"


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
    """

    path: Path
    grid: Grid
    lens: tuple[str, float] | None
    homographies: dict[str, NDArray[np.float64]]
    shifts: dict[str, tuple[float, float]]


def read_alignment(path: Path) -> Alignment:
    """Read the report of an alignment.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No such report, or one with numbers missing.
    """
    try:
        content = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise CorruptInputError(path, f"is not valid JSON ({error})") from error
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise CorruptInputError(
            path, f'is not the report of an alignment (its "kind" is not "{KIND}"); '
            "impasto align writes one, report/alignment.json"
        )  # fmt: skip
    if content.get("version") != 1:
        raise CorruptInputError(path, f"is of version {content.get('version')!r}, expected 1")
    with damage_of(path, "the report of an alignment"):
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
    for one in content["photographs"]:
        name = str(one["source"])
        matrix = np.array(one["homography"], dtype=np.float64)
        x, y = (float(value) for value in one["shift_px"] or (0.0, 0.0))
        finite = matrix.shape == (3, 3) and np.isfinite([*matrix.ravel(), x, y]).all()
        if not finite or abs(np.linalg.det(matrix)) == 0.0:
            raise CorruptInputError(path, f"{name}: its homography or shift is none")
        homographies[name.casefold()], shifts[name.casefold()] = matrix, (x, y)
    made_with = None if lens is None else (str(lens["model"]), float(lens["residual_px"]))
    return Alignment(path, grid, made_with, homographies, shifts)

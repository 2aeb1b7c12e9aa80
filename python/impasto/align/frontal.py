"""The plane of a painting in a photograph: a homography behind a lens.

The homography minimises the distances in pixels between marks that were found and those that it
predicts, by the direct linear transform and Levenberg-Marquardt (OpenCV's ``findHomography``
[@hartley2004multiple]).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.errors import GeometryError
from impasto.frontal_view import FrontalView
from impasto.lens import Lens

Floats = NDArray[np.float64]

COLLINEAR = 2e-3
"""Second smallest singular value of the linear equations, relative to the largest, from which marks
lie on one line; four corners of a painting ten times as wide as high have 0.01."""
CONTRADICTING = 0.01
"""Largest residual as a share of the distance between marks: more is no error of detection."""


def frontal_view(
    mm: Floats,
    found: Floats,
    names: tuple[str, ...],
    size_mm: tuple[float, float],
    lens: Lens | None,
    photograph: str,
) -> FrontalView:
    """The plane of the painting from its marks.

    Parameters
    ----------
    mm
        ``(n, 2)`` their places, x right, y up.
    found
        ``(n, 2)`` pixels.
    names
        Of the marks.
    size_mm
        Of the area that is shown.
    lens
        The distortion that is taken out first.
    photograph
        Its name, for messages.

    Raises
    ------
    GeometryError
        Fewer than 4 marks, marks on one line, mirrored marks, a painting beyond the horizon, or
        marks that contradict each other, with the worst one.
    """
    import cv2

    if len(names) < 4:
        raise GeometryError(f"{photograph}: {len(names)} marks, but 4 are the least")
    ideal = found if lens is None else lens.ideal(found)
    for points, what in ((mm, "in mm"), (ideal, "in the photograph")):
        if _spread(points) < COLLINEAR:
            raise GeometryError(
                f"{photograph}: {_listed(names)} lie on one line {what}, or three of four do; such "
                "marks determine no perspective"
            )
    matrix, _ = cv2.findHomography(mm, ideal, 0)
    if matrix is None:
        raise GeometryError(f"{photograph}: {_listed(names)} determine no perspective")
    matrix = np.asarray(matrix, np.float64)
    view = FrontalView(matrix, lens, names, found, np.zeros_like(found))
    homogeneous = np.column_stack([mm, np.ones(len(mm))]) @ matrix.T
    residual = ideal - homogeneous[:, :2] / homogeneous[:, 2:]
    _check_side(matrix, homogeneous[:, 2], size_mm, photograph)
    off = np.linalg.norm(residual, axis=1)
    worst = int(off.argmax())
    extent = float(np.linalg.norm(np.ptp(ideal, axis=0)))
    if off[worst] > CONTRADICTING * extent:
        raise GeometryError(
            f"{photograph}: marks contradict each other by {off[worst]:.1f} pixels, most at "
            f"{names[worst]}; is it where the layout says, the size right, and the lens given?"
        )
    return FrontalView(view.matrix, lens, names, found, residual)


def _check_side(
    matrix: Floats, depths: Floats, size_mm: tuple[float, float], photograph: str
) -> None:
    width, height = size_mm
    corners = np.array(
        [(x, y, 1.0) for x in (-width / 2, width / 2) for y in (-height / 2, height / 2)]
    )
    all_depths = np.concatenate([corners @ matrix[2], depths])
    if all_depths.min() * all_depths.max() <= 0.0:
        raise GeometryError(
            f"{photograph}: its marks put a part of the painting behind the camera; are two of "
            "them exchanged?"
        )
    # x right and y up, to columns and rows, turns the plane over: a negative determinant.
    if np.linalg.det(matrix) * np.sign(all_depths[0]) >= 0.0:
        raise GeometryError(
            f"{photograph}: its marks are mirrored; are left and right exchanged, or the "
            "photograph?"
        )


def _spread(points: Floats) -> float:
    """How far points are from determining no homography: 0 for those on one line."""
    own = points - points.mean(axis=0)
    own = own / max(float(np.sqrt(np.square(own).mean())), 1e-12)
    if len(own) == 4:
        areas = [_area(np.delete(own, one, axis=0)) for one in range(4)]
        return float(min(areas))
    sizes = np.linalg.svd(own, compute_uv=False)
    return float(sizes[1] / sizes[0])


def _area(triangle: Floats) -> float:
    (a, b), (c, d) = triangle[1:] - triangle[0]
    return float(abs(a * d - b * c)) / 2.0


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{len(names)} marks"

"""The plane of a painting in a photograph: a homography behind a lens.

The homography minimises the distances in pixels between marks that were found and those that it
predicts, by the direct linear transform and Levenberg-Marquardt (OpenCV's ``findHomography``
[@hartley2004multiple]).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.calibrate.lens import Lens
from impasto.errors import GeometryError

Floats = NDArray[np.float64]

COLLINEAR = 2e-3
"""Second smallest singular value of the linear equations, relative to the largest, from which marks
lie on one line; four corners of a painting ten times as wide as high have 0.01."""
CONTRADICTING = 0.01
"""Largest residual as a share of the distance between marks: more is no error of detection."""


@dataclass(frozen=True, eq=False)
class FrontalView:
    """How one photograph shows the plane of the painting.

    Attributes
    ----------
    matrix
        ``(3, 3)``: from homogeneous mm (x right, y up) to pixels of a pinhole camera.
    lens
        Its distortion; None for none.
    names
        The marks it was found from.
    found
        ``(n, 2)`` their pixels in the photograph.
    residual
        ``(n, 2)`` found minus predicted, in pixels of the pinhole camera.
    """

    matrix: Floats
    lens: Lens | None
    names: tuple[str, ...]
    found: Floats
    residual: Floats

    @property
    def rms(self) -> float | None:
        """Root mean square of the residuals in pixels; None for 4 marks, which fit exactly."""
        if len(self.names) <= 4:
            return None
        return float(np.sqrt(np.square(self.residual).sum(axis=1).mean()))

    def pixels(self, mm: ArrayLike) -> Floats:
        """Pixels ``(..., 2)`` of the photograph that show places ``(..., 2)`` in mm."""
        places = np.asarray(mm, dtype=np.float64)
        m = self.matrix
        x, y = places[..., 0], places[..., 1]
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2]
        across = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / depth
        down = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / depth
        ideal = np.stack([across, down], axis=-1)
        return ideal if self.lens is None else self.lens.observed(ideal)

    def mm(self, pixels: ArrayLike) -> Floats:
        """Places ``(n, 2)`` in mm that pixels ``(n, 2)`` of the photograph show."""
        seen = np.asarray(pixels, dtype=np.float64)
        ideal = seen if self.lens is None else self.lens.ideal(seen)
        homogeneous = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(self.matrix).T
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

    def marks_mm(self, ideal: Floats) -> Floats:
        """``(n, 2)``: the places in mm of the marks that were found at pixels of a pinhole camera.

        Found less residual is what the homography predicts of them.
        """
        predicted = np.column_stack([ideal - self.residual, np.ones(len(ideal))])
        homogeneous = predicted @ np.linalg.inv(self.matrix).T
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

    def pixel_mm(self) -> float:
        """Width in mm of the finest pixel in the middle of the painting, in its finest direction.

        A rectified picture with this pixel loses nothing that the photograph shows there.
        """
        step = 0.5
        moves = self.pixels([[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]])
        slopes = np.stack([moves[0] - moves[1], moves[2] - moves[3]], axis=1)
        return float(1.0 / np.linalg.svd(slopes, compute_uv=False)[0])


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

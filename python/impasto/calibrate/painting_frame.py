"""Lamps in the frame of the painting: the camera's place and turn from the homography of its marks.

Balls show where lamps stand as the camera sees them. A camera that is a degree askew would give
every lamp a degree of error. The homography of the painting's plane is decomposed with the camera
matrix [@zhang2000flexible]: its first two columns are those of the rotation, made orthonormal by
the polar decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import GeometryError

Floats = NDArray[np.float64]

RIGHT_UP_BACK = np.diag([1.0, -1.0, -1.0])
"""From right, down and forward of a camera to the frame in which balls give directions."""


@dataclass(frozen=True, eq=False)
class PaintingFrame:
    """How a camera looks at the painting.

    Parameters
    ----------
    rotation
        ``(3, 3)`` from the camera (right, up, towards the viewer) to the painting (x right, y up, z
        towards the viewer).
    camera_mm
        ``(3,)`` place of the camera, from the middle of the painting.
    """

    rotation: Floats
    camera_mm: Floats

    @classmethod
    def of(cls, homography: ArrayLike, camera_matrix: ArrayLike) -> PaintingFrame:
        """From the homography of the painting's plane.

        Parameters
        ----------
        homography
            ``(3, 3)`` from mm on the painting to pixels behind the lens.
        camera_matrix
            ``(3, 3)``.

        Raises
        ------
        GeometryError
            No camera in front of the painting has this homography.
        """
        columns = np.linalg.solve(np.asarray(camera_matrix, float), np.asarray(homography, float))
        columns /= np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
        columns *= np.sign(columns[2, 2])
        first, second, shift = columns.T
        left, _, right = np.linalg.svd(np.stack([first, second, np.cross(first, second)], axis=1))
        rotation = left @ right
        place = -rotation.T @ shift
        if not place[2] > 0.0:
            raise GeometryError("homography: it shows the painting from behind or mirrored")
        return cls((RIGHT_UP_BACK @ rotation).T, place)

    def directions(self, seen: ArrayLike) -> Floats:
        """``(n, 3)`` directions in the frame of the painting, from those of the camera."""
        return np.asarray(np.asarray(seen, dtype=np.float64) @ self.rotation.T)

    def places(self, seen: ArrayLike) -> Floats:
        """``(n, 3)`` mm from the middle of the painting, from places seen by the camera in mm."""
        return self.directions(seen) + self.camera_mm

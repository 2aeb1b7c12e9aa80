"""Lamps in the frame of the painting, as its marks show where the camera stood and looked.

Balls show where lamps stand as the camera sees them. A camera that is a degree askew would give
every lamp a degree of error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

RIGHT_UP_BACK = np.diag([1.0, -1.0, -1.0])
"""From right, down and forward of a camera to the frame in which balls give directions."""


@dataclass(frozen=True, eq=False)
class PaintingFrame:
    """How a camera looks at the painting.

    Parameters
    ----------
    rotation
        ``(3, 3)`` from the painting (x right, y up, z towards the viewer) to the camera (right,
        down, forward), as :class:`impasto.align.Pose` has it.
    camera_mm
        ``(3,)`` place of the camera, from the middle of the painting.
    """

    rotation: Floats
    camera_mm: Floats

    def directions(self, seen: ArrayLike) -> Floats:
        """``(n, 3)`` directions in the frame of the painting, from those of the camera."""
        camera = RIGHT_UP_BACK @ self.rotation
        return np.asarray(np.asarray(seen, dtype=np.float64) @ camera)

    def places(self, seen: ArrayLike) -> Floats:
        """``(n, 3)`` mm from the middle of the painting, from places seen by the camera in mm."""
        return self.directions(seen) + self.camera_mm

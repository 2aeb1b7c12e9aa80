"""Where a frame lies in the merged painting: an affine map of pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placement:
    """From columns and rows of a frame to those of the merged painting.

    Whole numbers are the middles of pixels.

    Parameters
    ----------
    linear
        ``(2, 2)``.
    offset
        ``(2,)``, in columns and rows.
    """

    linear: Floats
    offset: Floats

    @classmethod
    def identity(cls) -> Placement:
        """That of the reference frame."""
        return cls(np.eye(2), np.zeros(2))

    def to(self, points: Floats) -> Floats:
        """Points ``(n, 2)`` of the frame in the merged painting."""
        return points @ self.linear.T + self.offset

    def back(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Columns and rows of the merged painting in the frame."""
        (a, b), (c, d) = np.linalg.inv(self.linear).tolist()
        right, down = x - self.offset[0], y - self.offset[1]
        return a * right + b * down, c * right + d * down

    def after(self, first: Placement) -> Placement:
        """``first``, then this one."""
        return Placement(self.linear @ first.linear, self.to(first.offset[None])[0])

    @property
    def inverse(self) -> Placement:
        """From the merged painting to the frame."""
        linear = np.linalg.inv(self.linear)
        return Placement(np.asarray(linear, np.float64), -linear @ self.offset)

    @property
    def scale(self) -> float:
        """Pixels of the merged painting for one of the frame, along a side."""
        return math.sqrt(abs(float(np.linalg.det(self.linear))))

    @property
    def angle(self) -> float:
        """Radians by which the frame is rotated, counterclockwise as one sees it."""
        # Rows run down: a positive angle of (x, y) is clockwise to the eye.
        u, _, vt = np.linalg.svd(self.linear)
        rotation = u @ vt
        return -math.atan2(rotation[1, 0], rotation[0, 0])

    @property
    def rotation(self) -> Floats:
        """``(3, 3)`` that normals of the frame need: x right, y up, z towards the viewer."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def corners(self, shape: tuple[int, int]) -> Floats:
        """``(4, 2)``: the middles of a frame's corner pixels in the merged painting."""
        bottom, right = shape[0] - 1.0, shape[1] - 1.0
        return self.to(np.array([(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)]))

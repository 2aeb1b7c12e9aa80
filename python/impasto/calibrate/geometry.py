"""A mirror ball under a camera: its outline, and the law of reflection.

Camera frame: x right, y up, z towards the camera. A perspective camera stands at the origin and
looks along -z; an orthographic one is infinitely far away. Pixels: x right, y down, the middle of
the first pixel is (0, 0). Lengths are in radii of the ball where nothing else is said.

The outline of a ball has three numbers in pixels, ``(x, y, radius)``. For an orthographic camera it
is that circle. A perspective camera sees the ball in a circular cone [@hartley2004multiple], whose
section with the sensor is an ellipse; ``(x, y)`` is then the image of the ball's middle, the axis
of the cone, and ``radius`` = f tan(alpha) with its half angle alpha.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import numbers, positive
from impasto.errors import ArgumentError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BallCamera:
    """The camera that photographed the balls.

    Parameters
    ----------
    focal_px
        Focal length in pixels; None: orthographic, a camera that is far away or telecentric.
    centre
        (x, y) of the principal point in pixels of the whole frame: its middle, as a rule.

    Raises
    ------
    ArgumentError
        A focal length that is not positive, or a principal point that is not two numbers.
    """

    focal_px: float | None = None
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.focal_px is not None:
            positive(self.focal_px, "focal_px", "a positive focal length in pixels")
        pair = numbers(self.centre, "centre", "(x, y) in pixels")
        if pair.shape != (2,) or not np.isfinite(pair).all():
            raise ArgumentError(f"centre: expected (x, y) in pixels, found {self.centre!r}")
        object.__setattr__(self, "centre", (float(pair[0]), float(pair[1])))

    @classmethod
    def of_sensor(cls, focal_mm: float, sensor_mm: float, size: tuple[int, int]) -> BallCamera:
        """A perspective camera by its lens.

        Parameters
        ----------
        focal_mm
            Focal length in mm.
        sensor_mm
            Width of the sensor in mm, along x.
        size
            (height, width) of the whole frame in pixels.
        """
        focal = positive(focal_mm, "focal_mm", "a positive focal length in mm")
        width = positive(sensor_mm, "sensor_mm", "a positive width of the sensor in mm")
        return cls(focal / width * size[1], ((size[1] - 1) / 2, (size[0] - 1) / 2))

    @property
    def perspective(self) -> bool:
        """Whether the camera is near."""
        return self.focal_px is not None

    def rays(self, pixels: Array) -> Array:
        """``(..., 3)`` unit directions away from the camera, of pixels ``(..., 2)``."""
        if self.focal_px is None:
            return np.broadcast_to(np.array([0.0, 0.0, -1.0]), (*pixels.shape[:-1], 3))
        plane = (pixels - self.centre) / self.focal_px
        found = np.concatenate(
            [plane[..., :1], -plane[..., 1:], np.full((*plane.shape[:-1], 1), -1.0)], axis=-1
        )
        return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))

    def off_outline(self, outline: Array, pixels: Array) -> Array:
        """Pixels ``(..., 2)`` outside (+) or inside (-) of an outline ``(..., 3)``, in pixels."""
        if self.focal_px is None:
            return np.asarray(
                np.hypot(pixels[..., 0] - outline[..., 0], pixels[..., 1] - outline[..., 1])
                - outline[..., 2]
            )
        axis = self.rays(outline[..., :2])
        ray = self.rays(pixels)
        across = np.linalg.norm(np.cross(ray, axis), axis=-1)
        angle = np.arctan2(across, np.einsum("...i,...i->...", ray, axis))
        half = np.arctan2(outline[..., 2], self.focal_px)
        # A pixel covers fewer radians away from the principal point: f / cos^2 for the most part.
        scale = self.focal_px / np.square(ray[..., 2])
        return np.asarray((angle - half) * scale)

    def outline_points(self, outline: Array, count: int = 360) -> Array:
        """``(count, 2)`` pixels along an outline ``(3,)``, counter-clockwise from the right."""
        turn = np.arange(count) * (2.0 * np.pi / count)
        if self.focal_px is None:
            circle = np.stack([np.cos(turn), -np.sin(turn)], axis=1)
            return np.asarray(outline[:2] + outline[2] * circle)
        axis = self.rays(outline[:2])
        right, up = tangents(axis)
        half = np.arctan2(outline[2], self.focal_px)
        ring = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * up
        return self.pixels(np.cos(half) * axis + np.sin(half) * ring)

    def pixels(self, points: Array) -> Array:
        """``(..., 2)`` pixels of points ``(..., 3)`` in front of a perspective camera."""
        if self.focal_px is None:
            raise ArgumentError("focal_px: an orthographic camera has no scale of its own")
        plane = points[..., :2] / -points[..., 2:]
        return np.asarray(plane * (self.focal_px, -self.focal_px) + self.centre)

    def balls(self, outline: Array) -> tuple[Array, Array]:
        """Middles ``(..., 3)`` and radii ``(...)`` of balls by their outlines ``(..., 3)``.

        Perspective: radii are 1, distances follow from the cones. Orthographic: pixels, with the
        ball on the plane z = 0.
        """
        if self.focal_px is None:
            middle = (outline[..., :2] - self.centre) * (1.0, -1.0)
            return np.concatenate([middle, outline[..., 2:]], axis=-1), outline[..., 2]
        sine = outline[..., 2] / np.hypot(outline[..., 2], self.focal_px)
        return np.asarray(self.rays(outline[..., :2]) / sine[..., None]), np.ones_like(sine)

    def reflected(self, outline: Array, pixels: Array) -> tuple[Array, Array]:
        """The law of reflection on a ball: where a pixel looks, and what it sees there.

        With the ball's middle C, radius R and a pixel's ray d: t = d.C - sqrt((d.C)^2 - C.C + R^2),
        p = t d, n = (p - C) / R, u = d - 2 (d.n) n.

        Parameters
        ----------
        outline
            ``(..., 3)``.
        pixels
            ``(..., 2)`` within the outline; NaN results from others.

        Returns
        -------
        tuple
            ``(..., 3)`` p on the ball, in units of :meth:`balls`, and ``(..., 3)`` unit vectors u
            from p to what is mirrored.
        """
        middle, radius = self.balls(outline)
        with np.errstate(invalid="ignore"):
            if self.focal_px is None:
                across = (pixels - outline[..., :2]) * (1.0, -1.0) / radius[..., None]
                height = np.sqrt(1.0 - np.square(across).sum(axis=-1, keepdims=True))
                normal = np.concatenate([across, height], axis=-1)
                point = middle + radius[..., None] * normal
                ray = self.rays(pixels)
            else:
                ray = self.rays(pixels)
                along = np.einsum("...i,...i->...", ray, middle)
                beside = np.square(middle - along[..., None] * ray).sum(axis=-1)
                point = (along - np.sqrt(np.square(radius) - beside))[..., None] * ray
                normal = (point - middle) / radius[..., None]
        cosine = np.einsum("...i,...i->...", ray, normal)[..., None]
        return point, np.asarray(ray - 2.0 * cosine * normal)


def tangents(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors ``(..., 3)`` across a direction and each other: right and up of it."""
    # Whichever axis is farther from the direction.
    upright = np.abs(direction[..., 1:2]) < 0.9
    helper = np.where(upright, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    right = np.cross(helper, -direction)
    right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    return right, np.cross(-direction, right)

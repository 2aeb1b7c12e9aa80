"""The plane of a painting in a photograph: a homography [@hartley2004multiple] behind a lens.

What finds it (:mod:`impasto.align`) and what reads photographs by it (:mod:`impasto.io`) share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.lens import Lens

Floats = NDArray[np.float64]

SAME_VIEW = np.radians(0.5)
"""Views that differ by less are one: the camera stood still."""


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


def cameras_of(places: Sequence[Floats | None]) -> Floats | None:
    """``(n, 3)`` mm: the places of the cameras of a stack, as its rig takes them.

    Parameters
    ----------
    places
        ``(3,)`` mm from the middle of the painting for each photograph; None where not known.

    Returns
    -------
    ndarray
        One place for all if the camera stood still; None where a place is not known. A camera in
        front of the painting has a place, too: near it, each pixel is seen from another direction.
    """
    known = [place for place in places if place is not None]
    if len(known) < len(places):
        return None
    found = np.array(known)
    eyes = found / np.linalg.norm(found, axis=1, keepdims=True)
    common = eyes.mean(axis=0) / np.linalg.norm(eyes.mean(axis=0))
    # The chord of a small angle is the angle.
    if np.linalg.norm(eyes - common, axis=1).max() < SAME_VIEW:
        return np.tile(found.mean(axis=0), (len(found), 1))
    return found

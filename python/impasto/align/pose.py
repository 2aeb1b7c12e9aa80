"""The pose of the camera from the marks of a painting: infinitesimal plane-based pose estimation.

The homography of the marks is decomposed with the camera matrix [@collins2014ippe] (OpenCV's
``SOLVEPNP_IPPE``), both candidates are refined by Levenberg-Marquardt on the reprojection
[@levenberg1944; @marquardt1963], and the one that fits better is kept. The covariance is that of
least squares, from the derivatives of the reprojection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError, GeometryError
from impasto.frontal_view import FrontalView

Floats = NDArray[np.float64]

UNKNOWNS = 6
LEAST_SIGMA = 0.01
"""Pixels: no mark is found better, however well a few of them fit."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera of one photograph stood.

    Attributes
    ----------
    rotation
        ``(3, 3)``: from the frame of the painting to that of the camera (right, down, forward).
    place_mm
        ``(3,)`` of the camera, from the middle of the painting (x right, y up, z to the viewer).
    place_sigma_mm
        ``(3,)`` standard deviations.
    view_sigma
        Standard deviation of the direction to the camera from the middle of the painting, along its
        worse axis, radians.
    residual_px
        Root mean square of the distances between found and predicted marks.
    freedom
        Twice the marks less six: 2 for four marks.
    sigma_px
        The error of a mark's coordinate that the standard deviations are for.
    """

    rotation: Floats
    place_mm: Floats
    place_sigma_mm: Floats
    view_sigma: float
    residual_px: float
    freedom: int
    sigma_px: float

    @property
    def view(self) -> Floats:
        """``(3,)`` unit vector from the middle of the painting to the camera."""
        return np.asarray(self.place_mm / np.linalg.norm(self.place_mm))

    def views(self, mm: ArrayLike) -> Floats:
        """``(..., 3)`` unit vectors to the camera from places ``(..., 2)`` of the painting."""
        places = np.asarray(mm, dtype=np.float64)
        way = self.place_mm - np.concatenate([places, np.zeros((*places.shape[:-1], 1))], axis=-1)
        return np.asarray(way / np.linalg.norm(way, axis=-1, keepdims=True))

    @property
    def tilt(self) -> float:
        """Angle between the direction to the camera and the normal of the painting, radians."""
        x, y, z = self.place_mm.tolist()
        return float(np.arctan2(np.hypot(x, y), z))


def camera_poses(views: Sequence[FrontalView]) -> list[Pose] | None:
    """The poses of all photographs; the error of a mark is that of all of them together.

    Parameters
    ----------
    views
        How each photograph shows the painting.

    Returns
    -------
    list
        One for each; None instead of a list if a photograph has no lens, without which there is no
        camera matrix.

    Raises
    ------
    GeometryError
        As :func:`camera_pose`.
    """
    if any(view.lens is None for view in views):
        return None
    alone = [camera_pose(view) for view in views]
    freedom = sum(one.freedom for one in alone)
    squares = sum(
        one.residual_px**2 * len(view.names) for one, view in zip(alone, views, strict=True)
    )
    sigma = max(float(np.sqrt(squares / freedom)), LEAST_SIGMA)
    return [camera_pose(view, sigma_px=sigma) for view in views]


def camera_pose(view: FrontalView, *, sigma_px: float | None = None) -> Pose:
    """The pose of the camera of one photograph.

    Parameters
    ----------
    view
        How it shows the painting, with a lens.
    sigma_px
        Standard deviation of a coordinate of a mark; default: what the residual says, 0.01 pixels
        at least. Four marks say little of it: better take :func:`camera_poses`.

    Raises
    ------
    ArgumentError
        A view without a lens.
    GeometryError
        Marks that no camera in front of the painting shows.
    """
    import cv2

    if view.lens is None:
        raise ArgumentError("view: the pose of a camera needs its lens (impasto calibrate lens)")
    ideal = view.lens.ideal(view.found)
    flat = np.column_stack([view.marks_mm(ideal), np.zeros(len(ideal))])
    camera = view.lens.matrix
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            flat, ideal, camera, None, flags=cv2.SOLVEPNP_IPPE
        )
        found = [
            cv2.solvePnPRefineLM(flat, ideal, camera, None, turn, shift)
            for turn, shift in zip(turns, shifts, strict=True)
        ]
    except cv2.error as error:
        raise GeometryError(f"view: its marks determine no pose ({error.err})") from error
    fits = []
    for turn, shift in found:
        seen, slopes = cv2.projectPoints(flat, turn, shift, camera, None)
        off = ideal - np.asarray(seen).reshape(-1, 2)
        matrix, by_turn = cv2.Rodrigues(turn)
        place = -matrix.T @ shift.ravel()
        if np.isfinite(off).all() and place[2] > 0.0:
            fits.append((float(np.square(off).sum()), matrix, by_turn, shift.ravel(), slopes))
    if not fits:
        raise GeometryError("view: no camera in front of the painting shows its marks so")
    squares, matrix, by_turn, shift, slopes = min(fits, key=lambda one: one[0])
    freedom = 2 * len(ideal) - UNKNOWNS
    if sigma_px is None:
        sigma_px = max(float(np.sqrt(squares / freedom)), LEAST_SIGMA)
    covariance = sigma_px**2 * np.linalg.inv(slopes[:, :UNKNOWNS].T @ slopes[:, :UNKNOWNS])
    # The place is -R't: by the rotation vector through OpenCV's derivatives of R, by t it is -R'.
    by_vector = -np.einsum("vij,i->jv", by_turn.reshape(3, 3, 3), shift)
    derivatives = np.hstack([by_vector, -matrix.T])
    own = derivatives @ covariance @ derivatives.T
    place = -matrix.T @ shift
    distance = float(np.linalg.norm(place))
    across = np.eye(3) - np.outer(place, place) / distance**2
    worse = float(np.linalg.eigvalsh(across @ own @ across)[-1])
    return Pose(
        np.asarray(matrix), np.asarray(place), np.sqrt(np.diag(own)),
        np.sqrt(worse) / distance, float(np.sqrt(squares / len(ideal))), freedom, sigma_px,
    )  # fmt: skip

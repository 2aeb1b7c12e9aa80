"""From lamps up to a rotation to lamps in the frame of a painting.

The mean normal of a painting looks at the camera, which fixes two of three angles. The third is
that at which the slopes of the relief are those of a surface, without curl
[@yuille1999determining]. Turned by half a turn about the view, hills for hollows, they are as good:
relief under lamps from the left cannot be told from its cast under lamps from the right
[@belhumeur1999basrelief]. The fall-off of near lamps tells, or the user.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impasto.calibrate.uncalibrated.patches import Array

STEEP = 5.0
"""Median sizes of curl and divergence above which a cell is an edge of paint, and left out."""


@dataclass(frozen=True, eq=False)
class PanelFrame:
    """A frame of the painting up to half a turn.

    Parameters
    ----------
    matrix
        ``(3, 3)`` orthogonal: lamps @ matrix are in the frame of the painting; determinant -1 where
        the factors were mirrored.
    curl
        Curl left over the largest at any angle, 0 for a perfect surface, 1 for none.
    mirrored_curl
        The same for the mirror image: where both are alike, nothing tells right from left.
    """

    matrix: Array
    curl: float
    mirrored_curl: float


def panel_frame(lamps: Array, surface: Array, weights: Array) -> PanelFrame:
    """The frame in which the painting faces the camera and its slopes have least curl.

    Parameters
    ----------
    lamps
        ``(lamp, 3)`` unit vectors in any frame.
    surface
        ``(3, patch, y, x)`` normals times albedo in the same frame.
    weights
        ``(patch,)`` how often each patch counts.
    """
    view = _mean_normal(lamps, surface, weights)
    helper = np.eye(3)[np.argmin(np.abs(view))]
    right = np.cross(helper, view)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(view, right), view], axis=1)
    rotated = np.tensordot(axes.T, surface, axes=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope_x, slope_y = -rotated[0] / rotated[2], -rotated[1] / rotated[2]
    plain = _least_curl(slope_x, slope_y, weights)
    mirrored = _least_curl(slope_x, -slope_y, weights)
    (angle, curl), other = (plain, mirrored[1]) if plain[1] <= mirrored[1] else (mirrored, plain[1])
    if mirrored[1] < plain[1]:
        axes = axes * (1.0, -1.0, 1.0)
    return PanelFrame(axes @ about_view(angle), curl, other)


def mirrored(frame: PanelFrame, surface: Array, weights: Array) -> PanelFrame:
    """The best frame of the other hand."""
    flip = np.diag([1.0, -1.0, 1.0])
    rotated = np.tensordot((frame.matrix @ flip).T, surface, axes=1)
    angle, curl = _least_curl(-rotated[0] / rotated[2], -rotated[1] / rotated[2], weights)
    return PanelFrame(frame.matrix @ flip @ about_view(angle), curl, frame.curl)


def about_view(angle: float) -> Array:
    """Vectors @ this are turned about z, from x to y."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _mean_normal(lamps: Array, surface: Array, weights: Array) -> Array:
    """Where slopes have no mean: a panel is flat at large."""
    flat = surface.reshape(3, len(weights), -1)
    length = np.linalg.norm(flat, axis=0)
    share = np.broadcast_to(weights[:, None], length.shape) * (length > 0.0)
    unit = flat / np.where(length > 0.0, length, 1.0)
    view = (unit * share).sum(axis=(1, 2))
    view /= np.linalg.norm(view)
    for _ in range(20):
        facing = np.tensordot(view, flat, axes=1)
        seen = share * (facing > 0.2 * length)
        slope = flat / np.where(facing > 0.0, facing, 1.0) - view[:, None, None]
        view = view + (slope * seen).sum(axis=(1, 2)) / max(seen.sum(), 1.0)
        view /= np.linalg.norm(view)
    return np.asarray(view * np.sign(np.median(lamps @ view) or 1.0))


def _least_curl(slope_x: Array, slope_y: Array, weights: Array) -> tuple[float, float]:
    """The angle by which slopes are turned for the least curl, and that over the largest."""
    x_of_x, y_of_x = _differences(slope_x)
    x_of_y, y_of_y = _differences(slope_y)
    curl, divergence = x_of_y - y_of_x, x_of_x + y_of_y
    size = np.hypot(curl, divergence)
    usual = size <= STEEP * np.nanmedian(size)
    share = np.where(usual, weights[:, None, None], 0.0)
    curl, divergence = (np.where(usual, each, 0.0) for each in (curl, divergence))
    cross = (share * curl * divergence).sum()
    value, vector = np.linalg.eigh(
        [[(share * curl * curl).sum(), cross], [cross, (share * divergence * divergence).sum()]]
    )
    # Turned by an angle, curl is cos(angle) curl + sin(angle) divergence.
    angle = float(np.arctan2(vector[1, 0], vector[0, 0]))
    return angle, float(max(value[0], 0.0) / max(value[1], np.finfo(float).tiny))


def _differences(slope: Array) -> tuple[Array, Array]:
    """Derivatives to the right and upwards in the middle of each two by two pixels."""
    right = np.diff(slope, axis=-1)
    down = np.diff(slope, axis=-2)
    return (
        0.5 * (right[..., 1:, :] + right[..., :-1, :]),
        -0.5 * (down[..., :, 1:] + down[..., :, :-1]),
    )

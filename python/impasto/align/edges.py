"""Corners of a dark square from its edges: lines through edge points, by total least squares.

Along lines across each side, the edge lies at the centroid of the brightness' slope, which the blur
of a lens does not move [@ghosal1993orthogonal]. Corners are the intersections of the lines
through these points [@pearson1901lines]. Gradients around a corner alone, which the usual
refinement looks at, put it inside, as blur rounds it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ALONG = 48
"""Lines across each side."""
INNER = 0.12
"""Share of a side at either end that is left out: corners are rounded."""
STEP = 0.25
"""Pixels between samples of a line."""
LEAST, MOST = 2.0, 8.0
"""Reach of a line to either side, in pixels."""
BORDER = 0.75
"""The same in cells of the code at most: the border is one cell wide."""
ROUNDS = 3
OUTLIER = 3.0
"""Standard deviations from a line from which an edge point is left out."""
DIM = 0.3
"""Share of the median contrast below which an edge point counts for nothing (a highlight)."""


def square_corners(light: NDArray[np.float32], rough: Floats, cells: int) -> Floats | None:
    """Corners of a square.

    Parameters
    ----------
    light
        ``(y, x)`` linear.
    rough
        ``(4, 2)`` pixels, in order around the square, within a quarter of a cell.
    cells
        Of the code along a side, with the border.

    Returns
    -------
    ndarray or None
        ``(4, 2)``; None where a side has too few edge points, or lines lead elsewhere.
    """
    corners = rough
    for _ in range(ROUNDS):
        lines = []
        for side in range(4):
            start, stop = corners[side], corners[(side + 1) % 4]
            line = _line(light, start, stop, corners.mean(axis=0), cells)
            if line is None:
                return None
            lines.append(line)
        found = [_crossing(lines[side - 1], lines[side]) for side in range(4)]
        corners = np.array(found)
    reach = np.linalg.norm(rough - np.roll(rough, 1, axis=0), axis=1).min() / cells
    if not np.linalg.norm(corners - rough, axis=1).max() < max(reach, LEAST):
        return None
    return corners


def _line(
    light: NDArray[np.float32], start: Floats, stop: Floats, middle: Floats, cells: int
) -> tuple[Floats, Floats] | None:
    """A point of the side and its unit direction."""
    import cv2

    along = stop - start
    length = float(np.linalg.norm(along))
    if length < 4.0 * LEAST:
        return None
    along = along / length
    outwards = np.array([along[1], -along[0]])
    depth = float((start - middle) @ outwards)
    if depth < 0.0:
        outwards, depth = -outwards, -depth
    reach = float(np.clip(BORDER * 2.0 * depth / cells, LEAST, MOST))
    places = start + np.outer(np.linspace(INNER, 1.0 - INNER, ALONG) * length, along)
    offsets = np.arange(-reach, reach + STEP / 2, STEP)
    samples = places[:, None] + offsets[None, :, None] * outwards
    profile = np.asarray(
        cv2.remap(
            light,
            samples[..., 0].astype(np.float32),
            samples[..., 1].astype(np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float64,
    )
    slope = np.diff(profile, axis=1)
    contrast = slope.sum(axis=1)
    usual = float(np.median(contrast))
    fine = contrast > DIM * usual
    if usual <= 0.0 or fine.sum() < ALONG // 3:
        return None
    between = (offsets[:-1] + offsets[1:]) / 2.0
    # Slopes far from the edge are noise alone; a window about the edge leaves them out.
    edge = (slope * between).sum(axis=1)[fine] / contrast[fine]
    for _ in range(2):
        window = np.abs(between[None] - edge[:, None]) <= max(LEAST, reach / 2.0)
        share = slope[fine] * window
        edge = (share * between).sum(axis=1) / np.where(
            share.sum(axis=1) > 0.0, share.sum(axis=1), np.inf
        )
    points = places[fine] + edge[:, None] * outwards
    for _ in range(2):
        centre = points.mean(axis=0)
        direction = np.linalg.svd(points - centre, full_matrices=False)[2][0]
        off = (points - centre) @ np.array([-direction[1], direction[0]])
        spread = max(1.4826 * float(np.median(np.abs(off))), 1e-3)
        kept = np.abs(off) <= OUTLIER * spread
        points = points[kept]
    return centre, direction


def _crossing(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> Floats:
    (a, along), (b, across) = first, second
    reach = np.linalg.solve(np.stack([along, -across], axis=1), b - a)
    return np.asarray(a + reach[0] * along)

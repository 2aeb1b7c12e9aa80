"""A photograph of a ColorChecker in perspective, under light that falls off, from spectra.

Plain numpy and OpenCV's warp: a drawing of the chart at 4 pixels per mm, 24 squares of 34 mm in a
lattice of 40 mm, seen in a quadrangle, at twice the size, which is then averaged.
"""

from __future__ import annotations

import cv2
import numpy as np

CORNERS = np.float32([[150, 90], [560, 120], [540, 400], [130, 380]])
"""Pixels of the corners of the chart's frame: upper left, upper right, lower right, lower left."""
SIZE = (500, 700)
PER_MM, LATTICE, SQUARE, EDGE = 4, 40, 34, 4


def homography():
    width, height = (PER_MM * (LATTICE * count + 2 * EDGE) for count in (6, 4))
    frame = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
    return cv2.getPerspectiveTransform(frame, CORNERS), (height, width)


def middles():
    """(24, 2) pixels of the middles of the patches."""
    matrix, _ = homography()
    rows, columns = np.divmod(np.arange(24), 6)
    at = np.stack([columns + 0.5, rows + 0.5], axis=1) * LATTICE + EDGE
    whole = np.concatenate([PER_MM * at, np.ones((24, 1))], axis=1) @ matrix.T
    return whole[:, :2] / whole[:, 2:] - 0.5


def photograph(light, slope=(0.05, -0.04), noise=0.002, seed=0):
    """(band, y, x) linear light from the (24, band) light of the patches; grey around the chart.

    ``slope``: how the light changes over the width and the height of the photograph.
    """
    matrix, size = homography()
    drawing = np.full((*size, light.shape[1]), 0.03)
    for patch, (row, column) in enumerate(np.ndindex(4, 6)):
        top, left = (
            PER_MM * (EDGE + LATTICE * at + (LATTICE - SQUARE) // 2) for at in (row, column)
        )
        drawing[top : top + PER_MM * SQUARE, left : left + PER_MM * SQUARE] = light[patch]
    twice = np.diag([2.0, 2.0, 1.0]) @ matrix
    around = [0.35] * light.shape[1]
    seen = cv2.warpPerspective(drawing, twice, (2 * SIZE[1], 2 * SIZE[0]), borderValue=around)
    seen = seen.reshape(SIZE[0], 2, SIZE[1], 2, -1).mean(axis=(1, 3))
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    shading = 1 + slope[0] * (x / SIZE[1] - 0.5) + slope[1] * (y / SIZE[0] - 0.5)
    seen = seen * shading[..., None]
    seen = seen + np.random.default_rng(seed).normal(0, noise, seen.shape)
    return np.moveaxis(np.clip(seen, 0, 1), -1, 0)

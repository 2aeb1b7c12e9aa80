"""What lies on the plane of a studio: the painting between its marks, a chart, a target."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.chart import COLUMNS, ROWS
from impasto.rehearsal.studio import Floats, Reflectances

GROUND = 0.18
"""Reflectance of the matte table."""
INK, PAPER = 0.04, 0.85
CELLS = 6
"""Cells of a marker of 4 x 4 bits along a side."""
CHESS = (9, 6)
"""Inner corners of the target for the lens."""


def uniform(reflectance: float, bands: int) -> Reflectances:
    """A board of one reflectance that fills the frame."""

    def seen(x: Floats, _: Floats) -> Floats:
        return np.full((bands, *x.shape), reflectance)

    return seen


def marks(
    width_mm: float, height_mm: float, side_mm: float, bands: int, *, ground: float = GROUND
) -> Reflectances:
    """ArUco markers 0 to 3 that touch the corners of a painting, on a table.

    Each has a border of paper as wide as one of its cells; with a ``ground`` of :data:`PAPER` all
    are printed on one sheet.
    """
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    patterns = [cv2.aruco.generateImageMarker(codes, number, CELLS) > 0 for number in range(4)]
    corners = ((-1, 1), (1, 1), (1, -1), (-1, -1))
    cell = side_mm / CELLS

    def seen(x: Floats, y: Floats) -> Floats:
        plane = np.full(x.shape, ground)
        for pattern, (right, up) in zip(patterns, corners, strict=True):
            left = right * width_mm / 2 - (side_mm if right < 0 else 0.0)
            top = up * height_mm / 2 + (side_mm if up > 0 else 0.0)
            column, row = (x - left) / cell, (top - y) / cell
            border = (column > -1) & (column < CELLS + 1) & (row > -1) & (row < CELLS + 1)
            inner = (column >= 0) & (column < CELLS) & (row >= 0) & (row < CELLS)
            plane[border] = PAPER
            paper = pattern[row[inner].astype(int), column[inner].astype(int)]
            plane[inner] = np.where(paper, PAPER, INK)
        return np.broadcast_to(plane, (bands, *x.shape))

    return seen


def with_card(
    around: Reflectances,
    middle: tuple[float, float],
    size: tuple[float, float],
    reflectance: float,
) -> Reflectances:
    """What lies around, and on it a card of one reflectance."""

    def seen(x: Floats, y: Floats) -> Floats:
        inside = (np.abs(x - middle[0]) <= size[0] / 2) & (np.abs(y - middle[1]) <= size[1] / 2)
        return np.where(inside, reflectance, around(x, y))

    return seen


def picture(planes: NDArray[np.floating], pitch_mm: float) -> Reflectances:
    """A picture ``(band, y, x)`` about the middle of the plane; NaN beyond it."""
    rows, columns = planes.shape[1:]
    source = [np.ascontiguousarray(plane, dtype=np.float32) for plane in planes]

    def seen(x: Floats, y: Floats) -> Floats:
        across = (x / pitch_mm + (columns - 1) / 2).astype(np.float32)
        down = ((rows - 1) / 2 - y / pitch_mm).astype(np.float32)
        found = np.stack([
            cv2.remap(plane, across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            for plane in source
        ]).astype(np.float64)  # fmt: skip
        outside = (np.abs(x) > columns * pitch_mm / 2) | (np.abs(y) > rows * pitch_mm / 2)
        found[:, outside] = np.nan
        return np.where(found < 0.0, 0.0, found)

    return seen


def chart(patches: Floats, lattice_mm: float) -> Reflectances:
    """A ColorChecker: ``(24, band)`` responses to its patches, whose middles lie so far apart."""

    def seen(x: Floats, y: Floats) -> Floats:
        column, row = x / lattice_mm + COLUMNS / 2, ROWS / 2 - y / lattice_mm
        inside = (column >= 0) & (column < COLUMNS) & (row >= 0) & (row < ROWS)
        patch = np.full(x.shape, -1)
        patch[inside] = COLUMNS * row[inside].astype(int) + column[inside].astype(int)
        gap = (np.abs(column % 1 - 0.5) > SQUARE) | (np.abs(row % 1 - 0.5) > SQUARE)
        frame = (np.abs(column - COLUMNS / 2) < COLUMNS / 2 + EDGE) & (
            np.abs(row - ROWS / 2) < ROWS / 2 + EDGE
        )
        found = np.where(frame, INK, GROUND) * np.ones((patches.shape[1], *x.shape))
        shown = inside & ~gap
        found[:, shown] = patches[patch[shown]].T
        return found

    return seen


SQUARE, EDGE = 0.43, 0.1
"""Half a patch and the frame of a chart, in lattice widths."""


def chessboard(side_mm: float, bands: int) -> Reflectances:
    """Squares with :data:`CHESS` inner corners, on paper."""

    def seen(x: Floats, y: Floats) -> Floats:
        column, row = (
            np.floor(place / side_mm + (count + 1) / 2)
            for place, count in zip((x, y), CHESS, strict=True)
        )
        board = (column >= 0) & (column <= CHESS[0]) & (row >= 0) & (row <= CHESS[1])
        plane = np.where(board & ((column + row) % 2 == 0), INK, PAPER)
        return np.broadcast_to(plane, (bands, *x.shape))

    return seen

"""Targets with known corners, and their corners in photographs: chessboards and ChArUco boards.

Chessboards are found by the localised Radon transform [@duda2018accurate], the markers of a ChArUco
board by their codes [@garridojurado2014automatic]. The places of corners are those to which the
gradients around them point best [@forstner1987fast]. All by OpenCV.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import suggestion
from impasto.calibrate.tones import grey_from
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

_SIZES = r"(?P<columns>\d+)x(?P<rows>\d+)"
_MM = r"(?P<{}>[\d.]+)mm"
_CHESSBOARD = re.compile(f"chessboard:{_SIZES}:{_MM.format('square')}")
_CHARUCO = re.compile(
    f"charuco:{_SIZES}:{_MM.format('square')}:{_MM.format('marker')}(:(?P<dictionary>\\w+))?"
)
SHARE = 0.4
"""Reach of the refinement of a corner, as a share of the distance to the nearest other one, where
nothing else is near."""
NARROW, WIDE = 3, 12
"""Least and largest reach, in pixels: wider ones average the lens's distortion."""
USUAL = "4x4_50"
"""Dictionary of markers if none is named."""
EXAMPLES = "chessboard:9x6:25mm or charuco:7x5:30mm:22mm:4x4_50"


def dictionary(name: str, argument: str) -> Any:
    """OpenCV's dictionary of markers by a name such as ``4x4_50``.

    Raises
    ------
    ArgumentError
        A name that OpenCV does not have.
    """
    import cv2

    known = {
        one.removeprefix("DICT_").lower(): one for one in dir(cv2.aruco) if one.startswith("DICT_")
    }
    if name.lower() not in known:
        hint = suggestion(name.lower(), known)
        raise ArgumentError(
            f"{argument}: {name!r} is no dictionary of markers, such as {USUAL}{hint}"
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known[name.lower()]))


@dataclass(frozen=True, eq=False)
class Target:
    """A flat board with corners at known places.

    Attributes
    ----------
    name
        As it was given.
    corners
        ``(n, 2)`` mm from the middle of the corners: x right, y up.
    shape
        Corners per row and rows of corners.
    board
        OpenCV's ChArUco board; None for a chessboard.
    clear
        How far from a corner nothing but its own edges is seen, in sides of a square.
    """

    name: str
    corners: Floats
    shape: tuple[int, int]
    board: Any = None
    clear: float = SHARE

    def find(self, light: NDArray[np.float32]) -> tuple[NDArray[np.intp], Floats]:
        """Numbers ``(m,)`` of the corners that a picture ``(y, x)`` shows, and pixels ``(m, 2)``.

        A chessboard is found whole or not at all. ``light`` is linear (``calibrate.tones``).
        """
        numbers, corners = self._rough(grey_from(light))
        if len(numbers) < 2:
            return numbers, corners
        apart = np.linalg.norm(corners[:, None] - corners, axis=2)
        apart[np.diag_indices(len(corners))] = np.inf
        return numbers, refined_corners(light, corners, self.clear * float(apart.min()))

    def _rough(self, grey: NDArray[np.uint8]) -> tuple[NDArray[np.intp], Floats]:
        import cv2

        if self.board is None:
            flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
            seen, found = cv2.findChessboardCornersSB(grey, self.shape, flags=flags)
            if not seen:  # small or soft squares, which thresholds still separate
                flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
                seen, found = cv2.findChessboardCorners(grey, self.shape, flags=flags)
            if not seen:
                return np.zeros(0, np.intp), np.zeros((0, 2))
            return np.arange(len(self.corners)), np.asarray(found, np.float64).reshape(-1, 2)
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(self.board).detectBoard(grey)
        if numbers is None or corners is None:
            return np.zeros(0, np.intp), np.zeros((0, 2))
        return (
            np.asarray(numbers, np.intp).ravel(),
            np.asarray(corners, np.float64).reshape(-1, 2),
        )


def refined_corners(light: NDArray[np.float32], corners: Floats, reach: float) -> Floats:
    """Corners ``(n, 2)`` of linear light, each from the gradients within ``reach`` pixels of it.

    The detectors' own places are off by 0.25 pixels in simulated photographs, these by 0.04
    (``tests/test_lens.py``).
    """
    import cv2

    half = int(np.clip(reach, NARROW, WIDE))
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    start = np.ascontiguousarray(corners[:, None].astype(np.float32))
    found = cv2.cornerSubPix(light, start, (half, half), (-1, -1), stop)
    return np.asarray(found, np.float64).reshape(-1, 2)


def target_from(text: str, argument: str = "target") -> Target:
    """A target from its description.

    Parameters
    ----------
    text
        ``chessboard:COLUMNSxROWS:SIDEmm`` with the inner corners, where four squares meet, per row
        and column; or ``charuco:COLUMNSxROWS:SQUAREmm:MARKERmm:DICTIONARY`` with squares per row
        and column, the sides of a square and of a marker; dictionary ``4x4_50`` if none is named.
    argument
        How messages call it.

    Raises
    ------
    ArgumentError
        Another description, or sizes that no board has.
    """
    if found := _CHESSBOARD.fullmatch(text.lower()):
        shape = int(found["columns"]), int(found["rows"])
        square = _length(found["square"], text, argument)
        if min(shape) < 3:
            raise ArgumentError(
                f"{argument}: a chessboard needs 3 inner corners or more along each side, found "
                f"{text!r}"
            )
        return Target(text, _grid(shape, square), shape)
    found = _CHARUCO.fullmatch(text.lower())
    if found is None:
        raise ArgumentError(f"{argument}: expected a target such as {EXAMPLES}, found {text!r}")
    square, marker = (_length(found[name], text, argument) for name in ("square", "marker"))
    squares = int(found["columns"]), int(found["rows"])
    if min(squares) < 3 or not marker < square:
        raise ArgumentError(
            f"{argument}: a ChArUco board needs 3 squares or more along each side and markers that "
            f"are smaller than squares, found {text!r}"
        )
    codes = dictionary(found["dictionary"] or USUAL, argument)
    if squares[0] * squares[1] // 2 > len(codes.bytesList):
        raise ArgumentError(
            f"{argument}: {text!r} has {squares[0] * squares[1] // 2} markers, but its dictionary "
            f"{len(codes.bytesList)}"
        )
    import cv2

    board = cv2.aruco.CharucoBoard(squares, square, marker, codes)
    shape = squares[0] - 1, squares[1] - 1
    # Markers begin where the white border of their squares ends.
    clear = min(SHARE, (square - marker) / (2.0 * square))
    return Target(text, _grid(shape, square), shape, board, clear)


def _length(word: str, text: str, argument: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e6:
        raise ArgumentError(f"{argument}: expected lengths above 0 mm, found {text!r}")
    return value


def _grid(shape: tuple[int, int], square: float) -> Floats:
    """Row by row from the upper left, as OpenCV counts."""
    columns, rows = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]))
    x = (columns.ravel() - (shape[0] - 1) / 2) * square
    y = ((shape[1] - 1) / 2 - rows.ravel()) * square
    return np.stack([x, y], axis=1).astype(np.float64)

"""A photograph against another session's: SIFT [@lowe2004sift], RANSAC [@fischler1981ransac].

Features connect the two, a homography that most of them agree on places one in the other.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import length_mm
from impasto._internal.damage import damage_of
from impasto.align.photographs import LINEAR
from impasto.calibrate.tones import grey_from, light_from
from impasto.errors import ArgumentError, GeometryError
from impasto.frontal_view import FrontalView
from impasto.io.files import read_text
from impasto.io.session.linear_codes import read_photograph
from impasto.lens import Lens
from impasto.rectification import Grid

Floats = NDArray[np.float64]

LARGEST = 2400
"""Rows or columns of a picture in which features are looked for at most."""
FEATURES = 8000
RATIO = 0.8
"""A match is kept if the second best is so much farther away [@lowe2004sift]."""
NEAR = 2.0
"""Pixels of a reduced picture by which a match may miss the homography."""
LEAST = 20
"""Matches that must agree: a homography has 8 unknowns, 4 matches."""


class Reference:
    """A frontal picture that others are aligned to.

    Parameters
    ----------
    light
        ``(y, x)`` linear.
    grid
        Its pixels.
    name
        The picture, for messages.
    """

    def __init__(self, light: NDArray[np.float32], grid: Grid, name: str) -> None:
        self.light, self.grid, self.name = light, grid, name
        places, self._descriptors = _features(light)
        self._mm = grid.mm(places[:, 0], places[:, 1])

    def view(self, light: NDArray[np.float32], lens: Lens | None, photograph: str) -> FrontalView:
        """How a photograph, linear ``(y, x)``, shows the plane of the reference.

        Raises
        ------
        GeometryError
            Too few features agree.
        """
        import cv2

        places, descriptors = _features(light)
        kept = []
        if min(len(places), len(self._mm)) >= LEAST:
            matcher = cv2.BFMatcher(cv2.NORM_L2)
            pairs = matcher.knnMatch(self._descriptors, descriptors, k=2)
            kept = [one for one, other in pairs if one.distance < RATIO * other.distance]
        mm = self._mm[[match.queryIdx for match in kept]]
        found = places[[match.trainIdx for match in kept]]
        ideal = found if lens is None or not kept else lens.ideal(found)
        agree = np.zeros(len(kept), dtype=bool)
        matrix = None
        if len(kept) >= LEAST:
            near = NEAR * max(1.0, max(light.shape) / LARGEST)
            cv2.setRNGSeed(0)
            matrix, mask = cv2.findHomography(
                mm, ideal, cv2.RANSAC, near, maxIters=5000, confidence=0.9999
            )
            agree = np.zeros(len(kept), bool) if mask is None else mask.ravel().astype(bool)
        if matrix is None or agree.sum() < LEAST:
            raise GeometryError(
                f"{photograph}: {int(agree.sum())} features agree with {self.name}, {LEAST} are "
                "the least; is it the same painting, sharp, and not much smaller? Else use markers"
            )
        matrix, _ = cv2.findHomography(mm[agree], ideal[agree], 0)
        matrix = np.asarray(matrix, np.float64)
        homogeneous = np.column_stack([mm[agree], np.ones(int(agree.sum()))]) @ matrix.T
        residual = ideal[agree] - homogeneous[:, :2] / homogeneous[:, 2:]
        names = tuple(f"feature {number}" for number in range(int(agree.sum())))
        return FrontalView(matrix, lens, names, found[agree], residual)


def read_reference(
    path: str | Path, *, pixel_mm: float | None = None, encoding: str | None = None
) -> Reference:
    """A frontal picture of another session.

    Parameters
    ----------
    path
        The picture, such as one that :func:`impasto.align.align` wrote.
    pixel_mm
        Width of its pixels; default: what ``report/alignment.json`` beside it says.
    encoding
        Its tone curve; default: 8-bit files by their profile, else sRGB, all others linear.

    Raises
    ------
    ArgumentError
        Not found, or the width of its pixels is not known.
    """
    path = Path(path)
    light = light_from(read_photograph(path, encoding).planes, LINEAR)
    if pixel_mm is None:
        pixel_mm = _stated_pixel(path)
    if pixel_mm is None:
        raise ArgumentError(f"to: the width of the pixels of {path} is not known; give --pixel")
    length_mm(pixel_mm, "pixel_mm")
    rows, columns = light.shape
    return Reference(light, Grid((columns * pixel_mm, rows * pixel_mm), pixel_mm), path.name)


def _stated_pixel(path: Path) -> float | None:
    beside = path.parent / "report" / "alignment.json"
    if not beside.is_file():
        return None
    with damage_of(beside, "the report of an alignment"):
        return float(json.loads(read_text(beside))["pixel_mm"])


def _features(light: NDArray[np.float32]) -> tuple[Floats, NDArray[np.float32]]:
    """Places ``(n, 2)`` in pixels and descriptors ``(n, 128)``."""
    import cv2

    grey = grey_from(light)
    scale = min(1.0, LARGEST / max(grey.shape))
    if scale < 1.0:
        size = round(grey.shape[1] * scale), round(grey.shape[0] * scale)
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    factors = light.shape[1] / grey.shape[1], light.shape[0] / grey.shape[0]
    # Without precise upscaling all places are off by a quarter of a pixel.
    sift = cv2.SIFT.create(nfeatures=FEATURES, enable_precise_upscale=True)
    points, descriptors = sift.detectAndCompute(grey, None)
    places = np.array([point.pt for point in points], np.float64).reshape(-1, 2)
    if descriptors is None:
        descriptors = np.zeros((0, 128), np.float32)
    return (places + 0.5) * factors - 0.5, np.asarray(descriptors, np.float32)

"""Calibration of a camera from photographs of a flat target: Zhang's method [@zhang2000flexible].

OpenCV minimises the distances between corners that were found and those that camera, lens and the
poses of the target predict, over all of them. Between the models of the lens decides BIC
[@schwarz1978bic].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import one_of
from impasto.calibrate.target import Target, target_from
from impasto.calibrate.tones import light_from
from impasto.errors import ArgumentError, GeometryError
from impasto.io.images import photographs_in, read_image
from impasto.lens import FREE, NAMES, Lens, LensModel

Floats = NDArray[np.float64]

LEAST_PHOTOGRAPHS = 3
"""Zhang's equations need two tilts; a third one shows whether they agree."""
LEAST_CORNERS = 8
"""A pose has 6 unknowns, each corner gives 2 numbers; fewer than 8 corners hardly check them."""
LEAST_DEPTH = 0.01
"""Least change of depth over half of the target, relative to its distance, in two photographs: from
the front alone, focal length and distance cannot be told apart."""


@dataclass(frozen=True, eq=False)
class TargetView:
    """The target in one photograph.

    Attributes
    ----------
    name
        The photograph.
    found
        ``(n, 2)`` pixels of its corners.
    residual
        ``(n, 2)`` pixels: found minus predicted.
    """

    name: str
    found: Floats
    residual: Floats

    @property
    def rms(self) -> float:
        """Root mean square of the distances, in pixels."""
        return float(np.sqrt(np.square(self.residual).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and what it was found from.

    Attributes
    ----------
    lens
        The lens.
    views
        The target in each photograph that was used.
    unused
        Names of photographs in which the target was not found.
    tried
        Residual in pixels of each model that was tried.
    """

    lens: Lens
    views: tuple[TargetView, ...]
    unused: tuple[str, ...]
    tried: dict[LensModel, float]


def lens_from_target(
    photographs: str | Path | Sequence[NDArray[np.generic]],
    target: str | Target,
    *,
    model: LensModel | Literal["auto"] = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> LensCalibration:
    """Camera matrix and distortion of a lens from photographs of a flat target.

    Ten photographs or more, tilted up to 45 degrees to all sides, with the target in all parts of
    the frame, with the focus and the aperture of the painting's photographs.

    Parameters
    ----------
    photographs
        A folder, or ``(band, y, x)`` pictures.
    target
        Such as ``"chessboard:9x6:25mm"`` or ``"charuco:7x5:30mm:22mm:4x4_50"``
        (``impasto.calibrate.target_from``).
    model
        ``"radial"``, the 5th-order polynomial of the paper, ``"brown"``, or that which BIC prefers.
    progress
        Called with photographs done and their number.

    Raises
    ------
    ArgumentError
        No folder, photographs of different sizes, or fewer than 3 that show the target.
    GeometryError
        The target faces the camera in all photographs but one.
    """
    one_of(model, ("auto", *FREE), "model")
    board = target_from(target) if isinstance(target, str) else target
    seen: list[tuple[str, NDArray[np.intp], Floats]] = []
    unused: list[str] = []
    size: tuple[int, int] | None = None
    first = ""
    sources = _sources(photographs)
    for number, (name, load) in enumerate(sources, 1):
        light = light_from(load())
        own = light.shape[1], light.shape[0]
        if size is None:
            size, first = own, name
        elif own != size:
            raise ArgumentError(
                f"{name}: {own[0]} x {own[1]} pixels, but {first} has {size[0]} x {size[1]}; "
                "one lens needs photographs of one size, none of them rotated"
            )
        numbers, corners = board.find(light)
        if len(numbers) >= LEAST_CORNERS:
            seen.append((name, numbers, corners))
        else:
            unused.append(name)
        if progress is not None:
            progress(number, len(sources))
    if len(seen) < LEAST_PHOTOGRAPHS or size is None:
        raise ArgumentError(
            f"target: {board.name} was found in {len(seen)} of {len(sources)} photographs, "
            f"{LEAST_PHOTOGRAPHS} are the least (10 are good); count its corners once more, and "
            "show all of a chessboard with a white border, sharp and evenly lit"
        )
    _check_tilts(board, seen)
    found = {
        one: _calibrated(board, seen, size, one) for one in FREE if model in {"auto", one}
    }  # fmt: skip
    best = min(found, key=lambda one: _bic(*found[one]))
    lens, views = found[best]
    tried = {one: pair[0].residual_px for one, pair in found.items()}
    return LensCalibration(lens, tuple(views), tuple(unused), tried)


def _check_tilts(board: Target, seen: Sequence[tuple[str, NDArray[np.intp], Floats]]) -> None:
    import cv2

    half = float(np.linalg.norm(np.ptp(board.corners, axis=0))) / 2.0
    depths = []
    for _, numbers, corners in seen:
        matrix, _ = cv2.findHomography(board.corners[numbers], corners, 0)
        depths.append(0.0 if matrix is None else half * float(np.hypot(*matrix[2, :2])))
    if sum(depth > LEAST_DEPTH for depth in depths) < 2:
        raise GeometryError(
            "photographs: the target faces the camera in all of them but one; tilt it by 30 to 45 "
            "degrees to several sides, else no focal length follows"
        )


def _sources(
    photographs: str | Path | Sequence[NDArray[np.generic]],
) -> list[tuple[str, Callable[[], NDArray[np.generic]]]]:
    if isinstance(photographs, str | Path):
        paths = photographs_in(Path(photographs))
        return [(path.name, lambda path=path: read_image(path)) for path in paths]  # type: ignore[misc]
    return [
        (f"photograph {number}", lambda one=one: np.asarray(one))  # type: ignore[misc]
        for number, one in enumerate(photographs, 1)
    ]


def _calibrated(
    board: Target,
    seen: Sequence[tuple[str, NDArray[np.intp], Floats]],
    size: tuple[int, int],
    model: LensModel,
) -> tuple[Lens, list[TargetView]]:
    import cv2

    # OpenCV's y runs down, and so does the board's, so that its z is away from the camera.
    solid = np.hstack([board.corners * (1.0, -1.0), np.zeros((len(board.corners), 1))])
    objects = [solid[numbers].astype(np.float32) for _, numbers, _ in seen]
    pixels = [corners.astype(np.float32)[:, None] for _, _, corners in seen]
    flags = 0 if model == "brown" else cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    rms, matrix, distortion, turns, shifts, sigma, _, _ = cv2.calibrateCameraExtended(
        objects, pixels, size, None, None, flags=flags, criteria=stop
    )
    deviations = np.asarray(sigma, np.float64).ravel()
    total = sum(len(numbers) for _, numbers, _ in seen)
    lens = Lens(
        model,
        size,
        np.asarray(matrix, np.float64),
        np.asarray(distortion, np.float64).ravel()[: len(NAMES)],
        deviations[:4],
        deviations[4 : 4 + len(NAMES)],
        float(rms),
        len(seen),
        total,
    )
    views = []
    for (name, _, corners), points, turn, shift in zip(seen, objects, turns, shifts, strict=True):
        predicted = cv2.projectPoints(
            points.astype(np.float64), turn, shift, lens.matrix, lens.coefficients
        )[0].reshape(-1, 2)
        views.append(TargetView(name, corners, corners - predicted))
    return lens, views


def _bic(lens: Lens, views: Sequence[TargetView]) -> float:
    """Minus twice the logarithm of the likelihood of normal errors, and what unknowns cost."""
    numbers = 2 * lens.corners
    unknowns = 4 + len(FREE[lens.model]) + 6 * len(views)
    square = max(lens.residual_px**2 / 2.0, 1e-12)
    return float(numbers * np.log(square) + unknowns * np.log(numbers))

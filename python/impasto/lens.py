"""Distortion of a lens: Brown's model, and the radial polynomial of 5th order that is part of it.

Coordinates x, y are those of a pinhole camera at distance 1; with r^2 = x^2 + y^2 the lens shows
them at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

[@brown1971close]. Without k3, p1 and p2, r' = r + k1 r^3 + k2 r^5 is the polynomial of Snel's paper
[@snel]. Pixels are (column, row); whole numbers are the middles of pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.damage import damage_of
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.images.write import write_json
from impasto.io.json_file import VERSION, read_kind

Floats = NDArray[np.float64]
LensModel = Literal["radial", "brown"]

KIND = "impasto lens"
NAMES = ("k1", "k2", "p1", "p2", "k3")
FREE: dict[LensModel, tuple[str, ...]] = {"radial": ("k1", "k2"), "brown": NAMES}
"""Coefficients that each model has; the others are 0."""
LARGEST = 1e9
"""Of any number of a lens: powers of larger ones overflow, and no lens comes near."""
SHORTEST = 1.0
"""Focal length in pixels; a fisheye lens has some hundreds."""
ROUNDS = 50
CLOSED = 1e-6
"""Focal lengths by which a point may miss itself after the way back: less than 0.01 pixels."""


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera with its lens.

    Parameters
    ----------
    model
        ``"radial"`` (k1, k2) or ``"brown"`` (k1, k2, p1, p2, k3).
    size
        Columns and rows of its photographs.
    matrix
        ``(3, 3)``: focal lengths and principal point in pixels.
    coefficients
        ``(5,)``: k1, k2, p1, p2, k3.
    matrix_sigma
        ``(4,)`` standard deviations of the focal lengths and the principal point, in pixels.
    coefficient_sigma
        ``(5,)``; 0 where a coefficient is none of the model.
    residual_px
        Root mean square of the distances between found and predicted corners.
    photographs, corners
        How many were used.
    """

    model: LensModel
    size: tuple[int, int]
    matrix: Floats
    coefficients: Floats
    matrix_sigma: Floats
    coefficient_sigma: Floats
    residual_px: float
    photographs: int
    corners: int

    def __repr__(self) -> str:
        named = zip(NAMES, self.coefficients.tolist(), strict=True)
        words = ", ".join(
            f"{name} {value:.4g}" for name, value in named if name in FREE[self.model]
        )
        return f"<Lens {self.size[0]} x {self.size[1]} px, f {self.matrix[0, 0]:.1f} px, {words}>"

    def observed(self, ideal: ArrayLike) -> Floats:
        """Pixels ``(..., 2)`` in the photograph of pixels that a pinhole camera would show."""
        pixels = np.asarray(ideal, dtype=np.float64)
        k1, k2, p1, p2, k3 = self.coefficients.tolist()
        fx, fy, cx, cy = self._numbers
        x, y = (pixels[..., 0] - cx) / fx, (pixels[..., 1] - cy) / fy
        square = x * x + y * y
        radial = 1.0 + square * (k1 + square * (k2 + square * k3))
        across = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
        down = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack([fx * across + cx, fy * down + cy], axis=-1)

    def ideal(self, observed: ArrayLike) -> Floats:
        """Pixels ``(..., 2)`` of a pinhole camera from those in the photograph.

        Raises
        ------
        ArgumentError
            A place that the model reaches from none or from several places.
        """
        import cv2

        pixels = np.asarray(observed, dtype=np.float64)
        stop = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, ROUNDS, 1e-12)
        flat = np.ascontiguousarray(pixels.reshape(-1, 1, 2))
        found = cv2.undistortPoints(
            flat, self.matrix, self.coefficients, R=None, P=self.matrix, criteria=stop
        )
        ideal = np.asarray(found, dtype=np.float64).reshape(pixels.shape)
        # A point beyond the fold of the polynomial has no way back.
        off = np.linalg.norm(self.observed(ideal) - pixels, axis=-1)
        if not (off <= CLOSED * self._numbers[0]).all():
            worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
            x, y = pixels.reshape(-1, 2)[worst].tolist()
            raise ArgumentError(
                f"lens: its model has no inverse at pixel ({x:.0f}, {y:.0f}); photograph the "
                "target in the corners of the frame, too, and calibrate again"
            )
        return ideal

    @property
    def _numbers(self) -> tuple[float, float, float, float]:
        m = self.matrix
        return float(m[0, 0]), float(m[1, 1]), float(m[0, 2]), float(m[1, 2])

    def save(self, path: str | Path) -> None:
        """Write a small JSON file with everything (replaced atomically)."""
        names = ("fx", "fy", "cx", "cy")
        free = FREE[self.model]
        content = {
            "kind": KIND,
            "version": VERSION,
            "model": self.model,
            "size_px": list(self.size),
            "camera_matrix": self.matrix.tolist(),
            "camera_sigma_px": dict(zip(names, self.matrix_sigma.tolist(), strict=True)),
            "coefficients": {n: v for n, v in _named(self.coefficients) if n in free},
            "coefficient_sigma": {n: v for n, v in _named(self.coefficient_sigma) if n in free},
            "residual_px": self.residual_px,
            "photographs": self.photographs,
            "corners": self.corners,
        }
        write_json(path, content)


def _named(values: Floats) -> list[tuple[str, float]]:
    return list(zip(NAMES, values.tolist(), strict=True))


def read_lens(path: str | Path) -> Lens:
    """Read a lens that :meth:`Lens.save` wrote.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No such file of a lens, or one with numbers missing.
    """
    path = Path(path)
    what = "the file of a lens"
    content = read_kind(path, KIND, what, "impasto calibrate lens")
    with damage_of(path, what):
        return _lens(path, content)


def _lens(path: Path, content: dict[str, Any]) -> Lens:
    model = content["model"]
    if model not in FREE:
        raise CorruptInputError(path, f"model: expected radial or brown, found {model!r}")
    width, height = (int(number) for number in content["size_px"])
    matrix = np.array(content["camera_matrix"], dtype=np.float64)
    said = content["camera_sigma_px"]
    camera_sigma = np.array([said[name] for name in ("fx", "fy", "cx", "cy")], dtype=np.float64)
    values, sigma = (
        np.array([float(content[key].get(name, 0.0)) for name in NAMES])
        for key in ("coefficients", "coefficient_sigma")
    )
    missing = sorted(set(FREE[model]) - set(content["coefficients"]))
    if missing:
        raise CorruptInputError(path, f"coefficients: {', '.join(missing)} missing")
    if not 0 < min(width, height) <= max(width, height) <= LARGEST:
        raise CorruptInputError(path, "size_px: expected columns and rows from 1 on")
    read = np.concatenate([matrix.ravel(), values, camera_sigma, sigma])
    if matrix.shape != (3, 3) or not np.isfinite(read).all():
        raise CorruptInputError(path, "camera_matrix: expected 3 x 3 finite numbers")
    if np.abs(read).max() > LARGEST:
        raise CorruptInputError(
            path, f"camera_matrix, coefficients: expected numbers up to {LARGEST:.0e}"
        )
    if min(matrix[0, 0], matrix[1, 1]) < SHORTEST:
        raise CorruptInputError(path, "camera_matrix: expected focal lengths of a pixel or more")
    return Lens(
        model, (width, height), matrix, values, camera_sigma, sigma,
        float(content["residual_px"]), int(content["photographs"]), int(content["corners"]),
    )  # fmt: skip

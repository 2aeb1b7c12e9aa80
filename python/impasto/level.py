"""The plane of a panel: how it leans towards the lights, and what relief is about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import instance, truth
from impasto._internal.waiting import floats
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

NEAR = np.radians(15.0)
"""Normals this close to the plane's belong to a panel."""
LEANS = np.radians(1.0)
"""A smaller tilt is no better known than the lights' directions."""
_PIXELS = 60_000
"""Pixels of an even grid that are fitted."""
_STEEPEST = 3.0
_STEPS = 30
_TUKEY = 4.685
"""Tuning constant of Tukey's biweight: 95 % of the efficiency of least squares."""
_CONVERGED = 1e-9


@dataclass(frozen=True, slots=True)
class Level:
    """The plane about which a panel's relief lies, and its slow bending.

    The panel's height is ``slope . r + r . bend . r / 2`` with r = (x, y) from its middle, x right,
    y up, in units of its longer side.

    Parameters
    ----------
    slope
        Rise of the plane to the right and upwards, millimetres per millimetre.
    bend
        Second derivatives (xx, xy, yy) of the slow bending; zeros unless it was asked for.
    share
        Share of the normals within 15 degrees of the plane's.
    """

    slope: tuple[float, float]
    bend: tuple[float, float, float] = (0.0, 0.0, 0.0)
    share: float = 1.0

    @property
    def normal(self) -> tuple[float, float, float]:
        """Unit normal of the plane."""
        vector = np.array([-self.slope[0], -self.slope[1], 1.0])
        x, y, z = (vector / np.linalg.norm(vector)).tolist()
        return (x, y, z)

    @property
    def angle(self) -> float:
        """Tilt of the plane in radians."""
        return float(np.arctan(np.hypot(*self.slope)))

    @property
    def azimuth(self) -> float:
        """Where the plane's normal leans to, radians: 0 is right, pi / 2 up."""
        return float(np.arctan2(-self.slope[1], -self.slope[0]))

    @property
    def sagitta(self) -> float:
        """Largest depth of the bending along the longer side, as a share of that side."""
        xx, xy, yy = self.bend
        return float(np.abs(np.linalg.eigvalsh([[xx, xy], [xy, yy]])).max() / 8.0)

    @property
    def is_panel(self) -> bool:
        """Whether most normals belong to one plane; of a round object they do not."""
        return self.share >= 0.5

    @property
    def leans(self) -> bool:
        """Whether there is a plane, tilted by more than a degree."""
        return self.is_panel and self.angle > LEANS

    def rotated(self, normal: ArrayLike) -> NDArray[np.float32]:
        """Normals ``(3, y, x)`` relative to the plane: its own normal becomes z.

        The slow bending is subtracted from their slopes.
        """
        planes = floats(normal)
        rotated = np.einsum("ij,jyx->iyx", self._rotation(), planes, dtype=np.float64)
        if any(self.bend):
            with np.errstate(divide="ignore", invalid="ignore"):
                p, q = (-rotated[axis] / rotated[2] for axis in (0, 1))
            x, y = _places(*planes.shape[1:])
            xx, xy, yy = self.bend
            p, q = p - xx * x - xy * y, q - xy * x - yy * y
            in_front = rotated[2] > 0
            flat = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(1.0 + p * p + q * q)
            rotated = np.where(in_front, flat, rotated)
        return np.asarray(rotated, dtype=np.float32)

    def surface(self, size: tuple[int, int], pitch_mm: float = 1.0) -> NDArray[np.float64]:
        """Height ``(y, x)`` of plane and bending in mm, mean 0; subtract it from a height."""
        x, y = _places(*size)
        (p, q), (xx, xy, yy) = self.slope, self.bend
        height = p * x + q * y + 0.5 * (xx * x * x + 2.0 * xy * x * y + yy * y * y)
        return np.asarray((height - height.mean()) * max(size) * pitch_mm)

    def _rotation(self) -> Floats:
        """``(3, 3)``: the least rotation that turns the plane's normal to z."""
        x, y, z = self.normal
        cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
        return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z))

    def __str__(self) -> str:
        if not self.is_panel:
            return f"no panel: {100 * self.share:.0f} % of the normals lie near one plane"
        if not self.leans:
            return "the panel is level within a degree"
        sides = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom",
                 "lower right")  # fmt: skip
        side = sides[round(np.degrees(self.azimuth) / 45.0) % 8]
        return f"the panel faces {np.degrees(self.angle):.1f} degrees to the {side}"


def find_level(normal: ArrayLike, *, bend: bool = False) -> Level:
    """Find the plane of a panel from its normals.

    The slopes of the normals are fitted by Tukey's biweight from their median on, by iteratively
    reweighted least squares [@holland1977robust], on an even grid of at most 60,000 pixels: brush
    strokes, frames and losses do not tilt the plane.

    Parameters
    ----------
    normal
        ``(3, y, x)``, x right, y up, z towards the viewer. Not finite or facing away: left out.
    bend
        Whether to fit a quadratic surface: a warped panel, or directions of lights that are wrong
        by a little everywhere in the picture, as of near lamps taken for distant ones. Strokes are
        too short to look like it; a relief as wide as the picture is taken for it.

    Returns
    -------
    Level
        Its ``share`` says whether there is a plane at all.

    Raises
    ------
    ArgumentError
        A wrong shape, or fewer than ten usable normals.
    """
    planes = floats(normal)
    if planes.ndim != 3 or planes.shape[0] != 3 or 0 in planes.shape:
        raise ArgumentError(f"normal: expected shape (3, y, x), found {planes.shape}")
    size = planes.shape[1], planes.shape[2]
    step = sample_step(size)
    return level_of_sample(planes[:, ::step, ::step], size, step, bend=bend)


def sample_step(size: tuple[int, int]) -> int:
    """Of every how many rows and columns of a painting :func:`find_level` takes a normal."""
    height, width = size
    return max(1, int(np.ceil(np.sqrt(height * width / _PIXELS))))


def level_of_sample(
    normal: NDArray[np.float32], size: tuple[int, int], step: int, *, bend: bool = False
) -> Level:
    """What :func:`find_level` finds, from every ``step`` rows and columns of a painting's normals.

    ``size`` is that of the painting.
    """
    height, width = size
    vectors = normal.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        p, q = -vectors[0] / vectors[2], -vectors[1] / vectors[2]
    x, y = (place[::step, ::step] for place in _places(height, width))
    known = np.isfinite(p) & np.isfinite(q) & (vectors[2] > 0) & (np.hypot(p, q) < _STEEPEST)
    if known.sum() < 10:
        raise ArgumentError("normal: expected at least ten finite normals that face the viewer")
    return _fitted(p[known], q[known], x[known], y[known], bend=truth(bend, "bend"))


def level_of_height(height: NDArray[np.floating], pitch_mm: float) -> Level:
    """The plane of a height ``(y, x)`` in mm, from its slopes; level where it has no slopes."""
    if min(height.shape) < 2:
        return Level((0.0, 0.0))
    down, right = np.gradient(np.asarray(height, dtype=np.float64), pitch_mm)
    normal = np.stack([-right, down, np.ones_like(right)])
    usable = np.isfinite(normal).all(axis=0) & (np.hypot(right, down) < _STEEPEST)
    return find_level(normal) if usable.sum() >= 10 * 10 else Level((0.0, 0.0))


def as_level(level: bool | Level, normal: ArrayLike) -> Level | None:
    """The plane that an argument ``level`` stands for; None for False."""
    if isinstance(level, bool | np.bool_):
        return find_level(normal) if level else None
    instance(level, Level, "level", "True, False or what impasto.find_level returns")
    return level


def _fitted(p: Floats, q: Floats, x: Floats, y: Floats, *, bend: bool) -> Level:
    """Slopes p = p0 + xx x + xy y and q = q0 + xy x + yy y, robustly."""
    one, zero = np.ones_like(p), np.zeros_like(p)
    columns = [(one, zero), (zero, one)]
    if bend:
        columns += [(x, zero), (y, x), (zero, y)]
    design = np.stack([np.concatenate(pair) for pair in columns], axis=1)
    slopes = np.concatenate([p, q])
    found = np.zeros(design.shape[1])
    found[:2] = np.median(p), np.median(q)
    for _ in range(_STEPS):
        residual = np.hypot(*np.split(slopes - design @ found, 2))
        # The median length of two normal variables is 1.1774 of their deviation.
        scale = max(float(np.median(residual)) / 1.1774, 1e-12)
        weight = np.clip(1.0 - (residual / (_TUKEY * scale)) ** 2, 0.0, None) ** 2
        weighted = design * np.concatenate([weight, weight])[:, None]
        last, found = (
            found,
            np.linalg.lstsq(weighted.T @ design, weighted.T @ slopes, rcond=None)[0],
        )
        if np.abs(found - last).max() < _CONVERGED:
            break
    values = [*found.tolist(), 0.0, 0.0, 0.0][:5]
    level = Level((values[0], values[1]), (values[2], values[3], values[4]))
    nx, ny, nz = level.normal
    cosine = (nz - nx * p - ny * q) / np.sqrt(1.0 + p * p + q * q)
    share = float((cosine > np.cos(NEAR)).mean())
    return Level(level.slope, level.bend, share)


def _places(height: int, width: int) -> tuple[Floats, Floats]:
    """X and y ``(y, x)`` from the middle of the picture, in units of its longer side."""
    side = max(height, width)
    x = (np.arange(width) - (width - 1) / 2) / side
    y = ((height - 1) / 2 - np.arange(height)) / side
    return np.broadcast_to(x, (height, width)), np.broadcast_to(y[:, None], (height, width))

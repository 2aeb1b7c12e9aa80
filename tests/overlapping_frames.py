"""Six overlapping stacks of one simulated painting, and what is true of it.

The painting is simulated and lit with two or three pixels for one of a frame. A lens is a
Gaussian; each frame's pixels then lie where its shift, scale and rotation say. Nothing of
``impasto.merge`` is used. A panel that leans, and a frame that is rotated, is a panel at rest under
lamps that lean the other way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto import simulate

Planes = NDArray[np.float64]

LENS = 0.75
"""Standard deviation of the lens in pixels of a frame, of a camera whose pixels do not alias."""


@dataclass(frozen=True)
class Shot:
    """How a frame is taken.

    ``x, y`` is its middle in pixels of the whole painting (rows down), ``angle`` (radians,
    counterclockwise) and ``scale`` are those of what it shows in the whole painting, ``gain``
    multiplies its samples band by band, and ``tilt`` is a rotation vector of the panel.
    """

    x: float
    y: float
    angle: float = 0.0
    scale: float = 1.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Stacks of all frames, and the painting that they show.

    ``normal (3, y, x)`` and ``diffuse (band, y, x)`` are those of the simulation through the lens,
    with ``fine`` pixels for one of a frame, along a side.
    """

    stacks: tuple[impasto.Stack, ...]
    shots: tuple[Shot, ...]
    frame: tuple[int, int]
    fine: int
    normal: Planes
    diffuse: Planes

    def truth(self, report: impasto.MergeReport) -> tuple[Planes, Planes]:
        """Normals and colours at the pixels of the merged painting, in the system of frame 0."""
        x, y = np.meshgrid(np.arange(report.shape[1]), np.arange(report.shape[0]))
        first, (height, width) = report.frames[0], self.frame
        right = x - first.left - (width - 1) / 2 + self.shots[0].x
        down = y - first.top - (height - 1) / 2 + self.shots[0].y
        normal = at_places(self.normal, right, down, self.fine)
        return normal / np.linalg.norm(normal, axis=0), at_places(
            self.diffuse, right, down, self.fine
        )

    def truth_of(self, index: int) -> tuple[Planes, Planes]:
        """Normals and colours at the pixels of a frame, in its own system, but for its gain."""
        shot = self.shots[index]
        right, down = places(shot, self.frame)
        normal = at_places(self.normal, right, down, self.fine)
        normal = np.einsum("ij,jyx->iyx", turn_of(shot), normal / np.linalg.norm(normal, axis=0))
        gain = np.array(shot.gain)[:, None, None]
        return normal, gain * at_places(self.diffuse, right, down, self.fine)


def lamps(count: int) -> Planes:
    """Two rings of directions, and one from the front."""
    angle = 2 * np.pi * np.arange(count - 1) / (count - 1)
    height = np.radians(np.where(np.arange(count - 1) % 2 == 0, 35.0, 60.0))
    ring = np.stack(
        [np.cos(angle) * np.cos(height), np.sin(angle) * np.cos(height), np.sin(height)], axis=1
    )
    return np.concatenate([ring, [(0.0, 0.0, 1.0)]])


def rotation(vector: tuple[float, float, float]) -> Planes:
    """The matrix of a rotation vector, radians."""
    import cv2

    return np.asarray(cv2.Rodrigues(np.array(vector))[0], np.float64)


def scene(
    size: tuple[int, int],
    frame: tuple[int, int],
    shots: tuple[Shot, ...],
    *,
    lights: int = 24,
    seed: int = 3,
    noise: float = 0.002,
    beta: float = 2.0,
    lens: float = LENS,
    fine: int = 3,
) -> Scene:
    """Photograph a painting of ``size`` pixels in frames of ``frame`` pixels, rows and columns.

    ``noise`` is the standard deviation of a sample of 1, as that of photons: it goes with the root.
    """
    painting = simulate.painting(
        seed, (size[0] * fine, size[1] * fine), pitch_mm=0.3 / fine, thread_mm=2.4, relief=0.7
    )
    diffuse = painting.reflectance_in(simulate.camera("rgb"))
    surface = impasto.Surface.torrance_sparrow(painting.normal, diffuse, beta, 0.2)
    rng = np.random.default_rng(seed)
    directions = lamps(lights)
    stacks = []
    for shot in shots:
        back = turn_of(shot).T
        samples = np.empty((lights, 3, *frame), np.float32)
        for index, direction in enumerate(directions):
            towards, eye = back @ direction, back @ (0.0, 0.0, 1.0)
            seen = surface.predict(towards[None], eye)[0]
            right, down = places(shot, frame)
            taken = at_places(through_lens(seen, lens * fine), right, down, fine)
            taken *= np.array(shot.gain)[:, None, None]
            photons = rng.normal(size=taken.shape) * noise * np.sqrt(np.maximum(taken, 0.0))
            samples[index] = taken + photons
        stacks.append(impasto.Stack(samples, lights=directions, bands=("red", "green", "blue")))
    shown = (through_lens(planes, lens * fine) for planes in (painting.normal, diffuse))
    return Scene(tuple(stacks), shots, frame, fine, *shown)


def through_lens(planes: NDArray[np.floating], sigma: float) -> Planes:
    """Maps of the simulation as the lens shows them."""
    import cv2

    exact = planes.astype(np.float64)
    return np.stack([cv2.GaussianBlur(plane, (0, 0), sigma) for plane in exact])


def places(shot: Shot, frame: tuple[int, int]) -> tuple[Planes, Planes]:
    """Columns and rows of the whole painting at the pixels of a frame."""
    height, width = frame
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    cos, sin = np.cos(shot.angle), np.sin(shot.angle)
    right = shot.x + shot.scale * (cos * x + sin * y)
    down = shot.y + shot.scale * (-sin * x + cos * y)
    return right, down


def turn_of(shot: Shot) -> Planes:
    """From directions in the painting to those in the frame."""
    return rotation(shot.tilt) @ rotation((0.0, 0.0, -shot.angle))


def at_places(planes: Planes, right: Planes, down: Planes, fine: int) -> Planes:
    """Maps of the simulation at columns and rows of the whole painting.

    Between pixels so much narrower than the lens a straight line is as good as any.
    """
    column, row = ((one + 0.5) * fine - 0.5 for one in (right, down))
    left, top = np.floor(column).astype(int), np.floor(row).astype(int)
    across, along = column - left, row - top
    last = planes.shape[1] - 1, planes.shape[2] - 1
    found = np.zeros((len(planes), *right.shape))
    for i, weight in enumerate((1 - along, along)):
        for j, other in enumerate((1 - across, across)):
            at = np.clip(top + i, 0, last[0]), np.clip(left + j, 0, last[1])
            found += weight * other * planes[:, at[0], at[1]]
    return found


def two_by_three(size: tuple[int, int], frame: tuple[int, int]) -> tuple[Shot, ...]:
    """Six shots that cover the painting, each with errors of its own; the first has none."""
    rows = (frame[0] / 2, size[0] - frame[0] / 2)
    columns = (frame[1] / 2, size[1] / 2, size[1] - frame[1] / 2)
    errors: tuple[dict[str, Any], ...] = (
        {},
        {"angle": 0.012, "scale": 1.01, "gain": (1.1, 1.05, 0.98), "tilt": (0.01, -0.02, 0.0)},
        {"angle": -0.02, "scale": 0.99, "gain": (0.9, 0.93, 0.97), "tilt": (-0.015, 0.01, 0.0)},
        {"angle": 0.006, "scale": 0.995, "gain": (0.85, 0.85, 0.85), "tilt": (0.02, 0.015, 0.0)},
        {"angle": -0.01, "scale": 1.006, "gain": (1.05, 1.0, 0.95), "tilt": (-0.01, -0.01, 0.0)},
        {"angle": 0.018, "scale": 1.0, "gain": (1.2, 1.15, 1.1), "tilt": (0.0, 0.018, 0.0)},
    )  # fmt: skip
    rng = np.random.default_rng(5)
    shots = []
    for index, one in enumerate(errors):
        off = rng.uniform(-2.0, 2.0, 2) if index else (0.0, 0.0)
        place = columns[index % 3] - 0.5 + off[0], rows[index // 3] - 0.5 + off[1]
        shots.append(Shot(*place, **one))
    return tuple(shots)

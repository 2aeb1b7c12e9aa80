"""Environments on the page: cubes of half precision, and the colours of their channels."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import instance
from impasto.environment import FACE, Environment, divided
from impasto.errors import ArgumentError
from impasto.rooms import LABELS, ROOMS

PARTS = 3
"""Rays per texel of a face and axis."""
LARGEST = 60000.0
"""Of a number in half precision: brighter maps are scaled."""
MOST = 16
"""Environments of a page."""
COMPRESSION = 6
DIRECTIONS = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]], [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]], [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]], [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    np.float64,
)  # fmt: skip
"""Of each face of a cube map, as in OpenGL: right, down, and out."""


class Environments:
    """The environments of a page, by number: those that impasto contains, then others.

    Parameters
    ----------
    own
        Others, each an :class:`impasto.Environment`.

    Raises
    ------
    ArgumentError
        Something else, or more than 16 together.
    """

    def __init__(self, own: Sequence[Environment] = ()) -> None:
        given = list(own)
        for one in given:
            instance(one, Environment, "environments", "a sequence of impasto.Environment")
        if len(given) + len(ROOMS) > MOST:
            raise ArgumentError(
                f"environments: expected at most {MOST - len(ROOMS)}, found {len(given)}"
            )
        self._all = [*(Environment.named(name) for name in ROOMS), *given]

    def __len__(self) -> int:
        return len(self._all)

    @property
    def records(self) -> list[dict[str, Any]]:
        """For the page: name, label, texels along a face, factor on the numbers, rotation."""
        found: list[dict[str, Any]] = []
        for number, one in enumerate(self._all):
            contained = number < len(ROOMS)
            name = one.name if contained else f"own-{number - len(ROOMS) + 1}"
            found.append(
                {
                    "name": name,
                    "label": LABELS[name] if contained else one.name,
                    "side": _side(one),
                    "scale": _scale(one) * one.intensity,
                    "rotation": [[float(value) for value in row] for row in one.rotation],
                }
            )
        return found

    def data(self, number: int) -> bytes:
        """Faces ``(6, y, x, 3)`` of an environment, half precision, compressed by gzip.

        Raises
        ------
        IndexError
            There is none of that number.
        """
        one = self._all[number]
        faces = np.clip(cube_of(one.radiance) / _scale(one), 0.0, LARGEST)
        halves = np.moveaxis(faces, 1, -1).astype(np.float16)
        return gzip.compress(halves.tobytes(), COMPRESSION, mtime=0)


def cube_of(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Faces ``(6, 3, n, n)`` in the painting's frame; those of a map of 128 texels along a side.

    A cube map is left-handed as seen from within, so that x of a given one is turned round.
    """
    if radiance.ndim == 4:
        return divided(radiance[[1, 0, 2, 3, 4, 5], ..., ::-1])
    height, width = radiance.shape[-2:]
    places = 2.0 * (np.arange(FACE * PARTS) + 0.5) / (FACE * PARTS) - 1.0
    found = np.empty((6, 3, FACE, FACE), np.float32)
    for face, (right, down, out) in enumerate(DIRECTIONS):
        x, y, z = (
            right[i] * places[None, :] + down[i] * places[:, None] + out[i] for i in range(3)
        )
        latitude = np.arctan2(y, np.hypot(x, z))
        longitude = np.arctan2(-x, z)
        column = ((longitude / (2.0 * np.pi) + 0.5) * width).astype(int) % width
        row = np.clip(((0.5 - latitude / np.pi) * height).astype(int), 0, height - 1)
        rays = radiance[:, row, column]
        found[face] = rays.reshape(3, FACE, PARTS, FACE, PARTS).mean(axis=(2, 4))
    return found


def _side(one: Environment) -> int:
    return int(divided(one.radiance).shape[-1]) if one.radiance.ndim == 4 else FACE


def _scale(one: Environment) -> float:
    return max(1.0, float(one.radiance.max()) / LARGEST)

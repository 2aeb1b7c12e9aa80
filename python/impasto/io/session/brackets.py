"""Photographs of a session that are exposure brackets: each is read as one."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.bracket import READ_NOISE, SHOT_NOISE, merge_exposures
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.session.linear_codes import Photograph

Read = Callable[[Path], Photograph]
FULL = 65535.0
"""Of linear codes of 16 bits."""


@dataclass(eq=False)
class Brackets:
    """Which photographs are brackets, and what merges them.

    Parameters
    ----------
    frames
        Files and seconds of each bracket, the shortest first, by the path of the shortest.
    dark
        Files of dark frames, or the black level in codes; None: 0.
    noise
        Standard deviations of a code in the dark and at full scale, as shares of full scale.
    """

    frames: Mapping[Path, Sequence[tuple[Path, float]]]
    dark: Sequence[Path] | NDArray[np.float64] | None = None
    noise: tuple[float, float] = (READ_NOISE, SHOT_NOISE)
    _black: NDArray[np.float32] | None = field(default=None, init=False)

    @property
    def others(self) -> list[Path]:
        """All files but the shortest exposures, by whose names the photographs are known."""
        return [path for frames in self.frames.values() for path, _ in frames[1:]]

    def read(self, path: Path, read: Read, curve: Callable[[], Encoding]) -> Photograph:
        """A photograph as floats, full scale 1; a bracket is merged.

        Parameters
        ----------
        path
            Of the photograph, a board or a dark frame.
        read
            Reads one file as linear codes.
        curve
            The tone curve of the files, of which a black level is a code.

        Raises
        ------
        ArgumentError
            Exposures of different sizes.
        """
        frames = self.frames.get(place_of(path))
        if frames is None:
            return _floats(read(path))
        seen = [_floats(read(one)) for one, _ in frames]
        for (one, _), photograph in zip(frames, seen, strict=True):
            if photograph.planes.shape != seen[0].planes.shape:
                raise ArgumentError(
                    f"brackets: {one} has shape {photograph.planes.shape} (band, y, x), "
                    f"{frames[0][0].name} {seen[0].planes.shape}; a camera at one setting takes "
                    "all exposures of a bracket"
                )
        if self._black is None:
            self._black = self._read_black(read, curve)
        merged = merge_exposures(
            [one.planes for one in seen], [seconds for _, seconds in frames],
            clipped_from=seen[0].full, black=self._black,
            read_noise=self.noise[0], shot_noise=self.noise[1],
        )  # fmt: skip
        return Photograph(merged, seen[0].full)

    def _read_black(self, read: Read, curve: Callable[[], Encoding]) -> NDArray[np.float32]:
        if self.dark is None:
            return np.zeros((1, 1, 1), np.float32)
        if isinstance(self.dark, np.ndarray):
            return np.asarray(curve().decode(self.dark.reshape(-1, 1, 1)), np.float32)
        total = np.zeros((1, 1, 1))
        for path in self.dark:
            total = total + _floats(read(path)).planes
        return np.asarray(total / len(self.dark), np.float32)


def place_of(path: Path) -> Path:
    """A path by which a file is known, however it was written."""
    return Path(os.path.normpath(path.absolute()))


def _floats(photograph: Photograph) -> Photograph:
    if photograph.planes.dtype.kind == "f":
        return photograph
    full = None if photograph.full is None else photograph.full / FULL
    return Photograph((photograph.planes / np.float32(FULL)).astype(np.float32), full)

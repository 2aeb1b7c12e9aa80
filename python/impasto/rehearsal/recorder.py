"""The camera of a rehearsed session: light in files, dark frames, and the lens's target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from impasto.io import write_tiff16
from impasto.rehearsal.studio import Floats, Lamp, Reflectances, Studio, StudioCamera
from impasto.rehearsal.things import chessboard
from impasto.simulate.sensor import Sensor

BITS = 12
DARK_FRAMES = 4
POSES = 12
"""Photographs of the target for the lens."""

Progress = Callable[[int, int], None]


class Recorder:
    """Writes light as 16-bit TIFFs of a sensor with :data:`BITS` bits.

    Parameters
    ----------
    folder
        Of the session.
    sensor
        Each photograph has its own noise, by its number in the session.
    bands
        Their names.
    total
        Photographs of the session.
    progress
        Called with photographs done and all.
    """

    def __init__(
        self,
        folder: Path,
        sensor: Sensor,
        bands: tuple[str, ...],
        total: int,
        progress: Progress | None,
    ) -> None:
        self._folder, self._sensor, self._bands = folder, sensor, bands
        self._total, self._progress, self._done = total, progress, 0

    def write(self, name: str, light: Floats) -> None:
        """Write light ``(band, y, x)``, of which a white board in full light has 1."""
        codes = self._sensor.samples(light.astype(np.float32), self._done)
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        # The full scale of the sensor is that of the file, as from raw converters.
        whole = np.rint(codes * (65535.0 / (2**BITS - 1)))
        write_tiff16(path, whole.astype(np.uint16), attributes={"bands": self._bands})
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)

    def dark(self, size: tuple[int, int]) -> None:
        """Write :data:`DARK_FRAMES` of ``size`` rows and columns."""
        for number in range(DARK_FRAMES):
            light = np.zeros((len(self._bands), *size))
            self.write(f"painting/dark/dark{number + 1}.tif", light)

    def target(
        self,
        eye: StudioCamera,
        lamp: Lamp,
        lattice_mm: float,
        reach_mm: float,
        rng: np.random.Generator,
    ) -> None:
        """Write the target for the lens in :data:`POSES` poses.

        Parameters
        ----------
        eye
            The camera, whose tilts are replaced.
        lamp
            Its light.
        lattice_mm
            Side of a square.
        reach_mm
            How far from the middle of the plane the target may lie, along each axis.
        rng
            Of its places.
        """
        for number in range(POSES):
            pose = replace(
                eye,
                tilt=np.radians((0, 25, 35, 40, 30, 38)[number % 6] + number // 6),
                azimuth=np.radians(108 * number),
                roll=np.radians(15 * number),
            )
            own = chessboard(lattice_mm, len(self._bands))
            target = _moved(own, *rng.uniform(-reach_mm, reach_mm, 2))
            light = Studio(pose).light(lamp, target)
            self.write(f"target/target{number + 1:02}.tif", light)


def _moved(seen: Reflectances, right: float, up: float) -> Reflectances:
    return lambda x, y: seen(x - right, y - up)

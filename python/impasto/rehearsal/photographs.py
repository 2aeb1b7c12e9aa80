"""The photographs that a lab would make of a painting, with all that its calibration needs.

The painting lies between four markers, with a mirror ball on either side, under near lamps of
unequal strength, and a camera with a lens photographs it slightly askew, as far away as four widths
of the painting. A white board takes its place under each lamp, then a ColorChecker; the target for
the lens is photographed in twelve poses, and nothing in the dark.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impasto import simulate
from impasto.calibrate.chart import GRID, chart_reflectances
from impasto.lights import PointLight
from impasto.rehearsal.recorder import BITS, DARK_FRAMES, POSES, Progress, Recorder
from impasto.rehearsal.studio import Lamp, MirrorBall, Studio, StudioCamera
from impasto.rehearsal.things import chart, marks, picture, uniform
from impasto.rig import PointView, Rig
from impasto.simulate.sensor import Noise, Sensor

EXPOSURE = 0.45
"""Share of full scale that a white board in the middle reaches under a lamp of strength 1."""
FRAME = (1.5, 2.0)
"""Height and width of the photographs, in widths of the painting on the plane."""
FINER = 0.6
"""Width of a pixel of the photographs on the plane, in pixels of the painting."""
CAMERA, LAMPS = 4.0, 3.0
"""How far camera and lamps stand, in widths of the painting."""
MARKER, BALL, LATTICE = 0.16, 0.14, 0.11
"""Side of a marker, radius of a ball and side of a square of the lens's target, in widths of the
painting."""
BALLS = ((-0.8, -0.25), (0.8, -0.2))
"""Middles of the balls, in widths of the painting."""
DISTORTION = (-0.06, 0.02, 0.0, 0.0)
BOARD = 0.99
"""Reflectance of the white board."""


@dataclass(frozen=True)
class Session:
    """What was photographed, and what is true of it.

    Attributes
    ----------
    folder
        With ``painting``, which holds ``photographs``, ``board`` and ``dark``, and with ``target``
        and ``chart.tif``.
    truth
        For :func:`impasto.simulate.score`.
    size_mm
        Width and height of the painting.
    ball_mm
        Diameter of the balls.
    marker_mm
        Side of a marker.
    lattice_mm
        Side of a square of the lens's target.
    names
        The photographs.
    """

    folder: Path
    truth: simulate.Truth
    size_mm: tuple[float, float]
    ball_mm: float
    marker_mm: float
    lattice_mm: float
    names: tuple[str, ...]


def photograph_session(
    folder: Path,
    system: str,
    painting: simulate.Painting,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Session:
    """Write all photographs of a session as 16-bit TIFFs of a sensor with 12 bits.

    Parameters
    ----------
    folder
        A new folder.
    system
        Whose lamps and bands: ``"tominaga-rgb-camera"`` or ``"tominaga-six-band-adaptation"``.
    painting
        What is photographed.
    seed
        Of strengths and noise.
    progress
        Called with photographs done and all.
    """
    width, height = (painting.pitch_mm * side for side in painting.size[::-1])
    camera, rng = simulate.camera(system), np.random.default_rng(seed)
    bands, pitch = len(camera.bands), painting.pitch_mm * FINER
    size = tuple(round(side * width / pitch) for side in FRAME)
    far = CAMERA * width
    eye = StudioCamera(
        (size[0], size[1]), far / pitch, far, np.radians(1.5), 1.0, np.radians(0.7), DISTORTION
    )
    directions = simulate.rig(system).directions
    lamps = [Lamp(LAMPS * width * one, rng.uniform(0.8, 1.25)) for one in directions]
    rig = Rig(
        [PointLight(tuple(lamp.position.tolist())) for lamp in lamps],
        views=PointView(tuple(eye.place.tolist())),
        pitch_mm=painting.pitch_mm,
    )
    # Without a sensor: this one sees the painting through the studio's camera.
    seen = simulate.capture(painting, rig, camera, noise=False, bits=None, shadows=True)
    sensor = Sensor(Noise(), BITS, "linear", EXPOSURE, np.ones(bands), 1, seed)
    studio = Studio(eye)
    around = marks(width, height, MARKER * width, bands)
    balls = tuple(MirrorBall(x * width, y * width, BALL * width) for x, y in BALLS)
    names = tuple(f"light{number + 1:02}.tif" for number in range(len(lamps)))
    total = 2 * len(lamps) + DARK_FRAMES + POSES + 1
    recorder = Recorder(folder, sensor, camera.bands, total, progress)
    board = uniform(BOARD, bands)
    for name, lamp, planes in zip(names, lamps, seen.stack.samples, strict=True):
        own = picture(planes, painting.pitch_mm)
        light = studio.light(lamp, around, glossy=own, balls=balls)
        recorder.write(f"painting/photographs/{name}", light)
        recorder.write(f"painting/board/{name}", studio.light(lamp, board))
    recorder.dark(eye.size)
    patches = np.array([camera.response(one, GRID) for one in chart_reflectances()])
    card = chart(patches, 0.2 * width)
    recorder.write("chart.tif", studio.light(lamps[0], card))
    lattice = LATTICE * width
    front = Lamp(np.array([0.0, 0.0, LAMPS * width]), 1.0)
    recorder.target(eye, front, lattice, 0.25 * width, rng)
    return Session(
        folder, seen.truth, (width, height), 2 * BALL * width, MARKER * width, lattice, names,
    )  # fmt: skip

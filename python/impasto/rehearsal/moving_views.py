"""The photographs of the third paper's rig [@snel]: every light with a view of its own.

The painting has bulges and patches of varnish, and lies on a sheet with four large markers. A lamp
stands at the places of the rig, near enough to fall off, and a camera with a lens photographs the
painting from each view. No board can be photographed from every view: a white card lies beside the
painting. The lens has its target, the sensor its dark frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import simulate
from impasto.errors import ArgumentError
from impasto.io import write_lights
from impasto.io.lights import LightFile
from impasto.lights import PointLight
from impasto.rehearsal.recorder import BITS, DARK_FRAMES, POSES, Progress, Recorder
from impasto.rehearsal.relief import Relief
from impasto.rehearsal.studio import Floats, Lamp, Studio, StudioCamera
from impasto.rehearsal.things import PAPER, marks, picture, with_card
from impasto.rig import PointView, Rig
from impasto.simulate.cameras import CAMERA_OPTIONS
from impasto.simulate.lobes import Lobes, lobes
from impasto.simulate.photographs import Photographs
from impasto.simulate.sensor import Noise, Sensor

SYSTEM = "snel-lafortune"
FLATTEST = 60.0
"""Degrees from the normal of the painting beyond which a view is left out: markers cannot be read,
and a photograph has less than half the rows of its frontal view."""
LEAST = 12
"""Views of a session: fewer determine no lobes."""
CAMERA, LAMPS = 6.0, 8.0
"""How far camera and lamp stand, in widths of the painting: the lamp behind the camera, which hides
nothing."""
FRAME = (2.3, 2.0)
"""Height and width of the photographs, in widths of the painting: the markers of all views."""
FINER = 0.6
"""Width of a pixel of a frontal photograph on the plane, in pixels of the painting."""
RIM = 0.05
"""Width of the frame about the painting, at whose corners the markers are, in widths of the
painting: no paint touches a marker."""
MARKER, LATTICE = 0.25, 0.16
"""Side of a marker and of a square of the lens's target, in widths of the painting."""
DISTORTION = (-0.3, 0.2, 0.0, 0.0)
ROLL = np.radians(4.0)
"""Of the camera about its axis: edges of markers that lie along rows of pixels are found worse."""
CARD = 0.99
"""Reflectance of the white card."""
CARD_AT, CARD_SIDES = (0.67, 0.0), (0.14, 0.3)
"""Middle, and width and height of the card, in widths of the painting: between two markers."""


@dataclass(frozen=True, eq=False)
class MovingSession:
    """What was photographed, and what is true of it.

    Attributes
    ----------
    folder
        With ``painting``, which holds ``photographs``, ``dark`` and ``lights.dome``, and with
        ``target``.
    painting, diffuse, lobes
        The painting, its diffuse reflectance ``(band, y, x)`` and its Lafortune lobes.
    cameras
        One for each photograph.
    rig
        Its lamps and cameras.
    left_out
        Pairs of light and view whose view is flatter than :data:`FLATTEST`.
    size_mm
        Width and height of the frame between the markers.
    rim
        Pixels of the painting from the frame's edge to the painting's.
    marker_mm, lattice_mm
        Side of a marker, and of a square of the lens's target.
    card_mm
        Middle, width and height of the white card beside the painting.
    names
        The photographs.
    """

    folder: Path
    painting: simulate.Painting
    diffuse: NDArray[np.float32]
    lobes: Lobes
    cameras: tuple[StudioCamera, ...]
    rig: Rig
    left_out: int
    size_mm: tuple[float, float]
    rim: int
    marker_mm: float
    lattice_mm: float
    card_mm: tuple[float, float, float, float]
    names: tuple[str, ...]


def steep_pairs(views: int | None) -> tuple[NDArray[np.int64], int]:
    """Numbers of the pairs of the rig that are photographed, and how many are too flat.

    Parameters
    ----------
    views
        How many, evenly spread over the list, in which neighbours are alike; None: all.

    Raises
    ------
    ArgumentError
        Fewer than :data:`LEAST` or more than there are.
    """
    eyes = simulate.rig(SYSTEM).views
    # Mirror directions of 60 degrees are in the rig, to rounding errors.
    steep = np.flatnonzero(eyes[:, 2] > np.cos(np.radians(FLATTEST)) - 1e-9)
    flat = len(eyes) - len(steep)
    if views is None:
        return steep, flat
    if not LEAST <= views <= len(steep):
        raise ArgumentError(
            f"--views: expected {LEAST} to {len(steep)}, the pairs of light and view up to "
            f"{FLATTEST:g} degrees, found {views}"
        )
    return steep[np.linspace(0, len(steep) - 1, views).round().astype(int)], flat


def photograph_views(
    folder: Path,
    painting: simulate.Painting,
    *,
    views: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> MovingSession:
    """Write all photographs of a session as 16-bit TIFFs of a sensor with 12 bits.

    Parameters
    ----------
    folder
        A new folder.
    painting
        What is photographed (:func:`impasto.rehearsal.relief.with_bulges`).
    views
        How many pairs of light and view; None: all that are not too flat.
    seed
        Of the noise.
    progress
        Called with photographs done and all.

    Raises
    ------
    ArgumentError
        A number of views that the rig does not have.
    """
    width, height = (painting.pitch_mm * side for side in painting.size[::-1])
    picked, flat = steep_pairs(views)
    listed, camera = simulate.rig(SYSTEM), simulate.camera(SYSTEM)
    pitch = painting.pitch_mm * FINER
    rows, columns = (round(side * width / pitch) for side in FRAME)
    far = CAMERA * width

    def eye(towards: Floats) -> StudioCamera:
        tilt = float(np.arctan2(np.hypot(towards[0], towards[1]), towards[2]))
        azimuth = float(np.arctan2(towards[1], towards[0]))
        return StudioCamera((rows, columns), far / pitch, far, tilt, azimuth, ROLL, DISTORTION)

    cameras = tuple(eye(view) for view in listed.views[picked])
    lamps = [Lamp(LAMPS * width * one, 1.0) for one in listed.directions[picked]]
    rig = Rig(
        [PointLight(_place(lamp.position)) for lamp in lamps],
        views=[PointView(_place(one.place)) for one in cameras],
        pitch_mm=painting.pitch_mm,
    )
    diffuse = painting.reflectance_in(camera)
    gloss = lobes(painting, diffuse)
    seen = Photographs(painting, rig, diffuse, gloss, shadows=True)
    recorder = Recorder(
        folder, _sensor(seed), camera.bands, len(rig) + DARK_FRAMES + POSES, progress
    )
    bands = len(camera.bands)
    rim = round(RIM * painting.size[1])
    frame = (width + 2 * rim * painting.pitch_mm, height + 2 * rim * painting.pitch_mm)
    x, y, wide, high = (width * share for share in (*CARD_AT, *CARD_SIDES))
    around = with_card(
        marks(*frame, MARKER * width, bands, ground=PAPER), (x, y), (wide, high), CARD
    )
    relief = Relief(painting.height, painting.pitch_mm)
    names = tuple(f"view{number + 1:03}.tif" for number in range(len(rig)))
    for number, (name, own, lamp) in enumerate(zip(names, cameras, lamps, strict=True)):
        shown = picture(seen.light(number, "planned"), painting.pitch_mm)
        light = Studio(own, relief).light(lamp, around, glossy=shown)
        recorder.write(f"painting/photographs/{name}", light)
    frontal = eye(np.array([0.0, 0.0, 1.0]))
    recorder.dark(frontal.size)
    front = Lamp(np.array([0.0, 0.0, LAMPS * width]), 1.0)
    lattice = LATTICE * width
    recorder.target(frontal, front, lattice, 0.2 * width, np.random.default_rng(seed))
    far_away = np.linalg.norm(rig.vectors, axis=1)
    file = LightFile(
        folder / "painting" / "lights.dome", "dome", None, rig.directions, far_away,
        positions=rig.vectors, width_mm=frame[0],
    )  # fmt: skip
    write_lights(file.path, file)
    return MovingSession(
        folder, painting, diffuse, gloss, cameras, rig, flat, frame, rim, MARKER * width,
        lattice, (x, y, wide, high), names,
    )  # fmt: skip


def _sensor(seed: int) -> Sensor:
    """That of the paper: blue is least sensitive, and a white board nearly clips green."""
    options: dict[str, Any] = CAMERA_OPTIONS[SYSTEM]
    share = np.array(options["sensitivity"])
    return Sensor(Noise(), BITS, "linear", options["exposure"], share, 1, seed)


def _place(place: Floats) -> tuple[float, float, float]:
    x, y, z = place.tolist()
    return (x, y, z)

"""A rig that photographs a simulated painting, with misfires on demand.

Light adds up: with two lamps on, a photograph is the sum of two. Every photograph has noise of its
own, as those of a camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impasto.bands import Camera
from impasto.capture.ball_joint import JOINTS
from impasto.capture.devices import Frame, Pose, Vector
from impasto.capture.drivers.faults import DRIFT_TRIGGERS, Fault, Faults
from impasto.capture.joints import directions_of
from impasto.errors import DeviceError, DisconnectedError
from impasto.rig import FRONTAL, Rig
from impasto.simulate import Noise, Painting
from impasto.simulate import camera as camera_named
from impasto.simulate.photographs import Photographs
from impasto.simulate.sensor import Sensor

EXPOSURE_S = 0.01
"""At which a white board that faces a lamp reaches half of full scale."""
BRIGHT, WEAK, BLUR = 20.0, 0.95, 1.5


@dataclass(frozen=True)
class Taken:
    """What really happened at a photograph."""

    order: int
    lamps: tuple[int, ...]
    fault: Fault | None
    data: bytes


@dataclass(eq=False)
class SimulatedRig:
    """Camera, lamps and stage in one: give it for all three.

    Parameters
    ----------
    painting
        From :func:`impasto.simulate.painting`.
    directions
        ``(n, 3)``: to the lamps; lamp 1 is the first.
    faults
        What goes wrong.
    seed
        Of the noise.
    bands
        The camera, or its name for :func:`impasto.simulate.camera`.
    shadows
        Whether the relief casts shadows.

    Attributes
    ----------
    taken
        What really happened, photograph by photograph.
    """

    painting: Painting
    directions: NDArray[np.float64]
    faults: Faults = field(default_factory=Faults)
    seed: int = 0
    bands: Camera | str = "rgb"
    shadows: bool = False
    taken: list[Taken] = field(default_factory=list)
    _exposure: float = EXPOSURE_S
    _on: tuple[int, ...] = ()
    _pose: Pose = field(default_factory=Pose)
    _order: int = 0
    _last: bytes = b""
    _drift: int = 0
    _gone: bool = False

    @property
    def name(self) -> str:
        """Of the camera."""
        return "simulated camera"

    @property
    def joints(self) -> tuple[str, ...]:
        """Nothing turns; the camera and the lamp go wherever a plan says."""
        return ()

    def set_exposure(self, seconds: float) -> float | None:
        """Begin an order: the next photograph of the list of faults."""
        self._order += 1
        self._exposure = seconds
        return 2.0 * seconds if self._fault == "setting" else seconds

    def move(self, pose: Pose) -> Pose:
        """Take the lamp and the camera to a pose."""
        self._pose = pose
        return pose

    def switch_on(self, lamp: int) -> int:
        """Acknowledge a lamp, as far as the faults allow."""
        before, fault = self._on[0] if self._on else lamp, self._fault
        self._on = (lamp,)
        other = lamp % len(self.directions) + 1
        if fault == "no-ack":
            raise DeviceError(f"no acknowledgement of lamp {lamp} within 2 s")
        if fault == "late-ack":
            return before if before != lamp else other
        if fault == "wrong-ack":
            self._on = (other,)
            return other
        if fault == "wrong-lamp":
            self._on = (other,)
        elif fault == "dark":
            self._on = ()
        elif fault == "double":
            self._on = (lamp, (lamp + len(self.directions) // 2 - 1) % len(self.directions) + 1)
        return lamp

    def switch_off(self) -> None:
        """All lamps."""
        self._on = ()

    def reconnect(self) -> None:
        """The camera is there again, unless it is gone for good."""
        self._gone = self._order + 1 in self.faults.forever

    def trigger(self) -> Frame:
        """A photograph, 16 bits, as PNG."""
        fault = self._fault
        if fault == "disconnect" or self._gone:
            self._gone = True
            raise DisconnectedError("the camera does not answer: see to its cable and battery")
        if fault == "timeout":
            raise DeviceError("the camera has sent no photograph within 10 s")
        if fault == "missing":
            return self._frame(b"", fault)
        if fault == "duplicate" and self._last:
            return self._frame(self._last, fault)
        if fault == "drift":
            self._drift = DRIFT_TRIGGERS
        strength = WEAK if self._drift else 1.0
        self._drift = max(0, self._drift - 1)
        light = np.zeros((len(self._camera.bands), *self.painting.size), np.float32)
        for lamp in self._on:
            light += np.float32(strength) * self._light(lamp)
        data = self._developed(light, fault)
        if fault == "corrupt":
            return self._frame(data[: len(data) // 2], fault)
        self._last = data
        return self._frame(data, fault)

    def _frame(self, data: bytes, fault: Fault | None) -> Frame:
        self.taken.append(Taken(self._order, self._on, fault, data))
        seconds = self._exposure * (1.5 if fault == "exposure" else 1.0)
        return Frame(data, ".png", seconds, datetime.now())

    def _developed(self, light: NDArray[np.float32], fault: Fault | None) -> bytes:
        """The file of light: lens, exposure, noise, codes."""
        import cv2

        planes = np.moveaxis(light, 0, -1)
        if fault == "moved":
            planes = np.concatenate([planes[:, :1], planes[:, :-1]], axis=1)
        if fault == "blurred":
            planes = np.asarray(cv2.GaussianBlur(planes, (0, 0), BLUR))
        times = self._exposure / EXPOSURE_S
        times *= {"clipped": BRIGHT, "exposure": 1.5}.get(fault or "", 1.0)
        sensor = replace(self._sensor, seed=self.seed)
        codes = sensor.samples(np.moveaxis(planes, -1, 0) * np.float32(times), len(self.taken))
        done, data = cv2.imencode(".png", np.ascontiguousarray(np.moveaxis(codes[::-1], 0, -1)))
        if not done:
            raise DeviceError("the photograph cannot be written as PNG")
        return bytes(data.tobytes())

    def _light(self, lamp: int) -> NDArray[np.float32]:
        """``(band, y, x)``: under one lamp, from the view of the pose."""
        light, view = self._towards(lamp)
        if light is None and view is None:
            return self._photographs.light(lamp - 1, "planned")
        rig = Rig(np.array([light or self.directions[lamp - 1]]), views=view or FRONTAL)
        return replace(self._photographs, rig=rig).light(0, "planned")

    def _towards(self, lamp: int) -> tuple[Vector | None, Vector | None]:
        """To lamp and eye in the frame of the painting; None: as the list of lamps, from front."""
        return self._pose.light, self._pose.view

    @property
    def _fault(self) -> Fault | None:
        return self.faults.of(self._order)

    @cached_property
    def _camera(self) -> Camera:
        return self.bands if isinstance(self.bands, Camera) else camera_named(self.bands)

    @cached_property
    def _photographs(self) -> Photographs:
        diffuse = self.painting.reflectance_in(self._camera)
        return Photographs(self.painting, Rig(self.directions), diffuse, None, self.shadows)

    @cached_property
    def _sensor(self) -> Sensor:
        share = np.ones(len(self._camera.bands))
        return Sensor(Noise(), 16, "linear", 0.5, share, 1, self.seed)


@dataclass(eq=False)
class SimulatedBallJoint(SimulatedRig):
    """The rig of the third paper [@snel]: the painting turns on a ball joint.

    ``directions`` are those of the lamp's places in the frame of the room. Lamp and eye, as the
    painting sees them, follow from the angles of the joints; what a plan states of them is not
    read. The photograph is the frontal view of the painting, without perspective.
    """

    @property
    def joints(self) -> tuple[str, ...]:
        """Pan, tilt and roll of the painting, and the angle of the camera."""
        return JOINTS

    def _towards(self, lamp: int) -> tuple[Vector | None, Vector | None]:
        return directions_of(self._pose, self.directions[lamp - 1])

"""What a capture needs of a camera, its lamps and a stage: protocols that drivers implement.

A driver reports what the device says, not what it was ordered: the run compares both. Whatever
goes wrong in a device is a :class:`~impasto.errors.DeviceError`, and a device that is gone a
:class:`~impasto.errors.DisconnectedError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Pose:
    """Where camera, lamp and painting stand for a photograph.

    Parameters
    ----------
    view, light
        Unit vectors from the painting to the eye and to the lamp, in the frame of the painting (x
        right, y up, z to the viewer); None: as the plan's lamps say, seen from the front.
    angles
        Joints of the stage by their names, radians.
    """

    view: Vector | None = None
    light: Vector | None = None
    angles: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Frame:
    """A photograph as it comes from a camera.

    Parameters
    ----------
    data
        The bytes of the file.
    suffix
        Ending of its name, with the dot.
    exposure_s
        Seconds, as the camera says; None: it does not, then EXIF of the file is read.
    taken
        When, by the clock of the camera; None: as EXIF says.
    """

    data: bytes
    suffix: str
    exposure_s: float | None = None
    taken: datetime | None = None


class CameraDevice(Protocol):
    """A camera that is released by the run."""

    @property
    def name(self) -> str:
        """Maker and model."""
        ...

    def set_exposure(self, seconds: float) -> float | None:
        """Set the exposure time, and read it back in seconds; None: the camera cannot say."""
        ...

    def trigger(self) -> Frame:
        """Take one photograph and download it.

        Raises
        ------
        DeviceError
            No photograph came.
        DisconnectedError
            The camera is gone.
        """
        ...

    def reconnect(self) -> None:
        """Begin anew after an error; raises :class:`DisconnectedError` if the camera is gone."""
        ...


class Lights(Protocol):
    """Lamps that are switched one at a time, by numbers from 1 on: the order of the light file."""

    def switch_on(self, lamp: int) -> int:
        """Switch this lamp on and all others off; the number that the device acknowledges.

        Raises
        ------
        DeviceError
            No acknowledgement, or the device reports an error.
        DisconnectedError
            Nothing answers at all.
        """
        ...

    def switch_off(self) -> None:
        """Switch all lamps off, with acknowledgement; errors as :meth:`switch_on`."""
        ...


class Stage(Protocol):
    """What moves camera, lamp or painting."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that it sets: a plan has the angle of each of them, and no other."""
        ...

    def move(self, pose: Pose) -> Pose:
        """Go to a pose and read it back; errors as :meth:`Lights.switch_on`."""
        ...


class FixedStage:
    """Nothing moves: every pose is that of the plan."""

    joints: tuple[str, ...] = ()

    def move(self, pose: Pose) -> Pose:
        """The pose as ordered."""
        return pose

"""Capture by hand: a person switches lamps, sets joints, or releases a camera with a folder."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.capture.devices import Frame, Pose
from impasto.errors import ArgumentError, CorruptInputError, DeviceError, DisconnectedError
from impasto.io.images import IMAGE_SUFFIXES, read_header

POLL_S = 0.25
STABLE = 2
"""Looks at a file in sequence at which size and time are the same, and the file is whole."""


class HandLights:
    """Lamps that a person switches, who is told which one.

    Parameters
    ----------
    directions
        ``(n, 3)``: to the lamps.
    say
        Called with the sentence that says what to switch.
    confirm
        Called after it, and returns when the person has done so; None: the photograph says so.
    """

    def __init__(
        self,
        directions: NDArray[np.float64],
        say: Callable[[str], None],
        confirm: Callable[[], None] | None = None,
    ) -> None:
        self._directions = directions
        self._say = say
        self._confirm = confirm
        self._on: int | None = None

    def switch_on(self, lamp: int) -> int:
        """Say which lamp; it counts as on when the person confirms it."""
        x, y, z = self._directions[lamp - 1].tolist()
        azimuth = math.degrees(math.atan2(y, x)) % 360.0
        elevation = math.degrees(math.asin(max(-1.0, min(1.0, z))))
        where = f"azimuth {azimuth:.0f}, elevation {elevation:.0f} degrees"
        self._order(f"switch on lamp {lamp} alone ({where})")
        self._on = lamp
        return lamp

    def switch_off(self) -> None:
        """Say that all lamps go off."""
        if self._on != 0:
            self._order("switch all lamps off")
        self._on = 0

    def _order(self, words: str) -> None:
        self._say(words)
        if self._confirm is not None:
            self._confirm()


class HandStage:
    """Joints that a person sets, who is told the angles.

    Parameters
    ----------
    joints
        Their names.
    say
        Called with the sentence that says how to set them; not where they stay as they are.
    confirm
        Called after it, and returns when the person has done so; None: nobody waits.
    """

    def __init__(
        self,
        joints: tuple[str, ...],
        say: Callable[[str], None],
        confirm: Callable[[], None] | None = None,
    ) -> None:
        self.joints = joints
        self._say = say
        self._confirm = confirm
        self._set: dict[str, float] = {}

    def move(self, pose: Pose) -> Pose:
        """Say the angles of all joints; they count as set when the person confirms them."""
        wanted = dict(pose.angles)
        if wanted and wanted != self._set:
            angles = (f"{name} to {math.degrees(wanted[name]) + 0.0:.1f}" for name in self.joints)
            self._say(f"set {', '.join(angles)} degrees")
            if self._confirm is not None:
                self._confirm()
            self._set = wanted
        return pose


class FolderCamera:
    """A camera that a person releases and that saves into a folder, by cable or card.

    Parameters
    ----------
    folder
        Where new files appear.
    say
        Called when it is time to release.
    patience_s
        Seconds to wait for a new file.
    poll_s
        Seconds between looks at the folder.

    Raises
    ------
    ArgumentError
        No such folder.
    """

    name = ""

    def __init__(
        self,
        folder: Path,
        say: Callable[[str], None],
        *,
        patience_s: float = 600.0,
        poll_s: float = POLL_S,
    ) -> None:
        if not folder.is_dir():
            raise ArgumentError(
                f"watch: {folder} is no folder; give that into which the camera saves"
            )
        self._folder = folder
        self._say = say
        self._patience_s = patience_s
        self._poll_s = poll_s
        self._known = self._files().keys()
        self._seconds: float | None = None

    def set_exposure(self, seconds: float) -> float | None:
        """Say another time than that before; EXIF of the photograph says what it was."""
        if self._seconds not in {None, seconds}:
            self._say(f"set the exposure time to {1000.0 * seconds:.4g} ms")
        self._seconds = seconds
        return None

    def trigger(self) -> Frame:
        """Wait for a new file that is whole.

        Raises
        ------
        DeviceError
            None came, or it stays damaged.
        DisconnectedError
            The folder is gone.
        """
        self._say(f"take the photograph; {self._folder} is watched")
        end = time.monotonic() + self._patience_s
        before: tuple[Path, tuple[int, int]] | None = None
        same, problem = 0, ""
        while time.monotonic() < end:
            files = self._files()
            new = [path for path in files if path not in self._known]
            if new:
                path = min(new, key=lambda one: files[one][1])
                same = same + 1 if before == (path, files[path]) else 0
                before = (path, files[path])
                if same >= STABLE:
                    try:
                        read_header(path)
                    except CorruptInputError as error:
                        problem = f"; {path.name} {error.problem}"
                    else:
                        self._known = files.keys()
                        return Frame(path.read_bytes(), path.suffix)
            time.sleep(self._poll_s)
        raise DeviceError(
            f"no new photograph in {self._folder} within {self._patience_s:g} s{problem}; see that "
            "the camera saves there"
        )

    def reconnect(self) -> None:
        """What has come in between belongs to no shot."""
        self._known = self._files().keys()

    def _files(self) -> dict[Path, tuple[int, int]]:
        """Photographs with size and time."""
        found = {}
        try:
            for path in self._folder.iterdir():
                if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith("."):
                    about = path.stat()
                    found[path] = (about.st_size, about.st_mtime_ns)
        except OSError as error:
            raise DisconnectedError(
                f"the folder {self._folder} cannot be read ({error.strerror}); is its disk or card "
                "there?"
            ) from error
        return found

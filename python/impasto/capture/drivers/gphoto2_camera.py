"""Cameras that libgphoto2 knows, by its Python binding gphoto2 (the extra ``capture``).

The library is under the LGPL: it is installed with the extra only, and imported when a camera is.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

from impasto._internal.extras import need
from impasto.capture.devices import Frame
from impasto.errors import DeviceError, DisconnectedError

SHUTTER = ("shutterspeed", "shutterspeed2", "exptime")
"""Names of the exposure time, of several makers."""


class GPhoto2Camera:
    """The camera at the USB port; close it when done.

    Raises
    ------
    MissingExtraError
        gphoto2 is not installed.
    DisconnectedError
        No camera, or another program holds it.
    """

    def __init__(self) -> None:
        need("gphoto2", "capture", "a camera at a USB port")
        import gphoto2

        self._library: Any = gphoto2
        self._camera: Any = None
        self.name = ""
        self.reconnect()

    def reconnect(self) -> None:
        """Close the camera, and open it again."""
        self.close()
        gp = self._library
        try:
            camera = gp.Camera()
            camera.init()
            self.name = str(camera.get_abilities().model)
        except gp.GPhoto2Error as error:
            raise DisconnectedError(
                f"no camera ({error.string}); see that it is on, that its cable is plugged in, "
                "and that no other program, such as a file manager, has opened it"
            ) from error
        self._camera = camera

    def set_exposure(self, seconds: float) -> float | None:
        """Set the nearest time that the camera has, and read it back."""
        widget, config = self._shutter()
        if widget is None:
            return None
        times = {choice: _seconds(choice) for choice in self._choices(widget)}
        known = {choice: value for choice, value in times.items() if value}
        if not known:
            return _seconds(str(self._called(widget.get_value)))
        nearest = min(known, key=lambda choice: abs(known[choice] / seconds - 1.0))
        self._called(widget.set_value, nearest)
        self._called(self._opened.set_config, config)
        widget, _ = self._shutter()
        return None if widget is None else _seconds(str(self._called(widget.get_value)))

    def trigger(self) -> Frame:
        """Release, and download; the copy in the camera is removed."""
        gp = self._library
        path = self._called(self._opened.capture, gp.GP_CAPTURE_IMAGE)
        file = self._called(self._opened.file_get, path.folder, path.name, gp.GP_FILE_TYPE_NORMAL)
        data = bytes(memoryview(self._called(file.get_data_and_size)))
        # The camera's memory would fill up; what is downloaded is checked, and taken again if not.
        with suppress(gp.GPhoto2Error):
            self._opened.file_delete(path.folder, path.name)
        return Frame(data, PurePosixPath(path.name).suffix.lower())

    def close(self) -> None:
        """Give the camera back."""
        if self._camera is not None:
            with suppress(self._library.GPhoto2Error):
                self._camera.exit()
            self._camera = None

    @property
    def _opened(self) -> Any:
        if self._camera is None:
            raise DisconnectedError("no camera; see that it is on, and to its cable")
        return self._camera

    def _shutter(self) -> tuple[Any, Any]:
        """The setting of the exposure time, and all settings."""
        gp = self._library
        config = self._called(self._opened.get_config)
        for name in SHUTTER:
            with suppress(gp.GPhoto2Error):
                return config.get_child_by_name(name), config
        return None, config

    def _choices(self, widget: Any) -> list[str]:
        gp = self._library
        if widget.get_type() not in (gp.GP_WIDGET_RADIO, gp.GP_WIDGET_MENU):
            return []
        return [str(choice) for choice in widget.get_choices()]

    def _called(self, call: Any, *arguments: Any) -> Any:
        """A call of the library, whose errors say what to do."""
        gp = self._library
        try:
            return call(*arguments)
        except gp.GPhoto2Error as error:
            gone = {gp.GP_ERROR_IO_USB_FIND, gp.GP_ERROR_MODEL_NOT_FOUND, gp.GP_ERROR_IO,
                    gp.GP_ERROR_IO_USB_CLAIM, gp.GP_ERROR_BAD_PARAMETERS}  # fmt: skip
            kind = DisconnectedError if error.code in gone else DeviceError
            raise kind(
                f"{self.name or 'the camera'}: {error.string}; see to its cable, battery and card"
            ) from error


def _seconds(text: str) -> float | None:
    """``1/125``, ``0.0080s`` or ``2`` as seconds; None: bulb, auto."""
    above, _, below = text.strip().removesuffix("s").partition("/")
    try:
        return float(above) / float(below) if below else float(above)
    except (ValueError, ZeroDivisionError):
        return None

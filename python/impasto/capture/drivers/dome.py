"""A dome of lamps behind a serial port, by a protocol of one line for each order.

115200 baud, ASCII, lines that end in a line feed. Every order has a number, and its answer the same
number, so that a late answer is never taken for that of another order::

    #1 ID            #1 OK IMPASTO-DOME 1 64      version of the protocol, number of lamps
    #2 ON 17         #2 OK ON 17                  lamp 17 is on, all others are off
    #3 OFF           #3 OK OFF                    all lamps are off
    #4 ON 99         #4 ERR no such lamp          any text after ERR

The dome answers when the lamp has its full light.
"""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any

from impasto._internal.extras import need
from impasto.errors import ArgumentError, DeviceError, DisconnectedError

NAME = "IMPASTO-DOME"
VERSION = 1
BAUD = 115200
ANSWER_S = 2.0
"""Seconds for an answer: an LED needs milliseconds, a relay with a halogen lamp about one second.
"""
STARTS = 3
"""Times that a dome is called at the beginning: many boards restart when their port is opened."""


class Dome:
    """Lamps of a dome; close it, or use it in a ``with`` block.

    Parameters
    ----------
    port
        Such as ``"/dev/ttyUSB0"`` or ``"COM3"``.
    answer_s
        Seconds to wait for an answer.

    Attributes
    ----------
    lamps
        How many lamps the dome says that it has.

    Raises
    ------
    MissingExtraError
        pyserial is not installed.
    DisconnectedError
        There is no such port, or nothing answers on it.
    DeviceError
        Something else answers.
    """

    def __init__(self, port: str, *, answer_s: float = ANSWER_S) -> None:
        need("serial", "capture", "a dome at a serial port")
        import serial

        if not answer_s > 0:
            raise ArgumentError(f"answer_s: expected seconds above 0, found {answer_s!r}")
        self.port = port
        self._answer_s = answer_s
        self._errors: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._count = 0
        self._part = b""
        try:
            self._serial: Any = serial.Serial(port, BAUD, timeout=0.05, write_timeout=answer_s)
        except self._errors as error:
            raise DisconnectedError(
                f"the dome: {port} cannot be opened ({error}); see that its cable is plugged in, "
                "and that no other program uses the port"
            ) from error
        try:
            self.lamps = self._identified()
        except BaseException:
            self._serial.close()
            raise

    def switch_on(self, lamp: int) -> int:
        """As :class:`impasto.capture.Lights` says."""
        answer = self._ordered(f"ON {lamp}")
        words = answer.split()
        if len(words) != 2 or words[0] != "ON" or not words[1].isdecimal():
            raise DeviceError(f"the dome answered {answer!r} to ON {lamp}; see to its firmware")
        return int(words[1])

    def switch_off(self) -> None:
        """All lamps."""
        if (answer := self._ordered("OFF")) != "OFF":
            raise DeviceError(f"the dome answered {answer!r} to OFF; see to its firmware")

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()

    def __enter__(self) -> Dome:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _identified(self) -> int:
        for last in (*[False] * (STARTS - 1), True):
            try:
                words = self._ordered("ID").split()
                break
            except DisconnectedError:
                if last:
                    raise
        if len(words) != 3 or words[0] != NAME or not (words[1] + words[2]).isdecimal():
            raise DeviceError(
                f"the device at {self.port} says {' '.join(words)!r}, and is no dome with the "
                "protocol of impasto; give another port"
            )
        if int(words[1]) != VERSION:
            raise DeviceError(
                f"the dome has version {words[1]} of the protocol, expected {VERSION}; change its "
                "firmware"
            )
        return int(words[2])

    def _ordered(self, order: str) -> str:
        """The answer to an order, without its number and ``OK``."""
        self._count += 1
        head = f"#{self._count} "
        try:
            self._serial.write(f"{head}{order}\n".encode("ascii"))
            end = time.monotonic() + self._answer_s
            while (line := self._line(end)) is not None:
                # Answers to earlier orders came too late, and text of a restart has no number.
                if line.startswith(head):
                    answer = line.removeprefix(head).strip()
                    if answer.startswith("ERR"):
                        why = answer.removeprefix("ERR").strip() or "no reason given"
                        raise DeviceError(f"the dome refuses {order}: {why}")
                    if answer.startswith("OK"):
                        return answer.removeprefix("OK").strip()
                    raise DeviceError(f"the dome answered {answer!r} to {order}")
        except self._errors as error:
            raise DisconnectedError(
                f"the dome at {self.port} is gone ({error}); plug in its cable"
            ) from error
        raise DisconnectedError(
            f"no answer from the dome at {self.port} to {order} within {self._answer_s:g} s; see "
            "that it has power, that the cable carries data, and that this is its port"
        )

    def _line(self, end: float) -> str | None:
        """The next line; None when the time is over."""
        while b"\n" not in self._part:
            if time.monotonic() > end:
                return None
            self._part += self._serial.read(max(1, self._serial.in_waiting))
        line, _, self._part = self._part.partition(b"\n")
        return line.decode("ascii", errors="replace").strip()

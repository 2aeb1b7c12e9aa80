"""The open connections of a small server: so many at a time, each for so long.

Whoever can reach the port can open connections, thousands at once, and say nothing, or one letter
every few seconds. A connection is a *stranger* until it has asked with the token. Strangers must
ask soon; where there are too many, the one that came first makes room for the next. So the page of
the user, who asks at once, gets its answer however many strangers wait.
"""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

MOST_STRANGERS = 48
"""Open connections that have not shown the token."""
MOST_KNOWN = 48
"""Open connections that have; a browser opens six to a host."""
SOON = 5.0
"""Seconds in which a stranger must have asked."""
IDLE = 30.0
"""Seconds in which the next whole request must arrive, or an answer be taken."""


@dataclass
class _Connection:
    ends: float | None
    known: bool = False


class Connections:
    """Which connections are open, and until when."""

    def __init__(self) -> None:
        self._open: dict[socket.socket, _Connection] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._open)

    def admit(self, one: socket.socket) -> bool:
        """A new connection; False: there is no room, close it."""
        with self._lock:
            strangers = [other for other, found in self._open.items() if not found.known]
            if len(strangers) >= 2 * MOST_STRANGERS:
                return False  # those that were told to end have not ended yet
            for other in strangers[: max(0, len(strangers) - MOST_STRANGERS + 1)]:
                _end(other)
            self._open[one] = _Connection(time.monotonic() + SOON)
            return True

    def known(self, one: socket.socket) -> bool:
        """A connection has shown the token; False: too many have."""
        with self._lock:
            found = self._open.get(one)
            if found is None:
                return False
            count = sum(other.known for other in self._open.values())
            if not found.known and count >= MOST_KNOWN:
                return False
            found.known, found.ends = True, time.monotonic() + IDLE
            return True

    def waiting(self, one: socket.socket, seconds: float | None) -> None:
        """From now on a connection may take so long; None: as long as the server itself needs.

        A stranger has no more time than it came with.
        """
        with self._lock:
            found = self._open.get(one)
            if found is not None and found.known:
                found.ends = None if seconds is None else time.monotonic() + seconds

    def gone(self, one: socket.socket) -> None:
        """A connection is closed."""
        with self._lock:
            self._open.pop(one, None)

    def end_late(self) -> None:
        """End those whose time is over: their threads read the end of the stream."""
        now = time.monotonic()
        with self._lock:
            for one, found in self._open.items():
                if found.ends is not None and found.ends < now:
                    _end(one)


def _end(one: socket.socket) -> None:
    with suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)

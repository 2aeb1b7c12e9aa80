"""The permissions that new files do not get, read without changing them for other threads."""

from __future__ import annotations

import os
from pathlib import Path

STATUS = Path("/proc/self/status")


def umask() -> int:
    """The mask of this process, as Linux tells it; elsewhere that of the import of this module.

    POSIX tells it only by setting another one, for all threads: with none, what one of them makes
    in that moment may be written by everybody.
    """
    told = _told()
    return _AT_IMPORT if told is None else told


def _told() -> int | None:
    try:
        lines = STATUS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith("Umask:")]
    return int(found[0], 8) if found else None


def _at_import() -> int:
    told = _told()
    if told is None:
        # Meanwhile files of other threads are private rather than everybody's.
        told = os.umask(0o077)
        os.umask(told)
    return told


_AT_IMPORT = _at_import()

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
    found = _of_status()
    return _AT_IMPORT if found is None else found


def _of_status() -> int | None:
    try:
        lines = STATUS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    masks = [line.split()[1] for line in lines if line.startswith("Umask:")]
    return int(masks[0], 8) if masks else None


def _at_import() -> int:
    found = _of_status()
    if found is None:
        # Meanwhile files of other threads are private rather than everybody's.
        found = os.umask(0o077)
        os.umask(found)
    return found


_AT_IMPORT = _at_import()

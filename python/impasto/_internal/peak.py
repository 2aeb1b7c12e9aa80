"""The largest memory that a process had, as far as the system says."""

from __future__ import annotations

import sys
from pathlib import Path


def peak_bytes() -> int | None:
    """Largest resident memory of this process; None where the system does not say.

    Linux: ``VmHWM``, since its ``getrusage`` includes the parent's memory before ``exec``. Other
    systems of the POSIX family, macOS among them: ``getrusage``.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmHWM")))
    except (OSError, StopIteration, ValueError):
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    largest = int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    # In bytes on macOS, in KiB elsewhere.
    return largest if sys.platform == "darwin" else 1024 * largest

"""What stands beside a bar of long work: time left, and memory in use."""

from __future__ import annotations

import os
from pathlib import Path

from rich.progress import ProgressColumn, Task
from rich.text import Text

_LONG = 2.0
"""Seconds after which work is long."""


class Remaining(ProgressColumn):
    """The task's own ``words``; of long work without any, the memory in use.

    And the time left, where the task's ``total`` counts all of the work (its field ``whole``).
    """

    def render(self, task: Task) -> Text:
        """The words."""
        words = str(task.fields.get("words", ""))
        if not words and (task.elapsed or 0.0) > _LONG and not task.finished:
            left = task.time_remaining if task.fields.get("whole") else None
            times = "" if left is None else f"{time_words(left)} left"
            words = ", ".join(filter(None, (times, memory_words())))
        return Text(words, style="dim")


def time_words(seconds: float) -> str:
    """``45 s``, ``12 min``, ``3 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def memory_words() -> str:
    """Memory of this process, ``0.42 GiB``; empty where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return ""
    return f"{pages * os.sysconf('SC_PAGE_SIZE') / 2**30:.2f} GiB"

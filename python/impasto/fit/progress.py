"""A progress bar for ``progress=True``; rich is loaded only then."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from impasto.fit.border import ProgressCallback


@contextmanager
def bar(description: str) -> Iterator[ProgressCallback]:
    """A bar on stderr that starts with the first call and is gone at the end; none in a log."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    display = Progress(console=console, transient=True)
    task = display.add_task(description, total=None)

    def update(done: int, total: int) -> None:
        if not display.live.is_started:
            display.start()
        display.update(task, completed=done, total=total)

    try:
        yield update
    finally:
        display.stop()

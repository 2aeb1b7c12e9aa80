"""A progress bar for ``progress=True``; rich is loaded only then."""

from __future__ import annotations

from impasto.fit.border import ProgressCallback


def bar(description: str) -> ProgressCallback:
    """A bar on stderr that starts with the first call and ends with the last tile."""
    from rich.console import Console
    from rich.progress import Progress

    display = Progress(console=Console(stderr=True), transient=True)
    task = display.add_task(description, total=None)

    def update(done: int, total: int) -> None:
        if not display.live.is_started:
            display.start()
        display.update(task, completed=done, total=total)
        if done >= total:
            display.stop()

    return update

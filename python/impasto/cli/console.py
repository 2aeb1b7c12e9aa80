"""Messages and progress on stderr; stdout is for data."""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn
from rich.text import Text

from impasto._internal.bars import Remaining
from impasto._internal.printable import printable
from impasto.errors import ImpastoWarning
from impasto.report import Timings

NAME_WIDTH = 14
NOTE_WIDTH = 52

Advance = Callable[[int, int], None]
"""Progress of a stage: (done, total)."""


class _Printable(Console):
    """A console on which control characters of names are shown, not obeyed."""

    def print(self, *objects: Any, **options: Any) -> None:
        super().print(*(_shown(one) for one in objects), **options)


def _shown(one: Any) -> Any:
    if isinstance(one, str):
        return printable(one, lines=True)
    if isinstance(one, Text) and (words := printable(one.plain, lines=True)) != one.plain:
        return Text(words, style=one.style)
    return one


def stdout() -> Console:
    """The console for data."""
    return _Stdout(highlight=False, soft_wrap=True)


class _Stdout(_Printable):
    def on_broken_pipe(self) -> None:
        # Called while the error is handled; Rich would exit with code 1.
        raise


def stderr() -> Console:
    """The console for progress and messages."""
    return _Printable(stderr=True, highlight=False, soft_wrap=True)


def make_output_safe() -> None:
    """Let an ASCII terminal show ``?`` for other characters, and a closed stream accept output."""
    # Python sets a stream to None that was closed (``>&-``).
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def terminals() -> list[int]:
    """Which of the file descriptors of stdout and stderr are terminals."""
    return [one for one in (1, 2) if os.isatty(one)]


def silence_closed(terminals: list[int]) -> None:
    """Let terminals that have been closed accept output: a bar that ends would be an error."""
    for one in terminals:
        if not os.isatty(one):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, one)
            os.close(nowhere)


def complain(message: str) -> None:
    """Print an error message in red."""
    stderr().print(f"[bold red]impasto:[/] [red]{escape(printable(message, lines=True))}[/]")


def hint(message: str) -> None:
    """Print a dim line that says what to do."""
    stderr().print(f"[dim]{escape(message)}[/]")


def print_json(content: Any) -> None:
    """Print JSON with sorted keys on stdout."""
    sys.stdout.write(json.dumps(content, indent=2, sort_keys=True) + "\n")


class Stages:
    """The stages of a command: a bar while one runs, one line with its time when it ends.

    Parameters
    ----------
    quiet
        Show nothing.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self.timings = Timings()
        self._console = _Printable(stderr=True, highlight=False, soft_wrap=True, quiet=quiet)

    def say(self, text: str) -> None:
        """Print one line of rich markup."""
        self._console.print(text)

    def advise(self, text: str) -> None:
        """Print what to do next, as the last line of a command."""
        self._console.print(escape(text))

    @contextmanager
    def warned(self) -> Iterator[None]:
        """Print each :class:`ImpastoWarning` of the body as one line, after it."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ImpastoWarning)
            yield
        for one in caught:
            if issubclass(one.category, ImpastoWarning):
                words = str(one.message).replace('backend="cpu"', "--backend cpu")
                self.say(f"[yellow]warning:[/] {escape(words)}")
            else:
                warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)

    @contextmanager
    def stage(self, name: str, note: str = "", *, whole: bool = False) -> Iterator[Stage]:
        """Run the body as one stage; the body may change the ``note`` of the stage.

        The bar says how much time is left where its total counts the ``whole`` work.
        """
        stage = Stage(note)
        columns = (
            SpinnerColumn(style="dim"),
            TextColumn(f"{name:<{NAME_WIDTH}}"),
            BarColumn(40, complete_style="cyan", finished_style="cyan", pulse_style="cyan"),
            Remaining(),
        )
        # A log file only gets the final lines.
        hidden = not self._console.is_terminal
        bars = Progress(*columns, console=self._console, transient=True, disable=hidden)
        with bars as progress, self.timings.stage(name):
            # Until there is progress, what is being done.
            task = progress.add_task(name, total=None, words=note, whole=whole)
            shown = note

            def show(words: str) -> None:
                nonlocal shown
                shown = words
                progress.update(task, words=words)

            def advance(done: int, total: int) -> None:
                if done and shown == note:
                    show("")
                progress.update(task, completed=done, total=total)

            stage.advance, stage.show, stage.refresh = advance, show, progress.refresh
            yield stage
        seconds = self.timings.seconds[name]
        words = escape(f"{stage.note:<{NOTE_WIDTH}}")
        self._console.print(f"  {name:<{NAME_WIDTH}}[dim]{words}{seconds:7.1f} s[/]")


class Stage:
    """A running stage: its progress, words beside the bar, and a note for its final line."""

    def __init__(self, note: str) -> None:
        self.note = note
        self.advance: Advance = lambda done, total: None
        self.show: Callable[[str], None] = lambda words: None
        self.refresh: Callable[[], None] = lambda: None

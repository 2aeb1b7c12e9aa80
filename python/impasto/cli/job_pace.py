"""How far a job is, how fast, and what it says of its photographs, beside its bar."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from impasto._internal.bars import memory_words, time_words
from impasto.cli.console import Stage, Stages

PHASES = {
    "reading": "reading the photographs",
    "learning": "learning from the whole painting",
    "tiles": "fitting tiles",
    "scales": "making smaller scales",
}


def pace_words(pixels_per_second: float) -> str:
    """``2.3 Mpx/s``."""
    if pixels_per_second < 1e5:
        return f"{pixels_per_second / 1e3:.3g} kpx/s"
    return f"{pixels_per_second / 1e6:.3g} Mpx/s"


class Pace:
    """Pixels per second, time left and memory of a running job, in words."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._start: tuple[float, int] | None = None
        self._pixels = 0.0

    @property
    def begun(self) -> bool:
        """Whether tiles are being fitted."""
        return self._start is not None

    def words(self, done: int, total: int) -> str:
        """After a tile."""
        from impasto import jobs

        now = time.monotonic()
        if self._start is None:
            self._start = now, done
            found = jobs.status(self._out)
            self._pixels = found.pixels / found.tiles
        seconds, tiles = now - self._start[0], done - self._start[1]
        parts = [f"{done} of {total}"]
        if done == total:
            parts.append(PHASES["scales"])
        elif tiles and seconds > 0:
            parts.append(pace_words(tiles * self._pixels / seconds))
            parts.append(f"{time_words((total - done) * seconds / tiles)} left")
        return ", ".join(filter(None, (*parts, memory_words())))

    def summary(self, out: Path) -> str:
        """At the end."""
        from impasto import jobs

        found = jobs.status(out)
        return f"{found.tiles_done} of {found.tiles}, {found.pixels / 1e6:.3g} Mpx, {out}"


@dataclass(frozen=True)
class JobProgress:
    """Shows how far a job is, in tiles; before, how many of its finished files are compared."""

    stages: Stages
    stage: Stage
    pace: Pace
    out: Path

    def __call__(self, done: int, total: int) -> None:
        """In tiles."""
        if not self.pace.begun:
            say_notes(self.stages, self.out)
        self.stage.advance(done, total)
        self.stage.show(self.pace.words(done, total))

    def comparing(self, done: int, total: int) -> None:
        """In bytes, before a job that was interrupted goes on."""
        self.stage.show("comparing finished tiles")
        self.stage.advance(done, total)
        if not done:
            self.stage.refresh()


def say_notes(stages: Stages, out: Path) -> None:
    """What was repaired, left out or assumed of the photographs."""
    from impasto import jobs

    for _, text in jobs.status(out).notes:
        stages.say(f"  {'':14}[dim]{escape(text)}[/]")

"""What a capture, or its check, comes to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from impasto.capture.misfires import Misfire


@dataclass(frozen=True)
class Retake:
    """A shot that has to be taken again.

    Parameters
    ----------
    name
        Of the shot.
    lamp
        Its number; None for dark frames.
    misfire
        What is wrong with it: code, a sentence, what to do.
    """

    name: str
    lamp: int | None
    misfire: Misfire

    def __str__(self) -> str:
        lamp = "" if self.lamp is None else f" (lamp {self.lamp})"
        return f"{self.name}{lamp}: {self.misfire.why}"


@dataclass(frozen=True)
class CaptureResult:
    """The state of a capture.

    Parameters
    ----------
    folder
        Of the capture.
    planned, taken
        Shots of the plan, and those whose photographs count.
    retakes
        All others that were tried, in the order of the plan.
    notes
        What concerns no single shot: the clock, a lamp that drifts.
    session
        The session file; None: not written, since no photograph is there or it was edited by hand.
    """

    folder: Path
    planned: int
    taken: int
    retakes: tuple[Retake, ...]
    notes: tuple[str, ...]
    session: Path | None

    @property
    def complete(self) -> bool:
        """Whether every shot of the plan is there and right."""
        return self.taken == self.planned and not self.retakes

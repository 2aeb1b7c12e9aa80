"""Notes on what was repaired, left out or assumed while files were read."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impasto._internal.printable import printable
from impasto.errors import CorruptInputError

LOG = logging.getLogger("impasto.io")
LOG.addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class Note:
    """One thing that the reader did or found.

    Parameters
    ----------
    kind
        A short stable word for programs: ``"count"``, ``"length"``, ``"horizon"``, ``"match"``,
        ``"missing"``, ``"unlisted"`` ...
    where
        The file (and line) it is about.
    message
        One sentence for people: what was found and what was done.
    repair
        True where the reader changed or dropped something; ``strict=True`` raises instead.
    how
        Of a value that nobody gave: ``"assumed"``, or ``"profile"`` where the files state it.
    """

    kind: str
    where: str
    message: str
    repair: bool = True
    how: str = ""

    def __post_init__(self) -> None:
        # Logged and shown on terminals: names of files may hold control characters.
        object.__setattr__(self, "where", printable(self.where))
        object.__setattr__(self, "message", printable(self.message))

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


@dataclass(slots=True)
class Notebook:
    """Collects notes, logs each one, and refuses repairs when strict."""

    strict: bool = False
    notes: list[Any] = field(default_factory=list)

    def repair(self, kind: str, where: Path | str, message: str) -> None:
        """Note a repair, or raise an error if strict."""
        if self.strict:
            raise CorruptInputError(where, f"{message} (refused because of strict=)")
        self._add(Note(kind, str(where), message), logging.WARNING)

    def warn(self, kind: str, where: Path | str, message: str, how: str = "") -> None:
        """Note something unusual that was kept."""
        self._add(Note(kind, str(where), message, repair=False, how=how), logging.WARNING)

    def say(self, kind: str, where: Path | str, message: str, how: str = "") -> None:
        """Note a harmless decision."""
        self._add(Note(kind, str(where), message, repair=False, how=how), logging.INFO)

    def take(self, note: Any) -> None:
        """Keep a note with more content than a sentence (a tone estimate), and log it."""
        self._add(note, logging.INFO if note.decided else logging.WARNING)

    def extend(self, notes: tuple[Note, ...]) -> None:
        """Take over notes that were already logged."""
        self.notes.extend(notes)

    def _add(self, note: Any, level: int) -> None:
        self.notes.append(note)
        LOG.log(level, "%s", note)


def few(items: list[str] | tuple[str, ...], limit: int = 3) -> str:
    """The first few of a list, in words: ``a, b, c and 9 more``."""
    shown = ", ".join(items[:limit])
    rest = len(items) - limit
    return f"{shown} and {rest} more" if rest > 0 else shown

"""The log of a session: lines of JSON, each on the disk before the next trial begins.

Every line ends in a checksum of its own. What is torn off at the end of the file is a choice that
was not confirmed, and the trial is shown again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from impasto._internal.checks import is_whole
from impasto.colour.temperature import checked_degree
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.json_lines import JournalFile, read_lines

KIND = "impasto.matching"
MOST_BYTES = 1 << 24
"""Of a log: that of a session has some thousands."""
_ADVICE = "; bring back a copy of it, or begin a session with another log"


@dataclass(frozen=True)
class Choice:
    """What an observer chose in a trial.

    Attributes
    ----------
    trial
        From 0 on.
    degree
        Of the chosen picture.
    steps
        How many pictures were looked at, repeats included.
    seconds
        From the first picture of the trial to the choice.
    """

    trial: int
    degree: float
    steps: int
    seconds: float

    def __post_init__(self) -> None:
        checked_degree(self.degree)
        if not (is_whole(self.trial) and self.trial >= 0 and is_whole(self.steps)):
            raise ValueError("trial and steps are whole numbers from 0 on")
        if not (isinstance(self.seconds, int | float) and isfinite(self.seconds)):
            raise ValueError("seconds is a finite number")


@dataclass
class MatchingLog:
    """A session.

    Attributes
    ----------
    settings
        Its first line: observer, painting, seed, degrees, trials, adapt_seconds, illuminant,
        reference, mode, display, key of the stimuli, and colours ``xyz`` of the painting.
    choices
        In the order of their trials.
    size
        Bytes of the file up to the end of its last whole line.
    """

    settings: dict[str, Any]
    choices: list[Choice] = field(default_factory=list)
    size: int = 0

    @property
    def observer(self) -> str:
        """Who looked."""
        return str(self.settings["observer"])

    @property
    def painting(self) -> str:
        """At what."""
        return str(self.settings["painting"])

    @property
    def trials(self) -> int:
        """How many there are in all."""
        return int(self.settings["trials"])

    def take(self, content: Mapping[str, Any]) -> None:
        """What one more line says."""
        one = Choice(**content["choice"])
        if one.trial != len(self.choices) or one.trial >= self.trials:
            raise ValueError(f"trial {one.trial} after {len(self.choices)} of {self.trials}")
        if one.degree not in self.settings["degrees"]:
            raise ValueError(f"{one.degree} is none of the degrees")
        self.choices.append(one)


def read_log(path: str | Path) -> MatchingLog:
    """Read a session; a last line without its end is left out.

    Raises
    ------
    CorruptInputError
        A file that is damaged or something else.
    FileNotFoundError
        There is none.
    """
    target = Path(path)
    if target.stat().st_size > MOST_BYTES:
        raise CorruptInputError(target, f"has more than {MOST_BYTES} bytes: no log of a session")
    found: MatchingLog | None = None

    def take(content: Mapping[str, Any], _: bytes) -> None:
        nonlocal found
        if found is None:
            found = MatchingLog(_checked(content))
        else:
            found.take(content)

    size = read_lines(target, take, _ADVICE)
    if found is None:
        raise CorruptInputError(target, "is no log of a matching experiment")
    found.size = size
    return found


class LogWriter:
    """A log that is being written; its file is open until :meth:`close`."""

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Begin a log, or go on with one of the same settings.

        Raises
        ------
        ArgumentError
            The file is of another session.
        CorruptInputError
            It is damaged.
        """
        begun = path.is_file() and b"\n" in path.read_bytes()
        first = _checked({"kind": KIND, **settings})
        self.log = read_log(path) if begun else MatchingLog(first)
        for name, value in first.items():
            found = self.log.settings.get(name)
            if found != value and name != "xyz":
                raise ArgumentError(
                    f"log: {path} is of another session ({name} is {found!r} there, here "
                    f"{value!r}); give another name"
                )
        self._file = JournalFile(path, self.log.size, first)

    def commit(self, choice: Choice) -> None:
        """One more choice; it is on the disk when this returns."""
        content = {"choice": vars(choice)}
        self._file.append(content)
        self.log.take(content)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def _checked(content: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a session, complete and of the right types.

    Raises
    ------
    ValueError, KeyError
        They are not.
    """
    if content["kind"] != KIND:
        raise ValueError(f"{content['kind']} is no matching experiment")
    for name in ("observer", "painting", "mode", "display", "key"):
        if not isinstance(content[name], str):
            raise ValueError(f"{name} is no text")
    if not (is_whole(content["trials"]) and 1 <= content["trials"] <= 10_000):
        raise ValueError("trials is no number from 1 on")
    for d in content["degrees"]:
        checked_degree(d)
    if len(content["xyz"]) != 3 or len({len(row) for row in content["xyz"]}) != 1:
        raise ValueError("xyz is not (3, n)")
    if not all(isfinite(value) for row in content["xyz"] for value in row):
        raise ValueError("xyz is not finite")
    for name in ("illuminant", "reference"):
        if not isinstance(content[name], str | int | float):
            raise ValueError(f"{name} is neither a name nor kelvin")
    return dict(content)

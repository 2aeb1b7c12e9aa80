"""``journal.jsonl`` of a capture: what is on the disk, in the order in which it happened.

A line is appended, and reaches the disk, after the photograph did: a photograph that no line names
does not count. What is torn off at the end of the file is a shot that was not finished. Every line
ends in a checksum of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from impasto._internal.checks import is_whole
from impasto.capture.misfires import Misfire
from impasto.errors import CorruptInputError
from impasto.io.json_lines import JournalFile, read_lines

JOURNAL = "journal.jsonl"
_ADVICE = (
    "; bring back a copy of it, or begin anew in another folder: the photographs beside it stay"
)


@dataclass(frozen=True)
class Entry:
    """A photograph that is on the disk.

    Attributes
    ----------
    name
        Of the shot.
    file
        Its path in the folder of the capture.
    sha256
        Of the file.
    lamp
        The lamp that was acknowledged; None: none was on.
    exposure_s
        As read back, or as ordered where the camera cannot say; seconds.
    time
        Seconds since 1970, by the clock of this computer.
    tries
        Photographs that were taken for it.
    level
        Mean linear light, full scale 1, the black of the dark frames included.
    """

    name: str
    file: str
    sha256: str
    lamp: int | None
    exposure_s: float
    time: float
    tries: int
    level: float

    def __post_init__(self) -> None:
        texts = self.name, self.file, self.sha256
        numbers = self.exposure_s, self.time, self.level
        if not all(isinstance(value, str) for value in texts):
            raise ValueError("name, file and sha256 are texts")
        if not all(isinstance(value, int | float) and isfinite(value) for value in numbers):
            raise ValueError("exposure_s, time and level are finite numbers")
        if not is_whole(self.tries) or not (self.lamp is None or is_whole(self.lamp)):
            raise ValueError("tries and lamp are whole numbers")
        if ".." in self.file.split("/") or self.file.startswith("/"):
            raise ValueError(f"a file outside of the capture: {self.file!r}")


@dataclass
class CaptureLog:
    """What a journal says.

    Attributes
    ----------
    plan
        SHA-256 of the plan that it belongs to.
    entries
        The photographs that count, by the names of their shots, in the order of their commits.
    failed
        Why a shot was given up or withdrawn, by its name.
    session
        SHA-256 of the last session file that the capture wrote; empty: none.
    size
        Bytes of the file up to the end of its last whole line.
    """

    plan: str
    entries: dict[str, Entry] = field(default_factory=dict)
    failed: dict[str, Misfire] = field(default_factory=dict)
    session: str = ""
    size: int = 0

    def take(self, content: Mapping[str, Any]) -> None:
        """What one more line says."""
        if "shot" in content:
            entry = Entry(**content["shot"])
            self.entries.pop(entry.name, None)
            self.entries[entry.name] = entry
            self.failed.pop(entry.name, None)
        elif "failed" in content:
            name = str(content["failed"])
            self.entries.pop(name, None)
            self.failed[name] = Misfire(*(str(content[k]) for k in ("code", "why", "advice")))
        elif "session" in content:
            self.session = str(content["session"])
        elif "tried" not in content and "note" not in content:
            raise ValueError("a line of no known kind")


def read_log(path: Path) -> CaptureLog:
    """What a journal says; a last line without its end is left out.

    Raises
    ------
    CorruptInputError
        A file that is damaged or something else.
    FileNotFoundError
        There is none.
    """
    found: CaptureLog | None = None

    def take(content: Mapping[str, Any], _: bytes) -> None:
        nonlocal found
        if found is None:
            found = CaptureLog(str(content["plan"]))
        else:
            found.take(content)

    size = read_lines(path, take, _ADVICE)
    if found is None:
        raise CorruptInputError(path, "is no journal of a capture")
    found.size = size
    return found


class Journal:
    """A journal that is being written; its file is open until :meth:`close`."""

    def __init__(self, path: Path, plan: str) -> None:
        """Go on with a journal, or begin one, and cut off what is torn."""
        begun = path.is_file() and b"\n" in path.read_bytes()
        self.log = read_log(path) if begun else CaptureLog(plan)
        self._file = JournalFile(path, self.log.size, {"plan": plan})

    def commit(self, entry: Entry) -> None:
        """A photograph whose file is on the disk."""
        self._write({"shot": vars(entry)})

    def fail(self, name: str, misfire: Misfire) -> None:
        """A shot that is given up, or whose photograph is withdrawn."""
        self._write({"failed": name, **vars(misfire)})

    def tried(self, name: str, misfire: Misfire) -> None:
        """A try that did not give a right photograph."""
        self._write({"tried": name, **vars(misfire)})

    def note(self, code: str, text: str) -> None:
        """What concerns no single shot."""
        self._write({"note": code, "text": text})

    def session(self, sha256: str) -> None:
        """A session file that the capture has written."""
        self._write({"session": sha256})

    def close(self) -> None:
        """Give the file back."""
        self._file.close()

    def _write(self, content: Mapping[str, Any]) -> None:
        self._file.append(content)
        self.log.take(content)

"""The folder of a capture: its names, and how photographs come into it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from impasto.capture.journal import JOURNAL
from impasto.capture.shots import Kind, Shot
from impasto.capture.shots_file import SHOTS_FILE
from impasto.errors import ArgumentError

NOTES = "capture"
"""The folder of plan, journal and lock."""
WITHDRAWN = "withdrawn"
"""The folder of photographs that do not count; none is deleted."""
FOLDERS: Mapping[Kind, str] = {
    "photograph": "photographs",
    "dark": "dark",
    "board": "board",
    "reference": "reference",
}


class CaptureFolder:
    """Paths in the folder of a capture."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.notes = root / NOTES
        self.journal = self.notes / JOURNAL
        self.shots = self.notes / SHOTS_FILE

    def prepare(self, *, resume: bool) -> None:
        """Make the folders of a new capture, or see that there is one.

        Raises
        ------
        ArgumentError
            A capture that is not to go on, or a folder with something else in it.
        """
        if self.journal.exists() and not resume:
            raise ArgumentError(
                f"out: {self.root} already holds a capture; go on with it (resume=True, --resume), "
                "or give another folder"
            )
        if self.root.exists() and not self.root.is_dir():
            raise ArgumentError(f"out: {self.root} is a file; give the name of a folder")
        if not self.journal.exists() and self.root.is_dir() and any(self._strange()):
            raise ArgumentError(
                f"out: {self.root} is not empty and holds no capture; give another folder"
            )
        for name in (NOTES, *FOLDERS.values()):
            (self.root / name).mkdir(parents=True, exist_ok=True)

    def file_of(self, shot: Shot, suffix: str) -> Path:
        """Where the photograph of a shot lies."""
        return self.root / FOLDERS[shot.kind] / f"{shot.name}{suffix.lower()}"

    def relative(self, path: Path) -> str:
        """The name of a file as the journal has it."""
        return path.relative_to(self.root).as_posix()

    def withdraw(self, path: Path) -> None:
        """Keep a file that does not count under a new name."""
        if path.exists():
            path.rename(self._free(path))

    def keep(self, path: Path, data: bytes) -> None:
        """Keep the last bytes of a shot that is given up, for a look at them."""
        self._free(path).write_bytes(data)

    def _free(self, path: Path) -> Path:
        home = self.root / WITHDRAWN
        home.mkdir(exist_ok=True)
        number = 1
        while (target := home / f"{path.stem}-{number}{path.suffix}").exists():
            number += 1
        return target

    def _strange(self) -> list[Path]:
        """What an interrupted beginning does not leave."""
        own = {self.root / name for name in (NOTES, *FOLDERS.values())}
        return [path for path in self.root.iterdir() if path not in own]

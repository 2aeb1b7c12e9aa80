"""``journal.jsonl``: which tiles are on the disk, with a checksum of every file.

A line is appended, and reaches the disk, after all files of its tile did. What is torn off at the
end of the file is a tile that was not finished. Every line ends in a checksum of its own, so that
a change is found while the job runs, too.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impasto._internal.regular import kind_of
from impasto.errors import CorruptInputError
from impasto.io.json_lines import JournalFile, crc_of, read_lines, sealed_line
from impasto.jobs.grid import Grid, Tile

JOURNAL = "journal.jsonl"
CHUNK = 1 << 24
"""Bytes of a file that are read at a time."""


@dataclass(frozen=True)
class TileEntry:
    """A tile that is on the disk.

    Attributes
    ----------
    estimated
        Pixels whose normal is estimated.
    shards
        CRC-32 in hexadecimal digits of the file of each map, by its name in the store.
    """

    estimated: int
    shards: Mapping[str, str]


@dataclass
class Entries:
    """What a journal says.

    Attributes
    ----------
    job, learned
        SHA-256 of the record and of the learned model that it belongs to.
    tiles
        The tiles on the disk.
    numbers
        CRC-32 of what is no map, in the versions that the running job has written or was about to
        write; a finished journal has it among the files.
    files
        CRC-32 of all other files; None while the job runs.
    length
        Bytes of the file up to the end of its last whole line.
    ended
        Whether the checksums of all other files are its last line, and nothing follows.
    """

    job: str
    learned: str
    tiles: dict[Tile, TileEntry] = field(default_factory=dict)
    numbers: list[str] = field(default_factory=list)
    files: dict[str, str] | None = None
    length: int = 0
    ended: bool = False

    def to_bytes(self, grid: Grid) -> bytes:
        """The whole file, tiles in the order of the grid."""
        lines = [sealed_line({"job": self.job, "learned": self.learned})]
        lines += [
            sealed_line(_tile_content(tile, self.tiles[tile]))
            for tile in grid
            if tile in self.tiles
        ]
        if self.files is not None:
            before = crc_of(b"".join(lines))
            lines.append(sealed_line({"before": before, "files": self.files}))
        return b"".join(lines)


def read_journal(path: Path) -> Entries:
    """What a journal says; a last line without its end is left out.

    Raises
    ------
    CorruptInputError
        A file that is damaged or something else.
    FileNotFoundError
        There is none.
    """
    found: Entries | None = None
    before = 0

    def take(content: Mapping[str, Any], line: bytes) -> None:
        nonlocal found, before
        if found is None:
            found = Entries(str(content["job"]), str(content["learned"]))
        elif "files" in content:
            found.files = _checksums(content["files"])
            if content["before"] != f"{before:08x}":
                raise ValueError("the checksum of the lines before does not agree")
        elif "numbers" in content:
            found.numbers.append(str(content["numbers"]))
        else:
            row, column = (int(at) for at in content["tile"])
            shards = _checksums(content["shards"])
            found.tiles[row, column] = TileEntry(int(content["estimated"]), shards)
        found.ended = "files" in content
        before = zlib.crc32(line, before)

    length = read_lines(path, take)
    if found is None:
        raise CorruptInputError(path, "is no journal of a job")
    found.length = length
    found.ended = found.ended and path.stat().st_size == length
    return found


class Journal:
    """A journal that is being written; its file is open until :meth:`close`."""

    def __init__(self, path: Path, entries: Entries) -> None:
        """Go on with a journal, or begin one, and cut off what is torn."""
        self.entries = entries
        first = {"job": entries.job, "learned": entries.learned}
        self._file = JournalFile(path, entries.length, first)

    def add(self, tile: Tile, entry: TileEntry) -> None:
        """A tile all of whose files are on the disk."""
        self._file.append(_tile_content(tile, entry))
        self.entries.tiles[tile] = entry

    def announce(self, crc: str) -> None:
        """The checksum of what is no map, before it is written."""
        self._file.append({"numbers": crc})
        self.entries.numbers.append(crc)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def checksum(path: Path) -> str:
    """The same of a file."""
    found = 0
    with path.open("rb") as file:
        while data := file.read(CHUNK):
            found = zlib.crc32(data, found)
    return f"{found:08x}"


def problem_of(path: Path, crc: str, where: str = "in the journal") -> str | None:
    """What is wrong with a file that had this checksum when it was written; None: nothing.

    Parameters
    ----------
    where
        The checksum stands, for the message.
    """
    if not path.is_file():
        return "is missing" if (kind := kind_of(path)) is None else f"is {kind}, not a file"
    if path.is_symlink():
        return "is a link, not the file that was written"
    if (found := checksum(path)) != crc:
        return f"has changed: its checksum is {found}, {where} {crc}"
    return None


def _checksums(content: Mapping[str, Any]) -> dict[str, str]:
    """Files of a store with their checksums; a journal names no others."""
    for name in content:
        if ".." in name.split("/") or name.startswith("/"):
            raise ValueError(f"a file outside of the store: {name!r}")
    return {str(name): str(crc) for name, crc in content.items()}


def _tile_content(tile: Tile, entry: TileEntry) -> dict[str, Any]:
    return {"tile": list(tile), "estimated": entry.estimated, "shards": dict(entry.shards)}

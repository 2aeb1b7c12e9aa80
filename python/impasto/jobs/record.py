"""``job.json``: everything that the bytes of a job's result depend on."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from impasto._internal.damage import DAMAGE
from impasto._internal.regular import content_of
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.json_lines import CHECK, crc_of
from impasto.io.results.precision import Precision
from impasto.jobs.grid import Grid
from impasto.jobs.record_entries import wrong_entry

UNSEALED, FORMAT = 1, 2
"""Versions of the format: without a checksum, and with one. The journal of a finished store has a
checksum of its record, too, so that one without is still read."""

SIDES = {"shape.0": "photographs", "shape.1": "bands", "shape.2": "rows", "shape.3": "columns"}
"""What differences call the numbers of a shape."""


@dataclass(frozen=True)
class JobRecord:
    """What a job works on, and how.

    Attributes
    ----------
    version
        Of impasto, with the digest of its code (:func:`~impasto._internal.build.build_name`).
    source
        The path for :func:`impasto.read_stack`; None for a stack in memory.
    reading
        Its options.
    encoding
        The tone curve of the photographs and its full scale.
    inputs
        Name, size in bytes and SHA-256 of every file that is read; of a stack in memory, of its
        numbers; of a tile of a store, one checksum of those of its chunks (``crc32c``).
    fit
        Options of the fit, defaults included.
    shape
        Observations, bands, rows and columns.
    tile
        Rows and columns of a tile.
    sample
        The model is learned from every so many rows and columns.
    precision
        Of the maps in the store: ``"single"`` or ``"half"``.
    notes
        Kind and text of what was repaired, left out or assumed while the photographs were read.
    """

    version: str
    source: str | None
    reading: Mapping[str, Any]
    encoding: tuple[str, float]
    inputs: Sequence[Mapping[str, Any]]
    fit: Mapping[str, Any]
    shape: tuple[int, int, int, int]
    tile: int
    sample: int
    precision: Precision
    notes: Sequence[Sequence[str]]
    format: int = field(default=FORMAT)

    @property
    def grid(self) -> Grid:
        """The tiles."""
        return Grid(*self.shape[2:], self.tile)

    @property
    def curve(self) -> Encoding:
        """The tone curve."""
        return Encoding(*self.encoding)

    def to_bytes(self) -> bytes:
        """The file; the same for the same job, whenever and wherever it runs.

        It has a checksum of its own: the journal, which has another one, only begins when the model
        is learned.
        """
        return _sealed(asdict(self))

    @classmethod
    def read(cls, path: Path) -> Self:
        """The record in a file.

        Raises
        ------
        CorruptInputError
            A file that is damaged or something else.
        """
        try:
            data = content_of(path)
            content = json.loads(data)
            if type(content) is not dict or type(version := content.get("format")) is not int:
                raise ValueError("it has no format")
        except CorruptInputError:
            raise
        except (*DAMAGE, OSError) as error:
            raise CorruptInputError(path, f"is no record of a job ({error})") from error
        if version not in (UNSEALED, FORMAT):
            raise CorruptInputError(
                path,
                f"has the format {version}, this version of impasto reads {FORMAT}: use the "
                "version that made it, or fit the painting anew",
            )
        if not _is_as_written(content, data):
            raise CorruptInputError(
                path, "is not as it was written; bring back the file, or fit the painting anew"
            )
        content.pop(CHECK, None)
        if (name := wrong_entry(content)) is not None:
            found = _shown(content[name]) if name in content else "no such entry"
            raise CorruptInputError(
                path, f"is no record of a job ({name}: found {found}, which no job writes)"
            )
        content["shape"] = tuple(content["shape"])
        content["encoding"] = tuple(content["encoding"])
        return cls(**content)

    def _by_file(self) -> dict[str, Any]:
        """The record with its inputs by their names, not by their numbers."""
        content: dict[str, Any] = json.loads(self.to_bytes())
        for name in (CHECK, "format"):  # of the file, not of the job
            content.pop(name, None)
        content["inputs"] = {one.pop("file"): one for one in content["inputs"]}
        return content

    def differences(self, other: JobRecord) -> list[str]:
        """What another record has else, one line each; notes where nothing else differs."""
        one, two = (record._by_file() for record in (self, other))
        files = list(_file_differences(one.pop("inputs"), two.pop("inputs")))
        notes = {"notes": one.pop("notes")}, {"notes": two.pop("notes")}
        return [*_differences(one, two), *files] or list(_differences(*notes))


def _sealed(content: Mapping[str, Any]) -> bytes:
    """The file of these entries, with the checksum of their text among them."""
    text = _text(content)
    return text if content["format"] == UNSEALED else _text({**content, CHECK: crc_of(text)})


def _text(content: Mapping[str, Any]) -> bytes:
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False)
    return (text + "\n").encode()


def _is_as_written(content: dict[str, Any], data: bytes) -> bool:
    entries = {name: value for name, value in content.items() if name != CHECK}
    try:
        return _sealed(entries) == data
    except DAMAGE:  # NaN, which the parser takes and no record has
        return False


def plain(value: Any, name: str) -> Any:
    """An option as it stands in the file: paths as text, absolute; numbers as of Python.

    Raises
    ------
    ArgumentError
        An array or another object, which cannot be compared with that of a later call.
    """
    if isinstance(value, os.PathLike):
        # Not resolved: what links lead to may lie without its neighbours.
        return str(Path(value).absolute())
    if isinstance(value, Mapping):
        return {str(key): plain(one, name) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one, name) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ArgumentError(
        f"{name}: a job keeps its options in a file, which holds no {type(value).__name__}; give "
        "a number, a text or the name of a file"
    )


def _differences(one: Any, two: Any) -> Iterator[str]:
    """Options by their names, with both values."""
    first, second = dict(_flat(one)), dict(_flat(two))
    for name in sorted(first.keys() | second.keys()):
        if first.get(name) != second.get(name):
            values = _shown(first.get(name)), _shown(second.get(name))
            called = SIDES.get(name, name.removeprefix("fit.").removeprefix("reading."))
            yield f"{called}: the job has {values[0]}, this call {values[1]}"


def _file_differences(one: Mapping[str, Any], two: Mapping[str, Any]) -> Iterator[str]:
    """Inputs by their names: of a hash nobody can tell what to do."""
    for name in sorted(one.keys() | two.keys()):
        if name not in two:
            yield f"the job has read {name}, this call does not"
        elif name not in one:
            yield f"the job has not read {name}"
        elif one[name] != two[name]:
            yield f"{name} has changed since the job read it"


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and text in nested lists and dictionaries, with its place."""
    if not isinstance(value, dict | list):
        yield name, value
        return
    for key, one in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _flat(one, f"{name}.{key}" if name else str(key))


def _shown(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."

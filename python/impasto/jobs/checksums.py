"""The checksums of a store that has no journal: that of merged frames, which is made in one go."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from impasto._internal.damage import DAMAGE
from impasto._internal.regular import content_of
from impasto.errors import CorruptInputError

CHECKSUMS = "checksums.json"
"""In the store: the CRC-32 of every other file, by its name."""


def checksums_file(crcs: Mapping[str, str]) -> bytes:
    """What is in the file: the same checksums make the same bytes."""
    return (json.dumps({"crc32": dict(crcs)}, indent=0, sort_keys=True) + "\n").encode()


def read_checksums(path: Path) -> dict[str, str]:
    """The checksums by the names of the files.

    Raises
    ------
    CorruptInputError
        The file is not as it was written.
    """
    data = content_of(path)
    try:
        crcs = json.loads(data)["crc32"]
        right = checksums_file(crcs) == data
        inside = all(not name.startswith("/") and ".." not in name.split("/") for name in crcs)
    except DAMAGE as error:
        raise CorruptInputError(path, "is no list of checksums") from error
    if not right or not inside:
        raise CorruptInputError(path, "is not as it was written")
    return {str(name): str(crc) for name, crc in crcs.items()}

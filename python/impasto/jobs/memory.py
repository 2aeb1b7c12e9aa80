"""The memory of a job, kept beside it until it is finished: whoever goes on need not know it."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from impasto._internal.damage import DAMAGE
from impasto._internal.regular import content_of
from impasto.io.files import atomic_bytes

MEMORY = "memory.json"
"""No part of the record: a job may go on with another memory."""


def keep_memory(notes: Path, memory: int) -> None:
    """Keep the bytes that a job may take now."""
    if kept_memory(notes) != memory:
        atomic_bytes(notes / MEMORY, json.dumps({"bytes": memory}).encode())


def kept_memory(notes: Path) -> int | None:
    """The bytes that a job could take last; None where nobody has said so, or not legibly."""
    with suppress(OSError, *DAMAGE):
        kept = int(json.loads(content_of(notes / MEMORY))["bytes"])
        return kept if kept > 0 else None
    return None

"""Lines of a journal: JSON that ends in a checksum of its own, so that a change is found."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

CHECK = "crc"
"""Name of the checksum of a line, CRC-32 of what stands before it, closed by a brace."""


def crc_of(data: bytes | memoryview) -> str:
    """CRC-32 in eight hexadecimal digits."""
    return f"{zlib.crc32(data):08x}"


def sealed_line(content: Mapping[str, Any]) -> bytes:
    """One line with its checksum."""
    text = json.dumps(content, sort_keys=True)
    # Last, whatever the order of the names.
    return f'{text[:-1]}, "{CHECK}": "{crc_of(text.encode())}"}}\n'.encode()


def opened_line(line: bytes) -> dict[str, Any]:
    """What a line says, if it is as it was written.

    Raises
    ------
    ValueError, KeyError
        It is not.
    """
    content: dict[str, Any] = json.loads(line)
    del content[CHECK]
    if sealed_line(content) != line:
        raise ValueError("the checksum of the line does not agree")
    return content

"""How many bytes a file may claim to hold, before any of them is made room for."""

from __future__ import annotations

from pathlib import Path

from impasto.errors import CorruptInputError

_RATIO = 1100
"""Deflate expands by at most 1032; a header that claims more is a decompression bomb."""
HARMLESS_BYTES = 1 << 26
"""Claims below 64 MiB are decoded at any ratio: a flat picture compresses well."""


def check_claim(path: Path, claimed_bytes: int, file_bytes: int, claim: str) -> None:
    """Refuse a claim that only a decompression bomb of this length keeps."""
    if claimed_bytes > max(HARMLESS_BYTES, _RATIO * file_bytes):
        raise CorruptInputError(
            path,
            f"claims {claim} ({claimed_bytes / 1e9:.1f} GB) in a file of {file_bytes} bytes: "
            "refused as damaged or hostile",
        )

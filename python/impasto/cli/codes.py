"""Exit codes."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """Exit codes of ``impasto``; ``docs/command-line.md`` lists them."""

    OK = 0
    USER_ERROR = 1
    """The input or the value of an argument cannot be used."""
    USAGE_ERROR = 2
    """The command line itself is wrong."""
    CORRUPT_INPUT = 3
    """A file is truncated or damaged."""
    PARTIAL = 4
    """The result is partial."""
    DEFECT = 70
    """A defect in impasto itself."""
    INTERRUPTED = 130

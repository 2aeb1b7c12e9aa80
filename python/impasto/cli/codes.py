"""Exit codes."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """What ``impasto`` returns to the shell; ``docs/command-line.md`` lists them."""

    OK = 0
    USER_ERROR = 1
    """The input or an argument's value cannot be used."""
    USAGE_ERROR = 2
    """The command line itself is wrong."""
    CORRUPT_INPUT = 3
    """A file is truncated or damaged."""
    PARTIAL = 4
    """The result is there, but not all of it."""
    DEFECT = 70
    """Impasto itself is wrong."""
    INTERRUPTED = 130

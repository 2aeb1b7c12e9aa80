"""Ctrl-C while the command line is being imported: one line, no traceback.

Imported before everything else of the package. The program ``impasto`` takes a second to load, and
:func:`impasto.cli.main` can catch nothing before it is there. In other programs this does nothing.
"""

from __future__ import annotations

import os
import sys
from types import TracebackType


def is_command_line() -> bool:
    """Whether this process is ``impasto`` or ``python -m impasto``."""
    name = os.path.basename(sys.argv[0]) if sys.argv else ""  # noqa: PTH119
    given = sys.orig_argv
    module = any(given[at : at + 2] == ["-m", "impasto"] for at in range(len(given)))
    return name.removesuffix(".exe") == "impasto" or module


def show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What ``sys.excepthook`` does; an import that Ctrl-C ends may be told as an ImportError."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    if cause is None:
        sys.__excepthook__(kind, error, trace)
    else:
        os.write(2, b"impasto: interrupted\n")


if is_command_line():
    sys.excepthook = show

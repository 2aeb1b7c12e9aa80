"""The command line: ``impasto demo | fit | job | render | animate | height ...``.

Data goes to stdout or into files, progress to stderr. Angles are in degrees. Exit codes:

====  ==========================================================
0     done
1     the input or an argument's value cannot be used
2     the command line itself is wrong
3     a file is truncated or damaged
4     the result is partial
70    a defect in impasto itself
130   interrupted
====  ==========================================================
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    arguments
        The arguments after the program name; default: those of the process.
    """
    try:
        # Importing takes half a second, in which Ctrl-C is possible.
        from impasto.cli import application
    except KeyboardInterrupt:
        import os

        os.write(2, b"impasto: interrupted\n")
        return 130
    return application.run(arguments)

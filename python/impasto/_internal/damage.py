"""What a reader trips over in a file of unknown origin is damage of that file."""

from __future__ import annotations

import csv
import errno
import lzma
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from impasto.errors import CorruptInputError, ImpastoError

DAMAGE = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, SyntaxError, TypeError, ValueError),
    RuntimeError,  # brackets nested too deep; zip archives that claim to be encrypted
    SystemError,  # characters that do not exist in texts of numpy
    *(csv.Error, struct.error, tokenize.TokenError),
    *(lzma.LZMAError, zipfile.BadZipFile, zlib.error),
)
"""What parsers of text, JSON, CSV, zip archives and headers raise at contents they do not expect.

Errors of the system and memory that runs out are not among them.
"""


@contextmanager
def damage_of(path: Path, what: str) -> Iterator[None]:
    """Errors of a parser become a :class:`~impasto.CorruptInputError` that names the file.

    Errors of impasto, which know better what is wrong, stay as they are, and so do those of the
    system, but for positions before the beginning of a file.

    Parameters
    ----------
    path
        The file whose contents the block parses.
    what
        What it should be: ``"a light file"``.
    """
    try:
        yield
    except ImpastoError:
        raise
    except (*DAMAGE, OSError) as error:
        if isinstance(error, OSError) and error.errno not in {None, errno.EINVAL}:
            raise
        problem = str(error) or type(error).__name__
        if type(error) is KeyError:
            problem = f"it has no {error.args[0]!r}" if error.args else "a key is missing"
        raise CorruptInputError(path, f"cannot be read as {what} ({problem})") from error

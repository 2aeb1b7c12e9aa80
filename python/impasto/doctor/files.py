"""Every damaged photograph of a folder at once: reading stops at the first."""

from __future__ import annotations

from pathlib import Path

from impasto.errors import CorruptInputError
from impasto.io.images import list_images, read_header


def damaged_files(folder: str | Path) -> tuple[CorruptInputError, ...]:
    """Check the structure of every picture in a folder to its end, without decoding.

    Parameters
    ----------
    folder
        Where the photographs are.

    Returns
    -------
    tuple
        One error, with ``.path`` and ``.problem``, for each damaged file, in the order of names.
    """
    found = []
    for path in list_images(Path(folder)):
        try:
            read_header(path)
        except CorruptInputError as error:
            found.append(error)
    return tuple(found)

"""All damaged photographs of a folder; reading stops at the first."""

from __future__ import annotations

from pathlib import Path

from impasto.errors import CorruptInputError
from impasto.io.images import list_images, read_header


def damaged_files(folder: str | Path) -> tuple[CorruptInputError, ...]:
    """Check the structure of every picture in a folder, to its end, without decoding it.

    Parameters
    ----------
    folder
        Folder of the photographs.

    Returns
    -------
    tuple
        One error for each damaged file, with ``.path`` and ``.problem``, in order of name.
    """
    found = []
    for path in list_images(Path(folder)):
        try:
            read_header(path)
        except CorruptInputError as error:
            found.append(error)
    return tuple(found)

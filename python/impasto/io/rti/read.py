"""Any RTI file, by its name."""

from __future__ import annotations

from pathlib import Path

from impasto.errors import ArgumentError
from impasto.io.rti.image import RelightableImage
from impasto.io.rti.ptm import read_ptm
from impasto.io.rti.relight_folder import INFO, read_relight
from impasto.io.rti.universal import read_rti


def is_relightable(path: Path) -> bool:
    """Whether a path is named as an RTI file, or is a folder of relight."""
    if path.suffix.lower() in {".ptm", ".rti"} or path.name == INFO:
        return True
    return path.is_dir() and (path / INFO).is_file()


def read_relightable(path: str | Path) -> RelightableImage:
    """Read a relightable image that another program made.

    Parameters
    ----------
    path
        A ``.ptm``, an ``.rti``, or a folder of relight (or its ``info.json``).

    Raises
    ------
    CorruptInputError
        Truncated, damaged or of another type than its name says.
    ArgumentError
        Not found, a kind that is not read, or larger than pictures may be.

    Examples
    --------
    Normals out of an old file:

    >>> image = impasto.io.read_relightable("icon.rti")          # doctest: +SKIP
    >>> normals = impasto.fit_normals(image.stack(), method="robust")   # doctest: +SKIP
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".ptm":
        return read_ptm(path)
    if suffix == ".rti":
        return read_rti(path)
    if not is_relightable(path):
        raise ArgumentError(
            f"path: expected a .ptm, an .rti or a folder with {INFO} of relight, found {path}"
        )
    return read_relight(path)

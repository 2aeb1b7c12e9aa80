"""The photographs of a folder that are aligned, and their lights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import photographs_in
from impasto.io.lights import LightFile, read_lights
from impasto.io.notes import Notebook
from impasto.io.session.observations import find_lights

LINEAR = Encoding("linear", 1.0)
"""Codes of photographs that were read for alignment."""


def photographs_of(folder: Path) -> list[Path]:
    """The photographs of a folder.

    Raises
    ------
    ArgumentError
        No folder, none in it, or two whose names differ in their endings only.
    """
    paths = photographs_in(folder)
    seen: dict[str, Path] = {}
    for path in paths:
        other = seen.setdefault(path.stem.casefold(), path)
        if other is not path:
            raise ArgumentError(
                f"path: {folder} holds {other.name} and {path.name}; their aligned pictures would "
                "have one name"
            )
    return paths


def lights_of(folder: Path, given: Path | None, names: list[str]) -> LightFile | None:
    """The lights of photographs, one each, in their order; None where the folder has none.

    Raises
    ------
    ArgumentError
        A light file that does not name every photograph, by name.
    """
    if given is not None:
        file = read_lights(given)
    else:
        try:
            file = find_lights(folder, Notebook(False))
        except ArgumentError as error:
            if "has no light file" in str(error):
                return None
            raise
    if file.names is None:
        if len(file) != len(names):
            raise ArgumentError(
                f"lights: {file.path} has {len(file)} lights without names for {len(names)} "
                "photographs"
            )
        order = list(range(len(names)))
    else:
        stems = {
            Path(name.replace("\\", "/")).stem.casefold(): index
            for index, name in enumerate(file.names)
        }
        missing = [name for name in names if Path(name).stem.casefold() not in stems]
        if missing:
            raise ArgumentError(
                f"lights: {file.path} has no light of {', '.join(missing[:5])}; move photographs "
                "without a light out of the folder"
            )
        order = [stems[Path(name).stem.casefold()] for name in names]

    def taken(values: NDArray[Any] | None) -> NDArray[Any] | None:
        return None if values is None else values[order]

    return LightFile(
        file.path, file.format, tuple(names), file.directions[order], file.lengths[order],
        taken(file.positions), taken(file.intensities), taken(file.views),
    )  # fmt: skip

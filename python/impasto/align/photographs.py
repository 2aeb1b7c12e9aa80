"""The photographs of a folder, read for alignment: linear light, one at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import list_images, load_image
from impasto.io.images.profile import OTHER
from impasto.io.lights import LightFile, read_lights
from impasto.io.notes import Notebook
from impasto.io.session.observations import find_lights

LINEAR = Encoding("linear", 1.0)
"""Codes of photographs that were read for alignment."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph.

    Attributes
    ----------
    planes
        ``(band, y, x)``: linear codes, uint16 (of full scale 65535) or float32.
    full
        The code from which samples are clipped; None for floats.
    """

    planes: NDArray[Any]
    full: float | None


def photographs_of(folder: Path) -> list[Path]:
    """The photographs of a folder.

    Raises
    ------
    ArgumentError
        No folder, none in it, or two whose names differ in their endings only.
    """
    if not folder.is_dir():
        raise ArgumentError(f"path: {folder} is not a folder")
    paths = list_images(folder)
    if not paths:
        raise ArgumentError(f"path: {folder} holds no photographs")
    seen: dict[str, Path] = {}
    for path in paths:
        other = seen.setdefault(path.stem.casefold(), path)
        if other is not path:
            raise ArgumentError(
                f"path: {folder} holds {other.name} and {path.name}; their aligned pictures would "
                "have one name"
            )
    return paths


def read_photograph(
    path: Path, encoding: str | None = None, saturation: float | None = None
) -> Photograph:
    """Read one photograph as linear codes.

    Without ``encoding``, 8 bits have the curve of their profile, else sRGB; all others are linear.
    8-bit codes become 16 bits by a table, so that neighbours are mixed in linear light. Codes from
    ``saturation`` on (default: the largest) are clipped.
    """
    header, codes = load_image(path)
    if codes.dtype.kind == "f":
        if encoding not in {None, "linear"}:
            raise ArgumentError(f"encoding: {path.name} holds floats, which are linear light")
        return Photograph(codes.astype(np.float32), saturation)
    top = int(np.iinfo(codes.dtype).max)
    curve = encoding
    if curve is None:
        stated = header.curve if header.curve not in {"", OTHER} else "srgb"
        curve = stated if codes.dtype == np.uint8 else "linear"
    clipped = float(top) if saturation is None else float(saturation)
    if codes.dtype == np.uint16 and Encoding(curve, float(top)).curve == "linear":
        return Photograph(codes, clipped)
    linear = Encoding(curve, float(top)).decode(np.arange(top + 1))
    table = np.rint(65535.0 * np.clip(linear, 0.0, 1.0)).astype(np.uint16)
    at = int(np.clip(clipped, 0, top))
    return Photograph(table[codes], float(table[at]))


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

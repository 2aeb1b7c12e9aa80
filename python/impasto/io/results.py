"""Results of a fit in one ``.npz`` file: plain arrays, no pickles."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.files import atomic_path
from impasto.rig import DistantLight, Light, PointLight, Rig


class SavedMaps:
    """The arrays of an open file, by name."""

    def __init__(self, path: Path, kind: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.path = path
        self.kind = kind
        self.arrays = arrays

    def take(self, name: str) -> Any:
        """One array; the file is refused if it is not there."""
        if name not in self.arrays:
            raise CorruptInputError(self.path, f"has no array {name!r}")
        return self.arrays[name]

    def array(self, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> Any:
        """One array of a kind of number and a size (None: any); the file is refused otherwise."""
        found = np.asarray(self.take(name))
        fits = len(found.shape) == len(shape) and all(
            wanted in (None, length) for wanted, length in zip(shape, found.shape, strict=True)
        )
        if not fits:
            raise CorruptInputError(self.path, f"array {name!r} has the wrong shape {found.shape}")
        wanted_type = np.dtype(dtype)
        self.demand(
            name, found.dtype.kind == wanted_type.kind, f"holds {found.dtype}, not {dtype.__name__}"
        )
        if wanted_type.kind == "U":
            return found
        array = np.ascontiguousarray(found, dtype=wanted_type).reshape(found.shape)
        if wanted_type.kind == "u":
            self.demand(name, np.array_equal(array, found), f"holds more than {dtype.__name__} can")
        return array

    def demand(self, name: str, holds: bool, problem: str) -> None:
        """Refuse the file because of what one array holds."""
        if not holds:
            raise CorruptInputError(self.path, f"array {name!r} {problem}")


def write_maps(path: str | os.PathLike[str], kind: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a result so that it appears whole or not at all."""
    target = Path(path)
    if target.suffix.lower() != ".npz":
        raise ArgumentError(
            f"path: results are saved as .npz, found {target.name!r}; name it {target.stem}.npz"
        )
    with atomic_path(target) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, kind=np.array(kind), **dict(arrays))


@contextmanager
def read_maps(path: str | os.PathLike[str], *kinds: str) -> Iterator[SavedMaps]:
    """The arrays of a result; whatever fails while they are looked at is the file's fault."""
    target = Path(path)
    try:
        # An open file of our own: numpy leaves its handle open when the archive is damaged.
        with target.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except FileNotFoundError:
        raise
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, AttributeError) as error:
        raise CorruptInputError(target, f"cannot be read as .npz ({error})") from error
    found = str(arrays.get("kind", "something else"))
    if found not in kinds:
        raise CorruptInputError(target, f"holds {found}, not {' or '.join(kinds)}")
    try:
        yield SavedMaps(target, found, arrays)
    except CorruptInputError:
        raise
    except (TypeError, ValueError, IndexError, ImpastoError) as error:
        raise CorruptInputError(target, f"is damaged ({error})") from error


def rig_arrays(rig: Rig) -> dict[str, NDArray[Any]]:
    """A rig as arrays: ``rig.lights`` (positions in mm where ``rig.near``), and so on."""
    near = [isinstance(light, PointLight) for light in rig.lights]
    vectors = [x.position if isinstance(x, PointLight) else x.direction for x in rig.lights]
    falloff = [isinstance(light, PointLight) and light.falloff for light in rig.lights]
    return {
        "rig.lights": np.array(vectors, dtype=np.float64),
        "rig.near": np.array(near),
        "rig.falloff": np.array(falloff),
        "rig.intensities": rig.intensities,
        "rig.views": rig.views,
        "rig.pitch_mm": np.array(np.nan if rig.pitch_mm is None else rig.pitch_mm),
    }


def rig_from_arrays(maps: SavedMaps) -> Rig:
    """The rig that :func:`rig_arrays` took apart."""
    near, falloff = maps.take("rig.near"), maps.take("rig.falloff")
    strength = maps.take("rig.intensities").tolist()
    lights: list[Light] = [
        PointLight((x, y, z), strength[i], bool(falloff[i]))
        if near[i]
        else DistantLight((x, y, z), strength[i])
        for i, (x, y, z) in enumerate(maps.take("rig.lights").tolist())
    ]
    pitch = float(maps.take("rig.pitch_mm"))
    return Rig(lights, views=maps.take("rig.views"), pitch_mm=None if np.isnan(pitch) else pitch)

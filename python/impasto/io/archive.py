"""A whole stack in one ``.npz`` file."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.files import atomic_path
from impasto.rig import DistantLight, Light, PointLight, Rig
from impasto.stack import Stack


def write_stack(path: str | Path, stack: Stack) -> None:
    """Write a stack so that :func:`~impasto.read_stack` gives the same one back.

    Plain arrays, no pickles: ``samples``, ``lights`` ``(obs, 3)`` (positions in mm where ``near``),
    ``intensities``, ``near``, ``falloff``, ``views``, ``bands``, ``names``, ``scale``, ``black``,
    ``curve``, ``white`` and, where known, ``pitch_mm``, ``mask``, ``saturation``.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise ArgumentError(f"path: expected a name ending in .npz, found {path}")
    lights = stack.rig.lights
    arrays: dict[str, Any] = {
        "samples": stack.samples,
        "lights": np.array(
            [x.position if isinstance(x, PointLight) else x.direction for x in lights]
        ),
        "near": np.array([isinstance(x, PointLight) for x in lights]),
        "falloff": np.array([isinstance(x, PointLight) and x.falloff for x in lights]),
        "intensities": stack.rig.intensities,
        "views": stack.rig.views,
        "bands": np.array(stack.bands),
        "names": np.array(stack.names),
        "scale": stack.scale,
        "black": stack.black,
        "curve": np.array(stack.encoding.curve),
        "white": np.array(stack.encoding.white),
    }
    if stack.rig.pitch_mm is not None:
        arrays["pitch_mm"] = np.array(stack.rig.pitch_mm)
    if stack.mask is not None:
        arrays["mask"] = stack.mask
    if stack.saturation is not None:
        arrays["saturation"] = stack.saturation
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read_archive(path: Path) -> Stack:
    """The stack of an ``.npz`` with at least ``samples`` and ``lights``."""
    try:
        # An open file of our own: numpy leaves its handle open when the archive is damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise CorruptInputError(path, f"cannot be read as .npz ({error})") from error
    lost = [key for key in ("samples", "lights") if key not in arrays]
    if lost:
        raise CorruptInputError(
            path, f"has no array {lost[0]!r}, only {sorted(arrays)}: see impasto.io.write_stack"
        )
    try:
        return _stack(arrays, path)
    except (ImpastoError, TypeError, ValueError) as error:
        raise CorruptInputError(path, f"holds arrays that make no stack: {error}") from error


def _stack(arrays: dict[str, NDArray[Any]], path: Path) -> Stack:
    levels = arrays.get("saturation")
    encoding: Encoding | str = "linear"
    if "curve" in arrays:
        encoding = Encoding(str(arrays["curve"]), float(arrays.get("white", np.array(1.0))))
    optional: dict[str, Any] = {
        key: arrays[key] for key in ("mask", "scale", "black") if key in arrays
    }
    samples = arrays["samples"]
    return Stack(
        samples,
        lights=_rig(arrays),
        bands=[str(band) for band in arrays["bands"]] if "bands" in arrays else None,
        names=[str(name) for name in arrays["names"]] if "names" in arrays else None,
        saturation=levels,
        encoding=encoding,
        sources=[path],
        **optional,
    )


def _rig(arrays: dict[str, NDArray[Any]]) -> Rig:
    vectors = np.asarray(arrays["lights"], dtype=np.float64)
    count = len(vectors)
    near = arrays.get("near", np.zeros(count, bool))
    falloff = arrays.get("falloff", np.ones(count, bool))
    strength = arrays.get("intensities", np.ones(count)).tolist()
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ArgumentError(f"lights: expected (obs, 3), found shape {vectors.shape}")
    for name, array in (("near", near), ("falloff", falloff), ("intensities", strength)):
        if np.shape(array) != (count,):
            raise ArgumentError(f"{name}: expected shape ({count},), found {np.shape(array)}")
    lights: list[Light] = [
        PointLight((x, y, z), strength[i], bool(falloff[i]))
        if near[i]
        else DistantLight((x, y, z), strength[i])
        for i, (x, y, z) in enumerate(vectors.tolist())
    ]
    pitch = float(arrays["pitch_mm"]) if "pitch_mm" in arrays else None
    return Rig(lights, views=arrays.get("views"), pitch_mm=pitch)

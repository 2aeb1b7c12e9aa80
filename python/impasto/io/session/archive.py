"""A whole stack in one ``.npz`` file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.npz import read_npz, write_npz
from impasto.io.rig_arrays import arrays_of_rig, rig_of_arrays
from impasto.stack import Stack, checked_stack


def write_stack(path: str | Path, stack: Stack) -> None:
    """Write a stack for :func:`~impasto.read_stack`, without loss.

    Plain arrays, no pickles: ``samples``, ``lights`` ``(obs, 3)`` (positions in mm where ``near``),
    ``intensities``, ``near``, ``falloff``, ``views``, ``bands``, ``names``, ``scale``, ``black``,
    ``curve``, ``white`` and, where known, ``radii`` of lamps, ``pitch_mm``, ``mask`` and
    ``saturation``.

    Raises
    ------
    ArgumentError
        No stack, or a path that is none or does not end in ``.npz``.
    """
    if not isinstance(path, str | os.PathLike):
        raise ArgumentError(f"path: expected the name of a file, found {type(path).__name__}")
    checked_stack(stack)
    arrays: dict[str, Any] = {
        "samples": stack.samples,
        **arrays_of_rig(stack.rig),
        "bands": np.array(stack.bands),
        "names": np.array(stack.names),
        "scale": stack.scale,
        "black": stack.black,
        "curve": np.array(stack.encoding.curve),
        "white": np.array(stack.encoding.white),
    }
    if stack.mask is not None:
        arrays["mask"] = stack.mask
    if stack.saturation is not None:
        arrays["saturation"] = stack.saturation
    write_npz(Path(path), arrays)


def read_archive(path: Path, given: Mapping[str, Any]) -> Stack:
    """The stack of an ``.npz`` with at least ``samples`` and ``lights``.

    ``given`` are options for photographs, None where nobody said any: a finished stack takes none.
    """
    for name, value in given.items():
        if value is not None:
            raise ArgumentError(
                f"{name}: {path} holds a finished stack, to which this option does not apply; use "
                "it when the photographs are read"
            )
    arrays = read_npz(path)
    lost = [key for key in ("samples", "lights") if key not in arrays]
    if lost:
        raise CorruptInputError(
            path, f"has no array {lost[0]!r}, only {sorted(arrays)}: see impasto.io.write_stack"
        )
    try:
        return _stack(arrays, path)
    except (ImpastoError, TypeError, ValueError) as error:
        raise CorruptInputError(path, f"holds arrays that are not a stack: {error}") from error


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
        lights=rig_of_arrays(arrays),
        bands=[str(band) for band in arrays["bands"]] if "bands" in arrays else None,
        names=[str(name) for name in arrays["names"]] if "names" in arrays else None,
        saturation=levels,
        encoding=encoding,
        sources=[path],
        **optional,
    )

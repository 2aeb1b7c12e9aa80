"""A whole stack in one ``.npz`` file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.damage import DAMAGE, damage_of
from impasto._internal.regular import RegularFile
from impasto._internal.windows import offset
from impasto.encoding import Encoding
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.arrays import ArraySource, member, observation
from impasto.io.npz import read_npz, write_npz
from impasto.io.results.maps import no_photographs
from impasto.io.rig_arrays import arrays_of_rig, rig_of_arrays
from impasto.io.session.frames import check_region
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
    write_npz(Path(path), {"samples": stack.samples, **arrays_beside_samples(stack)})


def arrays_beside_samples(stack: Stack) -> dict[str, NDArray[Any]]:
    """All that a stack is besides its samples, by name."""
    arrays: dict[str, Any] = {
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
    return {name: np.asarray(array) for name, array in arrays.items()}


def read_archive(
    path: Path, given: Mapping[str, Any], region: Sequence[int] | None = None
) -> Stack:
    """The stack of an ``.npz`` with at least ``samples`` and ``lights``, or a region of it.

    Of a region only its samples are read, unless they are compressed. ``given`` are options for
    photographs, None where nobody said any: a finished stack takes none.
    """
    refuse_options(path, given)
    part = None
    arrays = read_npz(path, without="" if region is None else "samples")
    if region is not None and "lights" in arrays:
        with damage_of(path, "a stack"):
            part = _read_part(path, region, arrays)
    return stack_of_arrays(arrays, path, part, [path])


def refuse_options(path: Path, given: Mapping[str, Any]) -> None:
    """A finished stack takes no options for photographs."""
    for name, value in given.items():
        if value is not None:
            raise ArgumentError(
                f"{name}: {path} holds a finished stack, to which this option does not apply; use "
                "it when the photographs are read"
            )


def stack_of_arrays(
    arrays: Mapping[str, NDArray[Any]],
    path: Path,
    part: tuple[float, float] | None,
    sources: Sequence[Path],
) -> Stack:
    """The stack of a file's arrays; ``part``: how far right and up the centre of a region lies."""
    lost = [key for key in ("samples", "lights") if key not in arrays]
    if lost and "kind" in arrays:
        raise CorruptInputError(path, no_photographs(str(arrays["kind"])))
    if lost:
        raise CorruptInputError(
            path, f"has no array {lost[0]!r}, only {sorted(arrays)}: see impasto.io.write_stack"
        )
    try:
        return _stack(arrays, part, sources)
    except (ImpastoError, *DAMAGE) as error:
        raise CorruptInputError(path, f"holds arrays that are not a stack: {error}") from error


def _read_part(
    path: Path, region: Sequence[int], arrays: dict[str, NDArray[Any]]
) -> tuple[float, float]:
    """Add the samples of a region, crop the mask; by how many pixels right and up its centre is."""
    with closing(RegularFile(path)) as file:
        try:
            stored = member(file, "samples")
            shape = stored.shape
        except CorruptInputError:
            raise
        except ArgumentError:  # compressed
            whole = read_npz(path).get("samples")
            if whole is None:
                return 0.0, 0.0  # the caller says so
            shape = whole.shape
            rows, columns = _area(path, region, shape)
            samples = whole[..., rows, columns].copy()
        else:
            rows, columns = _area(path, region, shape)
            every = (ArraySource(file, observation(path, stored, i)) for i in range(shape[0]))
            samples = np.stack([source.read(rows, columns) for source in every])
    arrays["samples"] = samples
    if "mask" in arrays:
        if arrays["mask"].shape != shape[2:]:
            raise CorruptInputError(
                path, f"has a mask {arrays['mask'].shape} for photographs {shape[2:]}"
            )
        arrays["mask"] = arrays["mask"][rows, columns]
    return offset((rows, columns), (shape[2], shape[3]))


def _area(path: Path, region: Sequence[int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    if len(shape) != 4 or 0 in shape:
        raise CorruptInputError(path, f"holds samples {shape}, not (obs, band, y, x)")
    area = check_region(region, (shape[2], shape[3]))
    assert area is not None
    top, left, height, width = area
    return slice(top, top + height), slice(left, left + width)


def _stack(
    arrays: Mapping[str, NDArray[Any]], part: tuple[float, float] | None, sources: Sequence[Path]
) -> Stack:
    levels = arrays.get("saturation")
    encoding: Encoding | str = "linear"
    if "curve" in arrays:
        encoding = Encoding(str(arrays["curve"]), float(arrays.get("white", np.array(1.0))))
    optional: dict[str, Any] = {
        key: arrays[key] for key in ("mask", "scale", "black") if key in arrays
    }
    rig = rig_of_arrays(arrays)
    return Stack(
        arrays["samples"],
        lights=rig if part is None else rig.part(*part),
        bands=[str(band) for band in arrays["bands"]] if "bands" in arrays else None,
        names=[str(name) for name in arrays["names"]] if "names" in arrays else None,
        saturation=levels,
        encoding=encoding,
        sources=sources,
        **optional,
    )

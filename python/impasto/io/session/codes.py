"""All photographs of a session as one array of codes, from one camera at one setting."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.recycling import empty
from impasto._internal.waiting import wait_for
from impasto.errors import ArgumentError
from impasto.io.images import ImageHeader, open_picture
from impasto.io.notes import Notebook
from impasto.io.session.frames import Region, check_region, read_region, read_region_into
from impasto.io.session.geometry import Geometry
from impasto.io.session.observations import Observations


def read_codes(
    observations: Observations,
    notebook: Notebook,
    *,
    region: Sequence[int] | None,
    layer: str | None,
    max_pixels: int,
    geometry: Geometry | None = None,
) -> tuple[NDArray[Any], ImageHeader, Region | None]:
    """Decode every file of the observations, or of each what a region needs, into one array.

    With a ``geometry`` they are resampled; the region is one of the result.

    Returns
    -------
    tuple
        Codes ``(obs, band, y, x)``, the first header (all agree in size and type; without a
        tone curve where theirs differ), and the region as four integers.

    Raises
    ------
    CorruptInputError
        A damaged file, named.
    ArgumentError
        Photographs of other sizes or types than the first, or more than this machine can hold.
    """
    headers: list[ImageHeader] = []
    area: Region | None = None
    out: NDArray[Any] | None = None
    widths: list[int] = []
    for index, files in enumerate(observations.files):
        band = 0
        for position, path in enumerate(files):
            opened: Any = open_picture if geometry is None else geometry.open
            with wait_for(opened, path, layer=layer, max_pixels=max_pixels) as picture:
                header = picture.header
                headers.append(header)
                if out is None and position == 0:
                    area = check_region(region, (header.height, header.width))
                _same_camera(header, headers[0])
                bands = picture.shape[0]
                if index == 0:
                    # The first observation determines the number of bands.
                    widths.append(bands)
                    if len(files) == 1:
                        size = (header.height, header.width) if area is None else area[2:]
                        each = np.dtype(picture.dtype), (bands, *size)
                        out = _allocate(*each, len(observations.files), path)
                        wait_for(read_region_into, picture, area, out[0])
                        continue
                    planes = wait_for(read_region, picture, area)
                    out = planes if out is None else np.concatenate([out, planes])
                else:
                    if bands != widths[position]:
                        _refuse(
                            header, headers[position], "number of bands", bands, widths[position]
                        )
                    assert out is not None
                    wait_for(read_region_into, picture, area, out[index, band : band + bands])
            band += bands
        if index == 0 and len(files) > 1:
            assert out is not None
            first = out
            out = _allocate(first.dtype, first.shape, len(observations.files), files[0])
            wait_for(np.copyto, out[0], first)
    assert out is not None
    _compare_orientations(headers, notebook)
    return out, _with_common_curve(headers, notebook), area


def _allocate(dtype: np.dtype[Any], shape: tuple[int, ...], count: int, path: Path) -> NDArray[Any]:
    needed = count * math.prod(shape) * dtype.itemsize
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not available on every system
        memory = needed
    if needed > memory:
        raise ArgumentError(
            f"{path.parent}: {count} photographs need {needed / 1e9:.1f} GB, this machine has "
            f"{memory / 1e9:.1f} GB; read a part with region=(top, left, height, width)"
        )
    return empty((count, *shape), dtype)


def _size(header: ImageHeader) -> str:
    return f"{header.width} x {header.height} pixels"


def _same_camera(header: ImageHeader, first: ImageHeader) -> None:
    if _size(header) != _size(first):
        _refuse(header, first, "size", _size(header), _size(first))
    if header.dtype != first.dtype:
        _refuse(header, first, "sample type", header.dtype, first.dtype)


def _refuse(header: ImageHeader, other: ImageHeader, what: str, found: Any, expected: Any) -> None:
    raise ArgumentError(
        f"photographs differ in {what}: {header.path} has {found}, {other.path} has {expected}; "
        "all photographs of a stack come from one camera at one setting, uncropped"
    )


def _with_common_curve(headers: list[ImageHeader], notebook: Notebook) -> ImageHeader:
    """The first header, without its tone curve if another photograph has a different one."""
    first = headers[0]
    for header in headers:
        if header.curve != first.curve:
            notebook.warn(
                "profile",
                header.path,
                f"its profile has the tone curve {header.curve or 'none'}, that of "
                f"{first.path.name} {first.curve or 'none'}: ignored in all; export all "
                "photographs alike, or give encoding=",
            )
            return replace(first, curve="")
    return first


def _compare_orientations(headers: list[ImageHeader], notebook: Notebook) -> None:
    """EXIF orientation is never applied: rotating one photograph alone would misalign the stack."""
    first = headers[0]
    for header in headers:
        if header.orientation != first.orientation:
            notebook.warn(
                "orientation",
                header.path,
                f"EXIF orientation {header.orientation}, {first.path.name} has "
                f"{first.orientation}: ignored in all, pixels are used as stored",
            )
            return
    if first.orientation != 1:
        notebook.say(
            "orientation",
            first.path,
            f"EXIF orientation {first.orientation} ignored in all photographs: light directions "
            "refer to the pixels as stored",
        )

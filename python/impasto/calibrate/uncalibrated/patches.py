"""Patches spread over a painting, photographed under every lamp: what lamps are estimated from."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.camera import linear_photograph
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.images import photographs_in
from impasto.io.session.frames import FrameSource

Array = NDArray[np.float64]

SIDE = 24
"""Pixels of a side of a patch: wide enough for differences of neighbours at any focus."""
COUNT = 64
"""Patches at most: 37,000 pixels tell lamps as well as all do."""
CLIPPED = 0.995
"""Share of the largest value from which a sample counts as clipped."""
SHOWN = 0.25
"""Least share of the samples of a photograph that show something: of a quarter, half of the patches
may still be a margin or a mask."""


@dataclass(frozen=True, eq=False)
class Patches:
    """The same patches of every photograph.

    Parameters
    ----------
    light
        ``(lamp, patch, y, x)`` linear light, the mean of the bands; NaN where it is not known:
        clipped, or not finite.
    place
        ``(patch, y, x, 2)`` x right and y up of each pixel from the middle of the photograph, in
        half of its width.
    names
        Of the photographs.
    """

    light: Array
    place: Array
    names: tuple[str, ...]


def patches_of(pictures: Iterable[NDArray[np.floating]], names: tuple[str, ...]) -> Patches:
    """Patches of pictures that come one after another, so that one is in memory.

    Parameters
    ----------
    pictures
        ``(band, y, x)`` each: linear light, 0 where there is none.
    names
        One for each.

    Raises
    ------
    ArgumentError
        No photographs, of several sizes, smaller than 48 x 48 pixels, or one that shows nothing.
    """
    if not names:
        raise ArgumentError("photographs: none were given")
    light: list[Array] = []
    corners: list[tuple[int, int]] = []
    shape: tuple[int, ...] = ()
    for name, picture in zip(names, pictures, strict=True):
        if picture.ndim != 3 or not len(picture):
            raise ArgumentError(
                f"photographs: {name} has shape {picture.shape}, expected (band, y, x)"
            )
        if not light:
            shape = picture.shape
            corners = _corners(shape[1], shape[2])
        elif picture.shape != shape:
            raise ArgumentError(
                f"photographs: {name} has {picture.shape[2]} x {picture.shape[1]} pixels and "
                f"{len(picture)} bands, {names[0]} {shape[2]} x {shape[1]} and {shape[0]}: all "
                "must be of one size, from one place"
            )
        full = float(np.max(picture, initial=0.0, where=np.isfinite(picture)))
        cut = np.array([picture[:, y : y + SIDE, x : x + SIDE] for y, x in corners], np.float64)
        known = np.asarray((np.isfinite(cut) & (cut < CLIPPED * full)).all(axis=1))
        grey = np.asarray(np.where(known[:, None], cut, 0.0).mean(axis=1))
        if np.count_nonzero(known & (grey > 0.0)) < SHOWN * grey.size:
            if not np.isfinite(cut).any():
                what = "nothing but NaN"
            else:
                what = f"mostly clipped, at {full:.4g}" if full > 0.0 else "black"
            raise ArgumentError(
                f"photographs: {name} is {what}: it shows no shading; leave it out, or photograph "
                "it again"
            )
        light.append(np.where(known, grey, np.nan))
    rows, columns = shape[1:]
    y, x = np.mgrid[:SIDE, :SIDE]
    place = np.array(
        [
            np.stack([left + x - (columns - 1) / 2, (rows - 1) / 2 - top - y], axis=-1)
            for top, left in corners
        ]
    )
    return Patches(np.array(light), place / (columns / 2), names)


def read_patches(
    folder: str | os.PathLike[str],
    *,
    encoding: Encoding | str | None = None,
    dark: FrameSource | None = None,
) -> Patches:
    """Patches of the photographs in a folder, in the order of their names.

    Parameters
    ----------
    folder
        One photograph for each lamp and no others.
    encoding, dark
        As for :func:`impasto.calibrate.linear_photograph`.

    Raises
    ------
    ArgumentError
        No folder, or none with photographs; and as :func:`patches_of`.
    CorruptInputError
        A file cannot be read.
    """
    home = Path(folder)
    paths = photographs_in(home)
    pictures = (linear_photograph(path, encoding, dark) for path in paths)
    return patches_of(pictures, tuple(path.name for path in paths))


def median_of_known(values: Array, axis: int | tuple[int, ...]) -> Array:
    """The median of what is not NaN along axes, which stay; NaN where nothing is."""
    some = np.isfinite(values).any(axis=axis, keepdims=True)
    median = np.nanmedian(np.where(some, values, 0.0), axis=axis, keepdims=True)
    return np.where(some, median, np.nan)


def _corners(rows: int, columns: int) -> list[tuple[int, int]]:
    """Top and left of patches in a regular grid, never overlapping."""
    if min(rows, columns) < 2 * SIDE:
        raise ArgumentError(
            f"photographs: {columns} x {rows} pixels are too few to find lamps in; at least "
            f"{2 * SIDE} x {2 * SIDE} are needed"
        )
    down = min(rows // SIDE, max(2, round(np.sqrt(COUNT * rows / columns))))
    across = min(columns // SIDE, max(2, COUNT // down))
    tops = np.linspace(0, rows - SIDE, down).astype(int)
    lefts = np.linspace(0, columns - SIDE, across).astype(int)
    return [(int(top), int(left)) for top in tops for left in lefts]

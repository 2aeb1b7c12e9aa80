"""What viewers know of a store: ``multiscales`` of OME-NGFF 0.5, for napari and its like."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from impasto.io.results.zarr_arrays import ZarrArray
from impasto.io.results.zarr_store import Levels

VERSION = "0.5"
SHOWN = ("diffuse", "normal")
"""The maps that are images at every scale; viewers open the first."""
AXES = ("c", "y", "x")


def with_dims(array: ZarrArray) -> ZarrArray:
    """The array with the names of its dimensions, which an image of OME-NGFF must have."""
    named = array.name.rsplit("/", 1)[-1] in SHOWN and len(array.shape) == len(AXES)
    return replace(array, dims=AXES) if named else array


def multiscales_of(
    maps: list[ZarrArray], levels: Levels, pitch_mm: float | None
) -> dict[str, Any] | None:
    """The attribute ``ome`` of a store; None where there is one scale only.

    The first pixel of the painting is the origin, and lengths are mm if the width of a pixel is
    known. A pixel of a smaller map lies in the middle of those that it stands for.
    """
    if not levels:
        return None
    names = {one.name for one in maps}
    unit = {} if pitch_mm is None else {"unit": "millimeter"}
    axes = [{"name": "c", "type": "channel"}]
    axes += [{"name": name, "type": "space", **unit} for name in AXES[1:]]
    pitch = 1.0 if pitch_mm is None else float(pitch_mm)
    return {
        "version": VERSION,
        "multiscales": [
            {
                "name": name,
                "axes": axes,
                "datasets": [
                    _dataset(name if factor == 1 else f"levels/{factor}/{name}", factor, pitch)
                    for factor in (1, *levels)
                ],
                "type": "mean",
                "metadata": {
                    "description": "means of 2 x 2 pixels that are known, again and again; normals "
                    "of unit length, what scatters about them in the widths of the lobes",
                    "method": "impasto.render(reduce=2)",
                },
            }
            for name in SHOWN
            if name in names
        ],
    }


def _dataset(path: str, factor: int, pitch: float) -> dict[str, Any]:
    middle = 0.5 * (factor - 1) * pitch
    side = factor * pitch
    return {
        "path": path,
        "coordinateTransformations": [
            {"type": "scale", "scale": [1.0, side, side]},
            {"type": "translation", "translation": [0.0, middle, middle]},
        ],
    }

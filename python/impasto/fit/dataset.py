"""Results as xarray datasets; xarray is loaded only when one is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, fields
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from impasto._internal.extras import need
from impasto.status import Status

if TYPE_CHECKING:
    from xarray import Dataset


Variable: TypeAlias = tuple[tuple[str, ...], Any, dict[str, Any]]
"""Dimensions, values, attributes: as xarray takes them."""


def variable(of: Field[Any], values: Any, *first: str) -> Variable:
    """The values of a field over its dimensions, after those that come ``first``."""
    unit = of.metadata["unit"]
    return (*first, *of.metadata["dims"]), values, {"units": unit} if unit else {}


def dataset_of(surface: Any) -> Dataset:
    """See :meth:`impasto.Sbrdf.to_xarray`; the result's own file imports this one."""
    return labelled(surface, surface.rig, surface.bands, {"kind": surface.kind()})


def labelled(result: Any, rig: Any, bands: Sequence[str], attributes: dict[str, Any]) -> Dataset:
    """The maps of a result, which may be dask arrays, with its numbers after ``attributes``."""
    need("xarray", "scale", "to_xarray")
    import xarray

    variables: dict[str, Any] = {
        "light": (("observation", "axis"), rig.vectors),
        "near": (("observation",), rig.near),
        "intensity": (("observation",), rig.intensities),
        "view": (("observation", "axis"), rig.views),
    }
    numbers = dict(attributes)
    for one in fields(result):
        dims = one.metadata.get("dims")
        if dims is None or one.name == "bands":
            continue
        value = getattr(result, one.name)
        if not dims:
            numbers[one.name] = int(value) if isinstance(value, bool) else value
            continue
        variables[one.name] = variable(one, value)
    # As the CF conventions write an enumeration.
    variables["status"][2].update(
        flag_values=np.array([int(status) for status in Status], dtype=np.uint8),
        flag_meanings=" ".join(status.name.lower() for status in Status),
    )
    coordinates: dict[str, Any] = {"band": list(bands), "axis": ["x", "y", "z"]}
    if rig.known_pitch_mm is not None:
        height, width = result.shape
        x, y = rig.origin
        across = (np.arange(width) - (width - 1) / 2 + x) * rig.known_pitch_mm
        up = ((height - 1) / 2 - np.arange(height) + y) * rig.known_pitch_mm
        coordinates |= {"x": ("x", across, {"units": "mm"}), "y": ("y", up, {"units": "mm"})}
    return xarray.Dataset(variables, coords=coordinates, attrs=numbers)

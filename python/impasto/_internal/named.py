"""Arrays whose dimensions have names (xarray's ``DataArray``), in the order of a stack."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError

DIMENSIONS: dict[str, tuple[str, ...]] = {
    "observation": ("observation", "obs", "photograph", "image", "light"),
    "band": ("band", "channel"),
    "y": ("y", "row"),
    "x": ("x", "column"),
}
"""The axes of a stack, in order, each with the names that are understood."""


def is_named(array: Any) -> bool:
    """Whether the array says what its dimensions are, as xarray's ``DataArray`` does."""
    return all(hasattr(array, name) for name in ("dims", "coords", "transpose"))


def in_order(array: Any, name: str, axes_of: Sequence[str] = tuple(DIMENSIONS)) -> Any:
    """The array over (observation, band, y, x); without a band, over (observation, y, x).

    Parameters
    ----------
    array
        With names of its dimensions.
    name
        That of the argument.
    axes_of
        The axes, in order: of a mask y and x.

    Raises
    ------
    ArgumentError
        A dimension with another name, two names for one axis, or an axis that is missing.
    """
    axes: dict[str, Any] = {}
    understood = {axis: DIMENSIONS[axis] for axis in axes_of}
    for dim in array.dims:
        axis = next((axis for axis, known in understood.items() if dim in known), None)
        if axis is None or axis in axes:
            choices = "; ".join(f"{axis}: {', '.join(known)}" for axis, known in understood.items())
            why = "is unknown" if axis is None else f"means the same as {axes[axis]!r}"
            raise ArgumentError(
                f"{name}: the dimension {dim!r} {why}; rename it to one of {choices}"
            )
        axes[axis] = dim
    missing = [axis for axis in understood if axis not in axes and axis != "band"]
    if missing:
        raise ArgumentError(
            f"{name}: expected the dimensions {', '.join(axes_of[:-1])} and {axes_of[-1]}, found "
            f"{', '.join(map(str, array.dims)) or 'none'}"
        )
    return array.transpose(*(axes[axis] for axis in understood if axis in axes))


def mask_in_order(mask: Any) -> Any:
    """A mask over (y, x), of which one with names may have another order."""
    return in_order(mask, "mask", ("y", "x")) if is_named(mask) else mask


def coordinate(array: Any, axis: str) -> list[str] | None:
    """The labels of one axis, if they are words; None if there are none."""
    known = (dim for dim in DIMENSIONS[axis] if dim in array.dims and dim in array.coords)
    dim = next(known, None)
    if dim is None or array.coords[dim].dtype.kind not in "UOT":
        return None
    return [str(label) for label in array.coords[dim].values.tolist()]


def light_directions(array: Any) -> NDArray[np.float64] | None:
    """``(observation, 3)`` from the coordinates ``light_x``, ``light_y``, ``light_z``, if there."""
    names = [f"light_{axis}" for axis in "xyz"]
    if not all(name in array.coords for name in names):
        return None
    return np.stack([np.asarray(array.coords[name], dtype=np.float64) for name in names], axis=-1)

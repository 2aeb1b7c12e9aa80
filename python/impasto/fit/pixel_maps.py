"""Crop and rotate results: the outcome is the same kind of result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impasto._internal.rotation import quarter_turns_of
from impasto._internal.windows import offset, rotated_map, window
from impasto.rig import Rig

ChangeMap = Callable[[NDArray[Any], tuple[str, ...]], NDArray[Any]]


class PixelMaps:
    """A dataclass of maps that can be cropped and rotated; its fields name their dimensions."""

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        height, width = np.shape(self.status)  # type: ignore[attr-defined]
        return height, width

    def __getitem__(self, key: Any) -> Self:
        """``[y0:y1, x0:x1]``: a part of the painting, which shares memory with the whole.

        Its rig keeps the position of the part, so near lights remain correct. Values of the whole
        painting (the pooled lobe, the pixels of a segment) do not change.
        """
        part = window(key, self.shape)
        right, up = offset(part, self.shape)
        found: Self = _changed(
            self, lambda plane, _: plane[(..., *part)], lambda rig: rig.part(right, up)
        )
        return found

    def placed(self, right: float, up: float) -> Self:
        """The same maps as a part whose middle lies so many pixels from that of the painting."""
        found: Self = _changed(self, lambda plane, _: plane, lambda rig: rig.part(right, up))
        return found

    def rotated(self, quarter_turns: int = 1) -> Self:
        """The result with painting, lights and views rotated counterclockwise.

        Coordinates only swap and change sign: four quarter turns change no bit.
        """
        turns = quarter_turns_of(quarter_turns)

        def turn(plane: NDArray[Any], dims: tuple[str, ...]) -> NDArray[Any]:
            return rotated_map(plane, turns, dims.index("axis") if "axis" in dims else None)

        found: Self = _changed(self, turn, lambda rig: rig.rotated(turns)) if turns else self
        return found


def _changed(result: Any, change_map: ChangeMap, change_rig: Callable[[Rig], Rig]) -> Any:
    changes: dict[str, Any] = {}
    for one in fields(result):
        value, dims = getattr(result, one.name), one.metadata.get("dims", ())
        if isinstance(value, Rig):
            changes[one.name] = change_rig(value)
        elif is_dataclass(value):
            changes[one.name] = _changed(value, change_map, change_rig)
        elif value is not None and tuple(dims[-2:]) == ("y", "x"):
            changes[one.name] = change_map(value, dims)
    return replace(result, **changes)

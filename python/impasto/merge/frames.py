"""Frames: results in memory or in stores, read by windows."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from impasto._internal.windows import Window, squares
from impasto.errors import ArgumentError
from impasto.fit.result import Sbrdf
from impasto.fit.sbrdf import load_sbrdf
from impasto.fit.stored import StoredSbrdf, open_sbrdf
from impasto.io.results import result_file
from impasto.rig import Rig

BLOCK = 1024
"""Rows and columns that are read at a time."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One of the results that are merged.

    Attributes
    ----------
    name
        How messages and the report call it.
    result
        Its maps, or the store that has them.
    """

    name: str
    result: Sbrdf | StoredSbrdf

    @property
    def kind(self) -> type[Sbrdf]:
        """The class of the result."""
        return self.result.kind if isinstance(self.result, StoredSbrdf) else type(self.result)

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.result.shape

    @property
    def bands(self) -> tuple[str, ...]:
        """One name per band."""
        return self.result.bands

    @property
    def rig(self) -> Rig:
        """Who lit and who looked."""
        return self.result.rig

    def window(self, rows: slice, columns: slice) -> Sbrdf:
        """A part of all maps."""
        return self.result[rows, columns]

    def map(self, name: str, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of one map."""
        if isinstance(self.result, StoredSbrdf):
            return self.result.map(name, rows, columns)
        found: NDArray[Any] = getattr(self.result, name)[..., rows, columns]
        return found

    def blocks(self, step: int) -> Iterator[Window]:
        """Windows that cover the frame; all but the last begin and end at multiples of a step."""
        return squares(self.shape, max(BLOCK // step, 1) * step)


def frames_of(given: Any) -> list[Frame]:
    """Frames from results, opened stores and files.

    Raises
    ------
    ArgumentError
        Fewer than two, one twice, something else among them, or frames of different bands.
    """
    if isinstance(given, str | os.PathLike) or not isinstance(given, Sequence):
        raise ArgumentError(
            f"frames: expected a list of results or their files, found {type(given).__name__}"
        )
    if len(given) < 2:
        raise ArgumentError(f"frames: expected two or more to merge, found {len(given)}")
    found = [_numbered(one, index) for index, one in enumerate(given)]
    seen: set[Any] = set()
    for one, frame in zip(given, found, strict=True):
        identity = _identity(one)
        if identity in seen:
            raise ArgumentError(f"frames: {frame.name} is given twice; leave one of them out")
        seen.add(identity)
    for frame in found[1:]:
        if frame.bands != found[0].bands:
            raise ArgumentError(
                f"frames: {frame.name} has the bands {', '.join(frame.bands)}, but "
                f"{found[0].name} has {', '.join(found[0].bands)}; merge frames of the same bands "
                "(with_bands of a result picks some)"
            )
    return found


def frame_of(one: Sbrdf | StoredSbrdf | str | os.PathLike[str], name: str) -> Frame:
    """A frame from a result, which is called ``name``, an opened store or a file."""
    if isinstance(one, str | os.PathLike):
        path = Path(one)
        stored = result_file(path).suffix.lower() == ".zarr"
        return Frame(str(path), open_sbrdf(path) if stored else load_sbrdf(path))
    return Frame(one.path.name if isinstance(one, StoredSbrdf) else name, one)


def _identity(one: Sbrdf | StoredSbrdf | str | os.PathLike[str]) -> Any:
    """The same for two frames only if they are one result."""
    if isinstance(one, Sbrdf):
        return id(one)
    return (one.path if isinstance(one, StoredSbrdf) else Path(one)).resolve()


def _numbered(one: Any, index: int) -> Frame:
    if isinstance(one, Sbrdf | StoredSbrdf | str | os.PathLike):
        return frame_of(one, f"frame {index}")
    raise ArgumentError(
        f"frames: number {index} is {type(one).__name__}; expected a result of impasto.fit_sbrdf, "
        "of impasto.open_sbrdf, or the name of its file"
    )

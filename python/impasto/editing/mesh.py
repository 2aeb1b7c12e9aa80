"""Heights of a depth mesh: the file of ``impasto align --depth``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from impasto.depth_mesh import DepthMesh
from impasto.editing.photographs import TILE, Photographs
from impasto.editing.written import WrittenFile
from impasto.errors import ArgumentError
from impasto.io.depth_mesh import as_written, depth_text, read_depth
from impasto.io.images import list_images
from impasto.pictures import colour_ramp


class Mesh:
    """The heights of a painting.

    Parameters
    ----------
    path
        A file of ``impasto align --depth estimate``.
    photograph
        An aligned photograph that is shown below the heights. Default: the first in the folder
        above that of the file, where ``impasto align`` writes them; none there, none is shown.
    encoding
        Tone curve of the photograph.

    Raises
    ------
    ArgumentError
        Not found.
    CorruptInputError
        No file of heights.
    """

    def __init__(
        self, path: Path, photograph: Path | None = None, encoding: str | None = None
    ) -> None:
        self.mesh = read_depth(path)
        self.file = WrittenFile(path)
        aligned = list_images(path.absolute().parent.parent) if photograph is None else [photograph]
        self.photographs = Photographs(aligned[:1], encoding)

    def document(self) -> dict[str, Any]:
        """Heights by rows from the top, their standard deviations, and colours from low to high."""
        return {
            "kind": "mesh",
            "file": self.file.path.name,
            "exists": True,
            "tile": TILE,
            "photographs": self.photographs.described(),
            "size_mm": list(self.mesh.size_mm),
            "depth_mm": self.mesh.depth_mm.tolist(),
            "ramp": colour_ramp().tolist(),
            "notes": {},
        }

    def picture(self, number: int) -> bytes:
        """The photograph."""
        return self.photographs.picture(number)

    def tile(self, number: int, column: int, row: int) -> bytes:
        """A part of the photograph."""
        return self.photographs.tile(number, column, row)

    def save(self, content: dict[str, Any]) -> str:
        """Write the heights ``{"depth_mm": [[...], ...]}``.

        Standard deviations of nodes whose height was changed are no longer known.
        """
        try:
            depth = np.array(content.get("depth_mm"), dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise ArgumentError("depth_mm: expected rows of numbers") from None
        if depth.shape != self.mesh.depth_mm.shape:
            rows, columns = self.mesh.depth_mm.shape
            raise ArgumentError(
                f"depth_mm: expected {rows} rows of {columns} heights, found shape {depth.shape}"
            )
        new = as_written(DepthMesh(self.mesh.size_mm, depth, self.mesh.sigma_mm))
        changed = new.depth_mm != as_written(self.mesh).depth_mm
        new = DepthMesh(new.size_mm, new.depth_mm, np.where(changed, np.nan, new.sigma_mm))
        self.file.write(depth_text(new), read_depth)
        self.mesh = new
        count = int(changed.sum())
        return f"{self.file.path.name} written, {count} height{'s' * (count != 1)} changed"

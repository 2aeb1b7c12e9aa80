"""The merged painting in a store, tile by tile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from impasto.io.files import atomic_bytes, atomic_together
from impasto.io.folders import new_folder
from impasto.io.json_lines import crc_of
from impasto.io.results.zarr_arrays import METADATA
from impasto.io.results.zarr_store import EMPTY_GROUP
from impasto.jobs.assembly import KNOWN, complete, files_of_tile
from impasto.jobs.checksums import CHECKSUMS, checksums_file
from impasto.jobs.grid import Grid
from impasto.merge.blend import Mosaic
from impasto.merge.report import MergeReport

NOTES = "merge"
REPORT = f"{NOTES}/report.json"
"""What :class:`MergeReport` says, in the store."""


def write_store(
    target: Path,
    mosaic: Mosaic,
    grid: Grid,
    report: MergeReport,
    done: Callable[[int], None],
) -> None:
    """Make a store that appears whole or not at all; ``done`` is called after every tile.

    It has the checksums of all of its files, as a job has them in its journal.
    """
    left: dict[str, NDArray[Any]] | None = None
    crcs: dict[str, str] = {}
    with new_folder(target) as folder:
        for count, tile in enumerate(grid):
            part = mosaic.part(*grid.window(tile))
            files, beside = files_of_tile(grid, tile, part, "single", mosaic.rig)
            atomic_together({folder / name: data for name, data in files.items()})
            crcs |= {name: crc_of(data) for name, data in files.items()}
            if left is None or (beside[KNOWN] and not left[KNOWN]):
                left = beside
            done(count + 1)
        assert left is not None
        more = {f"{NOTES}/{METADATA}": EMPTY_GROUP, REPORT: report.to_json().encode()}
        crcs |= complete(folder, left, grid, "single", more)
        atomic_bytes(folder / CHECKSUMS, checksums_file(crcs))

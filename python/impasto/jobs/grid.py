"""How a painting is cut into tiles, and how large these may be in the memory that there is."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from impasto import _core
from impasto._internal.checks import is_whole
from impasto._internal.windows import Window, widened
from impasto.errors import ArgumentError
from impasto.fit.lobes import MOST_LOBES
from impasto.fit.residuals import COMPONENTS

PIECE: int = _core.SurfaceStatistics.SIDE
"""Rows and columns of what a plan knows statistics of."""
Tile: TypeAlias = tuple[int, int]
"""Row and column of a tile in the grid."""

STEP = 64
"""Tiles that follow from the memory have multiples of so many rows and columns."""
MOST = 1024
"""Most rows and columns of such a tile: an interruption loses those in flight."""
MOST_MEMORY = 2.0**63
"""8 EiB, more than a file system counts."""
SMALLEST = 16
"""Fewest rows and columns of a tile that a caller may ask for."""
UNITS = {"": 1, "B": 1}
for _power, _prefix in enumerate("KMGT", 1):
    UNITS[f"{_prefix}B"] = 1000**_power
    UNITS[f"{_prefix}IB"] = UNITS[_prefix] = 1024**_power


@dataclass(frozen=True)
class Grid:
    """Square tiles over a painting; the last ones may be cut off by its border.

    Attributes
    ----------
    rows, columns
        Of the painting, in pixels.
    tile
        Rows and columns of a tile.
    """

    rows: int
    columns: int
    tile: int

    def __len__(self) -> int:
        down, across = self.shape
        return down * across

    def __iter__(self) -> Iterator[Tile]:
        down, across = self.shape
        return ((row, column) for row in range(down) for column in range(across))

    @property
    def shape(self) -> Tile:
        """Rows and columns of tiles."""
        return -(-self.rows // self.tile), -(-self.columns // self.tile)

    @property
    def half(self) -> Grid:
        """The same tiles over the painting at half its scale."""
        return Grid(self.rows // 2, self.columns // 2, self.tile // 2)

    @property
    def pieces(self) -> Grid:
        """The same tiles over the pieces of which statistics are known: each has its own."""
        side = -(-self.tile // PIECE)
        rows, columns = (
            (count - 1) * side + -(-(size - (count - 1) * self.tile) // PIECE)
            for count, size in zip(self.shape, (self.rows, self.columns), strict=True)
        )
        return Grid(rows, columns, side)

    def window(self, tile: Tile, halo: int = 0) -> Window:
        """Rows and columns of a tile and of a border around it, as far as the painting reaches."""
        rows, columns = (
            slice(at * self.tile, min((at + 1) * self.tile, size))
            for at, size in zip(tile, (self.rows, self.columns), strict=True)
        )
        return widened((rows, columns), (self.rows, self.columns), halo)

    def pixels(self, tile: Tile) -> int:
        """Pixels of a tile."""
        rows, columns = self.window(tile)
        return int(rows.stop - rows.start) * int(columns.stop - columns.start)


@dataclass(frozen=True)
class Footprint:
    """Bytes of memory that a pixel takes.

    Attributes
    ----------
    samples
        All samples of a pixel as the fit takes them.
    codes
        The same as they stand in the files, while they are read.
    observations, bands
        Their numbers.
    held
        Of the samples, what is in memory whether a job runs or not.
    """

    samples: int
    codes: int
    observations: int
    bands: int
    held: int = 0

    @property
    def maps(self) -> int:
        """At most, of the maps of a result with those of photometric stereo, without residuals.

        Three lobes in every band, and some thirty single numbers.
        """
        return 120 + 4 * self.bands * (4 + MOST_LOBES)

    @property
    def residuals(self) -> int:
        """At most, of the components of residuals that are kept, in half precision."""
        return 2 * self.bands * min(COMPONENTS[-1], self.observations)

    def of_tile(self, tile: tuple[int, int], read: tuple[int, int]) -> int:
        """Of a tile while it is fitted, the next one is read and the last two become files.

        Given are rows and columns, also of what is ``read`` for it: those of its border, too.

        Two tiles of samples with a border and a copy without it; two of maps, the files that are
        made of one, and those that are written. Residuals are computed in single precision.
        """
        bordered = (2 * self.samples + self.codes) * math.prod(read)
        inner = self.samples + 4 * self.maps + 6 * self.residuals
        return bordered + inner * math.prod(tile)

    @property
    def learned(self) -> int:
        """Of the photographs from which a model is learned."""
        return self.samples - self.held + self.codes + self.maps


def tile_for(memory: int, pixel: Footprint, source: tuple[int, int], border: int) -> int:
    """Rows and columns of the tiles of a job.

    Parameters
    ----------
    memory
        Bytes, half of those that a job has.
    pixel
        What a pixel takes.
    source
        Rows and columns of what is decoded at once; tiles are multiples of both where that fits.
    border
        Pixels around a tile that its fit needs.
    """
    sides = range(STEP, MOST + 1, STEP)

    def needed(side: int) -> int:
        return pixel.of_tile((side, side), (side + 2 * border, side + 2 * border))

    fitting = [side for side in sides if needed(side) <= memory]
    if not fitting:
        raise ArgumentError(
            f"memory: tiles of {STEP} x {STEP} pixels of these photographs need "
            f"{in_words(2 * needed(STEP))}, found {in_words(2 * memory)}"
            + less_words(lambda side: needed(side) <= memory)
        )
    side = fitting[-1]
    both = math.lcm(STEP, *source)
    step = both if both <= side else STEP
    return side // step * step


def stride_for(memory: int, pixel: Footprint, size: tuple[int, int], least: int) -> int:
    """Of every how many rows and columns a model is learned.

    The smallest odd number from ``least`` on whose sample fits into the memory.
    """
    stride = least
    while math.prod(-(-side // stride) for side in size) * pixel.learned > memory:
        stride += 2
        if stride > max(size):
            raise ArgumentError(
                f"memory: to learn from one pixel takes {2 * pixel.learned} bytes, "
                f"found {2 * memory}"
            )
    return stride


def checked_tile(tile: Any) -> int:
    """Rows and columns of a tile as a caller gave them.

    Raises
    ------
    ArgumentError
        No even number from 16 on.
    """
    if not is_whole(tile) or tile < SMALLEST or tile % 2:
        raise ArgumentError(f"tile: expected an even number from {SMALLEST} on, found {tile!r}")
    return int(tile)


def bytes_of(memory: Any) -> int:
    """Bytes of ``"4GiB"``, ``"500 MB"``, ``"4G"`` (GiB, as for Slurm and Docker) or a number.

    Raises
    ------
    ArgumentError
        Something else, or nothing.
    """
    if is_whole(memory) and memory > 0:
        return int(memory)
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([A-Za-z]*)\s*", str(memory))
    if found is None or found[2].upper() not in UNITS or isinstance(memory, bool):
        raise ArgumentError(
            f'memory: expected bytes, or a number with a unit such as "4GiB", found {memory!r}'
        )
    wanted = float(found[1]) * UNITS[found[2].upper()]
    size = int(wanted) if wanted < MOST_MEMORY else 0
    if size < 1:
        raise ArgumentError(f'memory: expected 1 B to 8 EiB, such as "4GiB", found {memory!r}')
    return size


def less_words(fits: Callable[[int], bool]) -> str:
    """What to give where tiles of :data:`STEP` rows and columns need too much memory."""
    side = next((side for side in range(STEP // 2, SMALLEST - 1, -SMALLEST) if fits(side)), None)
    if side is None:
        return "; give more memory"
    return f"; give more, or smaller tiles, which take longer (tile={side}, --tile {side})"


def in_words(size: int) -> str:
    """Bytes of a memory, for messages."""
    for power, unit in ((30, "GiB"), (20, "MiB"), (10, "KiB")):
        if size >= 2**power:
            return f"{size / 2**power:.4g} {unit}"
    return f"{size} B"

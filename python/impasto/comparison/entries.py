"""The entries of a comparison: statuses, registration, rows of the table, areas and maps."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.saved import over
from impasto.io.results import SavedMaps

RATIOS = 0.1, 10.0
"""Ratios of beta beyond these count as these in means and pictures: 0 where a lobe is gone,
infinity where it is new."""


class Compared(IntEnum):
    """Whether a pixel could be compared, and why not; below 16 its maps have numbers."""

    TESTED = 0
    """Compared, and every difference held against its predicted error."""
    NO_ERROR = 1
    """Compared, but no error is predicted (a pixel of as many samples as unknowns)."""
    OUTSIDE = 16
    """The painting after does not reach so far."""
    UNKNOWN_BEFORE = 17
    """Not estimated before."""
    UNKNOWN_AFTER = 18
    """Not estimated after."""
    UNKNOWN_BOTH = 19
    """Estimated in neither."""


class Changed(IntFlag):
    """What differs significantly at a pixel; sums of these."""

    NORMAL = 1
    COLOUR = 2
    GLOSS = 4


@dataclass(frozen=True)
class Registration:
    """Where the painting after lies in the pixels of the one before.

    Attributes
    ----------
    linear
        ``(2, 2)`` from columns and rows after to columns and rows before.
    offset
        ``(2,)`` pixels: column and row at which its first pixel lies.
    scale
        Pixels before for one after, along a side.
    angle
        Radians by which it was rotated in its plane, counterclockwise.
    affine
        Whether it was sheared and stretched.
    sigma
        Standard deviation of what is left, pixels along each axis; 0 where nothing was moved.
    tilt
        Radians by which its normals were rotated onto the plane of the painting before.
    gain
        Per band, what its colours were multiplied by; ones unless ``exposure="matched"``.
    """

    linear: tuple[tuple[float, float], tuple[float, float]]
    offset: tuple[float, float]
    scale: float
    angle: float
    affine: bool
    sigma: float
    tilt: float
    gain: tuple[float, ...]


@dataclass(frozen=True)
class Quantity:
    """A row of the table.

    Attributes
    ----------
    name, unit
        ``"normal"`` in degrees, ``"colour"`` in dE00, ``"gloss"`` as the ratio of beta.
    median, high
        Median and 95th percentile of the differences; of gloss those of the ratio, after to before.
    detectable
        Median of the smallest difference that would be significant; NaN where none is predicted.
    tested
        Pixels with a predicted error.
    significant
        Share of them with a significant difference.
    """

    name: str
    unit: str
    median: float
    high: float
    detectable: float
    tested: int
    significant: float


@dataclass(frozen=True)
class GlossChange:
    """The gloss of the whole painting, before and after.

    Attributes
    ----------
    beta, gamma
        Of both; gamma in radians.
    beta_z, gamma_z
        Differences of the logarithms in their standard deviations; NaN where none is known.
    """

    beta: tuple[float, float]
    gamma: tuple[float, float]
    beta_z: float
    gamma_z: float


@dataclass(frozen=True)
class Area:
    """A cell of the grid, or a region.

    Attributes
    ----------
    name
        ``"B3"``: column B, row 3 of the grid; or the code of the region.
    top, left, rows, columns
        The smallest rectangle around it, in pixels before.
    pixels
        Pixels that were compared.
    normal, colour, gloss
        Means of the angle (degrees) and of dE00, and the geometric mean of the ratio of beta, each
        within 0.1 to 10; NaN where nothing is known.
    changed
        Shares of compared pixels whose normal, colour and gloss changed significantly.
    """

    name: str
    top: int
    left: int
    rows: int
    columns: int
    pixels: int
    normal: float
    colour: float
    gloss: float
    changed: tuple[float, float, float]


@dataclass(frozen=True)
class Cluster:
    """Changed pixels that touch, more of them than chance connects.

    Attributes
    ----------
    top, left, rows, columns
        The smallest rectangle around them, in pixels before.
    pixels, area_mm2
        How many there are, and their area on the painting; NaN where the width of a pixel is not
        known.
    normal, colour, gloss
        Means of the angle (degrees) and of dE00, and the geometric mean of the ratio of beta, each
        within 0.1 to 10; NaN where nothing is known.
    changed
        Shares of them whose normal, colour and gloss changed significantly.
    """

    top: int
    left: int
    rows: int
    columns: int
    pixels: int
    area_mm2: float
    normal: float
    colour: float
    gloss: float
    changed: tuple[float, float, float]


@dataclass(frozen=True)
class ClusterExtent:
    """From which size on marks that touch are more than chance.

    Attributes
    ----------
    critical
        Pixels of a significant cluster at least; infinite where chance alone connects the marks.
    familywise
        Probability that an unchanged painting has one.
    chance
        Clusters of any size.
    continuation
        Share of chance clusters that grow by one more pixel.
    found
        Clusters of that size or more.
    share
        Share of the compared pixels that lie in them.
    """

    critical: float
    familywise: float
    chance: int
    continuation: float
    found: int
    share: float


@dataclass(frozen=True, eq=False)
class ComparisonMaps:
    """Maps over the pixels of the painting before; NaN where nothing could be compared.

    Attributes
    ----------
    angle
        ``(y, x)`` float32, radians between the normals.
    delta_e
        ``(y, x)`` float32, CIEDE2000 between the diffuse colours.
    beta_ratio, gamma_ratio
        ``(y, x)`` float32: strength of the lobes (their sum) and width of the strongest one, after
        divided by before. 0 and infinity: a lobe is gone or new.
    changed
        ``(y, x)`` uint8: sums of :class:`Changed`.
    status
        ``(y, x)`` uint8: :class:`Compared`.
    height
        ``(y, x)`` float32, mm: height after less height before, median 0; None unless wanted.
    """

    angle: NDArray[np.float32] = field(metadata=over("y", "x", unit="rad"))
    delta_e: NDArray[np.float32] = field(metadata=over("y", "x"))
    beta_ratio: NDArray[np.float32] = field(metadata=over("y", "x"))
    gamma_ratio: NDArray[np.float32] = field(metadata=over("y", "x"))
    changed: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    status: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    height: NDArray[np.float32] | None = None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All maps by name."""
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: array for name, array in every.items() if array is not None}

    @classmethod
    def of(cls, maps: SavedMaps) -> ComparisonMaps:
        """The maps of a file; sizes and types are checked."""
        status = maps.array("status", np.uint8, (None, None))
        found: dict[str, Any] = {
            one.name: maps.array(one.name, one.metadata["dtype"], status.shape)
            for one in fields(cls)
            if one.metadata
        }
        if "height" in maps.arrays:
            found["height"] = maps.array("height", np.float32, status.shape)
        return cls(**found)

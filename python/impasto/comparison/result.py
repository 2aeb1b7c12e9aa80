"""What a comparison found: maps, a table of quantities, areas that changed most."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.comparison.entries import (
    Area,
    Cluster,
    ClusterExtent,
    ComparisonMaps,
    GlossChange,
    Quantity,
    Registration,
)
from impasto.comparison.overview import Overview
from impasto.comparison.picture import comparison_picture
from impasto.comparison.text import as_text, table_rows
from impasto.errors import ArgumentError
from impasto.io.results import write_maps
from impasto.pictures import Picture

KIND = "impasto.Comparison"
"""Says in a saved file what it holds."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """What :func:`impasto.compare` found.

    Attributes
    ----------
    shape
        ``(y, x)`` of the painting before; all maps are on its pixels.
    names
        What was compared: before, after.
    registration
        Where the painting after lies, and how well that is known.
    alpha
        The probability of a mark, per pixel and quantity, where nothing changed.
    illuminant
        The light of the colour differences, or why there are none.
    quantities
        A row each for normal, colour and gloss.
    gloss
        The gloss of the whole painting.
    compared
        Pixels per :class:`Compared`, by name.
    areas
        Cells of the grid, or regions, those that changed most first.
    extent
        From which size on changed pixels that touch are more than chance.
    clusters
        Such areas, the largest first, 64 at most.
    overview
        Small pictures of both and of all maps.
    maps
        All maps; None for a comparison that was written to a store and not loaded.
    path
        The store that has the maps; None: they are in memory only.
    fits
        What gloss the fit of each has, in words; empty in earlier files. Where they differ, the
        table says that what the fits alone change is marked, too.
    """

    shape: tuple[int, int]
    names: tuple[str, str]
    registration: Registration
    alpha: float
    illuminant: str
    quantities: tuple[Quantity, ...]
    gloss: GlossChange
    compared: dict[str, int]
    areas: tuple[Area, ...]
    extent: ClusterExtent
    clusters: tuple[Cluster, ...]
    overview: Overview
    maps: ComparisonMaps | None = None
    path: Path | None = None
    fits: tuple[str, str] = ("", "")

    def quantity(self, name: str) -> Quantity:
        """The row of that name; KeyError: there is none."""
        return {one.name: one for one in self.quantities}[name]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write maps and numbers as ``.npz`` or ``.zarr``, whole or not at all.

        Raises
        ------
        ArgumentError
            Another suffix, or maps that are in a store of their own already.
        """
        if self.maps is None:
            raise ArgumentError(f"path: the maps are in {self.path} already")
        write_maps(path, KIND, self.maps.arrays() | self.numbers())

    def numbers(self) -> dict[str, NDArray[Any]]:
        """Everything but the maps as arrays of a file."""
        return {"report": np.array(self.to_json())} | self.overview.arrays()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; what is not known is None."""
        names = ("names", "fits", "alpha", "illuminant", "compared")
        content: dict[str, Any] = {name: getattr(self, name) for name in names}
        content["size"] = self.shape
        content["registration"] = asdict(self.registration)
        content["gloss"] = asdict(self.gloss)
        content["quantities"] = [asdict(one) for one in self.quantities]
        content["areas"] = [asdict(one) for one in self.areas]
        content["extent"] = asdict(self.extent)
        content["clusters"] = [asdict(one) for one in self.clusters]
        found = _plain(content)
        assert isinstance(found, dict)
        return found

    def to_json(self) -> str:
        """:meth:`to_dict` as text."""
        return json.dumps(self.to_dict(), indent=2, sort_keys=True) + "\n"

    def picture(self) -> Picture:
        """``(y, x, 3)`` uint8: before, after, the three maps, what changed, and their scales."""
        return comparison_picture(
            self.overview, self.names, self.quantities, self.compared, self.illuminant, self.extent
        )

    def rows(self) -> dict[str, object]:
        """The table in short: a name and a sentence each."""
        return table_rows(self.quantities, self.compared, self.alpha, self.extent, self.fits)

    def __str__(self) -> str:
        return as_text(
            self.names,
            self.registration,
            self.quantities,
            self.gloss,
            self.compared,
            self.areas,
            self.extent,
            self.clusters,
            alpha=self.alpha,
            illuminant=self.illuminant,
            fits=self.fits,
        )

    def __repr__(self) -> str:
        height, width = self.shape
        rows = ", ".join(f"{one.name} {100 * one.significant:.1f} %" for one in self.quantities)
        return f"<Comparison {width} x {height} pixels, changed: {rows}>"

    def _repr_html_(self) -> str:
        """HTML for notebooks: the table and small pictures."""
        from impasto.notebook import comparison_view

        return comparison_view(self)


def from_dict(
    content: dict[str, Any], overview: Overview, maps: ComparisonMaps | None, path: Path | None
) -> Comparison:
    """A comparison from the numbers of :meth:`Comparison.to_dict`."""
    place = content["registration"]
    return Comparison(
        shape=_pair(content["size"]),
        names=_pair(content["names"]),
        registration=Registration(
            linear=(_pair(place["linear"][0]), _pair(place["linear"][1])),
            offset=_pair(place["offset"]),
            gain=tuple(place["gain"]),
            **{name: place[name] for name in ("scale", "angle", "affine", "sigma", "tilt")},
        ),
        alpha=content["alpha"],
        illuminant=content["illuminant"],
        quantities=tuple(Quantity(**_known(one)) for one in content["quantities"]),
        gloss=GlossChange(
            beta=_pair(content["gloss"]["beta"]),
            gamma=_pair(content["gloss"]["gamma"]),
            **_known({name: content["gloss"][name] for name in ("beta_z", "gamma_z")}),
        ),
        compared=content["compared"],
        areas=tuple(
            Area(**_known(one) | {"changed": tuple(one["changed"])}) for one in content["areas"]
        ),
        extent=_extent(content.get("extent")),
        clusters=tuple(
            Cluster(**_known(one) | {"changed": tuple(one["changed"])})
            for one in content.get("clusters", [])
        ),
        overview=overview,
        maps=maps,
        path=path,
        fits=_pair(content.get("fits", ["", ""])),
    )


def _extent(entries: dict[str, Any] | None) -> ClusterExtent:
    """What is not finite is None in a file; earlier files have no clusters."""
    known = entries or {"familywise": math.nan, "chance": 0, "continuation": math.nan,
                        "found": 0, "share": math.nan}  # fmt: skip
    critical = known.get("critical")
    return ClusterExtent(**_known(known) | {"critical": math.inf if critical is None else critical})


def _pair(values: Sequence[Any]) -> tuple[Any, Any]:
    first, second = (math.nan if value is None else value for value in values)
    return first, second


def _known(entries: dict[str, Any]) -> dict[str, Any]:
    return {name: math.nan if value is None else value for name, value in entries.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""Results in a store, of any size: read by windows, shown and integrated part by part.

``maps`` reads, ``result`` is what :func:`impasto.open_sbrdf` returns, ``level`` its smaller scales,
``picture`` and ``height`` are made in the memory of some rows.
"""

from impasto.fit.stored.level import StoredLevel, maps_of_level, surface_of_level
from impasto.fit.stored.maps import StoredMaps
from impasto.fit.stored.result import StoredSbrdf, open_sbrdf

__all__ = [
    "StoredLevel",
    "StoredMaps",
    "StoredSbrdf",
    "maps_of_level",
    "open_sbrdf",
    "surface_of_level",
]

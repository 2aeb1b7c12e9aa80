"""Results of a fit in a file, whatever its format."""

from impasto.io.results.maps import (
    RESULT,
    STACK,
    SavedMaps,
    checked_maps,
    no_photographs,
    other_kind,
    read_maps,
    result_file,
    rig_arrays,
    rig_from_arrays,
    write_maps,
)
from impasto.io.results.store import STORES, MapStore

__all__ = [
    "RESULT",
    "STACK",
    "STORES",
    "MapStore",
    "SavedMaps",
    "checked_maps",
    "no_photographs",
    "other_kind",
    "read_maps",
    "result_file",
    "rig_arrays",
    "rig_from_arrays",
    "write_maps",
]

"""Formats of result files: named arrays, written whole or not at all.

A new format is one class with ``write`` and ``read``, and one line in ``STORES``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from impasto.io.npz import read_npz, write_npz
from impasto.io.results.zarr_store import ZarrStore


class MapStore(Protocol):
    """A file format for named arrays."""

    def write(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write all arrays; the file appears whole or not at all."""

    def read(self, path: Path) -> Mapping[str, NDArray[Any]]:
        """All arrays of a file; :class:`~impasto.CorruptInputError` where it is damaged."""


class NpzStore:
    """One ``.npz`` file, without pickles."""

    def write(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See :class:`MapStore`."""
        write_npz(path, arrays)

    def read(self, path: Path) -> Mapping[str, NDArray[Any]]:
        """See :class:`MapStore`."""
        return read_npz(path)


STORES: dict[str, MapStore] = {".npz": NpzStore(), ".zarr": ZarrStore()}
"""By suffix."""


def store_of(path: Path) -> MapStore:
    """The format for a file name; ``.npz`` for unknown suffixes, which it refuses."""
    return STORES.get(path.suffix.lower(), STORES[".npz"])

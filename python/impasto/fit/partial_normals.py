"""Some of the maps of photometric stereo, and memory that maps are written to again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import suggestion
from impasto.errors import ArgumentError
from impasto.fit.pixel_maps import PixelMaps
from impasto.fit.saved import over

NormalMap = Literal["normal", "albedo", "used", "rejected", "residual", "condition", "sigma"]
NORMAL_MAPS: tuple[NormalMap, ...] = get_args(NormalMap)
"""Maps of :func:`~impasto.fit_normals`, besides the status."""

PLANES = {"axis": 3, "reason": 4}
"""Planes of a map by its first dimension; ``"band"`` has those of the stack."""

ZEROED = ("rejected", "status")
"""Maps of which only what is not zero is written."""


@dataclass(frozen=True, eq=False, repr=False)
class PartialNormals(PixelMaps):
    """Those maps of a :class:`Normals` that ``fit_normals(stack, maps=...)`` was asked for.

    Each is the map of the same name in :class:`Normals`, bit by bit; the others are None.
    ``status`` is always there: it says why a map holds NaN.

    Parameters
    ----------
    status
        ``(y, x)`` uint8, see :class:`~impasto.Status`.
    method
        The method of :func:`fit_normals`.
    normal
        ``(3, y, x)`` float32 or None.
    albedo
        ``(band, y, x)`` float32 or None.
    used
        ``(y, x)`` uint16 or None.
    rejected
        ``(4, y, x)`` uint16 or None.
    residual, condition, sigma
        ``(y, x)`` float32 or None.
    """

    status: NDArray[np.uint8] = field(metadata=over("y", "x", dtype=np.uint8))
    method: str = field(metadata=over(dtype=np.str_))
    normal: NDArray[np.float32] | None = field(default=None, metadata=over("axis", "y", "x"))
    albedo: NDArray[np.float32] | None = field(default=None, metadata=over("band", "y", "x"))
    used: NDArray[np.uint16] | None = field(default=None, metadata=over("y", "x", dtype=np.uint16))
    rejected: NDArray[np.uint16] | None = field(
        default=None, metadata=over("reason", "y", "x", dtype=np.uint16)
    )
    residual: NDArray[np.float32] | None = field(default=None, metadata=over("y", "x"))
    condition: NDArray[np.float32] | None = field(default=None, metadata=over("y", "x"))
    sigma: NDArray[np.float32] | None = field(default=None, metadata=over("y", "x", unit="rad"))

    def __repr__(self) -> str:
        height, width = self.status.shape
        made = ", ".join(name for name in NORMAL_MAPS if getattr(self, name) is not None)
        return f"<PartialNormals {width} x {height} pixels, {self.method}: {made}>"


def chosen_maps(maps: Any) -> tuple[NormalMap, ...]:
    """The names of maps that a caller asks for, checked."""
    expected = f"some of {', '.join(map(repr, NORMAL_MAPS))}"
    if isinstance(maps, str) or not isinstance(maps, Iterable):
        hint = f"; for one map write maps=({maps!r},)" if maps in NORMAL_MAPS else ""
        raise ArgumentError(f"maps: expected {expected}, found {maps!r}{hint}")
    names = tuple(maps)
    for name in names:
        if not (isinstance(name, str) and name in NORMAL_MAPS):
            more = suggestion(name, NORMAL_MAPS)
            more = "; the status is always made" if name == "status" else more
            raise ArgumentError(f"maps: expected {expected}, found {name!r}{more}")
    if not names:
        raise ArgumentError(f"maps: expected {expected}, found none")
    return tuple(name for name in NORMAL_MAPS if name in names)


def partial_normals(
    shape: tuple[int, int, int, int], method: str, maps: tuple[NormalMap, ...]
) -> PartialNormals:
    """Memory for some maps of a stack of a ``shape (obs, band, y, x)``."""
    status = np.zeros(shape[2:], np.uint8)
    arrays: dict[str, Any] = {}
    for name, (size, dtype) in _expected(PartialNormals, shape).items():
        if name in maps:
            # Zeros that the system hands out are not touched where nothing is rejected.
            arrays[name] = (np.zeros if name in ZEROED else np.empty)(size, dtype)
    return PartialNormals(status=status, method=method, **arrays)


def cleared(out: Any, shape: tuple[int, int, int, int]) -> None:
    """Prepare the maps of ``out`` to be written again, for a stack ``(obs, band, y, x)``.

    Raises
    ------
    ArgumentError
        A map that does not fit the stack, or that cannot be written in one piece; it is named.
    """
    for name, (size, dtype) in _expected(type(out), shape).items():
        found = getattr(out, name)
        if found is None:
            continue
        if not isinstance(found, np.ndarray) or found.shape != size or found.dtype != dtype:
            has = f"{getattr(found, 'dtype', type(found).__name__)} {np.shape(found)}"
            raise ArgumentError(
                f"out.{name}: expected {np.dtype(dtype)} {size} as this stack has it, found {has}"
            )
        if not (found.flags.c_contiguous and found.flags.writeable):
            raise ArgumentError(
                f"out.{name}: expected an array in one piece that may be written to; "
                "give the whole result of an earlier fit, not a part or a copy that is read-only"
            )
    for name in ZEROED:
        if getattr(out, name) is not None:
            getattr(out, name).fill(0)


def _expected(
    kind: type[Any], shape: tuple[int, int, int, int]
) -> dict[str, tuple[tuple[int, ...], type[np.generic]]]:
    """Shape and type of each map."""
    _, bands, height, width = shape
    planes = PLANES | {"band": bands}
    found: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {}
    for one in fields(kind):
        if dims := one.metadata["dims"]:
            size = (*(planes[dim] for dim in dims[:-2]), height, width)
            found[one.name] = (size, one.metadata["dtype"])
    return found

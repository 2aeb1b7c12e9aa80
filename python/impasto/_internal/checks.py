"""Numbers that an argument may hold: refused by the argument's name before anything is computed."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.casts import quiet_cast
from impasto.errors import ArgumentError

LEAST, MOST = 1e-30, 1e30
"""Factors outside leave the range of single precision (1.2e-38 to 3.4e38) as soon as a few of them
are multiplied: a picture would be black or infinite without a word."""

FARTHEST_MM = 1e15
"""Lengths are squared and cubed on the way; this one, a light hour, still leaves room for that."""


def suggestion(value: Any, names: Iterable[str]) -> str:
    """``; did you mean 'robust'?`` for a word that is nearly one of the names, else nothing."""
    near = difflib.get_close_matches(str(value), list(names), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def one_of(value: Any, names: Iterable[str], argument: str) -> None:
    """Refuse a word that is none of the names; one of them may be nearly it."""
    known = tuple(names)
    if not (isinstance(value, str) and value in known):
        expected = " or ".join(map(repr, known))
        hint = suggestion(value, known)
        raise ArgumentError(f"{argument}: expected {expected}, found {value!r}{hint}")


def number(value: Any, name: str, expected: str) -> float:
    """One real number (NaN and infinity are), never a text or a truth value."""
    if type(value) is float:
        return value
    try:
        if isinstance(value, str | bytes | bool | np.bool_) or np.ndim(value) != 0:
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ArgumentError(f"{name}: expected {expected}, found {value!r}") from error


def positive(
    value: Any, name: str, expected: str, least: float = LEAST, most: float = MOST
) -> float:
    """One positive number that single precision can carry through the computation."""
    found = number(value, name, expected)
    if not (math.isfinite(found) and found > 0):
        raise ArgumentError(f"{name}: expected {expected}, found {value!r}")
    if not least <= found <= most:
        raise ArgumentError(
            f"{name}: expected {expected} from {least:g} to {most:g}, found {found:g}"
        )
    return found


def reachable(levels: NDArray[np.float64], full: int) -> None:
    """Refuse codes of saturation that no integer reaches: nothing would count as clipped.

    Infinity says just that.
    """
    if (np.isfinite(levels) & (levels > full)).any():
        found = ", ".join(f"{one:g}" for one in np.unique(levels))
        raise ArgumentError(
            f"saturation: expected at most {full}, the largest code of {full.bit_length()} bits, "
            f"found {found}"
        )


def length_mm(value: Any, name: str) -> float:
    """A positive width in mm."""
    return positive(value, name, "a positive width in mm", 1.0 / FARTHEST_MM, FARTHEST_MM)


def numbers(values: Any, name: str, expected: str) -> NDArray[np.float64]:
    """An array of real numbers of any shape; texts are refused even where they look like one."""
    found = real(values, name, expected)
    with quiet_cast():
        return found.astype(np.float64)


def real(values: Any, name: str, expected: str) -> NDArray[Any]:
    """As :func:`numbers`, in the type that they have: the array itself where it is one."""
    try:
        found = np.asarray(values)
        if found.dtype.kind not in "fiubO":
            raise TypeError
        return found.astype(np.float64) if found.dtype.kind == "O" else found
    except (TypeError, ValueError, OverflowError) as error:
        raise ArgumentError(f"{name}: expected {expected}, found {values!r}") from error


def three_numbers(values: Any, name: str) -> list[float]:
    """Finite numbers that single precision holds as positions in mm."""
    # Searches make lamps by the ten thousand: an array of each takes longer than all else.
    plain = type(values) is tuple and [*map(type, values)] == [float] * 3
    array: Any = values if plain else numbers(values, name, "three numbers")
    vector: list[float] = [*values] if plain else array.tolist()
    if not (plain or array.shape == (3,)) or not all(map(math.isfinite, vector)):
        raise ArgumentError(f"{name}: expected three finite numbers, found {values!r}")
    if max(map(abs, vector)) > FARTHEST_MM:
        raise ArgumentError(
            f"{name}: expected numbers of at most {FARTHEST_MM:g}, found {values!r}; "
            "a light that far away is a DistantLight with a unit direction"
        )
    return vector


def unmasked(values: ArrayLike) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """The entries of an array, and where numpy's own mask leaves them out (None: nowhere)."""
    masked = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
    return np.asarray(values), masked if masked is not None and masked.any() else None


def instance(value: Any, kind: type, name: str, expected: str) -> None:
    """Refuse what is not of a kind, as where arguments are swapped, or a whole for its part."""
    if isinstance(value, kind):
        return
    parts = getattr(value, "__dict__", {}).items()
    hint = next((f"; give its .{part}" for part, held in parts if isinstance(held, kind)), "")
    raise ArgumentError(f"{name}: expected {expected}, found {type(value).__name__}{hint}")


def holding(parts: Iterable[str], value: Any, name: str, expected: str) -> None:
    """Refuse what lacks a part that the call reads."""
    if not all(hasattr(value, part) for part in parts):
        raise ArgumentError(f"{name}: expected {expected}, found {type(value).__name__}")


def is_whole(value: Any) -> TypeGuard[int]:
    """Whether it is a whole number, of Python or numpy; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def picked(chosen: Any, count: int, name: str, noun: str) -> list[int]:
    """Places from 0 on out of ``count``; negative numbers count from the end, as in a list."""
    whole = type(chosen) is np.ndarray and chosen.ndim == 1 and chosen.dtype.kind in "iu"
    try:
        entries = chosen.tolist() if whole else list(chosen)
    except TypeError:
        entries = [None]
    if not (whole or all(map(is_whole, entries))):
        mask = all(isinstance(entry, bool | np.bool_) for entry in entries)
        hint = "; np.flatnonzero makes numbers of True and False" if mask else ""
        raise ArgumentError(f"{name}: expected numbers of {noun}s, found {chosen!r}{hint}")
    if not entries:
        raise ArgumentError(f"{name}: expected at least one {noun}, found none")
    for entry in entries:
        if not -count <= entry < count:
            raise ArgumentError(
                f"{name}: expected numbers of {noun}s from 0 to {count - 1} (or {-count} to -1, "
                f"from the end), found {entry}"
            )
    return [int(entry) % count for entry in entries]


def truth(value: Any, name: str) -> bool:
    """True or False, and nothing that Python would take for one of them."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name}: expected True or False, found {value!r}")
    return bool(value)


def refractive_index(value: Any) -> float:
    """Of a varnish, a lacquer, a glass: 1 (no interface) to 100 (beyond any dielectric)."""
    expected = "a refractive index from 1 to 100"
    found = number(value, "index", expected)
    if not 1.0 <= found <= 100.0:
        raise ArgumentError(f"index: expected {expected}, found {value!r}")
    return found

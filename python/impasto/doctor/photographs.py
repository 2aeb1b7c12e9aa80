"""Duplicate photographs, and what reading had to repair."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto.doctor.diagnosis import Finding, named
from impasto.doctor.lights import angles_between
from impasto.stack import Stack

Floats = NDArray[np.float64]

_APART_DEG = 15.0
"""Only lights this far apart must give different photographs."""
_FEWEST = 6
_ALIKE, _NEVER = 0.25, 0.1
"""Two photographs are one if they differ by less than this share of what is usual, and than this
share of their variance."""

_ADVICE = {
    "missing": "copy the files to where the light file expects them, or say images=FOLDER",
    "match": "check the pairing of names and photographs; rename the files or correct the list",
    "unlisted": "if they belong to the stack, add lines for them to the light file",
    "length": "if these are positions in mm, use a .dome or .relight file, or lights=Rig(...)",
    "horizon": "check the sign of z",
    "duplicate": "take the second line out of the light file",
    "orientation": "export all photographs with the same orientation",
    "position": "say how wide a pixel is: pitch_mm=",
    "count": "correct the first line of the light file",
    "comma": "write decimal points",
}
_SERIOUS = frozenset({"missing", "position"})


def reading(stack: Stack) -> list[Finding]:
    """Everything that was repaired, dropped or assumed while the files were read."""
    found = []
    for note in stack.notes:
        kind, repair = str(getattr(note, "kind", "note")), bool(getattr(note, "repair", False))
        if kind == "encoding":
            continue  # the tone curve has a check of its own
        by_order = kind == "match" and "order alone" in str(note)
        serious = kind in _SERIOUS or by_order or (kind == "orientation" and "has" in str(note))
        worth = repair or kind in {"unlisted", "horizon", "duplicate", "orientation"}
        found.append(
            Finding(
                "reading",
                "warning" if serious else "note" if worth else "ok",
                str(note),
                _ADVICE.get(kind, "") if serious or worth else "",
                numbers={"kind": kind, "repair": repair},
            )
        )
    return found


def duplicates(stack: Stack, likeness: Floats | None) -> list[Finding]:
    """Photographs that are there twice: byte for byte or, if all have one view, saved again."""
    exact = _equal_samples(stack)
    found = [_told(stack, group, "the same samples") for group in exact]
    # How alike photographs are is foretold by their lights only where all look from one place.
    one_view = not _core.views_differ(RigArguments.of(stack.rig))
    if one_view and likeness is not None and len(likeness) >= _FEWEST:
        seen = {frozenset(pair) for group in exact for pair in _pairs(group)}
        for first, second, times in _alike(stack, likeness):
            if frozenset((first, second)) not in seen:
                how = f"one picture saved twice ({min(times, 999.0):.0f} times more alike than "
                how += "others under such lights)"
                found.append(_told(stack, (first, second), how))
    if not found:
        return [Finding("duplicates", "ok", "no photograph is there twice")]
    return found


def _told(stack: Stack, group: tuple[int, ...], how: str) -> Finding:
    apart = angles_between(stack.rig.directions[list(group)], stack.rig.directions[list(group)])
    names = named(stack.names, group)
    numbers: dict[str, Any] = {"lights_apart_deg": round(float(apart.max()), 2)}
    if apart.max() < 0.5:
        return Finding(
            "duplicates",
            "warning",
            f"{names}: {how}, under the same light: counted {len(group)} times",
            "take all but one of these lines out of the light file",
            group,
            numbers,
        )
    return Finding(
        "duplicates",
        "warning",
        f"{names}: {how}, with light directions up to {apart.max():.0f} degrees apart: at most one "
        "of these directions is right",
        "copy the photographs from the camera again, or take the wrong lines out of the light file",
        group,
        numbers,
    )


def _pairs(group: tuple[int, ...]) -> list[tuple[int, int]]:
    return [(a, b) for i, a in enumerate(group) for b in group[i + 1 :]]


def _equal_samples(stack: Stack) -> list[tuple[int, ...]]:
    """Groups of observations with equal samples; a few rows decide for most."""
    step = max(1, stack.shape[2] // 16)
    few: dict[bytes, list[int]] = defaultdict(list)
    for index in range(len(stack.rig)):
        few[_digest(stack.samples[index, :, ::step])].append(index)
    groups = []
    for candidates in few.values():
        if len(candidates) == 1:
            continue
        whole: dict[bytes, list[int]] = defaultdict(list)
        for index in candidates:
            whole[_digest(stack.samples[index])].append(index)
        # Photographs of one value throughout (a lamp that did not fire) are another fault.
        groups += [
            tuple(group)
            for group in whole.values()
            if len(group) > 1 and not _uniform(stack.samples[group[0]])
        ]
    return groups


def _uniform(samples: NDArray[np.generic]) -> bool:
    flat = samples.reshape(-1)
    return bool((flat == flat[0]).all()) or bool((flat != flat).all())


def _digest(samples: NDArray[np.generic]) -> bytes:
    return hashlib.blake2b(np.ascontiguousarray(samples).data, digest_size=16).digest()


def _alike(stack: Stack, likeness: Floats) -> list[tuple[int, int, float]]:
    """Pairs under far lights that are several times more alike than such photographs ever are.

    Measured against the other photographs of the stack: under its far lights a flat painting
    looks much the same in all of them, and that is no fault. Photographs of their own always
    differ by their noise.
    """
    apart = angles_between(stack.rig.directions, stack.rig.directions)
    distance = np.where(apart > _APART_DEG, 1.0 - likeness, np.inf)
    nearest = distance.min(axis=1)
    if not np.isfinite(nearest).any():
        return []
    usual = float(np.median(nearest[np.isfinite(nearest)]))
    limit = min(_ALIKE * usual, _NEVER)
    pairs = np.argwhere(np.triu(distance < limit, 1)).tolist()
    return [(a, b, usual / max(float(distance[a, b]), 1e-9)) for a, b in pairs]

"""Duplicate photographs, and repairs made while reading."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.wording import factor
from impasto.doctor.diagnosis import Finding, named
from impasto.doctor.lights import angles_between
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import fit_surface, shading
from impasto.stack import Stack

Floats = NDArray[np.float64]

_APART_DEG = 15.0
"""Only lights this far apart must give different photographs."""
SAME_LIGHT_DEG = 0.5
_FEWEST = 6
_ALIKE, _NEVER = 0.25, 0.1
"""Two photographs are copies if they differ by less than this share of the median difference, and
less than this share of their variance."""

_SAME, _LESS = 0.02, 0.3
"""Median difference between two files of one photograph at most, and as a share of what their
lights would make it."""

_ADVICE = {
    "missing": "copy the files to the folder that the light file names, or give images=FOLDER",
    "match": "check the pairing of names and photographs; rename the files or correct the list",
    "unlisted": "if they belong to the stack, add lines for them to the light file",
    "length": "if these are positions in mm, use a .dome or .relight file, or lights=Rig(...)",
    "horizon": "check the sign of z",
    "duplicate": "remove the second line from the light file",
    "orientation": "export all photographs with the same orientation",
    "position": "give the width of a pixel: pitch_mm=",
    "count": "correct the first line of the light file",
    "comma": "write decimal points instead of commas",
}
_SERIOUS = frozenset({"missing", "position"})


def reading(stack: Stack) -> list[Finding]:
    """Everything that was repaired, left out or assumed while the files were read."""
    found = []
    for note in stack.notes:
        kind, repair = str(getattr(note, "kind", "note")), bool(getattr(note, "repair", False))
        if kind == "encoding":
            continue  # the tone curve has its own check
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


def duplicates(stack: Stack, sampled: SampledTiles, similarity: Floats | None) -> list[Finding]:
    """Photographs that occur twice: byte for byte or, if all have one view, saved again."""
    exact = _equal_samples(stack)
    found = [_duplicate(stack, group, "the same samples", exact=True) for group in exact]
    # Lights determine the similarity of photographs only if all have one view.
    one_view = not _core.views_differ(RigArguments.of(stack.rig))
    if one_view and similarity is not None and len(similarity) >= _FEWEST:
        seen = {frozenset(pair) for group in exact for pair in _pairs(group)}
        for first, second, times in _copies(stack, sampled, similarity):
            if frozenset((first, second)) not in seen:
                how = f"one picture saved twice ({factor(times)} times more similar than "
                how += "others under such lights)"
                found.append(_duplicate(stack, (first, second), how))
    if not found:
        return [Finding("duplicates", "ok", "no photograph occurs twice")]
    return found


def _duplicate(stack: Stack, group: tuple[int, ...], how: str, *, exact: bool = False) -> Finding:
    apart = angles_between(stack.rig.directions[list(group)], stack.rig.directions[list(group)])
    names = named(stack.names, group)
    numbers: dict[str, Any] = {
        "lights_apart_deg": round(float(apart.max()), 2),
        "exact": exact,
    }
    if apart.max() < SAME_LIGHT_DEG:
        return Finding(
            "duplicates",
            "warning",
            f"{names}: {how}, under the same light: counted {len(group)} times",
            "remove all but one of these lines from the light file"
            + (" (impasto doctor --write FILE.lp does so)" if exact else ""),
            group,
            numbers,
        )
    return Finding(
        "duplicates",
        "warning",
        f"{names}: {how}, with light directions up to {apart.max():.0f} degrees apart: at most one "
        "of these directions is right",
        "copy the photographs from the camera again, or remove the wrong lines from the light file "
        "(impasto doctor --write FILE.lp leaves out all of them)"
        if exact
        else "copy the photographs from the camera again, or remove the wrong lines from the light "
        "file",
        group,
        numbers,
    )


def _pairs(group: tuple[int, ...]) -> list[tuple[int, int]]:
    return [(a, b) for i, a in enumerate(group) for b in group[i + 1 :]]


def _equal_samples(stack: Stack) -> list[tuple[int, ...]]:
    """Groups of observations with equal samples; a few rows exclude most of them."""
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
        # Photographs of a single value (a lamp that did not fire) are another fault.
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


def _copies(
    stack: Stack, sampled: SampledTiles, similarity: Floats
) -> list[tuple[int, int, float]]:
    """Pairs under distant lights that are several times more similar than other such pairs.

    The comparison is with the other photographs of this stack: a flat painting looks nearly the
    same under all of its lights, and that is no fault. Two exposures always differ by their
    noise.
    """
    apart = angles_between(stack.rig.directions, stack.rig.directions)
    distance = np.where(apart > _APART_DEG, 1.0 - similarity, np.inf)
    nearest = distance.min(axis=1)
    if not np.isfinite(nearest).any():
        return []
    usual = float(np.median(nearest[np.isfinite(nearest)]))
    limit = min(_ALIKE * usual, _NEVER)
    pairs = np.argwhere(np.triu(distance < limit, 1)).tolist()
    return [
        (a, b, usual / max(float(distance[a, b]), 1e-9)) for a, b in pairs if _equal(sampled, a, b)
    ]


def _equal(sampled: SampledTiles, a: int, b: int) -> bool:
    """Whether two photographs differ by less than their lights make them differ.

    A flat painting looks nearly the same under two lights: a surface fitted to the other
    photographs says how much they should differ.
    """
    both = [a, b]
    others = np.setdiff1d(np.arange(len(sampled.grey)), both)
    surface = fit_surface(sampled.grey[others], sampled.lights[others])
    shown = shading(surface, sampled.lights[both])
    found, expected = _difference(*sampled.grey[both]), _difference(*shown)
    return found < _SAME and found < _LESS * expected


def _difference(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Median difference of two photographs after a change of exposure, relative to their light."""
    known = np.isfinite(one) & np.isfinite(other) & (one > 0) & (other > 0)
    if known.sum() < _FEWEST:
        return 0.0
    ratio = np.log(one[known] / other[known])
    return float(np.median(np.abs(ratio - np.median(ratio))))

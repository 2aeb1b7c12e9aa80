"""Whether the lights can determine a surface: number, spread, repetition, horizon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.wording import counted
from impasto.doctor.diagnosis import Finding, named
from impasto.stack import Stack

Floats = NDArray[np.float64]

_GOOD = 6
_WEAK = _core.CONDITION_LIMIT / 3.0
"""A pixel that loses lights to highlight or shadow has a larger condition number than the rig: a
factor of three is left before it is ``ILL_CONDITIONED``. Beyond ``RANK_LIMIT`` every pixel is
``RANK_DEFICIENT``."""
_SAME_DEG = 0.5
_GRAZING_DEG = 5.0


CODES = frozenset({"lights", "conditioning", "coverage", "repeated-lights", "horizon"})
"""What :func:`lights` finds."""


def lights(stack: Stack) -> list[Finding]:
    """All checks of the directions alone."""
    directions = stack.rig.directions
    return [
        _number(stack),
        *_conditioning(directions),
        *_coverage(directions),
        *_repeated(stack),
        *_horizon(stack),
    ]


def elevation(directions: Floats) -> Floats:
    """Degrees above the painting; 90 is in front of it."""
    return np.degrees(np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])))


def azimuth(directions: Floats) -> Floats:
    """Degrees counter-clockwise from the right, 0 to 360."""
    return np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) % 360.0


def angles_between(one: Floats, other: Floats) -> Floats:
    """Degrees between each of ``(n, 3)`` and each of ``(m, 3)`` unit vectors."""
    # By the chord: accurate for small angles, where the arc cosine is not.
    chord = np.linalg.norm(one[:, None] - other[None], axis=2)
    return np.asarray(2.0 * np.degrees(np.arcsin(np.clip(chord / 2.0, 0.0, 1.0))))


def _number(stack: Stack) -> Finding:
    count = len(stack.rig)
    height = elevation(stack.rig.directions)
    numbers = {
        "count": count,
        "lowest_deg": round(float(height.min()), 2),
        "highest_deg": round(float(height.max()), 2),
    }
    span = f"at {height.min():.0f} to {height.max():.0f} degrees above the painting"
    if count < 3:
        return Finding(
            "lights",
            "error",
            f"{counted(count, 'light')}: a normal and an albedo need at least three",
            "photograph under more lights, best 16 or more all around the painting",
            numbers=numbers,
        )
    if count < _GOOD:
        exact = "exactly three lights leave no sample to detect highlights and shadows with"
        few = f"{count} lights leave too few samples to detect highlights and shadows reliably"
        return Finding(
            "lights",
            "warning" if count == 3 else "note",
            f"{exact if count == 3 else few} ({span})",
            "photograph under more lights, best 16 or more all around the painting",
            numbers=numbers,
        )
    return Finding("lights", "ok", f"{count} lights {span}", numbers=numbers)


def _conditioning(directions: Floats) -> list[Finding]:
    if len(directions) < 3:
        return []
    singular = np.linalg.svd(directions, compute_uv=False)
    condition = float(singular[0] / max(singular[2], 1e-12 * singular[0]))
    numbers = {"condition": round(condition, 3)}
    # Measured: half a percent of noise becomes about 0.1 degrees times the condition number.
    cost = f"half a percent of noise tilts a normal by about {0.1 * condition:.1f} degrees"
    if condition > _core.RANK_LIMIT:
        return [
            Finding(
                "conditioning",
                "error",
                f"the lights lie in one plane with the middle of the painting (condition number "
                f"{min(condition, 1e6):.0f}): the normals are not determined",
                "add a light outside this plane; for a ring, one straight in front of the painting",
                numbers=numbers,
            )
        ]
    if condition > _WEAK:
        return [
            Finding(
                "conditioning",
                "warning",
                f"the lights are close together or nearly in one plane (condition number "
                f"{condition:.1f}): {cost}",
                "spread the lights: 30 to 60 degrees above the painting, all around it",
                numbers=numbers,
            )
        ]
    return [
        Finding("conditioning", "ok", f"condition number {condition:.2f}: {cost}", numbers=numbers)
    ]


def _coverage(directions: Floats) -> list[Finding]:
    height = elevation(directions)
    tilted = np.sort(azimuth(directions[height < 80.0]))
    if len(directions) < 3 or len(tilted) < 2:
        return []
    gaps = np.diff(tilted, append=tilted[0] + 360.0)
    worst = int(gaps.argmax())
    gap, start = float(gaps[worst]), float(tilted[worst])
    numbers = {"largest_gap_deg": round(gap, 1), "gap_starts_at_deg": round(start, 1)}
    found = []
    if gap > 130.0:
        found.append(
            Finding(
                "coverage",
                "warning" if gap > 180.0 else "note",
                f"no light from {start:.0f} to {(start + gap) % 360.0:.0f} degrees (0 is right, "
                f"90 up): {gap:.0f} degrees of the circle are empty, and slopes that face them are "
                "in shadow or raking light only",
                "add lights on that side",
                numbers=numbers,
            )
        )
    if height.max() < 25.0:
        found.append(
            Finding(
                "coverage",
                "warning",
                f"all lights are low: the highest is {height.max():.0f} degrees above the "
                "painting, and cast shadows hide the surface behind every ridge",
                "add lights at 30 to 60 degrees",
                numbers={"highest_deg": round(float(height.max()), 2)},
            )
        )
    if not found:
        message = f"lights on all sides of the painting, the largest gap is {gap:.0f} degrees"
        found.append(Finding("coverage", "ok", message, numbers=numbers))
    return found


def _repeated(stack: Stack) -> list[Finding]:
    """Light and view both repeated: a rig with many views has the same light for each of them."""
    rig = stack.rig
    same = angles_between(rig.directions, rig.directions) < _SAME_DEG
    same &= angles_between(rig.views, rig.views) < _SAME_DEG
    # Each photograph is compared with the first like it: a lamp that never moved counts once for
    # each photograph after the first, not once for each pair.
    first = same.argmax(axis=1)
    again = np.flatnonzero(first < np.arange(len(first)))
    if len(again) == 0:
        return []
    pairs = np.stack([first[again], again], axis=1)
    earlier, later = (stack.names[i] for i in pairs[0])
    return [
        Finding(
            "repeated-lights",
            "note",
            f"{counted(len(again), 'photograph')} with the light and the view of an earlier one "
            f"(within {_SAME_DEG} degrees), first {later} with those of {earlier}: they add no "
            "direction",
            "harmless if intended; otherwise a line of the light file was copied and one of the "
            "two directions is wrong",
            tuple(np.unique(pairs).tolist()),
            numbers={"pairs": pairs.tolist()},
        )
    ]


def _horizon(stack: Stack) -> list[Finding]:
    height = elevation(stack.rig.directions)
    found = []
    below = np.flatnonzero(height < 0.0).tolist()
    # A single low lamp is a mistake in the file; most of them behind are wrong axes.
    behind = 2 * np.count_nonzero(height <= 0.0) > len(height)
    if below:
        found.append(
            Finding(
                "horizon",
                "error" if behind else "warning",
                f"{counted(len(below), 'light')} below the plane of the painting "
                f"({named(stack.names, below)}, lowest {height.min():.1f} degrees): no light can "
                "reach the front from there",
                "z points towards the viewer: check the axes and the sign of z in the light file"
                if behind
                else "check the sign of z in the light file, or leave these photographs out",
                tuple(below),
                numbers={"lowest_deg": round(float(height.min()), 2)},
            )
        )
    grazing = np.flatnonzero((height >= 0.0) & (height < _GRAZING_DEG)).tolist()
    if grazing:
        found.append(
            Finding(
                "horizon",
                "note",
                f"{counted(len(grazing), 'light')} less than {_GRAZING_DEG:.0f} degrees above the "
                f"painting ({named(stack.names, grazing)}): mostly cast shadow",
                "robust fits reject these samples; leave the photographs out to save time",
                tuple(grazing),
            )
        )
    return found

"""The light directions a diagnosis recommends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.doctor.diagnosis import Diagnosis, named
from impasto.doctor.photographs import SAME_LIGHT_DEG
from impasto.stack import Stack

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def repaired_directions(stack: Stack, diagnosis: Diagnosis) -> NDArray[np.float64]:
    """The stack's light directions with the repairs of a diagnosis.

    The list is put in order, exchanged directions are exchanged back, and all are mirrored or
    rotated. If the photographs allow two repairs that differ by 180 degrees, the first one is
    used: check the result by eye.

    Parameters
    ----------
    stack, diagnosis
        The argument of :func:`examine`, and its result.

    Returns
    -------
    ndarray
        ``(obs, 3)`` unit vectors, for :func:`impasto.io.write_lights` or ``read_stack(lights=)``.
    """
    directions = stack.rig.directions
    for finding in diagnosis.findings:
        if finding.code == "order" and "order" in finding.numbers:
            directions = directions[finding.numbers["order"]]
    for finding in diagnosis.findings:
        for first, second in finding.numbers.get("pairs", []) if finding.code == "pairing" else []:
            directions[[first, second]] = directions[[second, first]]
    for finding in diagnosis.findings:
        repair = finding.numbers.get("repair") if finding.code == "directions" else None
        if repair:
            directions = directions @ repair_matrix(repair).T
    return directions


def kept_observations(diagnosis: Diagnosis) -> list[int]:
    """The photographs that a light file should list.

    Of equal photographs under one light the first is kept; of equal photographs under different
    lights none, for nobody knows which of the lights is right.

    Parameters
    ----------
    diagnosis
        The result of :func:`examine`.

    Returns
    -------
    list
        Indices, in order.
    """
    out: set[int] = set()
    for finding in diagnosis.findings:
        if finding.code == "duplicates" and finding.numbers.get("exact"):
            apart = finding.numbers["lights_apart_deg"] >= SAME_LIGHT_DEG
            out |= set(finding.observations[0 if apart else 1 :])
    return [index for index in range(len(diagnosis.names)) if index not in out]


def repairs(diagnosis: Diagnosis) -> tuple[list[str], set[str]]:
    """What a light file of the repaired directions puts right, in words, and the codes of it."""
    words, codes = [], set()
    for finding in diagnosis.findings:
        numbers, names = finding.numbers, diagnosis.names
        found: list[str] = []
        if finding.code == "order" and "order" in numbers:
            found = ["the lights are in the order of the photographs"]
        elif finding.code == "pairing":
            pairs = [f"{names[a]} and {names[b]}" for a, b in numbers.get("pairs", [])]
            found = [f"the directions of {pair} are exchanged" for pair in pairs]
        elif finding.code == "directions" and numbers.get("repair"):
            found = [f"{numbers['repair']} replaces each direction (x, y, z)"]
        if found:
            words += found
            codes.add(finding.code)
    kept = set(kept_observations(diagnosis))
    left_out = [index for index in range(len(diagnosis.names)) if index not in kept]
    if left_out:
        words.append(f"{named(diagnosis.names, left_out)} left out")
        codes.add("duplicates")
    return words, codes


def repair_matrix(text: str) -> NDArray[np.float64]:
    """``(3, 3)`` of a repair such as ``"(x, -y, z)"``."""
    words = text.strip("()").split(", ")
    rows = [np.multiply(_AXES[word[-1]], -1.0 if word.startswith("-") else 1.0) for word in words]
    return np.array(rows)

"""The faults that spoil a fit, found in a small part of its time.

A sample of the pixels and photographs is examined. Only if anything stands out there,
:func:`impasto.doctor.examine` decides, so that this check has no false alarms of its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto.doctor.diagnosis import Diagnosis, Finding
from impasto.doctor.directions import directions
from impasto.doctor.examination import examine, surface_of
from impasto.doctor.lights import CODES, lights
from impasto.doctor.order import order
from impasto.doctor.pairing import measure_similarity, pairing
from impasto.doctor.photographs import SAME_LIGHT_DEG, duplicates
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import shading
from impasto.errors import ArgumentError, ImpastoWarning
from impasto.stack import Stack

_PHOTOGRAPHS = 24
"""Photographs of which a surface is fitted, to test its curl."""
_RELIEF_SAMPLES = 480_000
"""Pixels of these photographs, times their number."""
_CURLED = 0.8
"""The curl under other lights, as a share of that under the given ones, that calls for a closer
look."""
_MANY = 9
"""Lights from which on a significant curl suffices."""
_PIXELS = 2_500
"""Pixels of every photograph that are compared with those of the others."""
_EIGHT_BITS = 255.0
_DIFFER = 0.01
"""Share of the light by which two photographs differ at least if their lights are to matter."""


def before_fit(stack: Stack) -> Diagnosis:
    """Faults that spoil a fit, and lights that are too few or too much alike for a good one.

    Takes about 1 % of the time of a fit of one megapixel if there are none.

    Parameters
    ----------
    stack
        As for :func:`impasto.fit_sbrdf`.

    Returns
    -------
    Diagnosis
        No findings as a rule. Errors are mirrored, rotated and shifted lights, exchanged
        photographs, and photographs that occur under two lights, also where
        :func:`impasto.doctor.examine` only warns of them. The directions alone have the severities
        that they have there; lights that fit no better than in random order are a warning.
    """
    some, warned = _suspicious(stack)
    found = [f for f in lights(stack) if f.severity in {"warning", "error"}] + warned
    if some:
        every = examine(stack).of("warning", "error")
        found += [replace(f, severity="error") for f in every if _spoils(stack, f)]
    return Diagnosis(tuple(found), stack.names, stack.shape)


def refuse_faults(diagnosis: Diagnosis) -> None:
    """Raise an error if :func:`before_fit` has found any, and warn the caller's caller of the rest.

    Raises
    ------
    ArgumentError
        With the findings, and how to go on.
    """
    if spoiling(diagnosis):
        words = f"{_words(diagnosis.findings)}; impasto.doctor.examine(stack) says more"
        raise ArgumentError(f"stack: {words}, check=False fits it as it is")
    if diagnosis.findings:
        words = f"stack: {_words(diagnosis.findings)}"
        warnings.warn(words, ImpastoWarning, stacklevel=3)


def spoiling(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """What a fit must not begin with, of all that :func:`before_fit` has found.

    Of lights that determine no normals the fit itself says so, pixel by pixel.
    """
    return tuple(finding for finding in diagnosis.of("error") if finding.code not in CODES)


def _words(findings: Sequence[Finding]) -> str:
    return "; ".join(f"{finding.message} ({finding.advice})" for finding in findings)


def _suspicious(stack: Stack) -> tuple[bool, list[Finding]]:
    """Whether a sample of the stack shows any of the faults; and what it warns of."""
    sampled = SampledTiles.of(stack, most=_PIXELS)
    if surface_of(sampled, stack.rig.directions) is None or _is_black(stack, sampled):
        return False, []
    similarity = measure_similarity(sampled)
    one_view = not _core.views_differ(RigArguments.of(stack.rig))
    orders = order(sampled, one_view=one_view)[0]
    warned = [finding for finding in orders if finding.severity == "warning"]
    found = [
        *duplicates(stack, sampled, similarity),
        *orders,
        *pairing(stack, sampled, similarity),
    ]
    if any(_spoils(stack, finding) for finding in found):
        return True, warned
    count = len(stack.rig)
    some = np.unique(np.linspace(0, count - 1, min(count, _PHOTOGRAPHS)).astype(int)).tolist()
    relief = SampledTiles.of(stack, photographs=some, most=_RELIEF_SAMPLES // len(some))
    surface = surface_of(relief, stack.rig.directions[some])
    if surface is None:
        return False, warned
    (finding,) = directions(relief, surface, stack.rig.directions[some]) or (None,)
    curled = finding is not None and (_spoils(stack, finding) or _undecided(finding))
    return curled, warned


def _is_black(stack: Stack, sampled: SampledTiles) -> bool:
    """Whether half of the light is below three codes of eight bits: steps of codes, no picture."""
    if stack.encoding.white != _EIGHT_BITS:
        return False
    least = float(stack.encoding.decode(3.0)) / float(np.median(stack.rig.intensities))
    return bool(np.nanmedian(sampled.grey) < least)


def _undecided(finding: Finding) -> bool:
    """Whether other lights fit the relief better, if not beyond doubt."""
    names = ("curl_mirrored", "curl_quarter_rotation", "curl_axes_swapped")
    return any(finding.numbers.get(name, 1.0) < _CURLED for name in names)


def _spoils(stack: Stack, finding: Finding) -> bool:
    """Whether a fit must not go on with what a finding is about."""
    if finding.severity not in {"warning", "error"}:
        return False
    if finding.code == "directions":
        return finding.severity == "error" and _clear(stack, finding)
    if finding.code == "order":
        return finding.severity == "error"
    if finding.code == "pairing":
        return not _core.views_differ(RigArguments.of(stack.rig))
    return finding.code == "duplicates" and _lights_matter(stack, finding)


def _clear(stack: Stack, finding: Finding) -> bool:
    """Whether the directions named have less than half of the curl, if there are few lights.

    Then the curl of gloss and shadow, which no light rejects, exceeds that of noise.
    """
    numbers = finding.numbers
    names = ("curl_mirrored", "curl_quarter_rotation", "curl_axes_swapped")
    least = min(numbers[name] for name in names)
    return len(stack.rig) >= _MANY or least < 0.5


def _lights_matter(stack: Stack, finding: Finding) -> bool:
    """Whether the lights of equal photographs are too different for this surface to hide it.

    Simulated photographs of a plane without noise are equal under all lights of one height.
    """
    numbers = finding.numbers
    if not (numbers.get("exact") and numbers["lights_apart_deg"] >= SAME_LIGHT_DEG):
        return False
    sampled = SampledTiles.of(stack, most=_PIXELS)
    surface = surface_of(sampled, stack.rig.directions)
    if surface is None:
        return False
    lights = sampled.lights[list(finding.observations)]
    shown: NDArray[Any] = shading(surface, lights)
    apart = np.nanmedian(np.ptp(shown, axis=0) / np.maximum(np.abs(shown).max(axis=0), 1e-30))
    return bool(apart > _DIFFER)

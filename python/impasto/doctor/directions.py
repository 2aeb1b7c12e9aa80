"""Whether the light directions are mirrored or rotated, by curl and fall-off."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import factor, scatter
from impasto.doctor.curl import RATIO, Curl, measure_curl
from impasto.doctor.diagnosis import Finding, Severity
from impasto.doctor.falloff import FallOff, measure_falloff
from impasto.doctor.sampled_tiles import SampledTiles

Floats = NDArray[np.float64]

_FEWEST = 4
_NEAR_DEG, _SLIGHT_DEG = 20.0, 12.0
"""Rotations this close to a multiple of 90 degrees count as one; smaller ones are not reported."""

_ROTATED_DEG = 45.0

_REPAIRS = {
    (0, True): ("mirrored top to bottom (y counted downwards?)", "(x, -y, z)"),
    (180, True): ("mirrored left to right", "(-x, y, z)"),
    (90, True): ("x and y are swapped", "(y, x, z)"),
    (-90, True): ("x and y are swapped and negated", "(-y, -x, z)"),
    (90, False): ("rotated by 90 degrees counter-clockwise", "(y, -x, z)"),
    (-90, False): ("rotated by 90 degrees clockwise", "(-y, x, z)"),
    (180, False): ("rotated by 180 degrees", "(-x, -y, z)"),
}
"""The fault of the given lights, and the lights (x, y, z) to use instead."""


def directions(sampled: SampledTiles, surface: Floats, listed: Floats) -> list[Finding]:
    """Check all light directions together.

    Parameters
    ----------
    sampled, surface
        The pixels examined, and the surface fitted to them ``(3, n)``.
    listed
        ``(obs, 3)``.
    """
    if len(listed) < 3:
        return []
    if len(listed) < _FEWEST:
        return [_undecided("three lights leave no sample to reject gloss with", {})]
    curl, falloff = measure_curl(sampled, surface), measure_falloff(sampled, listed)
    if not curl.known:
        return [_undecided("there is too little relief", {})]
    numbers = _numbers(curl, falloff)
    given = (0.0, False)
    others = [(90.0, False), (0.0, True), (90.0, True)]
    if all(curl.beats(given, other) for other in others) and abs(curl.best_rotation(False)) < 45.0:
        return [_straight(curl, falloff, numbers)]
    rivals = [(curl.best_rotation(m), m) for m in (False, True)]
    best = min(rivals, key=lambda rival: curl.of(*rival))
    other = rivals[1 - rivals.index(best)]
    if curl.beats(best, given) and curl.beats(best, other):
        return [_wrong(best, falloff, numbers)]
    return [_undecided(_ratios(numbers), numbers)]


def _straight(curl: Curl, falloff: FallOff, numbers: dict[str, Any]) -> Finding:
    message = f"the light directions fit the relief: {_ratios(numbers)}"
    if falloff.decided and not falloff.is_mirrored:
        if abs(falloff.rotation_deg) > 180.0 - 45.0:
            return Finding(
                "directions",
                "warning",
                f"{message}; but each lamp lights the opposite side of the picture more (by "
                f"{scatter(falloff.strength)} across): the directions are rotated by "
                "180 degrees, or the painting is hollow",
                "compare a photograph with its line in the light file; if the lamp was on the "
                f"other side, {_use('(-x, -y, z)')}",
                numbers=numbers,
            )
        if abs(falloff.rotation_deg) < 45.0:
            message += (
                "; each lamp also lights its own side more, so they are not rotated by 180 degrees"
            )
    turn = curl.best_rotation(False)
    if abs(turn) > _SLIGHT_DEG and curl.beats((turn, False), (0.0, False)):
        return Finding(
            "directions",
            "warning",
            f"the lights seem to be rotated by about {turn:.0f} degrees (counter-clockwise): "
            f"{_ratios(numbers)}",
            "check the orientation of the camera when the directions were measured",
            numbers=numbers,
        )
    return Finding("directions", "ok", message, numbers=numbers)


def _wrong(best: tuple[float, bool], falloff: FallOff, numbers: dict[str, Any]) -> Finding:
    turn, mirrored = best
    certain = falloff.decided and falloff.is_mirrored == mirrored
    if certain and np.cos(np.radians(falloff.rotation_deg - turn)) < 0.0:
        turn += 180.0
    nearest = int(90 * round(turn / 90.0))
    nearest = (nearest + 180) % 360 - 180 or 0
    nearest = 180 if nearest == -180 else nearest
    if abs(turn - 90 * round(turn / 90.0)) > _NEAR_DEG or (nearest, mirrored) not in _REPAIRS:
        kind = "mirrored and rotated" if mirrored else "rotated"
        what = f"the light directions are {kind}, by about {turn:.0f} degrees"
        advice = "measure the directions again, or check the orientation of the camera then"
        numbers |= {"verdict": kind}
        # A rotation by less than an eighth costs accuracy only.
        severity: Severity = "error" if mirrored or abs(turn) > _ROTATED_DEG else "warning"
        return Finding("directions", severity, f"{what}: {_ratios(numbers)}", advice, (), numbers)
    what, repair = _REPAIRS[nearest, mirrored]
    numbers |= {"verdict": what, "repair": repair}
    message = f"the light directions are wrong: {what}"
    advice = _use(repair)
    if not certain:
        other = nearest - 180 if nearest > 0 else nearest + 180
        twin, twin_repair = _REPAIRS[other, mirrored]
        numbers |= {"alternative": twin, "alternative_repair": twin_repair}
        message += f", or {twin}"
        advice += f"; if hollows then look like bumps, it is {twin_repair}"
    return Finding("directions", "error", f"{message}. {_ratios(numbers)}", advice, (), numbers)


def in_doubt(finding: Finding) -> Finding:
    """The finding where lights in random order fit as well: they seem turned, too.

    There is no repair then that could be written without a look at the list.
    """
    if finding.severity != "error":
        return finding
    numbers = dict(finding.numbers)
    numbers.pop("alternative_repair", None)
    repair = numbers.pop("repair", None)
    then = f"use {repair} in place of each direction (x, y, z)" if repair else finding.advice
    advice = f"make sure of the order first: lights in random order seem turned, too; then {then}"
    return replace(finding, advice=advice, numbers=numbers)


def _use(repair: str) -> str:
    return (
        f"use {repair} in place of each direction (x, y, z) of the light file; "
        "impasto doctor --write FILE.lp does so"
    )


def _undecided(why: str, numbers: dict[str, Any]) -> Finding:
    return Finding(
        "directions",
        "ok",
        f"cannot check whether the light directions are mirrored or rotated: {why}",
        "compare one photograph with its line in the light file by eye",
        numbers=numbers | {"verdict": "undecided"},
    )


def _numbers(curl: Curl, falloff: FallOff) -> dict[str, Any]:
    base = curl.of(0.0, False)
    return {
        "verdict": "as given",
        "curl_mirrored": round(curl.of(0.0, True) / base, 3),
        "curl_quarter_rotation": round(curl.of(90.0, False) / base, 3),
        "curl_axes_swapped": round(curl.of(90.0, True) / base, 3),
        "curl_best_rotation_deg": round(curl.best_rotation(False), 1),
        "needed_ratio": RATIO,
        "falloff_strength": round(falloff.strength, 4),
        "falloff_coherence": round(max(falloff.straight, falloff.mirrored), 3),
        "falloff_decided": falloff.decided,
        "falloff_mirrored": falloff.is_mirrored,
        "falloff_rotation_deg": round(falloff.rotation_deg, 1),
    }


def _ratios(numbers: dict[str, Any]) -> str:
    return (
        f"mirrored, they have {_times(numbers['curl_mirrored'])} times the curl, rotated by "
        f"90 degrees {_times(numbers['curl_quarter_rotation'])}, with x and y swapped "
        f"{_times(numbers['curl_axes_swapped'])} times"
    )


def _times(ratio: float) -> str:
    return factor(ratio) if ratio > 10.0 else f"{ratio:.2f}"

"""What EXIF says of a sequence of photographs: equal exposure, one camera, order and time."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from statistics import median

from impasto._internal.wording import counted
from impasto.doctor import Finding
from impasto.doctor.diagnosis import named
from impasto.io.images.exif import Exif

_EQUAL = 0.02
"""Relative difference of exposures that counts as none: cameras round 1/127 s to 1/125 s."""
_FEW_LATE = 0.25
"""More photographs than this share are no single ones out of order: the clock was set."""
_PAUSE_S, _PAUSES = 600.0, 10.0
"""A pause is longer than ten minutes, and than ten times the usual interval."""


def sequence(names: Sequence[str], exif: Sequence[Exif], *, equalised: bool) -> list[Finding]:
    """Compare what the camera has written about each photograph.

    Parameters
    ----------
    names
        Of the photographs, in the order in which they should have been taken.
    exif
        Of each; what is not stated is not compared.
    equalised
        Whether strengths of the lights or a white board for each light make up for exposures.

    Returns
    -------
    list
        Findings with the codes ``exif``, ``camera``, ``exposure``, ``order`` and ``clock``.
    """
    if not any(exif_of != Exif() for exif_of in exif):
        return [
            Finding(
                "exif",
                "note",
                "the photographs have no EXIF: exposures, order and times cannot be compared",
                "keep the files of the camera beside those that were exported without EXIF",
            )
        ]
    return [*_camera(names, exif), *_exposure(names, exif, equalised), *_times(names, exif)]


def longest_increasing(values: Sequence[float]) -> list[int]:
    """Places of a longest strictly increasing subsequence, by patience sorting.

    [@fredman1975computing]; ``n log n`` comparisons.
    """
    tails: list[float] = []
    ends: list[int] = []
    before: list[int] = []
    for place, value in enumerate(values):
        pile = bisect_left(tails, value)
        before.append(ends[pile - 1] if pile else -1)
        if pile == len(tails):
            tails.append(value)
            ends.append(place)
        else:
            tails[pile], ends[pile] = value, place
    found = []
    place = ends[-1] if ends else -1
    while place >= 0:
        found.append(place)
        place = before[place]
    return found[::-1]


def _camera(names: Sequence[str], exif: Sequence[Exif]) -> list[Finding]:
    found = []
    for noun, values in (
        ("cameras", [one.camera for one in exif]),
        ("focal lengths", [one.focal_length_mm for one in exif]),
    ):
        stated = [value for value in values if value is not None]
        if len(set(stated)) < 2:
            continue
        usual = max(stated, key=stated.count)
        odd = tuple(i for i, one in enumerate(values) if one is not None and one != usual)
        unit = "" if isinstance(usual, str) else " mm"
        found.append(
            Finding(
                "camera",
                "error",
                f"different {noun}: {named(names, odd)} with {values[odd[0]]}{unit}, the others "
                f"with {usual}{unit}",
                "all photographs of a stack come from one camera and lens at one setting; take "
                "these again",
                odd,
            )
        )
    if not found and (camera := next((one.camera for one in exif if one.camera), None)):
        found.append(Finding("camera", "ok", f"one camera, {camera}"))
    return found


def _exposure(names: Sequence[str], exif: Sequence[Exif], equalised: bool) -> list[Finding]:
    times = {i: one.exposure_s for i, one in enumerate(exif) if one.exposure_s is not None}
    if not times:
        return []
    light = {i: time * _gain(exif[i]) for i, time in times.items()}
    usual = median(light.values())
    odd = tuple(i for i, value in light.items() if abs(value / usual - 1.0) > _EQUAL)
    if not odd:
        shown = f"{1000.0 * next(iter(times.values())):.4g} ms"
        count = counted(len(light), "photograph")
        return [Finding("exposure", "ok", f"equal exposure of {count}, {shown}")]
    relative = {names[i]: round(value / usual, 4) for i, value in light.items()}
    first = odd[0]
    message = (
        f"exposure of {named(names, odd)} differs: {light[first] / usual:.3g} times the usual "
        f"one, by time, f-number and sensitivity ({1000.0 * times[first]:.4g} ms)"
    )
    if equalised:
        return [
            Finding(
                "exposure", "note", f"{message}; strengths or boards make up for it", "", odd,
                {"relative": relative},
            )
        ]  # fmt: skip
    return [
        Finding(
            "exposure",
            "error",
            message,
            "take these again; or, of linear files, write the strengths of the lights times "
            "these exposures into lights.intensities (impasto session check --json lists them)",
            odd,
            {"relative": relative},
        )
    ]


def _gain(exif: Exif) -> float:
    """Light per second of exposure on the scale of the codes; unknown factors are 1."""
    aperture = 1.0 if exif.f_number is None else exif.f_number**-2
    return aperture * (1.0 if exif.iso is None else exif.iso)


def _times(names: Sequence[str], exif: Sequence[Exif]) -> list[Finding]:
    """Order by time against the order by name, and gaps."""
    known = [(i, one.taken) for i, one in enumerate(exif) if one.taken is not None]
    if len(known) < 2:
        return []
    start = known[0][1]
    seconds = [(when - start).total_seconds() for _, when in known]
    # Photographs of the same second may have any order.
    kept = set(longest_increasing([s + 1e-7 * n for n, s in enumerate(seconds)]))
    late = [n for n in range(len(known)) if n not in kept]
    descents = [n for n in range(1, len(known)) if seconds[n] < seconds[n - 1]]
    if late and (len(descents) > 1 or len(late) <= max(1.0, _FEW_LATE * len(known))):
        places = tuple(known[n][0] for n in late)
        return [
            Finding(
                "order",
                "warning",
                f"{counted(len(late), 'photograph')} out of order: {named(names, places)}, by the "
                "times of the camera against the names",
                "compare their lights with the light file: a photograph that was taken again has "
                "a later time, a renamed one another light",
                places,
            )
        ]
    found = [Finding("order", "ok", "names and times are in the same order")]
    if late:
        n = descents[0]
        return [
            Finding(
                "clock",
                "warning",
                f"the clock goes back {_duration(seconds[n - 1] - seconds[n])} between "
                f"{_pair(names, known, n)}",
                "the clock of the camera was set, or the numbers of its files began anew: see "
                "that the order of the names is that of the lights",
                (known[n - 1][0], known[n][0]),
            )
        ]
    steps = [b - a for a, b in pairwise(seconds)]
    limit = max(_PAUSE_S, _PAUSES * median(steps))
    for n, step in enumerate(steps, 1):
        if step > limit:
            found.append(
                Finding(
                    "clock",
                    "warning",
                    f"a pause of {_duration(step)} between {_pair(names, known, n)}, usually "
                    f"{_duration(median(steps))}",
                    "see that camera and painting were not moved in between, and that the lamps "
                    "were warm again",
                    (known[n - 1][0], known[n][0]),
                )
            )
    return found


def _pair(names: Sequence[str], known: Sequence[tuple[int, datetime]], n: int) -> str:
    return f"{names[known[n - 1][0]]} and {names[known[n][0]]}"


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60.0)
    if minutes < 120:
        return f"{minutes} min"
    hours = round(seconds / 3600.0)
    return f"{hours} h" if hours < 48 else f"{round(hours / 24)} days"

"""A plan of shots: which lamp, which exposures, which pose, in which order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole, suggestion
from impasto.capture.devices import Pose, Vector
from impasto.errors import ArgumentError
from impasto.io.lights import LightFile
from impasto.rig import FRONTAL

Kind = Literal["photograph", "dark", "board", "reference"]
_LONGEST_NAME = 80
LEAST_STEP = 1.05
"""Between two exposures of a bracket: below it the camera may have the same time for both."""


@dataclass(frozen=True)
class Shot:
    """One photograph to take.

    Parameters
    ----------
    name
        Of its file, without an ending.
    kind
        ``"photograph"``; ``"dark"``: all lamps off; ``"board"``: a white board in place of the
        painting; ``"reference"``: the painting under always the same lamp, to see a lamp drift or a
        camera move.
    lamp
        Its number from 1 on, in the order of the plan's lamps; None for dark frames.
    exposure_s
        Exposure time, seconds.
    pose
        Of stage, camera and lamp.
    bracket
        Name of the photograph of which this is one exposure of several; None: it is whole.
    """

    name: str
    kind: Kind
    lamp: int | None
    exposure_s: float
    pose: Pose = field(default_factory=Pose)
    bracket: str | None = None

    @property
    def photograph(self) -> str:
        """The name of the photograph that it is, or is one exposure of."""
        return self.name if self.bracket is None else self.bracket


def exposed(
    name: str,
    kind: Kind,
    lamp: int | None,
    exposures_s: Sequence[float],
    pose: Pose | None = None,
) -> tuple[Shot, ...]:
    """The shots of one photograph: itself, or an exposure bracket, the shortest first.

    The exposures of a bracket are shots of their own, ``name-1`` and so on, each of which is
    checked and taken again by itself.
    """
    pose = Pose() if pose is None else pose
    if len(exposures_s) == 1:
        return (Shot(name, kind, lamp, exposures_s[0], pose),)
    return tuple(
        Shot(f"{name}-{number}", kind, lamp, seconds, pose, name)
        for number, seconds in enumerate(sorted(exposures_s), 1)
    )


@dataclass(frozen=True, eq=False)
class ShotPlan:
    """Lamps and shots, in the order in which they are taken.

    Parameters
    ----------
    shots
        All of them; names differ.
    directions
        ``(n, 3)`` unit vectors to the lamps; lamp 1 is the first.
    positions_mm
        ``(n, 3)`` of near lamps, mm from the middle of the painting; else None.

    Raises
    ------
    ArgumentError
        Equal names, a lamp that is not there, a dark frame with a lamp, a name that is no name of a
        file, an exposure that is not positive, or a bracket that is none.
    """

    shots: tuple[Shot, ...]
    directions: NDArray[np.float64]
    positions_mm: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if not self.shots:
            raise ArgumentError("shots: expected at least one shot, found none")
        twice = [name for name, count in Counter(s.name.casefold() for s in self.shots).items()
                 if count > 1]  # fmt: skip
        if twice:
            raise ArgumentError(f"shots: {twice[0]!r} is the name of several shots; name each once")
        for shot in self.shots:
            _check_shot(shot, len(self.directions))
        _check_brackets(self)

    def __len__(self) -> int:
        return len(self.shots)

    def __iter__(self) -> Iterator[Shot]:
        return iter(self.shots)

    def light_of(self, shot: Shot) -> Vector | None:
        """The direction to the lamp of a shot; None for dark frames."""
        if shot.lamp is None:
            return None
        if shot.pose.light is not None:
            return shot.pose.light
        x, y, z = self.directions[shot.lamp - 1].tolist()
        return x, y, z

    def of(self, *kinds: Kind) -> tuple[Shot, ...]:
        """The shots of some kinds."""
        return tuple(shot for shot in self.shots if shot.kind in kinds)

    def photographs(self) -> dict[str, tuple[Shot, ...]]:
        """The shots of each photograph of the painting, by its name, in their order."""
        found: dict[str, list[Shot]] = {}
        for shot in self.of("photograph"):
            found.setdefault(shot.photograph, []).append(shot)
        return {name: tuple(shots) for name, shots in found.items()}

    def joints(self) -> tuple[str, ...]:
        """Names of the joints that any shot sets, in the order of the plan."""
        return tuple(dict.fromkeys(name for shot in self.shots for name in shot.pose.angles))


def exposures_of(exposure_s: float | Sequence[float]) -> tuple[float, ...]:
    """One exposure time or several, in seconds, the shortest first.

    Raises
    ------
    ArgumentError
        None at all.
    """
    given = (exposure_s,) if isinstance(exposure_s, int | float) else tuple(exposure_s)
    if not given:
        raise ArgumentError("exposure_s: expected one exposure time or more, found none")
    return tuple(sorted(given))


def plan_shots(
    lights: LightFile,
    *,
    exposure_s: float | Sequence[float] = 0.01,
    darks: int = 3,
    references: int = 20,
) -> ShotPlan:
    """The usual plan of a light file: dark frames, then each lamp once, with reference shots.

    The reference lamp is that which stands most in front: it lights all slopes, and casts the least
    shadow.

    Parameters
    ----------
    lights
        From :func:`impasto.io.read_lights`. Photographs have its names, or ``shot_001`` and so on.
    exposure_s
        Exposure time of all shots, seconds; several: an exposure bracket of each photograph, such
        as :func:`exposures_from_pilot` finds. Dark frames have the longest, reference shots the
        longest but one, in which diffuse reflection is exact enough, and less clips.
    darks
        How many dark frames, at the beginning; their noise is averaged.
    references
        A reference shot before every so many photographs, and one at the end; 0: none.

    Raises
    ------
    ArgumentError
        Numbers that are not whole, or names of files that become equal without their endings.
    """
    for name, value in (("darks", darks), ("references", references)):
        if not is_whole(value) or value < 0:
            raise ArgumentError(f"{name}: expected a whole number from 0 on, found {value!r}")
    exposures = exposures_of(exposure_s)
    count = len(lights)
    frontal = int(np.argmax(lights.directions @ np.asarray(FRONTAL))) + 1
    names = [f"shot_{number:03}" for number in range(1, count + 1)]
    if lights.names is not None:
        names = [PurePosixPath(name.replace("\\", "/")).stem for name in lights.names]
    shots = [Shot(f"dark_{n:03}", "dark", None, exposures[-1]) for n in range(1, darks + 1)]
    taken = 0

    def reference() -> Shot:
        return Shot(f"reference_{taken + 1:03}", "reference", frontal, exposures[-2:][0])

    for number, name in enumerate(names):
        view = None if lights.views is None else unit_vector(lights.views[number])
        if references and number % references == 0:
            shots.append(reference())
            taken += 1
        shots += exposed(name, "photograph", number + 1, exposures, Pose(view=view))
    if references:
        shots.append(reference())
    return ShotPlan(tuple(shots), lights.directions, lights.positions)


def unit_vector(value: NDArray[np.float64]) -> Vector:
    """A direction of length 1; one that has it stays as it is, bit for bit."""
    length = float(np.linalg.norm(value))
    if not length > 0:
        raise ValueError("a direction of length 0")
    x, y, z = (value if abs(length - 1.0) < 1e-12 else value / length).tolist()
    return x, y, z


def _check_brackets(plan: ShotPlan) -> None:
    """Exposures of a bracket differ in nothing but their time."""
    names = {shot.name for shot in plan.shots}
    for shot in plan.shots:
        if shot.bracket is None:
            continue
        if shot.kind != "photograph":
            raise ArgumentError(
                f"shots: {shot.bracket!r} has several exposures, which are for photographs of the "
                f"painting; give one for a shot of kind {shot.kind}"
            )
        if shot.bracket in names:
            raise ArgumentError(f"shots: {shot.bracket!r} is the name of several shots")
    for name, shots in plan.photographs().items():
        first = shots[0]
        if first.bracket is None:
            continue
        if any((one.lamp, one.pose) != (first.lamp, first.pose) for one in shots):
            raise ArgumentError(f"shots: the exposures of {name!r} differ in lamp or pose")
        times = sorted(one.exposure_s for one in shots)
        if any(longer < LEAST_STEP * shorter for shorter, longer in pairwise(times)):
            raise ArgumentError(
                f"shots: {name!r} has the exposures {', '.join(f'{t:g}' for t in times)} s; each "
                f"must be {LEAST_STEP:g} times the one before it, or more"
            )


def _check_shot(shot: Shot, lamps: int) -> None:
    where = f"shots: {shot.name!r}"
    odd = not shot.name or shot.name != PurePosixPath(shot.name).name or shot.name.startswith(".")
    if odd or any(c in '\\:*?"<>|\0\n' for c in shot.name) or len(shot.name) > _LONGEST_NAME:
        raise ArgumentError(f"{where} is no name of a file; use letters, digits, - and _")
    if shot.kind not in get_args(Kind):
        hint = suggestion(shot.kind, get_args(Kind))
        raise ArgumentError(
            f"{where}: expected a kind of {', '.join(get_args(Kind))}, found {shot.kind!r}{hint}"
        )
    if not (np.isfinite(shot.exposure_s) and shot.exposure_s > 0):
        raise ArgumentError(f"{where}: expected a positive exposure, found {shot.exposure_s!r}")
    if shot.kind == "dark":
        if shot.lamp is not None:
            raise ArgumentError(f"{where}: a dark frame has no lamp, found lamp {shot.lamp}")
    elif not (is_whole(shot.lamp) and 1 <= shot.lamp <= lamps):
        raise ArgumentError(f"{where}: expected a lamp from 1 to {lamps}, found {shot.lamp!r}")

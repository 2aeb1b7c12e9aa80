"""A plan of shots: which lamp, which exposure, which pose, in which order; ``shots.toml``."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole, suggestion
from impasto._internal.damage import damage_of
from impasto.capture.devices import Pose, Vector
from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes, read_text
from impasto.io.lights import LightFile
from impasto.io.session_toml import values
from impasto.io.session_toml.write import toml
from impasto.rig import FRONTAL

Kind = Literal["photograph", "dark", "board", "reference"]
VERSION = 1
"""Of the format."""
SHOTS_FILE = "shots.toml"
_LONGEST_NAME = 80


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
    """

    name: str
    kind: Kind
    lamp: int | None
    exposure_s: float
    pose: Pose = field(default_factory=Pose)


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
        file, or an exposure that is not positive.
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


def plan_shots(
    lights: LightFile,
    *,
    exposure_s: float = 0.01,
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
        Exposure time of all shots, seconds.
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
    count = len(lights)
    frontal = int(np.argmax(lights.directions @ np.asarray(FRONTAL))) + 1
    names = [f"shot_{number:03}" for number in range(1, count + 1)]
    if lights.names is not None:
        names = [PurePosixPath(name.replace("\\", "/")).stem for name in lights.names]
    shots = [Shot(f"dark_{n:03}", "dark", None, exposure_s) for n in range(1, darks + 1)]
    taken = 0

    def reference() -> Shot:
        return Shot(f"reference_{taken + 1:03}", "reference", frontal, exposure_s)

    for number, name in enumerate(names):
        view = None if lights.views is None else _vector(lights.views[number])
        if references and number % references == 0:
            shots.append(reference())
            taken += 1
        shots.append(Shot(name, "photograph", number + 1, exposure_s, Pose(view=view)))
    if references:
        shots.append(reference())
    return ShotPlan(tuple(shots), lights.directions, lights.positions)


def shots_text(plan: ShotPlan) -> str:
    """The contents of a ``shots.toml``; it reads back to the same plan."""
    lamps = "directions" if plan.positions_mm is None else "positions_mm"
    vectors = plan.directions if plan.positions_mm is None else plan.positions_mm
    lines = [
        "# The shots of a capture, in their order, for impasto capture run --shots.",
        "# Lamp 1 is the first line of lamps. Directions and views are (x right, y up, z to the",
        "# viewer); exposures are in seconds, angles of a stage in radians.",
        f"version = {VERSION}",
        "",
        "[lamps]",
        f"{lamps} = [",
        *(f"  {toml(vector)}," for vector in vectors.tolist()),
        "]",
    ]
    for shot in plan:
        lines += ["", "[[shots]]", f"name = {toml(shot.name)}", f"kind = {toml(shot.kind)}"]
        lines += [] if shot.lamp is None else [f"lamp = {shot.lamp}"]
        lines.append(f"exposure_s = {toml(shot.exposure_s)}")
        for name in ("view", "light"):
            if (vector := getattr(shot.pose, name)) is not None:
                lines.append(f"{name} = {toml(vector)}")
        if shot.pose.angles:
            inner = ", ".join(f"{toml(k)} = {toml(v)}" for k, v in shot.pose.angles.items())
            lines.append(f"angles = {{ {inner} }}")
    return "\n".join(lines) + "\n"


def write_shots(path: str | Path, plan: ShotPlan) -> None:
    """Write a plan, atomically; an older file of this name is replaced."""
    atomic_bytes(path, shots_text(plan).encode())


def read_shots(path: str | Path) -> ShotPlan:
    """Read a plan of shots.

    Raises
    ------
    CorruptInputError
        No TOML.
    ArgumentError
        Not found, an unknown key, or a value of the wrong kind; the message names file and key.
    """
    path = Path(path)
    with damage_of(path, "TOML"):
        content = tomllib.loads(read_text(path))
    try:
        _keys(content, {"version", "lamps", "shots"}, "")
        if content.get("version") != VERSION:
            raise ValueError(f"version: expected {VERSION}, found {content.get('version')!r}")
        lamps = content.get("lamps")
        if not isinstance(lamps, dict) or len(lamps) != 1:
            raise ValueError("lamps: expected one key, directions or positions_mm")
        _keys(lamps, {"directions", "positions_mm"}, "lamps.")
        ((kind, rows),) = lamps.items()
        table = values.vectors({str(n): row for n, row in enumerate(rows, 1)})
        vectors = np.array(list(table.values()))
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise ValueError(f"lamps.{kind}: a lamp at (0, 0, 0) has no direction")
        shots = content.get("shots")
        if not isinstance(shots, list):
            raise ValueError("shots: expected sections [[shots]]")
        found = tuple(_shot(one, number) for number, one in enumerate(shots, 1))
        # Unit vectors stay as they are, bit for bit.
        unit = np.where(np.abs(lengths - 1.0) < 1e-12, vectors, vectors / lengths)
        return ShotPlan(found, unit, vectors if kind == "positions_mm" else None)
    except ValueError as error:
        raise ArgumentError(f"{path}: {str(error).removeprefix('shots: ')}") from error


_CHECKS: Mapping[str, Callable[[Any], Any]] = {
    "name": values.text,
    "kind": values.text,
    "lamp": values.whole,
    "exposure_s": values.positive,
    "view": lambda value: values.vectors({"view": value})["view"],
    "light": lambda value: values.vectors({"light": value})["light"],
    "angles": lambda value: {values.text(k): values.number(v) for k, v in dict(value).items()},
}


def _shot(content: Any, number: int) -> Shot:
    where = f"shot {number}"
    if not isinstance(content, dict):
        raise ValueError(f"{where}: expected a section [[shots]]")
    _keys(content, set(_CHECKS), f"{where}: ")
    for name in ("name", "kind", "exposure_s"):
        if name not in content:
            raise ValueError(f"{where}: has no {name}")
    found: dict[str, Any] = {}
    for name, value in content.items():
        try:
            found[name] = _CHECKS[name](value)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{where}: {name}: {error}") from error
    view, light = (
        None if name not in found else _vector(np.array(found[name])) for name in ("view", "light")
    )
    pose = Pose(view, light, found.get("angles", {}))
    return Shot(found["name"], found["kind"], found.get("lamp"), found["exposure_s"], pose)


def _keys(content: Mapping[str, Any], known: set[str], where: str) -> None:
    for name in content:
        if name not in known:
            raise ValueError(f"{where}{name!r} is no key{suggestion(name, sorted(known))}")


def _vector(value: NDArray[np.float64]) -> Vector:
    length = float(np.linalg.norm(value))
    if not length > 0:
        raise ValueError("a direction of length 0")
    x, y, z = (value if abs(length - 1.0) < 1e-12 else value / length).tolist()
    return x, y, z


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

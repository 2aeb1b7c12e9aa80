"""``shots.toml``, the one format of plans: ``capture run`` photographs what it says.

``capture plan``, ``capture ball-joint`` and ``capture run --dry-run`` write it, and a folder of a
capture holds that of its shots.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.checks import suggestion
from impasto._internal.damage import damage_of
from impasto.capture.devices import Pose
from impasto.capture.shots import Shot, ShotPlan, exposed, unit_vector
from impasto.errors import ArgumentError
from impasto.io.files import atomic_bytes, read_text
from impasto.io.session_toml import values
from impasto.io.session_toml.write import toml

VERSION = 1
"""Of the format."""
SHOTS_FILE = "shots.toml"


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
    for shots in _sections(plan):
        shot = shots[0]
        seconds: Any = tuple(one.exposure_s for one in shots)
        seconds = seconds if shot.bracket is not None else seconds[0]
        lines += ["", "[[shots]]", f"name = {toml(shot.photograph)}", f"kind = {toml(shot.kind)}"]
        lines += [] if shot.lamp is None else [f"lamp = {shot.lamp}"]
        lines.append(f"exposure_s = {toml(seconds)}")
        for name in ("view", "light"):
            if (vector := getattr(shot.pose, name)) is not None:
                lines.append(f"{name} = {toml(vector)}")
        if shot.pose.angles:
            inner = ", ".join(f"{toml(k)} = {toml(v)}" for k, v in shot.pose.angles.items())
            lines.append(f"angles = {{ {inner} }}")
    return "\n".join(lines) + "\n"


def _sections(plan: ShotPlan) -> list[tuple[Shot, ...]]:
    """Shots in their order; the exposures of a bracket together, where the first of them is."""
    whole = plan.photographs()
    found = []
    for shot in plan:
        shots = (shot,) if shot.bracket is None else whole[shot.bracket]
        if shot == shots[0]:
            found.append(shots)
    return found


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
        found = tuple(shot for number, one in enumerate(shots, 1) for shot in _shots(one, number))
        # Unit vectors stay as they are, bit for bit.
        unit = np.where(np.abs(lengths - 1.0) < 1e-12, vectors, vectors / lengths)
        return ShotPlan(found, unit, vectors if kind == "positions_mm" else None)
    except ValueError as error:
        raise ArgumentError(f"{path}: {str(error).removeprefix('shots: ')}") from error


def _exposures(value: Any) -> tuple[float, ...]:
    """One time in seconds, or the several of a bracket."""
    if not isinstance(value, list):
        return (values.positive(value),)
    if len(value) < 2:
        raise values.refuse("a time in seconds, or a list of two or more", value)
    return tuple(values.positive(one) for one in value)


_CHECKS: Mapping[str, Callable[[Any], Any]] = {
    "name": values.text,
    "kind": values.text,
    "lamp": values.whole,
    "exposure_s": _exposures,
    "view": lambda value: values.vectors({"view": value})["view"],
    "light": lambda value: values.vectors({"light": value})["light"],
    "angles": lambda value: {values.text(k): values.number(v) for k, v in dict(value).items()},
}


def _shots(content: Any, number: int) -> tuple[Shot, ...]:
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
        None if name not in found else unit_vector(np.array(found[name]))
        for name in ("view", "light")
    )
    pose = Pose(view, light, found.get("angles", {}))
    return exposed(found["name"], found["kind"], found.get("lamp"), found["exposure_s"], pose)


def _keys(content: Mapping[str, Any], known: set[str], where: str) -> None:
    for name in content:
        if name not in known:
            raise ValueError(f"{where}{name!r} is no key{suggestion(name, sorted(known))}")

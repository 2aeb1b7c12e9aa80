"""The check of a stack before it is fitted."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from impasto.errors import ArgumentError
from impasto.io.session_toml import is_session

if TYPE_CHECKING:
    from impasto.cli.console import Stages
    from impasto.cli.photographs import Reading
    from impasto.doctor import Diagnosis
    from impasto.stack import Stack

REPAIRED = "repaired.lp"
"""The light file that the commands of a refusal write."""


def refuse_faults(
    stages: Stages, photographs: Stack, path: Path, reading: Reading, out: Path
) -> None:
    """Examine a stack as a stage, and stop if a fit of it would be wrong.

    Raises
    ------
    ArgumentError
        With the findings, and the commands that repair them.
    """
    from impasto.doctor import before_fit
    from impasto.doctor.before_fit import spoiling

    with stages.stage("check") as stage:
        diagnosis = before_fit(photographs)
        stage.note = diagnosis.verdict
    if spoiling(diagnosis):
        raise _RefusedError(_refusal(diagnosis, photographs, path, reading, out))
    for finding in diagnosis.findings:
        stages.say(
            f"  [yellow]{finding.code}:[/] {escape(finding.message)}; {escape(finding.advice)}"
        )


class _RefusedError(ArgumentError):
    """Findings and commands, a line each."""

    _lines = True


def _refusal(
    diagnosis: Diagnosis, photographs: Stack, path: Path, reading: Reading, out: Path
) -> str:

    lines = ["the photographs and their lights do not belong together:"]
    for finding in diagnosis.of("error", "warning"):
        lines += [f"  {finding.code}: {finding.message}", f"  -> {finding.advice}"]
    if _has_repair(photographs, path):
        repaired = (path if path.is_dir() else path.parent) / REPAIRED
        first = _command("doctor", path, asdict(reading) | {"write": repaired})
        lines += ["to repair this, and fit again (with your other options):"]
        lines += [f"  {first}", f"  {_with_lights('fit', path, reading, repaired, out)}"]
    else:
        lines += ["impasto doctor says more"]
    return "\n".join([*lines, "--no-check fits them as they are"])


def written_words(
    diagnosis: Diagnosis, photographs: Stack, path: Path, reading: Reading, written: Path
) -> str:
    """What ``impasto doctor --write`` has repaired in the light file it wrote, and how to go on."""
    from impasto.doctor.repair import repairs

    words, codes = repairs(diagnosis)
    done = "; ".join(words) or "no direction is changed, no photograph left out"
    first = f"{written} written: {done}"
    others = sorted({finding.code for finding in diagnosis.of("error")} - codes)
    if others:
        return f"{first}\nA light file does not repair: {', '.join(others)} (see above)"
    if not words:
        return first
    if _is_whole(path):
        return (
            f"{first}\n{path} keeps its own lights: make it again from the photographs, with "
            f"--lights {shlex.quote(str(written))}"
        )
    if _has_near_lamps(photographs):
        return f"{first}\nIt has directions only: correct the places of the near lamps likewise"
    return f"{first}\nGo on with it: {_with_lights('fit', path, reading, written, Path('OUT'))}"


def _with_lights(name: str, path: Path, reading: Reading, lights: Path, out: Path) -> str:
    """A command that reads the photographs of ``path`` with other lights."""
    options = asdict(reading) | {"lights": None, "out": out}
    if is_session(path):  # it has the other settings
        return _command(name, path, options | {"lights": lights})
    folder = reading.images or (path if path.is_dir() else path.parent)
    if folder.resolve() != lights.parent.resolve():
        options["images"] = folder
    return _command(name, lights, options)


def _has_near_lamps(photographs: Stack) -> bool:
    from impasto.lights import PointLight

    return any(isinstance(light, PointLight) for light in photographs.rig.lights)


def _has_repair(photographs: Stack, path: Path) -> bool:
    """Whether a light file of directions can replace the one at hand."""
    return not (_is_whole(path) or _has_near_lamps(photographs))


def _is_whole(path: Path) -> bool:
    """Whether photographs and lights lie in one file or store, which takes no other lights."""
    return path.suffix.lower() in {".npz", ".zarr"}


def _command(name: str, path: Path, options: dict[str, Any]) -> str:
    words = ["impasto", name, str(path)]
    for option, value in options.items():
        if value is None or value is False:
            continue
        words.append("--" + option)
        if value is not True:
            words += [str(one) for one in (value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)

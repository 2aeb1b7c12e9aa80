"""The check of a stack before it is fitted."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

    with stages.stage("check") as stage:
        diagnosis = before_fit(photographs)
        stage.note = diagnosis.verdict
    if diagnosis.findings:
        raise _RefusedError(_refusal(diagnosis, photographs, path, reading, out))


class _RefusedError(ArgumentError):
    """Findings and commands, a line each."""

    _lines = True


def _refusal(
    diagnosis: Diagnosis, photographs: Stack, path: Path, reading: Reading, out: Path
) -> str:
    lines = ["the photographs and their lights do not belong together:"]
    for finding in diagnosis.findings:
        lines += [f"  {finding.code}: {finding.message}", f"  -> {finding.advice}"]
    if _has_repair(photographs, path):
        repaired = (path if path.is_dir() else path.parent) / REPAIRED
        options = asdict(reading)
        first = _command("doctor", path, options | {"write": repaired})
        again = repaired
        options |= {"lights": None, "out": out}
        if is_session(path):  # it has the other settings
            again = path
            options |= {"lights": repaired}
        lines += ["to repair this, and fit again (with your other options):"]
        lines += [f"  {first}", f"  {_command('fit', again, options)}"]
    else:
        lines += ["impasto doctor says more"]
    return "\n".join([*lines, "--no-check fits them as they are"])


def _has_repair(photographs: Stack, path: Path) -> bool:
    """Whether a light file of directions can replace the one at hand."""
    from impasto.lights import PointLight

    near = any(isinstance(light, PointLight) for light in photographs.rig.lights)
    return path.suffix.lower() != ".npz" and not near


def _command(name: str, path: Path, options: dict[str, Any]) -> str:
    words = ["impasto", name, str(path)]
    for option, value in options.items():
        if value is None or value is False:
            continue
        words.append("--" + option)
        if value is not True:
            words += [str(one) for one in (value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)

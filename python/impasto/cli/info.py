"""``impasto info``."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from impasto.cli import console


def info(
    result: Annotated[Path | None, Parameter(name=["RESULT"])] = None,
    /,
    *,
    json: bool = False,
) -> None:
    """Say what is installed, or what a result holds.

    Parameters
    ----------
    result
        A saved result; without it, the installation is described.
    json
        Print JSON for programs.
    """
    facts = _installation() if result is None else _result(result)
    out = console.stdout()
    if json:
        out.out(json_module.dumps(facts, indent=2, sort_keys=True))
        return
    for name, value in facts.items():
        out.out(f"{name:<16}{value}")


def _installation() -> dict[str, Any]:
    from impasto.report import versions

    return versions()


def _result(path: Path) -> dict[str, Any]:
    raise NotImplementedError

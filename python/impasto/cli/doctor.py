"""``impasto doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.markup import escape
from rich.text import Text

from impasto.cli import console
from impasto.cli.photographs import Reading

if TYPE_CHECKING:
    from rich.console import Console

    from impasto.doctor import Diagnosis, Finding

_MARKS = {"error": "bold red", "warning": "yellow", "note": "cyan", "ok": "green"}
_WIDEST = 100


def doctor(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    reading: Reading | None = None,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Check a stack before it is used, and say what to do about each fault.

    Looks for mirrored, turned or exchanged light directions, duplicate and missing photographs,
    clipped, dark and missing samples, a wrong tone curve, lights that cannot determine a surface
    and lamps of odd strength; repeats what reading had to repair.

    Exit code 0: usable, perhaps with warnings. 1: results would be wrong, or none. 3: a file is
    damaged.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, or an .npz.
    json
        Print JSON for programs.
    """
    from impasto.doctor import examine

    reading = Reading() if reading is None else reading
    with console.stderr().status("looking at the photographs"):
        diagnosis = examine(reading.read(stack))
    if json:
        console.print_json(diagnosis.to_dict())
    else:
        show(diagnosis, console.stdout())
    return 0 if diagnosis.usable else 1


def show(diagnosis: Diagnosis, out: Console) -> None:
    """Print a diagnosis, the gravest findings first."""
    width = min(_WIDEST, out.width)
    out.print(f"[bold]{escape(diagnosis.title)}[/]\n")
    for finding in diagnosis.of("ok", "note", "warning", "error"):
        _show(finding, out, width)
    style = _MARKS[diagnosis.worst]
    out.print(f"\n[{style}]{escape(diagnosis.verdict)}[/]")


def _show(finding: Finding, out: Console, width: int) -> None:
    mark = f"{finding.severity:<8}"
    text = Text.assemble((f"{finding.code}: ", "bold"), finding.message)
    lines = text.wrap(out, width - len(mark) - 1)
    for number, line in enumerate(lines):
        line.rstrip()
        first = Text(mark, style=_MARKS[finding.severity]) if number == 0 else Text(" " * len(mark))
        out.print(Text.assemble(first, " ", line), no_wrap=True)
    if finding.advice:
        advice = Text(finding.advice, style="dim").wrap(out, width - len(mark) - 4)
        for number, line in enumerate(advice):
            line.rstrip()
            arrow = " -> " if number == 0 else "    "
            out.print(Text.assemble(" " * len(mark), arrow, line), no_wrap=True)

"""``impasto doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.markup import escape
from rich.text import Text

from impasto.cli import console
from impasto.cli.checking import written_words
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.photographs import Reading
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.npz import npz_names
from impasto.io.results import result_file

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
    write: Path | None = None,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Check a stack before a fit, or a result after it, and say how to repair each fault.

    Checks for mirrored, rotated or exchanged light directions, duplicate and missing photographs,
    clipped, dark and missing samples, a wrong tone curve, lights that cannot determine a surface
    and lamps of unequal strength; lists what was repaired while reading. Of a result, of any size,
    it checks statuses, gaps, normals, colours, residuals and the borders of tiles.

    Exit code 0: usable, possibly with warnings. 1: results would be wrong or impossible. 3: a file
    is damaged.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, a session.toml, an .npz, or
        the .zarr of impasto ingest; or a result: the folder of impasto fit, its sbrdf.npz, or
        the .zarr of impasto job.
    write
        Write a light file (.lp; .csv with views) with corrected directions, without photographs
        that occur twice. The exit code is that of the lights as they were given.
    json
        Print JSON for programs.
    """
    from impasto.doctor import examine, kept_observations, repaired_directions
    from impasto.io import write_lights
    from impasto.rig import Rig

    if _is_result(stack):
        return _examined_result(stack, write, json=json)
    if write is not None and write.exists():
        raise ArgumentError(f"--write: {write} already exists; choose another name")
    reading = Reading() if reading is None else reading
    reading.check()
    with console.stderr().status("checking the photographs"):
        try:
            photographs = reading.read(stack)
        except CorruptInputError as error:
            return _complain_of_all(error)
        diagnosis = examine(photographs)
    if json:
        console.print_json(diagnosis.to_dict())
    else:
        show(diagnosis, console.stdout())
    if write is not None:
        kept = kept_observations(diagnosis)
        right = repaired_directions(photographs, diagnosis)[kept]
        rig = Rig(right, views=photographs.rig.views[kept])
        write_lights(write, rig, [photographs.names[index] for index in kept])
        Stages().advise(written_words(diagnosis, photographs, stack, reading, write))
    return Exit.OK if diagnosis.usable else Exit.USER_ERROR


def _is_result(path: Path) -> bool:
    """Whether there are the maps of a fit, not photographs."""
    from impasto.io.session.stored import is_stack

    file = result_file(path)
    if path.suffix.lower() == ".npz" and path.is_file():
        names = npz_names(path)
        return "status" in names and "samples" not in names
    if not path.is_dir() or any(path.glob("*.lp")):
        return False
    if file != path:
        return file.is_file()
    return file.suffix.lower() == ".zarr" and not is_stack(file)


def _examined_result(path: Path, write: Path | None, *, json: bool) -> int:
    import impasto
    from impasto.doctor import examine_result

    if write is not None:
        raise ArgumentError(f"--write: {path} is a result, which has no light file to repair")
    file = result_file(path)
    with console.stderr().status("checking the maps"):
        stored = file.is_dir()
        diagnosis = examine_result(impasto.open_sbrdf(file) if stored else impasto.load_sbrdf(file))
    if json:
        console.print_json(diagnosis.to_dict())
    else:
        show(diagnosis, console.stdout())
    return Exit.OK if diagnosis.usable else Exit.USER_ERROR


def _complain_of_all(first: CorruptInputError) -> int:
    """Report the file at which reading stopped, and all other damaged photographs beside it."""
    from impasto.doctor import damaged_files

    console.complain(str(first))
    for other in damaged_files(Path(str(first.path)).parent):
        if Path(str(other.path)) != Path(str(first.path)):
            console.complain(str(other))
    return Exit.CORRUPT_INPUT


def show(diagnosis: Diagnosis, out: Console) -> None:
    """Print a diagnosis, the most severe findings first."""
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

"""``impasto study``."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.options import SomeWhole, Whole, check_threads

if TYPE_CHECKING:
    from rich.console import Console

Flag = Annotated[bool, Parameter(negative="")]


def study(
    *,
    out: Path = Path("study"),
    data: Path | None = None,
    quick: Flag = False,
    seed: Whole = 0,
    threads: SomeWhole = None,
    repeats: Whole = 2,
    figures: bool = True,
    quiet: Flag = False,
) -> int:
    """Measure what accuracy costs in time on this machine, and draw it.

    Every setting is fitted to every data set. What is measured is kept run by run: the same command
    goes on where it was interrupted. Writes study.json, study.md and the figures.

    Parameters
    ----------
    out
        Folder; one that holds a study goes on with it.
    data
        Folder of real photographs, measured materials and spectra; default: $IMPASTO_DATA, else
        none.
    quick
        Few settings on small pictures, every fit in ``repeats`` turns; with two of them less than
        two minutes.
    seed
        Of paintings and noise.
    threads
        Threads of the fits; default: every allowed core.
    repeats
        Turns of every fit: with --quick just so many; else at least, and from 2 on up to twice as
        many where its cost is unsure, six times of fits of milliseconds.
    figures
        Draw the figures (needs matplotlib).
    quiet
        No progress, no table.
    """
    from impasto.extras import need
    from impasto.study import run, write
    from impasto.study.record import RUNS, check_folder
    from impasto.study.tables import tables

    check_threads(threads)
    # Before anything that is wrong with the machine: the folder is what was asked for.
    check_folder(out)
    if figures:
        need("matplotlib", "plot", "the study's figures (--no-figures does without)")
    if data is None and os.environ.get("IMPASTO_DATA"):
        data = Path(os.environ["IMPASTO_DATA"])
    words = console.stderr()
    start = time.perf_counter()
    with _bar(words, quiet) as progress:
        task = progress.add_task("", total=None)

        def advance(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, description=name)

        try:
            found = run(
                out, data=data, quick=quick, seed=seed, threads=threads, repeats=repeats,
                advance=advance,
            )  # fmt: skip
        except KeyboardInterrupt:
            if not quiet and (out / RUNS).is_file():
                kept = f"{out} keeps what is measured: the same command goes on"
                words.print(kept, style="dim", markup=False)
            raise
    written = write(found, out, figures=figures)
    if not quiet:
        _say(words, found, time.perf_counter() - start)
        words.print("[dim]CPU s: CPU seconds per megapixel[/]")
        print_table(tables(found["rows"])["presets"])
        words.print(f"[dim]{out}: {', '.join(path.name for path in written)}[/]")
    return Exit.PARTIAL if found["failed"] else Exit.OK


def print_table(table: list[dict[str, Any]]) -> None:
    """A table on stdout."""
    from impasto.study.tables import text

    console.stdout().print(text(table), markup=False)


def _say(words: Console, found: dict[str, Any], seconds: float) -> None:
    words.print(f"{len(found['rows'])} runs, {seconds:.0f} s", style="dim")
    for name, reason in found["missing"].items():
        words.print(f"without {name}: {reason}", style="yellow", markup=False)
    for reason in found["skipped"]:
        words.print(f"not measured: {reason}", style="yellow", markup=False)
    for reason in found["failed"]:
        words.print(f"failed: {reason}", style="red", markup=False)


def _bar(words: Console, quiet: bool) -> Progress:
    columns = (
        BarColumn(40, complete_style="cyan", finished_style="cyan"),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    hidden = quiet or not words.is_terminal
    return Progress(*columns, console=words, transient=True, disable=hidden)

"""``impasto study``."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.options import Flag, SomeWhole, check_threads
from impasto.cli.photographs import Reading


def study(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    reading: Reading | None = None,
    out: Path | None = None,
    error: float | None = None,
    seconds: float | None = None,
    threads: SomeWhole = None,
    figure: bool = True,
    force: Flag = False,
    json: Flag = False,
    quiet: Flag = False,
) -> int:
    """Compare settings of the fit on your photographs: error against time.

    Each setting is fitted to about four thousand pixels, with one photograph in six held out. The
    error is that of the held-out photographs; the time is predicted for the whole stack on this
    machine. Prints a table and the setting to take.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, a session.toml, an .npz, or
        the .zarr of impasto ingest.
    out
        Folder for study.json, study.md and the figure; default: print only.
    error
        Suggest the fastest setting with at most this error: 0.05 is 5 %.
    seconds
        Suggest the most accurate setting within this time.
    threads
        Threads of the fits; default: every core.
    figure
        Draw the figure (needs matplotlib).
    force
        Write into a folder that contains files of other programs.
    json
        Print JSON for programs instead of the table.
    quiet
        No progress, only the table.
    """
    from impasto._internal.extras import need
    from impasto.cli.fit import say_notes, stack_words
    from impasto.cli.folder import REPORT, result_folder
    from impasto.report import report, write_report
    from impasto.study import run, write
    from impasto.study.report import to_dict
    from impasto.study.suggestion import check_limits

    reading = Reading() if reading is None else reading
    reading.check()
    check_threads(threads)
    check_limits(error, seconds)
    inputs = reading.paths(stack)
    if figure and out is not None:
        need("matplotlib", "plot", "the figure of a study (--no-figure does without)")
    stages = console.Stages(quiet=quiet)
    result = nullcontext() if out is None else result_folder(out, inputs=inputs, force=force)
    with result as folder:
        with stages.stage("photographs") as stage:
            photographs = reading.read(stack)
            stage.note = stack_words(photographs)
        say_notes(stages, photographs)
        with stages.stage("settings", whole=True) as stage:
            found = run(
                photographs, error=error, seconds=seconds, threads=threads, advance=stage.advance
            )
            stage.note = f"{len(found.trials)}, {len(found.front)} on the Pareto front"
        if folder is not None:
            write(found, folder, figure=figure)
            options = {"stack": stack, **asdict(reading)}
            options |= {"error": error, "seconds": seconds, "threads": threads}
            content = report(
                "study",
                inputs=photographs.sources,
                options=options,
                results={"shape": photographs.shape},
                timings=stages.timings,
                notes=photographs.notes,
                folder=folder,
            )
            write_report(folder / REPORT, content)
    if json:
        console.print_json(to_dict(found))
    else:
        console.stdout().print(str(found), markup=False)
    return Exit.OK

"""``impasto job merge``: overlapping frames of one painting become one result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.markup import escape

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.job import terminated_as_interrupted
from impasto.cli.options import Flag, SomeWhole
from impasto.cli.resuming import OF_A_NAME, os_words

AGAIN = "go on with the same command"


def merge(
    *frames: Annotated[Path, Parameter(name=["FRAME"])],
    out: Path,
    reference: int = 0,
    white: SomeWhole = None,
    tile: SomeWhole = None,
    json: Flag = False,
    quiet: Flag = False,
) -> int:
    """Merge overlapping frames of one painting into one result of one scale, colour and level.

    Prints where each frame lies, what was done to it, and what is left where frames overlap. After
    an interruption the same command goes on.

    Parameters
    ----------
    frames
        Results of impasto fit or impasto job run, two or more: .npz, .zarr or their folders.
    out
        The result to make: painting.impasto.zarr, tile by tile, or painting.npz.
    reference
        Number of the frame, from 0, whose scale, direction, plane and lamps are kept.
    white
        Number of the frame whose colours are kept; default: the mean of all.
    tile
        Rows and columns of the tiles of a .zarr; default: 512.
    json
        Print the report as JSON for programs.
    quiet
        No progress, only errors.
    """
    import impasto
    from impasto.jobs.folder import partial_of, store_name

    stages = Stages(quiet=quiet)
    stored = out.suffix.lower() != ".npz"
    try:
        with terminated_as_interrupted(), stages.stage("merge", "registering") as stage:
            merged = impasto.merge(
                list(frames),
                out if stored else None,
                reference=reference,
                white=white,
                tile=tile,
                progress=stage.advance,
            )
            if isinstance(merged.sbrdf, impasto.Sbrdf):
                merged.sbrdf.save(out)
            stage.note = str(out)
    except KeyboardInterrupt:
        console.complain("interrupted")
        if stored and partial_of(store_name(out)).is_dir():
            console.hint(AGAIN)
        return Exit.INTERRUPTED
    except (OSError, MemoryError) as error:
        misnamed = isinstance(error, OSError) and error.errno in OF_A_NAME
        if misnamed or not (stored and partial_of(store_name(out)).is_dir()):
            raise
        full = "not enough memory"
        console.complain(os_words(error) if isinstance(error, OSError) else full)
        console.hint(AGAIN)
        return Exit.PARTIAL
    if json:
        console.print_json(merged.report.to_dict())
    else:
        console.stdout().out(str(merged.report))
    for sentence in merged.report.warnings:
        stages.say(f"[yellow]seam:[/] {escape(sentence)}")
    return Exit.OK

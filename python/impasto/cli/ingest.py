"""``impasto ingest``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import CycloptsError, Parameter

from impasto._internal.memory import DEFAULT_MEMORY
from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.options import Flag, SomeWhole
from impasto.cli.photographs import WholeReading
from impasto.cli.resuming import less_than


def ingest(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    out: Path,
    memory: str = DEFAULT_MEMORY,
    tile: SomeWhole = None,
    reading: WholeReading | None = None,
    quiet: Flag = False,
) -> int:
    """Write photographs into one store, tile by tile: impasto fit and impasto job run take it.

    All observations of a tile lie in one file there. Nothing is lost or compressed. An interrupted
    call leaves nothing.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, a session.toml, or an .npz.
    out
        The store to make: painting.stack.zarr.
    memory
        For samples, without the program: 500MB, 4GiB.
    tile
        Rows and columns of a tile; default: as the memory allows.
    quiet
        No progress, only errors.
    """
    from impasto.jobs import ingest as write

    reading = WholeReading() if reading is None else reading
    reading.check()
    if reading.region is not None:
        raise CycloptsError(msg="--region: a store holds whole photographs; leave it out")
    stages = Stages(quiet=quiet)
    options = reading.options()
    try:
        with stages.stage("tiles", "reading", whole=True) as stage:
            write(stack, out, memory=memory, tile=tile, reading=options, progress=stage.advance)
            stage.note = f"in {out}"
    except MemoryError:
        console.complain(f"not enough memory: {less_than(memory)}")
        return Exit.USER_ERROR
    return Exit.OK

"""``impasto job``: fits of any size, tile by tile, that survive interruptions."""

from __future__ import annotations

import re
import shlex
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import App, CycloptsError, Parameter

from impasto._internal.bars import time_words
from impasto._internal.calls import ProgressCallback
from impasto._internal.memory import DEFAULT_MEMORY
from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.job_pace import PHASES, JobProgress, Pace, pace_words, say_notes
from impasto.cli.options import Flag, SomeWhole, check_threads
from impasto.cli.photographs import WholeReading
from impasto.cli.resuming import (
    files_words,
    has_kept,
    is_of_a_disk,
    is_resumable,
    os_words,
    resume_words,
    say_how_to_repair,
    say_how_to_resume,
    say_how_to_take_less,
)
from impasto.effort import Preset
from impasto.errors import ArgumentError, ClusterError, CorruptInputError
from impasto.fit.normals import Method
from impasto.fit.options import Model
from impasto.fit.pooled import Extraction
from impasto.io.results.precision import Precision

if TYPE_CHECKING:
    from distributed import Client

Pooling: TypeAlias = Literal["auto", "none", "painting", "pixel"]
"""Segments cannot be learned from a sample of the pixels."""
LABEL_WIDTH = 12
COMMANDS = {
    "run": "Fit a painting tile by tile, or go on with that.",
    "status": "Show how far a job is.",
    "resume": "Go on with a job that was interrupted.",
    "verify": "Compare its files with its journal.",
    "rerun": "Make a finished store once more, and compare the bytes.",
    "export": "Put a finished job into an RO-Crate for an archive.",
    "merge": "Merge overlapping frames of one painting.",
}


def application() -> App:
    """The commands below ``impasto job``."""
    app = App(name="job", help="Fit a painting of any size, tile by tile, and resume it.")
    for name, words in COMMANDS.items():
        module = "merging" if name == "merge" else "job"
        app.command(f"impasto.cli.{module}:{name}", help=words)
    return app


def run(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    out: Path,
    memory: str = DEFAULT_MEMORY,
    tile: SomeWhole = None,
    sample: SomeWhole = None,
    precision: Precision = "single",
    resume: Annotated[bool, Parameter(negative="--no-resume")] = True,
    reading: WholeReading | None = None,
    model: Model = "torrance-sparrow",
    pooling: Pooling = "auto",
    lobes: SomeWhole = None,
    ambient: Annotated[bool | None, Parameter(negative="--no-ambient")] = None,
    coated: Annotated[bool | None, Parameter(negative="--no-coated")] = None,
    refine: Annotated[bool | None, Parameter(negative="--no-refine")] = None,
    residuals: Annotated[bool | None, Parameter(negative="--no-residuals")] = None,
    relief: Annotated[bool | None, Parameter(negative="--no-relief")] = None,
    method: Method | None = None,
    extraction: Extraction | None = None,
    peak: Annotated[bool | None, Parameter(negative="--no-peak")] = None,
    joint: Annotated[bool | None, Parameter(negative="--no-joint")] = None,
    index: float | None = None,
    effort: Preset = "standard",
    scheduler: str | None = None,
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> int:
    """Fit a painting tile by tile into a Zarr store, or go on with that after an interruption.

    Exit code 4: a disk is full or fails, memory runs out, or a cluster is lost, 130: interrupted;
    the job can be resumed. 4, too: listed photographs are missing.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, a session.toml, an .npz, or
        the .zarr of impasto ingest.
    out
        The store to make: painting.impasto.zarr.
    memory
        For samples and maps, without the program: 500MB, 4GiB.
    tile
        Rows and columns of a tile, an even number; default: as the memory allows.
    sample
        The model of the whole painting is learned from every so many rows and columns (odd); 1:
        from all pixels. Default: as the memory allows.
    precision
        Of normals, colours and lobes in the store; half takes about a third less space, and
        changes colours by 0.05 % at most.
    resume
        Go on with a job of this name; --no-resume removes an unfinished one.
    model
        The lobe of the first two papers, or Lafortune lobes.
    pooling
        One gloss for the painting, lobes per pixel, or none; auto: whichever predicts held-out
        photographs best. Segments are for impasto fit alone.
    lobes
        Lobes per pixel: how many at most.
    ambient
        Lobes per pixel: include ambient light in the model.
    coated
        Diffuse light crosses a varnish.
    refine
        First estimate distances of camera and lamps and strengths of lamps.
    residuals
        Keep what the model leaves of the photographs, for new lights.
    relief
        Model the painting's own shadows and the light between its parts.
    method
        How highlights and shadows are excluded from the fit of normals.
    extraction
        Which samples the first estimate of the gloss uses.
    peak
        The first estimate uses only samples near the peak of the highlight.
    joint
        Fit normals, colours and gloss together to all samples.
    index
        Index of refraction of the varnish.
    effort
        Accuracy against time.
    scheduler
        Fit the tiles on the workers of a running Dask scheduler: tcp://10.0.0.5:8786, or its
        scheduler file.
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    from impasto import jobs

    check_threads(threads)
    reading = WholeReading() if reading is None else reading
    reading.check()
    if reading.region is not None:
        raise CycloptsError(
            msg="--region: a job fits the whole painting; leave it out, or try a part by impasto "
            "fit --region"
        )
    options = {
        "model": model, "pooling": pooling, "lobes": lobes, "ambient": ambient, "coated": coated,
        "refine": refine, "residuals": residuals, "relief": relief, "normals": method,
        "extraction": extraction, "peak": peak, "joint": joint, "index": index, "effort": effort,
    }  # fmt: skip
    return _worked(
        out,
        memory,
        quiet,
        scheduler,
        lambda progress, client: jobs.run(
            stack,
            out,
            client=client,
            memory=memory,
            resume=resume,
            tile=tile,
            sample=sample,
            precision=precision,
            reading=reading.options(),
            threads=threads,
            progress=progress,
            **options,  # type: ignore[arg-type]
        ),
    )


def resume(
    out: Annotated[Path, Parameter(name=["OUT"])],
    /,
    *,
    memory: str | None = None,
    scheduler: str | None = None,
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> int:
    """Go on with a job that was interrupted.

    Parameters
    ----------
    out
        The --out of impasto job run.
    memory
        For samples and maps, without the program; default: what the job had. Tiles keep their size.
    scheduler
        Of a Dask cluster that fits the tiles; its address or its file.
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    from impasto import jobs

    check_threads(threads)
    return _worked(
        out,
        memory,
        quiet,
        scheduler,
        lambda progress, client: jobs.resume(
            out, memory=memory, client=client, threads=threads, progress=progress
        ),
    )


def status(out: Annotated[Path, Parameter(name=["OUT"])], /, *, json: Flag = False) -> int:
    """Show how far a job is, also from another terminal while it runs.

    Parameters
    ----------
    out
        The --out of impasto job run.
    json
        Print JSON for programs.
    """
    from impasto import jobs

    found = jobs.status(out)
    if json:
        model = _learned_words(found.folder)
        console.print_json(asdict(found) | {"folder": str(found.folder), "model": model})
        return Exit.OK
    rows: dict[str, str] = {"state": found.state}
    if found.phase is not None:
        where = "" if found.machine is None else f" on {found.machine}"
        rows["state"] += f", process {found.process}{where}, {PHASES[found.phase]}"
    if found.bytes_read is not None and found.bytes_to_read:
        read, size = found.bytes_read, found.bytes_to_read
        rows["read"] = f"{read / 1e9:.3g} of {size / 1e9:.3g} GB, {100.0 * read / size:.0f} %"
    if found.tiles:
        share = 100.0 * found.pixels_done / found.pixels
        rows["tiles"] = f"{found.tiles_done} of {found.tiles}, {share:.1f} % of the pixels"
    rows["folder"] = str(found.folder)
    if (model := _learned_words(found.folder)) is not None:
        rows["model"] = model
    if found.sample is not None and found.sample > 1:
        rows["learned"] = f"from one row and column in {found.sample} (--memory, --sample)"
    if (
        found.phase != "scales"
        and found.pixels_per_second is not None
        and found.seconds_left is not None
    ):
        rows["pace"] = pace_words(found.pixels_per_second)
        rows["left"] = time_words(found.seconds_left)
    if found.memory is not None:
        rows["memory"] = f"{found.memory / 2**30:.3g} GiB"
    if found.state == "interrupted":
        rows["resume"] = resume_words(out)
    page = console.stdout()
    for name, value in [*rows.items(), *(("note", text) for _, text in found.notes)]:
        page.out(f"{name:<{LABEL_WIDTH}}{value}")
    return Exit.OK


def _learned_words(folder: Path) -> str | None:
    """The model that a job has learned; None until then."""
    from impasto import load_learned
    from impasto.jobs.folder import NOTES
    from impasto.jobs.learning import LEARNED

    file = folder / NOTES / LEARNED
    try:
        return str(load_learned(file))
    except FileNotFoundError:
        return None
    except CorruptInputError as error:
        return str(error)
    except OSError as error:
        return os_words(error)


def verify(
    out: Annotated[Path, Parameter(name=["OUT"])],
    /,
    *,
    inputs: Annotated[bool, Parameter(negative="--no-inputs")] = True,
) -> int:
    """Compare every file of a job with its journal, and the photographs with its record.

    Every file of what impasto job merge has made is compared with its checksum, and every number
    of a store of impasto ingest.

    Prints a line for each file that is not as it was. Exit code 3: there is one; 4: all is well so
    far, but tiles are missing.

    Parameters
    ----------
    out
        The --out of impasto job run, impasto job merge or impasto ingest.
    inputs
        Read the photographs, too.
    """
    from impasto import jobs
    from impasto.jobs.checksums import CHECKSUMS
    from impasto.jobs.folder import store_name
    from impasto.jobs.lookup import holds_photographs

    store = store_name(out)
    findings = jobs.verify(store, inputs=inputs, progress=True)
    page = console.stdout()
    for finding in findings:
        page.out(str(finding))
    if findings:
        console.complain(f"{store}: {files_words(len(findings))} not as written or read")
        say_how_to_repair(store, findings)
        return Exit.CORRUPT_INPUT
    if (store / CHECKSUMS).is_file() or holds_photographs(store):
        page.out(f"{store}: all files are as written")
        return Exit.OK
    found = jobs.status(store)
    if found.state != "finished":
        page.out(f"{store}: as written, {found.tiles_done} of {found.tiles} tiles")
        return Exit.PARTIAL
    compared = " and all inputs as read" if inputs and found.reads_files else ""
    page.out(f"{store}: all files are as written{compared}")
    return Exit.OK


def export(
    out: Annotated[Path, Parameter(name=["OUT"])],
    /,
    *,
    ro_crate: Path,
    name: str | None = None,
    description: str | None = None,
    license: str | None = None,
) -> int:
    """Put a finished job into an RO-Crate for an archive, with what it was made of and how.

    Parameters
    ----------
    out
        The --out of impasto job run.
    ro_crate
        The folder to make: the store, as hard links where they can be, and ro-crate-metadata.json.
        Photographs are named with their SHA-256, not copied.
    name
        Of the crate; default: that of the store.
    description
        What it is; default: the size of the painting and the number of photographs.
    license
        The address of a licence: https://creativecommons.org/licenses/by/4.0/.
    """
    from impasto.jobs import export_ro_crate

    try:
        with Stages().warned():
            made = export_ro_crate(
                out, ro_crate, name=name, description=description, license=license, progress=True
            )
    except ArgumentError as error:  # the option says of what kind the folder is
        raise ArgumentError(re.sub("^folder:", "--ro-crate:", str(error))) from error
    console.stdout().out(str(made))
    return Exit.OK


def rerun(
    out: Annotated[Path, Parameter(name=["OUT"])],
    /,
    *,
    into: Path,
    memory: str = DEFAULT_MEMORY,
    scheduler: str | None = None,
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> int:
    """Make a finished store once more from its photographs, and compare the bytes.

    Prints the files that differ. Exit code 3: there is one.

    Parameters
    ----------
    out
        The --out of impasto job run.
    into
        The new store.
    memory
        For samples and maps, without the program.
    scheduler
        Of a Dask cluster that fits the tiles; its address or its file.
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    from impasto import jobs

    check_threads(threads)
    differ: list[str] | None = None

    def work(progress: ProgressCallback, client: Client | None) -> Path:
        nonlocal differ
        found = jobs.rerun(
            out, into, memory=memory, client=client, threads=threads, progress=progress
        )
        differ = list(found)
        return into

    code = _worked(into, memory, quiet, scheduler, work, again=out)
    if differ is None:
        return code
    page = console.stdout()
    for name in differ:
        page.out(name)
    if differ:
        count = "1 file differs" if len(differ) == 1 else f"{len(differ)} files differ"
        console.complain(f"{count} between {into} and {out}")
        console.hint(
            f"whether one was changed says: {shlex.join(['impasto', 'job', 'verify', str(out)])}"
        )
        return Exit.CORRUPT_INPUT
    page.out(f"{into}: the same bytes as {out}")
    return code


def _worked(
    out: Path,
    memory: str | None,
    quiet: bool,
    scheduler: str | None,
    work: Callable[[ProgressCallback, Client | None], Path],
    *,
    again: Path | None = None,
) -> int:
    """Do the work of a job, show its pace, and say how to go on where it ends early.

    ``again``: the store of which another is made.
    """
    from impasto.jobs.cluster import LOST, connected, has_workers

    stages, pace = Stages(quiet=quiet), Pace(out)
    try:
        with (
            terminated_as_interrupted(),
            connected(scheduler) as client,
            stages.warned(),
            stages.stage("tiles", "reading the photographs and learning from them") as stage,
        ):
            if client is not None and not has_workers(client):
                stages.say("  the scheduler has no workers yet: tiles wait for the first one")

            work(JobProgress(stages, stage, pace, out), client)
            stage.note = pace.summary(out)
    except KeyboardInterrupt:
        console.complain("interrupted")
        say_how_to_resume(out, scheduler, again)
        if not has_kept(out):
            console.hint("nothing was kept yet; give the same command again")
        return Exit.INTERRUPTED
    except ClusterError as error:
        words = str(error).removeprefix("client: ").replace("(memory=)", "(--memory)")
        console.complain(words.replace("a new client", "a scheduler that runs, or without one"))
        say_how_to_resume(out, None if str(error) == LOST else scheduler, again)
        return Exit.PARTIAL
    except OSError as error:
        if not is_resumable(out) or error.errno is None:
            raise
        console.complain(os_words(error))
        say_how_to_resume(out, scheduler, again)
        return Exit.PARTIAL
    except ArgumentError as error:
        if not is_of_a_disk(error, begun=pace.begun) or not is_resumable(out):
            raise
        console.complain(str(error))
        say_how_to_resume(out, scheduler, again)
        return Exit.PARTIAL
    except MemoryError:
        return say_how_to_take_less(out, memory, scheduler, again)
    if not pace.begun:
        say_notes(stages, out)
    return Exit.OK if again else _say_end(stages, out)


def _say_end(stages: Stages, out: Path) -> int:
    """What to do next; the code of a result without listed photographs."""
    from impasto import jobs

    made = shlex.quote(str(out))
    stages.advise(
        f"Turn the light: impasto view {made}; "
        f"pictures: impasto render {made} --light 180,20 --width 1000 --out raking.png"
    )
    if all(kind != "missing" for kind, _ in jobs.status(out).notes):
        return Exit.OK
    stages.say("[yellow]partial:[/] listed photographs are missing; the others were used")
    return Exit.PARTIAL


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM, as of a batch system, and SIGHUP, of a terminal that closes, are like Ctrl-C.

    Whoever ignores SIGHUP, as ``nohup`` does, goes on.
    """
    terminals = console.terminals()

    def interrupt(*_: Any) -> None:
        console.silence_closed(terminals)
        raise KeyboardInterrupt

    before: dict[int, Any] = {}
    try:
        # Only POSIX systems, on which jobs run, have SIGHUP; others are told so by the job itself.
        for one in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            if one not in before and signal.getsignal(one) is not signal.SIG_IGN:
                before[one] = signal.signal(one, interrupt)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        for one, action in before.items():
            signal.signal(one, action)

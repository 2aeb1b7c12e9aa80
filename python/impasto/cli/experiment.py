"""``impasto experiment``: pictures matched with a painting from memory."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import App, Parameter
from rich.markup import escape

from impasto.cli import console
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.options import Flag, Whole
from impasto.cli.serving import check_port, serve
from impasto.errors import ArgumentError

FIGURE = "matching.png"


def application() -> App:
    """The commands of ``impasto experiment``."""
    app = App(
        name="experiment",
        help="Match pictures with a painting from memory: the adaptation experiment.",
    )
    app.command("impasto.cli.experiment:run", help="Run it with one observer, in the browser.")
    app.command("impasto.cli.experiment:analyse", help="Degrees of adaptation from its sessions.")
    return app


def run(
    result: Annotated[Path, Parameter(name=["RESULT"])],
    /,
    *,
    log: Path,
    observer: str,
    painting: str | None = None,
    degrees: str = "0,0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8,0.9,1",
    trials: Whole = 4,
    seed: Whole = 0,
    adapt_seconds: float = 180.0,
    illuminant: str = "A",
    reference: str = "D65",
    mode: Literal["planck", "anchored"] = "planck",
    display: str = "srgb",
    reduce: Whole = 1,
    port: int = 0,
    no_browser: Flag = False,
) -> int:
    """Show pictures for several degrees of adaptation beside the real painting.

    RESULT is the --out folder of impasto fit, with spectra. The painting hangs beside the display
    under the lamp. The observer looks at it for three minutes, then steps through pictures in
    random order with the arrow keys and chooses the one that looks most like it with Enter. The
    page is served on this machine alone; every choice is on the disk before the next one, and the
    same command goes on with a session that was interrupted.

    Parameters
    ----------
    log
        The file of the session, such as anna.jsonl: made, or gone on with.
    observer
        A name or a number.
    painting
        What the observer looks at; default: the name of RESULT.
    degrees
        Degrees of adaptation of the pictures, 0 to 1.
    trials
        Matches to make.
    seed
        Of the random orders.
    adapt_seconds
        Seconds to look at the painting first.
    illuminant
        The lamp on the painting: A, or a temperature such as 2862K.
    reference
        The light of complete adaptation.
    mode
        planck: the path of the paper; anchored: its ends are the true whites.
    display
        srgb, display-p3, or the file of a display.
    reduce
        How many pixels of the painting, along a side, become one of the pictures.
    port
        To listen on; default: a free one.
    no_browser
        Print the address of the page only.
    """
    from impasto.cli.maps import load_result, name_of
    from impasto.colour import as_display
    from impasto.matching import Experiment, MatchingServer, stimuli

    check_port(port)
    stages = Stages(quiet=False)
    with stages.stage("pictures") as stage:
        sbrdf, reflectance = load_result(result)
        if reflectance is None:
            raise ArgumentError(f"{result} has no spectra; fit again with --camera")
        shown = stimuli(
            sbrdf, reflectance, _degrees(degrees), illuminant=illuminant, reference=reference,
            mode=mode, display=as_display(display), reduce=reduce,
        )  # fmt: skip
        stage.note = f"{len(shown.degrees)} degrees"
    experiment = Experiment(
        shown, log, observer=observer, painting=painting or name_of(result), trials=trials,
        seed=seed, adapt_seconds=adapt_seconds,
    )  # fmt: skip
    try:
        done = f"{experiment.trial} of {experiment.log.trials} matches are made"
        hint = f"{done}; Ctrl-C here ends the page"
        serve(MatchingServer(experiment, port), stages, hint, no_browser=no_browser)
    finally:
        experiment.close()
    stages.say(f"  {'':14}{experiment.trial} of {experiment.log.trials} in {escape(str(log))}")
    return Exit.OK


def analyse(
    *logs: Annotated[Path, Parameter(name=["LOG"])],
    out: Path | None = None,
    confidence: float = 0.95,
    force: Flag = False,
    json: Flag = False,
) -> int:
    """Print the mean degree of adaptation, its interval, and what models predict.

    LOG are the files of impasto experiment run, one or more for each observer.

    Parameters
    ----------
    out
        A folder for the figure matching.png and report.json.
    confidence
        Of the interval of the mean.
    force
        Write into a folder that has other files.
    json
        Print the numbers as JSON for programs.
    """
    from impasto.cli.folder import REPORT, result_folder
    from impasto.io import write_png8
    from impasto.matching import analyse as analysed
    from impasto.report import report, write_report

    if not logs:
        raise ArgumentError("logs: expected the file of a session, found none")
    found = analysed(logs, confidence=confidence)
    if out is not None:
        with result_folder(out, inputs=logs, force=force) as folder:
            write_png8(folder / FIGURE, np.moveaxis(found.picture(), -1, 0))
            content = report(
                "experiment analyse", inputs=logs, options={"confidence": confidence},
                results=found.to_dict(), folder=folder,
            )  # fmt: skip
            write_report(folder / REPORT, content)
    if json:
        console.print_json(found.to_dict())
    else:
        console.stdout().out(str(found))
    return Exit.OK


def _degrees(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise ArgumentError(
            f"--degrees: expected numbers such as 0,0.5,1, found {text!r}"
        ) from None

"""``impasto calibrate``: the rig from photographs made for that."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter
from rich.markup import escape

from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.errors import ArgumentError


def application() -> App:
    """The commands below ``impasto calibrate``."""
    app = App(name="calibrate", help="Find lamps from photographs of mirror balls.")
    app.command("impasto.cli.calibrate:lights")
    return app


def lights(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    out: Path,
    circles: str | None = None,
    rule: Literal["centroid", "median"] = "centroid",
    quiet: Flag = False,
) -> None:
    """Write a light file from photographs of mirror balls, and a picture of what was found.

    FOLDER holds a folder for each ball (its name contains ball, probe, sphere or chrome) and one of
    the object, all with the same lamps in the same order.

    Parameters
    ----------
    out
        The light file to write, a new .lp; a picture of the same name, .png, lies beside it.
    circles
        Name of a file in the folder of each ball with x, y and radius of its outline, counted from
        1, y up. Default: outlines are found.
    rule
        How the place of a highlight is found: centroid, or median as published with Xiong's data.
    quiet
        No progress, only errors.
    """
    import numpy as np

    from impasto.calibrate import balls_picture, lights_from_balls, read_balls
    from impasto.io import write_lights, write_png8

    shown = out.with_suffix(".png")
    if out.suffix.lower() != ".lp":
        raise ArgumentError(f"--out: expected a name ending in .lp, found {out.name}")
    for path in (out, shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("photographs") as stage:
        read = read_balls(folder, circles=circles)
        stage.note = f"{len(read.balls)} balls, {len(read.names)} lamps"
    with stages.stage("lamps") as stage:
        found: Any = lights_from_balls(read.balls, rule=rule)
        stage.note = f"directions within {np.degrees(found.sigma.max()):.2f} degrees"
    stages.say(f"  {'':14}[dim]{escape(found.verdict)}[/]")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, balls_picture(read.balls, found))
    write_lights(out, found.directions, read.names)

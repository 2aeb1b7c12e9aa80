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
    app = App(name="calibrate", help="Find lamps from mirror balls, and the lens from a target.")
    app.command("impasto.cli.calibrate:lights")
    app.command("impasto.cli.calibrate:lens")
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


def lens(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    target: str,
    out: Path,
    model: Literal["auto", "radial", "brown"] = "auto",
    quiet: Flag = False,
) -> None:
    """Write the distortion of a lens from photographs of a flat target, and a picture of it.

    FOLDER holds ten photographs or more of the target, tilted to all sides and in all parts of the
    frame, with the focus and aperture of the painting's photographs.

    Parameters
    ----------
    target
        chessboard:9x6:25mm with inner corners per row and column and the side of a square, or
        charuco:7x5:30mm:22mm:4x4_50 with squares per row and column, sides of a square and a
        marker, and the dictionary.
    out
        The file to write, a new .json; a picture of the same name, .png, lies beside it.
    model
        radial is the polynomial of 5th order, brown has five coefficients; auto takes the one that
        the photographs support.
    quiet
        No progress, only errors.
    """
    from impasto.calibrate import lens_from_target, lens_picture
    from impasto.io import write_png8

    shown = out.with_suffix(".png")
    if out.suffix.lower() != ".json":
        raise ArgumentError(f"--out: expected a name ending in .json, found {out.name}")
    for path in (out, shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("lens") as stage:
        found = lens_from_target(folder, target, model=model, progress=stage.advance)
        lens = found.lens
        stage.note = f"{lens.model}, {lens.corners} corners, residual {lens.residual_px:.3f} pixels"
    sigma = lens.matrix_sigma
    stages.say(
        f"  {'':14}[dim]focal length {lens.matrix[0, 0]:.1f} ± {sigma[0]:.1f} pixels, middle "
        f"({lens.matrix[0, 2]:.1f}, {lens.matrix[1, 2]:.1f}) ± {max(sigma[2:]):.1f}[/]"
    )
    if found.unused:
        names = escape(", ".join(found.unused))
        stages.say(f"[yellow]warning:[/] the target was not found in {names}")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, lens_picture(found))
    lens.save(out)

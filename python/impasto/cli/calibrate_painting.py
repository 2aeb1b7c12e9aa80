"""``impasto calibrate lights-from-painting``: lamps where there is no mirror ball."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.markup import escape

from impasto.cli.calibrate import picture_of, say_written
from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.cli.photographs import dark_of
from impasto.errors import ArgumentError


def lights_from_painting(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    out: Path,
    first_from: Literal["left", "right", "top", "bottom"] | None = None,
    strengths: Path | None = None,
    dark: str | None = None,
    encoding: str | None = None,
    quiet: Flag = False,
) -> None:
    """Write a light file from photographs of a painting alone, where there is no mirror ball.

    FOLDER holds eight photographs or more of one painting from one place, one for each lamp. It
    must be mostly matte, in low relief, and the lamps equally strong. What photographs alone do not
    tell is said; where they tell nothing, no file is written.

    Parameters
    ----------
    out
        The light file to write, a new .lp. Errors are in a .json of the same name, a picture in a
        .png beside it, or in a folder named calibration where there are photographs beside it.
    first_from
        The side from which the first photograph of the light file is lit. Default: the fall-off of
        the light tells.
    strengths
        File of impasto calibrate board with the strengths of the lamps. Default: all are alike.
    dark
        A dark frame, a folder of dark frames, or the black level in codes.
    encoding
        linear, srgb or a gamma. Default: 8-bit files are sRGB, others linear.
    quiet
        No progress, only errors.
    """
    import numpy as np

    from impasto.calibrate import (
        lights_from_panel,
        linear_photograph,
        panel_lights_picture,
        read_patches,
    )
    from impasto.io import write_lights, write_png8
    from impasto.io.session.rigs import read_strengths

    shown = picture_of(out)
    if out.suffix.lower() != ".lp":
        raise ArgumentError(f"--out: expected a name ending in .lp, found {out.name}")
    for path in (out, out.with_suffix(".json"), shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    black = dark_of(dark)
    with stages.stage("photographs") as stage:
        patches = read_patches(folder, encoding=encoding, dark=black)
        stage.note = f"{len(patches.names)} photographs, {patches.light.shape[1]} patches of each"
    strong = None if strengths is None else read_strengths(strengths)
    with stages.stage("lamps") as stage:
        found = lights_from_panel(patches, strengths=strong, first_from=first_from)
        worst = np.degrees(np.nanmax(found.sigma))
        stage.note = (
            f"{found.known.sum()} of {len(found.known)}, directions within {worst:.1f} degrees"
        )
    for words in found.assumptions:
        stages.say(f"  {'':14}[dim]taken for granted: {escape(words)}[/]")
    lost = [name for name, known in zip(found.names, found.known, strict=True) if not known]
    if lost:
        stages.say(
            f"[yellow]warning:[/] highlights hide the shading of {escape(', '.join(lost))}: not in "
            f"{escape(out.name)}"
        )
    numbers = np.flatnonzero(found.known)
    pictures = {
        int(number): linear_photograph(folder / found.names[number], encoding, black)
        for number in (numbers[0], numbers[len(numbers) // 2])
    }
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, panel_lights_picture(found, pictures))
    found.save_report(out.with_suffix(".json"))
    kept = tuple(found.names[number] for number in numbers)
    write_lights(out, found.directions[numbers], kept)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --lights")

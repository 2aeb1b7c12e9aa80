"""``impasto rti``: pictures and photographs out of RTI files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from impasto.cli.console import Stages
from impasto.cli.options import Flag, OneDirection
from impasto.errors import ArgumentError

File = Annotated[Path, Parameter(name=["FILE"], help="A .ptm, an .rti, or a folder of relight.")]
COMMANDS = {
    "render": "Show it under a light.",
    "photographs": "Write photographs of it, for impasto fit.",
}


def application() -> App:
    """The commands below ``impasto rti``."""
    app = App(name="rti", help="Use a .ptm, an .rti or a folder of relight.")
    for name, words in COMMANDS.items():
        app.command(f"impasto.cli.rti:{name}", help=words)
    return app


def render(file: File, /, *, out: Path, light: OneDirection = None, quiet: Flag = False) -> None:
    """Show a relightable image under a light, as its own functions say.

    Parameters
    ----------
    out
        The picture: .png or .jpg, in sRGB.
    light
        Azimuth,elevation of the lamp in degrees; default: 90,45.
    quiet
        No progress, only errors.
    """
    from impasto.cli.scenes import ABOVE
    from impasto.io import read_relightable, write_jpeg, write_png8

    writers = {".png": write_png8, ".jpg": write_jpeg, ".jpeg": write_jpeg}
    writer = writers.get(out.suffix.lower())
    if writer is None:
        raise ArgumentError(f"--out: expected a name ending in .png or .jpg, found {out}")
    stages = Stages(quiet=quiet)
    with stages.stage("picture") as stage:
        image = read_relightable(file)
        shown = image.display((light or ABOVE.angles).direction)
        out.parent.mkdir(parents=True, exist_ok=True)
        writer(out, shown)
        stage.note = str(out)
    for note in image.notes:
        stages.say(f"  {'':14}[dim]{note}[/]")


def photographs(file: File, /, *, out: Path, quiet: Flag = False) -> None:
    """Write what a relightable image shows under its lights, as photographs for impasto fit.

    Their normals and colours are those that its functions still hold: highlights and shadows are as
    smooth as these. Values are relative to the file's white, not to a white board.

    Parameters
    ----------
    out
        An .npz, which impasto fit and impasto doctor read.
    quiet
        No progress, only errors.
    """
    from impasto.io import read_relightable, write_stack

    stages = Stages(quiet=quiet)
    if out.suffix.lower() != ".npz":
        raise ArgumentError(f"--out: expected a name ending in .npz, found {out}")
    with stages.stage("photographs") as stage:
        image = read_relightable(file)
        stack = image.stack()
        out.parent.mkdir(parents=True, exist_ok=True)
        write_stack(out, stack)
        origin = "its own lights" if image.lights is not None else "lights of a dome"
        stage.note = f"{out}: {len(stack.rig)} under {origin}"
    for note in image.notes:
        stages.say(f"  {'':14}[dim]{note}[/]")

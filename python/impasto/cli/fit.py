"""``impasto fit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from impasto.cli import console


def fit(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    out: Path = Path("fit"),
    encoding: str = "auto",
    lights: Path | None = None,
    mask: Path | None = None,
    white: Path | None = None,
    dark: Path | None = None,
    saturation: float | None = None,
    pitch_mm: float | None = None,
    strict: Annotated[bool, Parameter(negative="")] = False,
    model: str = "torrance-sparrow",
    pooling: str = "painting",
    effort: Literal["draft", "standard", "reference"] = "standard",
    threads: int | None = None,
    quiet: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Estimate normals, diffuse colour and gloss from photographs.

    Parameters
    ----------
    stack
        Light file (.lp and its relatives) beside its photographs, or their folder.
    out
        Folder for the maps, overview.png and report.json.
    encoding
        Tone curve of the photographs: linear, srgb, a gamma such as 2.2, or auto to estimate it.
    lights
        Light file, where STACK is a folder without one.
    mask
        Picture that is white where the painting is.
    white
        White-board photographs: one file, or a folder with one per light.
    dark
        Dark frame, or a folder of them.
    saturation
        Code from which a sample counts as clipped; default: the largest of its type.
    pitch_mm
        Width of a pixel on the painting in mm; needed where lights are near.
    strict
        Refuse whatever the reader would otherwise repair.
    model
        Reflectance model.
    pooling
        Which pixels share one gloss.
    effort
        How much time accuracy may cost.
    threads
        Threads to use; default: all allowed cores.
    quiet
        Show no progress.
    json
        Print the report on stdout.
    """
    from impasto.cli.surface import measure

    stages = console.Stages(quiet=quiet)
    reading: dict[str, Any] = {
        "encoding": encoding,
        "lights": lights,
        "mask": mask,
        "white": white,
        "dark": dark,
        "saturation": saturation,
        "pitch_mm": pitch_mm,
        "strict": strict,
    }
    fitting: dict[str, Any] = {
        "model": model,
        "pooling": pooling,
        "effort": effort,
        "threads": threads,
    }
    report = measure(stack, out, stages=stages, reading=reading, fitting=fitting)
    stages.say(f"\nLook at [bold]{out / 'overview.png'}[/]")
    if json:
        console.print_json(report)

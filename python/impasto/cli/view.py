"""``impasto view``: a fitted painting in the browser, in any light."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from impasto._internal.checks import length_mm
from impasto.cli.console import Stages
from impasto.cli.options import Flag, SomeWhole, check_threads
from impasto.cli.serving import check_port, serve


def view(
    result: Annotated[Path, Parameter(name=["RESULT"])],
    /,
    *,
    photographs: Path | None = None,
    encoding: str | None = None,
    against: Path | None = None,
    camera: Annotated[str | None, Parameter(metavar="FILE|srgb")] = None,
    illuminant: str | None = None,
    title: str | None = None,
    pitch: float | None = None,
    environment: tuple[Path, ...] = (),
    port: int = 0,
    no_browser: Annotated[Flag, Parameter(negative="")] = False,
    threads: SomeWhole = None,
) -> int:
    """Show a fitted painting in the browser: drag the light over it.

    The page is served on this machine alone; Ctrl-C ends it. impasto export web writes the same
    page as a folder to hand on.

    Parameters
    ----------
    result
        The --out folder of impasto fit or demo, an sbrdf.npz, the .zarr of impasto job run, of any
        size, or what other programs made: a .ptm, an .rti or a folder of relight.
    photographs
        What the result was fitted to (a light file, session.toml, folder or store): four of them
        are shown beside its pictures, and Inspect draws what all of them measured at a pixel.
    encoding
        Tone curve of the photographs: srgb, linear or a gamma. Default: srgb for 8-bit files,
        linear for all others.
    against
        Another painting of the same size, to be shown beside it in the same lamp: another result
        (before and after), or what RTI tools made of it, as RESULT.
    camera
        CSV file of band sensitivities, or "srgb": spectra of a result that has none, such as a
        .zarr, and with them the colour of the light, adaptation and varnish.
    illuminant
        Light of the photographs (A, D65, 3000K), if the camera's file does not contain it.
    title
        Above the page; default: the name of the result.
    pitch
        Width of a pixel in mm, if the result does not contain it.
    environment
        An .exr or .hdr map to light the painting with, besides the rooms that the page has; may be
        given several times.
    port
        To listen on; default: a free one.
    no_browser
        Print the address of the page only.
    threads
        Default: every core.
    """
    from impasto.cli.maps import name_of
    from impasto.cli.page import (
        camera_for_page,
        own_environments,
        painting_beside,
        photographs_beside,
        say_empty,
        say_lacking,
        say_notes,
        shown_result,
    )
    from impasto.viewer import Contents, ViewServer

    check_threads(threads)
    check_port(port)
    if pitch is not None:
        length_mm(pitch, "pitch_mm")
    rooms = own_environments(environment)
    stages = Stages(quiet=False)
    with stages.stage("result") as stage:
        painting, reflectance = shown_result(result)
        rows, columns = painting.shape
        stage.note = f"{columns} x {rows} pixels"
    say_notes(painting, stages)
    other = painting_beside(against, stages)
    lens = camera_for_page(camera, illuminant)
    stack = photographs_beside(photographs, encoding, stages, rows * columns)
    with stages.stage("page") as stage:
        contents = Contents(
            painting,
            reflectance=reflectance,
            camera=lens,
            stack=stack,
            title=name_of(result) if title is None else title,
            pitch_mm=pitch,
            environments=rooms,
            threads=threads,
            **other,
        )
        stage.note = f"{contents.tiles} tiles"
    say_empty(contents, result, stages)
    say_lacking(contents.lacks, stages)
    hint = "Ctrl-C here ends it"
    return serve(ViewServer(contents, port), stages, hint, no_browser=no_browser)

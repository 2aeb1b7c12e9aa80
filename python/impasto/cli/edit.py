"""``impasto edit``: a page in the browser to correct what was found automatically."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.cli.serving import check_port, serve

if TYPE_CHECKING:
    from impasto.editing import Subject


def application() -> App:
    """The commands below ``impasto edit``."""
    app = App(
        name="edit",
        help="Correct marks, outlines of balls and depth meshes by hand, on a page in the browser.",
    )
    app.command("impasto.cli.edit:marks", help="Marks of a plane, for impasto align.")
    app.command("impasto.cli.edit:balls", help="Outlines of mirror balls.")
    app.command("impasto.cli.edit:mesh", help="A depth mesh, of impasto align --depth.")
    return app


def marks(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    points: Path,
    size: str | None = None,
    markers: str | None = None,
    encoding: str | None = None,
    port: int = 0,
    no_browser: Annotated[Flag, Parameter(negative="")] = False,
) -> int:
    """Place marks in photographs by hand: the file of impasto align --points.

    FOLDER holds the photographs. The page is served on this machine alone; Ctrl-C ends it.

    Parameters
    ----------
    points
        The JSON file: edited where it exists, else made with --size.
    size
        Width and height of the painting in mm, such as 400x300, for a new file.
    markers
        For a new file, aruco:4x4_50 or aruco:4x4_50:20mm: markers are found in each photograph, and
        corrected by hand. Default: the four corners of the painting, placed by hand.
    encoding
        Tone curve of the photographs: srgb, linear or a gamma. Default: srgb for 8-bit files,
        linear for all others.
    port
        To listen on; default: a free one.
    no_browser
        Print the address of the page only.
    """
    from impasto.align import size_from
    from impasto.editing import Marks

    stages = Stages(quiet=False)
    with stages.stage("marks") as stage:
        subject = Marks(
            points, folder, None if size is None else size_from(size), markers, encoding
        )
        stage.note = f"{len(subject.photographs.paths)} photographs"
    return _serve(subject, stages, port, no_browser)


def balls(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    circles: str = "circle_data.txt",
    encoding: str | None = None,
    port: int = 0,
    no_browser: Annotated[Flag, Parameter(negative="")] = False,
) -> int:
    """Correct outlines of mirror balls by hand: the files of impasto calibrate lights --circles.

    FOLDER is that of calibrate lights. The page is served on this machine alone; Ctrl-C ends it.

    Parameters
    ----------
    circles
        Name of the file with x, y and radius: in the folder of each ball, or in that of photographs
        which show balls beside the painting. Edited where it exists; else balls are found.
    encoding
        Tone curve of the photographs: srgb, linear or a gamma. Default: srgb for 8-bit files,
        linear for all others.
    port
        To listen on; default: a free one.
    no_browser
        Print the address of the page only.
    """
    from impasto.editing import BallOutlines

    stages = Stages(quiet=False)
    with stages.stage("balls") as stage:
        subject = BallOutlines(folder, circles, encoding)
        stage.note = (
            f"{sum(map(len, subject.circles))} in {len(subject.photographs.paths)} photographs"
        )
    return _serve(subject, stages, port, no_browser)


def mesh(
    path: Annotated[Path, Parameter(name=["FILE"])],
    /,
    *,
    photograph: Path | None = None,
    encoding: str | None = None,
    port: int = 0,
    no_browser: Annotated[Flag, Parameter(negative="")] = False,
) -> int:
    """Correct heights of a depth mesh by hand: the file of impasto align --depth.

    FILE is report/depth.csv of impasto align --depth estimate. The page is served on this machine
    alone; Ctrl-C ends it.

    Parameters
    ----------
    photograph
        An aligned photograph to show below the heights; default: the first that impasto align
        wrote beside the report.
    encoding
        Tone curve of the photograph: srgb, linear or a gamma. Default: srgb for 8-bit files, linear
        for all others.
    port
        To listen on; default: a free one.
    no_browser
        Print the address of the page only.
    """
    from impasto.editing import Mesh

    stages = Stages(quiet=False)
    with stages.stage("mesh") as stage:
        subject = Mesh(path, photograph, encoding)
        rows, columns = subject.mesh.depth_mm.shape
        stage.note = f"{columns} x {rows} nodes"
    return _serve(subject, stages, port, no_browser)


def _serve(subject: Subject, stages: Stages, port: int, no_browser: bool) -> int:
    from impasto.editing import EditServer

    check_port(port)
    hint = "save on the page; Ctrl-C here ends it"
    return serve(EditServer(subject, port), stages, hint, no_browser=no_browser)

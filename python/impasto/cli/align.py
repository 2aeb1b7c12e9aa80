"""``impasto align``: photographs to the frontal view of a painting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.markup import escape

from impasto._internal.checks import length_mm
from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.cli.photographs import dark_of
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.align import Card, Layout, Reference


def align(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    out: Path,
    markers: str | None = None,
    size: str | None = None,
    points: Path | None = None,
    to: Path | None = None,
    lens: Path | None = None,
    pixel: float | None = None,
    depth: str | None = None,
    mesh: float | None = None,
    refine: Flag = False,
    fixed_camera: Flag = False,
    lights: Path | None = None,
    card: str | None = None,
    card_reflectance: float = 1.0,
    dark: str | None = None,
    encoding: str | None = None,
    saturation: float | None = None,
    quiet: Flag = False,
) -> None:
    """Rectify photographs of a painting to its frontal view, and write them as a stack.

    One of --markers with --size, --points, and --to says where the painting is.

    Parameters
    ----------
    out
        The folder to write: 16-bit linear TIFFs, the light file, and report/ with numbers and a
        picture.
    markers
        aruco:4x4_50: markers 0 to 3 touch the corners of the painting, from the upper left
        clockwise; aruco:4x4_50:20mm: all corners of exactly mounted markers count;
        charuco:7x5:30mm:22mm: a board.
    size
        Width and height of the painting in mm, such as 400x300.
    points
        JSON file with marks that were found roughly by hand.
    to
        A frontal picture, such as one of another session, that photographs are aligned to by
        features.
    lens
        File of impasto calibrate lens.
    pixel
        Width of a pixel of the result in mm; default: the finest of the photographs.
    depth
        estimate: find the heights of the relief from the parallax between views (needs --lens); or
        a file report/depth.csv, as an earlier run wrote it or as it was edited since.
    mesh
        Largest distance between nodes of the estimated heights in mm; default: 12 pixels, or what
        makes 6000 nodes.
    refine
        Take out shifts between photographs, by their content.
    fixed_camera
        The camera did not move: marks of all photographs are taken together.
    lights
        The light file; default: the only one in the folder.
    card
        A white card in the plane of the painting, in all photographs, from which the strength of
        the lamp in each is measured: x, y of its middle, width and height in mm, such as
        230,0,40,80; x to the right and y up from the middle of the painting.
    card_reflectance
        Of that card.
    dark
        Of the card: a dark frame, a folder of dark frames, or the black level in codes.
    encoding
        Tone curve of the files: srgb, linear or a gamma such as 2.2. Default: srgb for 8-bit
        files, linear for all others.
    saturation
        Code from which samples are clipped; default: the largest.
    quiet
        No progress, only errors.
    """
    from impasto.align import align as run
    from impasto.align import read_depth
    from impasto.calibrate import read_lens

    if sum(one is not None for one in (markers, points, to)) != 1:
        raise ArgumentError("align: give one of --markers, --points and --to")
    if (markers is None) != (size is None):
        raise ArgumentError("align: --markers and --size go together")
    if out.exists():
        raise ArgumentError(f"--out: {out} already exists; choose another name")
    if pixel is not None:
        length_mm(pixel, "--pixel")
    if mesh is not None:
        length_mm(mesh, "--mesh")
        if depth != "estimate":
            raise ArgumentError("--mesh: is for --depth estimate; a file has its own nodes")
    if dark is not None and card is None:
        raise ArgumentError("--dark: is for --card; alignment leaves the black level as it is")
    if depth is not None and lens is None:
        raise ArgumentError("--depth: needs --lens, without which no camera has a place")
    stages = Stages(quiet=quiet)
    optics = None if lens is None else read_lens(lens)
    layout = _layout(markers, size, points, to, pixel, encoding)
    relief = False if depth is None else depth == "estimate" or read_depth(Path(depth))
    with stages.stage("align") as stage:
        found = run(
            folder, out, layout,
            lens=optics, pixel_mm=pixel, depth=relief, mesh_mm=mesh, refine=refine,
            fixed_camera=fixed_camera, lights=lights, card=_card(card, card_reflectance),
            dark=dark_of(dark), encoding=encoding, saturation=saturation,
            progress=stage.advance,
        )  # fmt: skip
        left = found.residual_px
        said = "4 marks fit exactly" if left is None else f"marks within {left:.3f} pixels"
        stage.note = f"{len(found.photographs)} photographs, {said}"
    grid = found.grid
    stages.say(
        f"  {'':14}[dim]{grid.columns} x {grid.rows} pixels of {grid.pixel_mm:g} mm; look at "
        f"{escape(str(out / 'report' / 'alignment.png'))}[/]"
    )
    if found.depth is not None:
        heights = found.depth.depth_mm
        stages.say(
            f"  {'':14}[dim]relief of {heights.min():.2f} to {heights.max():.2f} mm; look at "
            f"{escape(str(out / 'report' / 'depth.png'))}[/]"
        )
    if found.parallax is not None:
        before, after = found.parallax.left_px
        stages.say(
            f"  {'':14}[dim]along epipolar lines {before:.2f} pixels before, {after:.3f} after[/]"
        )
    if found.largest_shift_px is not None:
        stages.say(f"  {'':14}[dim]shifts up to {found.largest_shift_px:.2f} pixels taken out[/]")
    for name, pixels in found.moved.items():
        stages.say(
            f"[yellow]warning:[/] {escape(name)} moved by {pixels:.2f} pixels against the others; "
            "take it again, or leave out --fixed-camera, with which all have one view"
        )
    for name, why in found.refused.items():
        stages.say(f"[yellow]warning:[/] {escape(name)} was not shifted: {escape(why)}")
    if found.covered < 1.0:
        stages.say(
            f"[yellow]warning:[/] all photographs show {100 * found.covered:.1f} % of the "
            "painting; report/mask.png is for --mask"
        )
    if not found.lights:
        stages.say("[yellow]warning:[/] no light file: impasto fit needs one (--lights)")


def _card(text: str | None, reflectance: float) -> Card | None:
    from impasto.align import Card

    if text is None:
        return None
    try:
        x, y, width, height = (float(word) for word in text.split(","))
    except ValueError:
        raise ArgumentError(
            f"--card: expected x,y,width,height in mm such as 230,0,40,80, found {text!r}"
        ) from None
    return Card((x, y), (width, height), reflectance)


def _layout(
    markers: str | None,
    size: str | None,
    points: Path | None,
    to: Path | None,
    pixel: float | None,
    encoding: str | None,
) -> Layout | Reference:
    from impasto.align import layout_from_markers, read_points, read_reference, size_from

    if points is not None:
        return read_points(points)
    if to is not None:
        return read_reference(to, pixel_mm=pixel, encoding=encoding)
    assert markers is not None
    assert size is not None
    return layout_from_markers(markers, size_from(size))

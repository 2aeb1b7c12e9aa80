"""``impasto export``: a fitted painting in the formats of other programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter
from rich.markup import escape

from impasto._internal.checks import length_mm
from impasto.cli import console
from impasto.cli.console import Stages
from impasto.cli.options import Flag, OneDirection, SomeWhole, check_threads
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.export import Format

Result = Annotated[Path, Parameter(name=["RESULT"], help=(
    "The --out folder of impasto fit or demo, an sbrdf.npz, or the .zarr of impasto job run."
))]  # fmt: skip
Folder = Annotated[Path, Parameter(help="A new folder, or one that an export wrote.")]
Displaced = Annotated[bool, Parameter(negative="", show_default=False, help=(
    "A mesh of the relief, one point per pixel, instead of a flat panel."
))]  # fmt: skip
WORDS = {
    "web": "A web page with impasto's viewer.",
    "openlime": "A folder of layers for the viewer OpenLIME.",
    "relight": "A folder for relight's tools and RTI viewers.",
    "ptm": "A polynomial texture map (.ptm).",
    "hsh": "Hemispherical harmonics (.rti).",
    "gltf": "glTF 2.0 (.glb), for 3-D viewers and Blender.",
    "materialx": "A MaterialX document.",
    "usd": "A Universal Scene Description (.usda).",
    "mitsuba": "A scene for the renderer Mitsuba 3.",
    "height": "The height: .exr, .tif, .stl or .ply.",
    "normal-map": "A 16-bit normal map for Blender (.png).",
    "iiif": "Tiles of a picture for IIIF viewers.",
}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of all formats."""

    region: Annotated[
        tuple[int, int, int, int] | None, Parameter(metavar="TOP LEFT HEIGHT WIDTH", negative="")
    ] = None
    """A detail, in pixels."""

    width: SomeWhole = None
    """Of a .zarr of impasto job run, the smaller scale that has so many columns."""

    pitch: float | None = None
    """Width of a pixel in mm, if the result does not contain it."""

    json: Flag = False
    """Print the report of what is lost as JSON."""

    quiet: Flag = False
    """No progress, only errors."""


def application() -> App:
    """The commands below ``impasto export``."""
    app = App(name="export", help="Write a fitted painting in a format of other programs.")
    for name, words in WORDS.items():
        app.command(f"impasto.cli.export:{name.replace('-', '_')}", name=name, help=words)
    return app


def ptm(result: Result, /, *, out: Path, common: Common | None = None) -> None:
    """Write a polynomial texture map (.ptm) for RTI viewers."""
    _export("ptm", result, out, common)


def hsh(result: Result, /, *, out: Path, common: Common | None = None) -> None:
    """Write hemispherical harmonics (.rti) for RTI viewers."""
    _export("hsh", result, out, common)


def relight(
    result: Result,
    /,
    *,
    out: Folder,
    functions: Literal["hsh", "ptm"] = "hsh",
    common: Common | None = None,
) -> None:
    """Write a folder for relight's tools and OpenLIME's RTI layer.

    Parameters
    ----------
    functions
        Hemispherical harmonics, or a polynomial.
    """
    _export("relight", result, out, common, functions=functions)


def openlime(result: Result, /, *, out: Folder, common: Common | None = None) -> None:
    """Write layers for the viewer OpenLIME: BRDF, RTI and, of spectra, multispectral."""
    _export("openlime", result, out, common)


def gltf(
    result: Result, /, *, out: Path, displaced: Displaced = False, common: Common | None = None
) -> None:
    """Write glTF 2.0 (.glb): a panel of the painting's size, for 3-D viewers and Blender."""
    _export("gltf", result, out, common, displaced=displaced)


def materialx(result: Result, /, *, out: Folder, common: Common | None = None) -> None:
    """Write a MaterialX document (standard_surface) with its textures."""
    _export("materialx", result, out, common)


def usd(
    result: Result, /, *, out: Folder, displaced: Displaced = False, common: Common | None = None
) -> None:
    """Write a Universal Scene Description (.usda, UsdPreviewSurface) with its textures."""
    _export("usd", result, out, common, displaced=displaced)


def mitsuba(result: Result, /, *, out: Folder, common: Common | None = None) -> None:
    """Write a scene for the renderer Mitsuba 3, with a plug-in for Lafortune lobes."""
    _export("mitsuba", result, out, common)


def height(
    result: Result,
    /,
    *,
    out: Path,
    level: Annotated[bool, Parameter(negative="--no-level")] = True,
    common: Common | None = None,
) -> None:
    """Write the height in mm: .exr, .tif (16 bits), or a mesh in .stl or .ply.

    Parameters
    ----------
    level
        Heights about the plane of the panel, as of impasto height; --no-level keeps its lean. A
        round object has no plane.
    """
    _export("height", result, out, common, level=level)


def normal_map(result: Result, /, *, out: Path, common: Common | None = None) -> None:
    """Write a 16-bit normal map (.png): red right, green up (OpenGL), blue to the viewer."""
    _export("normal-map", result, out, common)


def iiif(
    result: Result,
    /,
    *,
    out: Folder,
    url: str | None = None,
    light: OneDirection = None,
    quality: int = 97,
    common: Common | None = None,
) -> None:
    """Write tiles of a picture for IIIF viewers (Image API 3.0, level 0: no server).

    Parameters
    ----------
    url
        Where the folder will be served: the id in info.json.
    light
        Azimuth,elevation of the lamp in degrees; default: 90,45.
    quality
        Of the JPEGs, 1 to 100.
    """
    import impasto

    options: dict[str, Any] = {"url": url, "quality": quality}
    if light is not None:
        options["scene"] = impasto.Scene([impasto.DistantLight(light.direction)])
    _export("iiif", result, out, common, **options)


def web(
    result: Result,
    /,
    *,
    out: Folder,
    photographs: Path | None = None,
    encoding: str | None = None,
    against: Path | None = None,
    camera: Annotated[str | None, Parameter(metavar="FILE|srgb")] = None,
    illuminant: str | None = None,
    title: str | None = None,
    pitch: float | None = None,
    environment: tuple[Path, ...] = (),
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> None:
    """Write a web page with impasto's viewer, of a painting of any size.

    Parameters
    ----------
    photographs
        What the result was fitted to (a light file, session.toml, folder or store), to compare with
        its pictures: four of them are shown.
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
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    from impasto.cli.maps import name_of
    from impasto.cli.page import (
        camera_for_page,
        own_environments,
        painting_beside,
        photographs_beside,
        say_lacking,
        say_notes,
        shown_result,
    )
    from impasto.viewer import write_site

    check_threads(threads)
    stages = Stages(quiet=quiet)
    if pitch is not None:
        length_mm(pitch, "pitch_mm")
    rooms = own_environments(environment)
    painting, reflectance = shown_result(result)
    say_notes(painting, stages)
    other = painting_beside(against, stages)
    lens = camera_for_page(camera, illuminant)
    stack = photographs_beside(photographs, encoding, stages)
    with stages.warned(), stages.stage("web page") as stage:
        site = write_site(
            painting,
            out,
            reflectance=reflectance,
            camera=lens,
            stack=stack,
            title=name_of(result) if title is None else title,
            pitch_mm=pitch,
            environments=rooms,
            threads=threads,
            progress=stage.advance,
            **other,
        )
        stage.note = f"{out}: {site.files} files, {site.size / 1e6:.1f} MB"
    say_lacking(site.lacks, stages)
    stages.say(f"  {'':14}[dim]open {escape(str(out / 'index.html'))} in a browser[/]")


def _export(
    format_: Format, result: Path, out: Path, common: Common | None, **options: Any
) -> None:
    """Load the part of a result, write it and report what is lost."""
    from impasto import export
    from impasto.cli.maps import name_of
    from impasto.cli.scale import scale_of, shown
    from impasto.cli.scenes import panel_of_heights
    from impasto.export import FORMATS

    common = common or Common()
    stages = Stages(quiet=common.quiet)
    if common.pitch is not None:
        length_mm(common.pitch, "pitch_mm")
    if common.width is not None and common.region is not None:
        raise CycloptsError(msg="--region is a detail, --width a smaller scale: give one of them")
    if common.width is None:
        part = shown(result, common.region, None, 1)
    else:
        part = scale_of(result, common.width)
    tiled = FORMATS[format_].tiled is not None and not part.detail
    if part.in_parts and not tiled:
        rows, columns = part.surface.shape
        raise ArgumentError(
            f"--width: {result} ({columns} x {rows} pixels) is too large to be exported whole as "
            f"{format_}; give the columns of a scale that it holds, of 16 million pixels at most, "
            "or --region for a detail of as many"
        )
    if "level" in options:
        options["level"] = panel_of_heights(stages, part.panel, wanted=options["level"])
    with stages.warned(), stages.stage(format_) as stage:
        report = export.to(
            format_,
            part.surface,
            out,
            reflectance=part.reflectance,
            pitch_mm=None if common.pitch is None else part.factor * common.pitch,
            name=name_of(result),
            **options,
        )
        stage.note = f"{out}: {report.summary}"
    if common.json:
        console.print_json(report.to_dict())
        return
    for words, entries in (("kept", report.kept), ("lost", report.lost)):
        for index, entry in enumerate(entries):
            stages.say(f"  {words if index == 0 else '':14}[dim]{entry}[/]")

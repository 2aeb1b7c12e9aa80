"""``impasto demo``: simulate, photograph, measure, relight, and compare with the truth."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.table import Table

from impasto._internal.wording import percent
from impasto.cli import console
from impasto.cli.console import Stages
from impasto.cli.measuring import measured
from impasto.cli.options import Flag, SomeWhole, Whole, check_threads
from impasto.errors import ArgumentError
from impasto.systems import Name

if TYPE_CHECKING:
    from impasto.image import Image
    from impasto.pictures import Panel
    from impasto.simulate import Capture, Score
    from impasto.systems import System

Rig = Literal["tominaga-six-band-adaptation", "tominaga-rgb-camera", "snel-lafortune"]
Varnish = Literal["matte", "satin", "gloss"]


SIZE, SMALL = 512, 128
"""Default size; that of Snel's 770 photographs."""


@dataclass(frozen=True)
class View:
    """One picture of the demonstration."""

    file: str
    title: str
    note: str
    scene: dict[str, Any]


VIEWS = (
    View("above", "Light from above", "45 degrees, D65", {"light": (0.0, 0.71, 0.71)}),
    View(
        "raking",
        "Raking light",
        "from the left, 15 degrees",
        {"light": (-0.93, 0.25, 0.26), "shadows": True, "exposure": 2.0},
    ),
    View(
        "lamp",
        "Incandescent lamp",
        "illuminant A, adaptation 0.56",
        {"light": (0.0, 0.71, 0.71), "illuminant": "A", "adaptation": 0.56},
    ),
    View(
        "slanted",
        "Seen from the right",
        "40 degrees, lamp above",
        {"light": (-0.30, 0.60, 0.74), "view": (0.64, 0.0, 0.77)},
    ),
)
"""The pictures of the papers: relit, under a lamp with incomplete adaptation, from the side."""
VIEWED = "relit, under a lamp, from the side"


def demo(
    *,
    out: Path = Path("demo"),
    size: SomeWhole = None,
    seed: Whole = 0,
    system: Name = "impasto",
    rig: Rig | None = None,
    varnish: Varnish = "satin",
    threads: SomeWhole = None,
    force: Flag = False,
    quiet: Flag = False,
) -> None:
    """Simulate a painting, photograph it, measure it, relight it, and compare with the truth.

    Parameters
    ----------
    out
        Folder for photographs, maps, pictures and report.
    size
        Height and width in pixels; default: 512, or 128 for the 770 photographs of snel-lafortune.
    seed
        Seed of the simulated painting.
    system
        The procedure of impasto, or that of one of the papers as published, with its figures.
    rig
        Camera and lights of one of the papers: six bands and 16 lights, RGB and 9, or RGB and 770
        pairs of light and view. Default: those of the system; six bands for impasto.
    varnish
        Gloss of the varnish.
    threads
        Default: every core.
    force
        Write into a folder that contains files of other programs.
    quiet
        No progress, only errors.
    """
    from impasto import simulate, systems
    from impasto.cli.fit import numbers
    from impasto.cli.folder import REPORT, result_folder
    from impasto.cli.maps import write_maps
    from impasto.cli.photographs import write_photographs
    from impasto.figures import figures
    from impasto.io import write_jpeg, write_png8
    from impasto.report import report, write_report
    from impasto.simulate.cameras import CAMERA_OPTIONS

    if rig is None:
        rig = "tominaga-six-band-adaptation" if system == "impasto" else system
    if size is None:
        size = SMALL if rig == "snel-lafortune" else SIZE
    if size < 16:
        raise ArgumentError(f"--size: expected at least 16 pixels, found {size}")
    if seed < 0:
        raise ArgumentError(f"--seed: expected a number from 0 on, found {seed}")
    check_threads(threads)
    procedure = systems.get(system)
    stages = Stages(quiet=quiet)
    with result_folder(out, force=force) as folder:
        with stages.stage("painting", f"{size} x {size} pixels, {varnish} varnish, seed {seed}"):
            painting = simulate.painting(seed, (size, size), varnish=varnish)
        with stages.stage("photographs") as stage:
            capture = simulate.capture(painting, rig, rig, **CAMERA_OPTIONS.get(rig, {}))
            stack = write_photographs(folder / "photographs", capture)
            observations, bands = stack.shape[:2]
            stage.note = f"{observations} lights, {bands} bands, 12 bits, sensor noise"
        camera = None if procedure.estimator is None else capture.truth.camera
        sbrdf, reflectance = measured(stages, procedure, stack, camera, threads)
        with stages.stage("pictures", "figures of the paper" if procedure.pictures else VIEWED):
            images = _images(procedure, sbrdf, reflectance, threads)
            drawn = figures(procedure, capture.stack, sbrdf, reflectance, truth=capture.truth)
        with stages.stage("truth", "errors against the true surface"):
            score = simulate.score(capture.truth, sbrdf, reflectance)
        censored = None
        if procedure.highlights == "reconstructed":
            with stages.stage("censored", "the same without clipped samples"):
                other = replace(procedure, highlights="censored")
                found, _ = other.measure(stack, camera, threads=threads)
                censored = simulate.score(capture.truth, found)
        with stages.stage("files", str(out)):
            write_maps(folder, sbrdf, reflectance)
            for view, image in images:
                image.save(folder / f"{view.file}.png")
            for name, picture in drawn.items():
                write_png8(folder / f"{name}.png", picture)
            write_jpeg(folder / "overview.jpg", _sheet(capture, sbrdf, reflectance, images, score))
        truth = {"truth": score.numbers()}
        if censored is not None:
            truth["truth_censored"] = censored.numbers()
        content = report(
            "demo",
            options={
                "size": size,
                "seed": seed,
                "rig": rig,
                "varnish": varnish,
                "system": system,
                **procedure.options,
                "threads": threads,
            },
            results=numbers(stack, sbrdf, reflectance) | truth,
            timings=stages.timings,
            folder=folder,
        )
        write_report(folder / REPORT, content)
    if not quiet:
        _print(score, censored, out)


def _images(
    procedure: System, sbrdf: Any, reflectance: Any, threads: int | None
) -> list[tuple[View, Image]]:
    """The pictures of the system; for impasto, those of the papers with shadows."""
    import impasto

    if procedure.pictures:
        rendered = procedure.render(sbrdf, reflectance, threads=threads)
        views = [View(name, _title(name), "", {}) for name in rendered]
        return list(zip(views, rendered.values(), strict=True))
    images = []
    for view in VIEWS:
        options = dict(view.scene)
        light = impasto.DistantLight(options.pop("light"))
        scene = impasto.Scene([light], background=(0.02, 0.02, 0.02), **options)
        image = impasto.render(sbrdf, scene, reflectance=reflectance, threads=threads)
        images.append((view, image))
    return images


def _title(name: str) -> str:
    """``figure-9-slanted``: ``Figure 9, slanted``."""
    number, _, rest = name.removeprefix("figure-").partition("-")
    return f"Figure {number}" + (f", {rest.replace('-', ' ')}" if rest else "")


def _sheet(
    capture: Capture,
    sbrdf: Any,
    reflectance: Any,
    images: list[tuple[View, Image]],
    score: Score,
) -> Any:
    from impasto.overview import DEGREES, diffuse_panel, gloss_panel, quality_panels, subtitle
    from impasto.pictures import Panel, contact_sheet, normal_panel, ramp_panel

    _, residual, *_, status = quality_panels(sbrdf)
    sigma = sbrdf.sigma
    top = next((end for end in (0.1, 0.5) if score.normal_p95 < end), 5.0)
    truth = capture.truth.painting
    relit = [Panel(view.title, image.display, view.note) for view, image in images]
    colour = score.colour_error
    colours_of = [] if colour is None else [_colour_error(colour)]
    panels = (
        *relit,
        diffuse_panel(sbrdf, reflectance),
        normal_panel(sbrdf.normal),
        gloss_panel(sbrdf),
        status,
        ramp_panel(score.normal_error, "Error of the normal", unit="degrees", low=0.0, high=top),
        ramp_panel(sigma, "Predicted error", unit="degrees", low=0.0, high=top, scale=DEGREES),
        *colours_of,
        residual,
    )
    title = f"Simulated painting {truth.seed}"
    columns = 4 if len(panels) > 9 else 3
    return contact_sheet(panels, title=title, subtitle=subtitle(sbrdf), columns=columns)


def _colour_error(error: Any) -> Panel:
    from impasto.pictures import ramp_panel

    return ramp_panel(error, "Error of the colour", unit="CIEDE2000, D65", low=0.0, high=5.0)


def _print(score: Score, censored: Score | None, out: Path) -> None:
    """The comparison, on stdout."""
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 3, 0, 0))
    for name, value, note in _rows(score, censored):
        table.add_row(name, value, f"[dim]{note}[/]")
    page = console.stdout()
    page.print("\nErrors against the truth of the simulation:\n")
    page.print(table)
    page.print(f"\nLook at {out / 'overview.jpg'} first; report.json has all numbers.")
    page.print(f"Turn the light: impasto view {shlex.quote(str(out))}", markup=False)


def _rows(score: Score, censored: Score | None) -> list[tuple[str, str, str]]:
    rows = [("normals", f"{score.normal_mean:.3g} deg", f"95 % below {score.normal_p95:.3g} deg")]
    if censored is not None:
        words = f"95 % below {censored.normal_p95:.3g} deg, without clipped samples"
        rows.append(("normals, censored", f"{censored.normal_mean:.3g} deg", words))
    if score.colour_error is not None:
        words = "RMSE of the reflectance, white is 1"
        rows.append(("spectra", f"{score.reflectance_rmse:.4f}", words))
    for name, mean in score.colour_mean.items():
        tail = f"CIEDE2000, 95 % below {score.colour_p95[name]:.2f}"
        rows.append((f"colour, {name}", f"{mean:.2f}", tail))
    if score.gamma == score.gamma:  # not with lobes per pixel
        rows.append(("gamma", percent(score.gamma, "+"), "width of the gloss"))
        rows.append(("beta", percent(score.beta, "+"), "strength of the gloss"))
    if score.estimated < 1.0:
        rows.append(("estimated", f"{100 * score.estimated:.2f} %", "of the pixels"))
    return rows

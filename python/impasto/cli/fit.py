"""``impasto fit``: from photographs to maps."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import CycloptsError, Parameter
from rich.markup import escape

from impasto._internal.checks import refractive_index
from impasto.cli.checking import refuse_faults
from impasto.cli.codes import Exit
from impasto.cli.console import Stages
from impasto.cli.gloss import LAFORTUNE, Gloss, with_labels
from impasto.cli.measuring import measured
from impasto.cli.options import Flag, SomeWhole, check_threads
from impasto.cli.photographs import Reading
from impasto.cli.rig import estimated_strengths, refined_rig, rig_numbers, strength_numbers
from impasto.effort import Preset
from impasto.errors import ArgumentError
from impasto.fit.normals import Method
from impasto.fit.options import takers
from impasto.fit.pooled import Extraction
from impasto.fit.reflectance import Estimator
from impasto.systems import Highlights, Name

if TYPE_CHECKING:
    from impasto.fit.result import Sbrdf
    from impasto.level import Level
    from impasto.stack import Stack
    from impasto.systems import System
    from impasto.training import Training


def fit(
    stack: Annotated[Path, Parameter(name=["STACK"])],
    /,
    *,
    out: Path,
    reading: Reading | None = None,
    gloss: Gloss | None = None,
    check: Annotated[bool, Parameter(negative="--no-check")] = True,
    refine: Annotated[bool | None, Parameter(negative="--no-refine")] = None,
    strengths: Flag = False,
    system: Name = "impasto",
    highlights: Highlights | None = None,
    method: Method | None = None,
    extraction: Extraction | None = None,
    peak: Annotated[bool | None, Parameter(negative="--no-peak")] = None,
    joint: Annotated[bool | None, Parameter(negative="--no-joint")] = None,
    index: float | None = None,
    effort: Preset | None = None,
    camera: Annotated[str | None, Parameter(metavar="FILE|srgb")] = None,
    illuminant: str | None = None,
    estimator: Estimator | None = None,
    training: Path | None = None,
    threads: SomeWhole = None,
    force: Flag = False,
    quiet: Flag = False,
) -> int:
    """Measure a painting: normals, diffuse reflectance and gloss from its photographs.

    Exit code 4: the result is partial. Listed photographs are missing, pixels were not computed, or
    no pixel could be measured.

    Parameters
    ----------
    stack
        Light file (.lp) beside its photographs, a folder of both, a session.toml, an .npz, or
        the .zarr of impasto ingest.
    out
        Folder for maps, overview and report.
    check
        Stop if lights are mirrored, rotated or exchanged, or a photograph occurs twice, and print
        the commands that repair it; takes a small part of the time of the fit.
    refine
        First estimate distances of camera and lamps and strengths of lamps from the photographs,
        accepted where held-out photographs are predicted better; some seconds. Default: with 24
        photographs or more from one view, unless --system, --pooling or an option of one is given.
    strengths
        First estimate only the strength of each lamp from the photographs (at least 7 lights), for
        lamps that were not measured, hand-held or in a dome; uses lobes per pixel (--lobes of
        --pooling pixel, else 2).
    system
        The procedure of impasto, or that of one of the papers as published, with its figures;
        the Tominaga systems need --camera. The options below change single steps.
    highlights
        Fit clipped samples as such (censored; impasto), or replace clipped bands from those that
        are not clipped (reconstructed; snel-lafortune), or ignore clipped samples (left-out).
    method
        How highlights and shadows are excluded from the fit of normals; impasto: robust.
    extraction
        Which samples the first estimate of the gloss uses; impasto: residual.
    peak
        The first estimate uses only samples near the peak of the highlight, as the RGB paper does.
    joint
        Fit normals, colours and gloss together to all samples; the papers do not.
    index
        Index of refraction of the varnish; default: 1.45.
    effort
        Accuracy against time; default: standard.
    camera
        CSV file of band sensitivities, or "srgb" for photographs developed to sRGB. Reflectance
        spectra are then estimated, and any illuminant can be rendered.
    illuminant
        Light of the photographs (A, D65, 3000K), if the camera's file does not contain it.
    estimator
        How spectra are estimated from bands; impasto: ensemble.
    training
        Table of measured spectra of the painting's paints, wavelengths in the first column or row;
        they are learnt from besides the spectra of the system.
    threads
        Default: every core.
    force
        Write into a folder that contains files of other programs.
    quiet
        No progress, only errors.
    """
    from impasto import systems
    from impasto.cli.folder import REPORT, result_folder
    from impasto.cli.maps import write_maps
    from impasto.figures import figures
    from impasto.fit.rig_refinement import refinable
    from impasto.io import write_jpeg, write_png8
    from impasto.overview import overview
    from impasto.report import report, status_counts, write_report

    if illuminant is not None and camera is None:
        raise CycloptsError(
            msg="--illuminant is the light for the sensitivities of a camera: it needs --camera"
        )
    if training is not None and camera is None:
        raise CycloptsError(
            msg="--training is for spectra of the bands of a camera: it needs --camera"
        )
    if system not in {"impasto", LAFORTUNE} and camera is None:
        raise CycloptsError(msg=f"--system {system} estimates spectra: it needs --camera")
    steps: dict[str, Any] = {
        "extraction": extraction,
        "peak": peak,
        "joint": joint,
        "index": index,
    }
    gloss = Gloss() if gloss is None else gloss
    gloss.check(system=system, steps=steps)
    every = steps | {
        "highlights": highlights,
        "method": method,
        "estimator": estimator,
        "effort": effort,
    }
    chosen = {name: value for name, value in every.items() if value is not None}
    procedure = replace(systems.get(system), **chosen)
    own = gloss.options(procedure, steps=steps)
    reading = Reading() if reading is None else reading
    reading.check()
    check_threads(threads)
    if "index" in own:
        refractive_index(own["index"])
    labels = [] if gloss.segments is None else [gloss.segments]
    tables = [] if training is None else [training]
    inputs = [*reading.paths(stack), *labels, *tables]
    stages = Stages(quiet=quiet)
    with result_folder(out, inputs=inputs, force=force) as folder:
        lens = None if camera is None else camera_of(camera, illuminant)
        spectra = None if training is None else training_of(training, procedure)
        with stages.stage("photographs") as stage:
            photographs = reading.read(stack)
            stage.note = stack_words(photographs)
        say_notes(stages, photographs)
        if check:
            refuse_faults(stages, photographs, stack, reading, out)
        lamps = estimated_strengths(stages, photographs, own, threads) if strengths else None
        photographs = photographs if lamps is None else lamps.stack
        if refine is None:
            open_choice = gloss.is_open(system=system, steps=steps) and not strengths
            refine = open_choice and refinable(photographs.rig)
        if refine:
            photographs = refined_rig(stages, photographs, index, threads)
        arguments = with_labels(own, photographs, reading.region)
        sbrdf, reflectance = measured(
            stages, procedure, photographs, lens, threads, arguments, spectra
        )
        if sbrdf.chosen is not None:
            stages.say(f"  {'':14}[dim]{sbrdf.chosen}[/]")
        if sbrdf.relief is not None:
            stages.say(f"  {'':14}[dim]{sbrdf.relief}[/]")
        panel = panel_of(sbrdf)
        if panel is not None:
            stages.say(f"  {'':14}[dim]{panel}[/]")
        with stages.stage("files") as stage:
            write_maps(folder, sbrdf, reflectance)
            if system != "impasto":
                images = procedure.render(sbrdf, reflectance, threads=threads)
                for name, image in images.items():
                    image.save(folder / f"{name}.png")
                for name, drawn in figures(procedure, photographs, sbrdf, reflectance).items():
                    write_png8(folder / f"{name}.png", drawn)
            sheet = overview(
                sbrdf, reflectance=reflectance, title=painting_name(stack), threads=threads
            )
            write_jpeg(folder / "overview.jpg", sheet)
            stage.note = str(out)
        content = report(
            "fit",
            inputs=[*photographs.sources, *labels, *tables],
            options={
                "stack": stack,
                **asdict(reading),
                "check": check,
                "refine": refine,
                "strengths": strengths,
                "system": system,
                **{name: value for name, value in procedure.options.items() if not takers(name)},
                "index": procedure.index,
                **own,
                "camera": camera,
                "illuminant": illuminant,
                **({} if training is None else {"training": training}),
                "threads": threads,
            },
            results=numbers(photographs, sbrdf, reflectance)
            | ({} if panel is None else level_numbers(panel))
            | rig_numbers(photographs)
            | ({} if lamps is None else strength_numbers(lamps)),
            timings=stages.timings,
            notes=photographs.notes,
            folder=folder,
        )
        write_report(folder / REPORT, content)
    unfinished = status_counts(sbrdf.status).get("not_computed", 0)
    missing = any(note.kind == "missing" for note in photographs.notes)
    if unfinished:
        stages.say(f"[yellow]partial:[/] {unfinished} pixels were not computed")
    nothing = not (sbrdf.status < 16).any()
    if nothing:
        stages.say("[red]no pixel could be measured:[/] run impasto doctor for the reason")
    if missing:
        stages.say("[yellow]partial:[/] listed photographs are missing; the others were used")
    if not nothing:
        sheet_of, made = shlex.quote(str(out / "overview.jpg")), shlex.quote(str(out))
        stages.advise(
            f"Look at {sheet_of}, then turn the light: impasto view {made}; "
            f"pictures: impasto render {made} --light 180,20 --out raking.png"
        )
    return Exit.PARTIAL if missing or unfinished or nothing else Exit.OK


def panel_of(sbrdf: Sbrdf) -> Level | None:
    """The plane of the panel; None where hardly any pixel could be measured."""
    from impasto.level import find_level

    # NaN is not above 0.
    return find_level(sbrdf.normal, bend=True) if (sbrdf.normal[2] > 0).sum() >= 100 else None


def level_numbers(level: Level) -> dict[str, Any]:
    """The panel's part of a report, in degrees."""
    import numpy as np

    return {
        "level": {
            "angle_degrees": np.degrees(level.angle),
            "azimuth_degrees": np.degrees(level.azimuth),
            "near_share": level.share,
            "sagitta": level.sagitta,
        }
    }


def training_of(path: Path, procedure: System) -> Training:
    """The spectra of ``--training`` with those of the system."""
    from impasto.io import read_spectra
    from impasto.training import default_training, general_training

    own = general_training() if procedure.training == "general" else default_training()
    return own + read_spectra(path)


def camera_of(text: str, illuminant: str | None) -> Any:
    """The camera of ``--camera`` and the light of ``--illuminant``."""
    from impasto.bands import Camera
    from impasto.io import read_camera

    if text.casefold() == "srgb":
        if illuminant is not None:
            raise ArgumentError(
                "--illuminant: photographs developed to sRGB have D65; leave it out"
            )
        return Camera.srgb()
    return read_camera(text, illuminant=illuminant)


def say_notes(stages: Stages, stack: Stack) -> None:
    """Print what was repaired, left out or assumed: important notes in yellow, others dim."""
    for note in stack.notes:
        odd = note.repair or not getattr(note, "decided", True)
        style = "yellow" if odd or note.kind in {"horizon", "duplicate", "unlisted"} else "dim"
        stages.say(f"  {'':14}[{style}]{escape(str(note))}[/]")


def stack_words(stack: Stack) -> str:
    """``72 x 402 x 395 pixels, 3 bands``."""
    observations, bands, rows, columns = stack.shape
    return f"{observations} of {columns} x {rows} pixels, {band_words(bands)}"


def band_words(count: int) -> str:
    """``1 band``, ``6 bands``."""
    return "1 band" if count == 1 else f"{count} bands"


def painting_name(stack: Path) -> str:
    """The title: of a session, else the folder of a light file, the folder or the archive."""
    from impasto.io.session_toml import is_session, read_session

    if is_session(stack) and (title := read_session(stack).title):
        return title
    path = stack.resolve()
    return (
        path.name if path.is_dir() else (path.stem if path.suffix == ".npz" else path.parent.name)
    )


def numbers(stack: Stack, sbrdf: Sbrdf, reflectance: Any) -> dict[str, Any]:
    """The numbers of a report."""
    import numpy as np

    from impasto.fit.result import median
    from impasto.report import status_counts

    return {
        "shape": stack.shape,
        "bands": stack.bands,
        "encoding": {
            "curve": stack.encoding.name,
            "white": stack.encoding.white,
            "source": stack.encoding_source,
        },
        "status": status_counts(sbrdf.status),
        "normals_status": status_counts(sbrdf.normals.status),
        **sbrdf.report(),
        "sigma_degrees_median": median(np.degrees(sbrdf.sigma)),
        "residual_median": median(sbrdf.residual),
        "reflectance": None if reflectance is None else reflectance.info,
        "choice": None if sbrdf.chosen is None else sbrdf.chosen.report(),
        "relief": None if sbrdf.relief is None else sbrdf.relief.report(),
    }

"""``impasto animate``: films of a fitted painting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import CycloptsError, Parameter
from numpy.typing import NDArray

from impasto._internal.checks import length_mm, positive
from impasto.cli.console import Advance, Stage, Stages
from impasto.cli.options import (
    Flag,
    OneSpan,
    SeveralLamps,
    SeveralPositions,
    SomeWhole,
    Whole,
    check_threads,
)
from impasto.cli.scenes import ABOVE, check_spectra, lamps, panel, say_false_colours
from impasto.colour.adaptation import Mode
from impasto.errors import ArgumentError

ELEVATION, ANGLE = 15.0, 30.0
"""Degrees, unless said otherwise."""
LEAST, WIDEST = 0.01, 89.9
"""Degrees: a lamp in the plane of the painting lights nothing, a painting seen from its side shows
nothing."""


def animate(
    result: Annotated[Path, Parameter(name=["RESULT"])],
    /,
    *,
    out: Path,
    raking: Flag = False,
    turntable: Flag = False,
    adaptation: OneSpan = None,
    width: SomeWhole = None,
    frames: Whole = 48,
    fps: float = 12.0,
    elevation: float | None = None,
    angle: float | None = None,
    light: SeveralLamps = None,
    point: SeveralPositions = None,
    illuminant: str | None = None,
    adaptation_mode: Mode = "planck",
    display: str = "srgb",
    exposure: float | None = None,
    shadows: Flag = False,
    level: Annotated[bool | None, Parameter(negative="--no-level")] = None,
    pitch: float | None = None,
    threads: SomeWhole = None,
    force: Flag = False,
    quiet: Flag = False,
) -> None:
    """Render a fitted painting as a film. One of --raking, --turntable and --adaptation is needed.

    Parameters
    ----------
    result
        The --out folder of impasto fit or demo, an sbrdf.npz, or the .zarr of impasto job run.
    out
        The film: .png (animated), or .gif or .mp4, which need the extra video; without a suffix a
        folder of pictures frame-00.png, frame-01.png ... and report.json.
    raking
        A lamp goes round the painting once, at --elevation.
    turntable
        The painting turns to both sides by --angle, under lights that stay where they are.
    adaptation
        The eye adapts: degrees of adaptation as in 0..1. Needs spectra.
    width
        Columns of the painting in the film, at most; of a large store only a smaller scale is then
        loaded. Default: those of the painting.
    frames
        Number of pictures.
    fps
        Pictures per second, 0.01 to 500; up to 50 in a .gif.
    elevation
        Of the lamp of --raking in degrees, 0.01 to 90. Default: 15.
    angle
        Of --turntable in degrees, 0.01 to 89.9. Default: 30.
    light
        As for impasto render; not with --raking.
    point
        As for impasto render; not with --raking.
    illuminant
        As for impasto render. Default: D65; A with --adaptation.
    adaptation_mode
        planck: between blackbodies, as in the six-band paper; anchored: between the true whites.
    display
        srgb, "Display P3", or a JSON file of measurements; .gif and .mp4 are for sRGB.
    exposure
        Factor on all light, the same for all frames. Default: the largest at which a white board
        facing the lights clips in no frame; with --raking, one that lies on the painting.
    shadows
        Include cast shadows of the relief.
    level
        Rotate a panel that leans to face the viewer; default: with --shadows and --raking, whose
        lamp then is as high on all sides.
    pitch
        Width of a pixel in mm, if the result does not contain it; required for near lamps.
    threads
        Default: every core.
    force
        Write into a folder that contains files of other programs.
    quiet
        No progress, only errors.
    """
    import impasto
    from impasto import animation
    from impasto.cli.folder import REPORT, result_folder
    from impasto.cli.maps import result_files
    from impasto.cli.scale import loaded
    from impasto.colour import icc_profile
    from impasto.io.films import FASTEST, GIF_FASTEST, SLOWEST, film_format, write_film
    from impasto.overview import visible
    from impasto.report import report, write_report

    check_threads(threads)
    _check_use(raking, turntable, adaptation, light or point, elevation, angle)
    if frames < 1:
        raise ArgumentError(f"--frames: expected a number from 1 on, found {frames}")
    kind = film_format(out, "--out") if out.suffix else None
    most = GIF_FASTEST if kind == "GIF" else FASTEST
    if not SLOWEST <= fps <= most:
        where = "" if kind is None else f" in {kind}"
        raise ArgumentError(
            f"--fps: expected {SLOWEST:g} to {most:g} pictures per second{where}, found {fps:g}"
        )
    if exposure is not None:
        positive(exposure, "--exposure", "a positive factor")
    if pitch is not None:
        length_mm(pitch, "pitch_mm")
    screen = impasto.colour.as_display(display)
    if kind not in {None, "PNG"} and screen.name != "srgb":
        raise ArgumentError(
            f"--display: {out.suffix} holds codes of sRGB only; write .png or a folder"
        )
    if illuminant is None:
        illuminant = "A" if adaptation else "D65"
    lights, illuminants = lamps(light, point, illuminant)
    scene = impasto.Scene(
        lights,
        illuminant=illuminants,
        adaptation=adaptation[0] if adaptation else None,
        adaptation_mode=adaptation_mode,
        display=screen,
        exposure=exposure,
        shadows=shadows,
    )
    risen = math.radians(elevation or ELEVATION)
    if raking:
        scenes = animation.raking(scene, frames, elevation=risen)
    elif turntable:
        largest = math.radians(angle or ANGLE)
        scenes = animation.turntable(scene, frames, angle=largest)
    else:
        first, last = adaptation or (0.0, 1.0)
        scenes = animation.adapting(scene, frames, first=first, last=last)
    stages = Stages(quiet=quiet)
    part = loaded(result, width)
    check_spectra(result, part.reflectance, scene)
    say_false_colours(stages, part.panel, part.reflectance)
    plane = panel(stages, part.panel, wanted=(shadows or raking) if level is None else level)
    shown = visible(part.surface, part.reflectance)
    wide = part.surface.pitch_mm if pitch is None else part.factor * pitch
    options: dict[str, Any] = {
        "reflectance": part.reflectance,
        "pitch_mm": wide,
        "level": plane,
        "reduce": part.reduce,
        "threads": threads,
    }
    scenes = animation.same_exposure(shown, scenes, **options)
    if raking and exposure is None:
        # A board that lies on the painting gets the sine of the elevation.
        factor: Any = scenes[0].exposure
        scenes = [one.changed(exposure=factor / math.sin(risen)) for one in scenes]
    if shadows:
        options["height"] = animation.relief(shown, plane, options["pitch_mm"], threads=threads)
    given = {
        "result": result,
        "raking": raking,
        "turntable": turntable,
        "adaptation": adaptation,
        "width": width,
        "frames": frames,
        "fps": fps,
        "elevation": (elevation or ELEVATION) if raking else None,
        "angle": (angle or ANGLE) if turntable else None,
        "light": [] if raking else [asdict(one) for one in light or (() if point else (ABOVE,))],
        "point": point or (),
        "illuminant": illuminant,
        "adaptation_mode": adaptation_mode,
        "display": display,
        "exposure": exposure,
        "shadows": shadows,
        "level": (shadows or raking) if level is None else level,
        "pitch": None if wide is None else wide / part.factor,
        "threads": threads,
    }
    measured = [Path(display)] if Path(display).is_file() else []

    def pictures(advance: Advance) -> Iterator[NDArray[np.uint8]]:
        for number, one in enumerate(scenes):
            yield part.resampled(impasto.render(shown, one, **options)).display
            advance(number + 1, len(scenes))

    def seen(stage: Stage) -> Iterator[NDArray[np.uint8]]:
        stage.note = f"{out}, {frames} frame{'s' * (frames != 1)}"
        shot = pictures(stage.advance)
        return animation.centred(shot, part.size, (0, 0, 0)) if turntable else shot

    if out.suffix:
        with stages.stage("film", whole=True) as stage:
            out.parent.mkdir(parents=True, exist_ok=True)
            write_film(out, seen(stage), fps=fps, icc=icc_profile(screen))
        return
    with result_folder(out, inputs=[result, *measured], force=force) as folder:
        with stages.stage("film", whole=True) as stage:
            _write_frames(folder, seen(stage), frames, icc_profile(screen))
        content = report(
            "animate",
            inputs=[*result_files(result), *measured],
            options=given,
            results={"exposure": scenes[0].exposure},
            timings=stages.timings,
            folder=folder,
        )
        write_report(folder / REPORT, content)


def _check_use(
    raking: bool, turntable: bool, adaptation: Any, lit: Any, elevation: Any, angle: Any
) -> None:
    if raking + turntable + (adaptation is not None) != 1:
        raise CycloptsError(msg="give one of --raking, --turntable and --adaptation FROM..TO")
    if raking and lit:
        raise CycloptsError(msg="--raking has its own lamp: leave --light and --point out")
    for name, value, used, most in (
        ("--elevation", elevation, raking, 90.0),
        ("--angle", angle, turntable, WIDEST),
    ):
        if value is not None and not used:
            raise CycloptsError(msg=f"{name} belongs to another kind of film")
        if value is not None and not LEAST <= value <= most:
            raise ArgumentError(
                f"{name}: expected degrees from {LEAST:g} to {most:g}, found {value:g}"
            )


def _write_frames(
    folder: Path, pictures: Iterator[NDArray[np.uint8]], frames: int, icc: bytes
) -> None:
    from impasto.io import write_png8

    digits = len(str(frames - 1))
    for number, codes in enumerate(pictures):
        planes = np.moveaxis(codes, -1, 0)
        write_png8(folder / f"frame-{number:0{digits}}.png", planes, icc=icc)

"""``impasto render``: a fitted painting under any light."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import CycloptsError, Parameter

from impasto._internal.checks import length_mm
from impasto.cli.console import Stages, stdout
from impasto.cli.options import (
    Flag,
    OneDirection,
    OnePosition,
    SeveralLamps,
    SeveralPositions,
    SomeWhole,
    Whole,
    check_threads,
)
from impasto.cli.scenes import (
    VarnishName,
    check_spectra,
    coat,
    lamps,
    panel,
    room_of,
    say_false_colours,
    tolerance_of,
)
from impasto.colour.adaptation import Mode
from impasto.errors import ArgumentError
from impasto.picture import Backend
from impasto.systems import Name

CLIPPED, DARK = 0.0005, 0.2
"""A message is printed above this share of clipped pixels, or below this brightness."""


def render(
    result: Annotated[Path, Parameter(name=["RESULT"])],
    /,
    *,
    out: Path,
    system: Name | None = None,
    light: SeveralLamps = None,
    point: SeveralPositions = None,
    lamp_size: float | None = None,
    environment: str | None = None,
    environment_rotation: float | None = None,
    illuminant: str = "D65",
    adaptation: float | None = None,
    adaptation_mode: Mode = "planck",
    display: str = "srgb",
    view: OneDirection = None,
    eye: OnePosition = None,
    exposure: float | Literal["maximum"] | None = None,
    shadows: Flag = False,
    varnish: VarnishName | None = None,
    remove_varnish: VarnishName | None = None,
    level: Annotated[bool | None, Parameter(negative="--no-level")] = None,
    reduce: Whole = 1,
    width: SomeWhole = None,
    region: Annotated[
        tuple[int, int, int, int] | None, Parameter(metavar="TOP LEFT HEIGHT WIDTH", negative="")
    ] = None,
    tolerance: str | None = None,
    explain: Flag = False,
    backend: Backend = "cpu",
    pitch: float | None = None,
    threads: SomeWhole = None,
    quiet: Flag = False,
) -> None:
    """Render a fitted painting and save the picture.

    Parameters
    ----------
    result
        The --out folder of impasto fit or demo, an sbrdf.npz, or the .zarr of impasto job run.
    out
        The picture: .png, .jpg or .tif (codes of the display), or .exr (linear light); .tif of a
        .zarr of more than 16 million pixels, which is rendered part by part without shadows. With
        --system the folder for its pictures.
    system
        Write the rendered figures of a paper, each in its own light and view, as fit --system and
        demo --system do. The options of one picture do not apply.
    light
        Azimuth,elevation of a distant light in degrees: 90,45 is above, 180,20 is raking light from
        the left. A third field is the illuminant of this lamp alone: 120,15,warm, 45,30,A or
        45,30,3200K; warm is 2700 K, cool 4000 K. Can be repeated.
        Default: 90,45, or none in an environment.
    point
        x,y,z in mm of a near lamp, from the middle of the painting. Can be repeated.
    lamp_size
        Degrees that the lamps of --light are across: their shadows are soft and their highlights as
        wide. The sun has 0.5, a softbox 20. Default: 0.
    environment
        Light from all directions: gallery, skylight, window, overcast, candles, or an .exr or .hdr
        map (twice as wide as high, or six faces of a cube). No other light is then needed.
    environment_rotation
        Degrees by which the room is turned about the painting's vertical. Default: 0.
    illuminant
        Light of all other lamps: A, D65, FL2 or kelvin, as in 2856K. Any but D65 needs spectra.
    adaptation
        Degree of adaptation of the eye to D65 from the illuminant, or the sum of several: 0 to 1;
        0.56 in the six-band paper. Default: no adaptation.
    adaptation_mode
        planck: between blackbodies, as in the paper; anchored: between the true whites.
    display
        srgb, "Display P3", or a JSON file of measurements.
    view
        Azimuth,elevation of the eye in degrees; default: in front, as far away as the camera was.
    eye
        x,y,z in mm, from the middle of the painting, of an eye that sees it in perspective.
    exposure
        Factor on all light; maximum: the brightest pixel of the picture becomes the display's
        white, as in the six-band paper. Default: the largest at which a white board in full light
        does not clip.
    shadows
        Include cast shadows of the relief.
    varnish
        A coat of 50 micrometres over the painting: clear, yellowed or brown. Needs spectra.
    remove_varnish
        Show the painting without the yellowed or brown varnish under which it was photographed.
        Needs spectra.
    level
        Rotate a panel that leans to face the viewer, so that lights shine on its own plane;
        default: with --shadows.
    reduce
        How many pixels of the result, along a side, become one of the picture, whose gloss stays
        that of the whole.
    width
        An overview of so many pixels across, seen from the front, or of as many as the result has;
        of a .zarr from a smaller scale that it holds, without reading the whole. Of one with more
        than 16 million pixels the largest of these scales is the widest overview.
    region
        A detail at full resolution, in pixels; of a .zarr nothing else is read. Shadows are those
        of the detail alone.
    tolerance
        What may be left out where it cannot be seen: 0, code:1 or dE:0.5. Default: nothing.
    explain
        Print which effects are simulated where, why, what leaving them out costs and saves.
    backend
        cpu: the same bits on every machine; gpu: a graphics card, or any Vulkan driver, also one
        that computes on the CPU; auto: a card if there is one. What these cannot do the CPU does.
    pitch
        Width of a pixel in mm, if the result does not contain it; required for near lamps.
    threads
        Default: every core.
    quiet
        No progress, only errors.
    """
    import impasto
    from impasto.cli.scale import check_parts, plan_parts, render_parts, shown
    from impasto.image import checked_suffix
    from impasto.overview import visible

    stages = Stages(quiet=quiet)
    check_threads(threads)
    if system is not None:
        others = (light, point, environment, environment_rotation, adaptation)
        more = (view, eye, lamp_size, exposure, level, tolerance, pitch, varnish, remove_varnish)
        scale = (width, region)
        chosen = (illuminant, adaptation_mode, display, shadows, reduce, explain, backend)
        usual = ("D65", "planck", "srgb", False, 1, False, "cpu")
        if any(value is not None for value in (*others, *more, *scale)) or chosen != usual:
            raise CycloptsError(
                msg="--system has its own lights, views and displays: give --out and --threads only"
            )
        _figures(result, system, out, stages, threads)
        return
    checked_suffix(out, "--out")
    if pitch is not None:
        length_mm(pitch, "pitch_mm")
    allowed = tolerance_of(tolerance)
    if view is not None and eye is not None:
        raise CycloptsError(msg="--view is a direction and --eye a place: give one of them")
    film = coat(varnish, remove_varnish)
    room = room_of(environment, environment_rotation)
    lights, illuminants = lamps(light, point, illuminant, dark=room is not None, size=lamp_size)
    stood: Any = None if view is None else view.direction
    if eye is not None:
        stood = impasto.PointView(eye)
    scene = impasto.Scene(
        lights,
        environment=room,
        illuminant=illuminants if room is None else [*illuminants, illuminant],
        view=stood,
        perspective=eye is not None,
        adaptation=adaptation,
        adaptation_mode=adaptation_mode,
        display=impasto.colour.as_display(display),
        exposure=exposure,
        shadows=shadows,
        varnish=film,
    )
    part = shown(result, region, width, reduce)
    check_spectra(result, part.reflectance, scene)
    say_false_colours(stages, part.panel, part.reflectance)
    if part.in_parts:
        check_parts(part, out, scene)
    if part.detail and shadows:
        stages.say(f"  {'':14}[dim]what stands around the detail throws no shadow into it[/]")
    plane = panel(stages, part.panel, wanted=shadows if level is None else level)
    options: dict[str, Any] = {
        "pitch_mm": None if pitch is None else part.factor * pitch,
        "level": plane,
        "threads": threads,
    }
    if part.in_parts:
        if explain:
            with stages.stage("plan") as stage:
                planned = plan_parts(
                    part, scene, tolerance=allowed or 0, progress=stage.advance, **options
                )
            stdout().print(planned.explain(), markup=False)
        options |= {"tolerance": allowed, "backend": backend}
        with stages.warned(), stages.stage("picture") as stage:
            out.parent.mkdir(parents=True, exist_ok=True)
            found = render_parts(part, scene, out, progress=stage.advance, **options)
            stage.note = str(out)
        _tell(stages, found.bright, found.exposure, found.clipped)
        return
    surface = visible(part.surface, part.reflectance)
    options |= {"reflectance": part.reflectance, "reduce": part.reduce}
    if explain:
        planned = impasto.plan(surface, scene, tolerance=allowed or 0, **options)
        stdout().print(planned.measured(threads=threads).explain(), markup=False)
    with stages.warned(), stages.stage("picture") as stage:
        image = impasto.render(
            surface,
            scene,
            tolerance=allowed,
            # The message about the exposure needs linear light whatever the format.
            output="light",
            backend=backend,
            progress=stage.advance,
            **options,
        )
        image = part.resampled(image)
        out.parent.mkdir(parents=True, exist_ok=True)
        image.save(out)
        stage.note = str(out)
    if image.valid.any():
        bright = float(np.percentile(image.linear.max(axis=0)[image.valid], 99.0))
        _tell(stages, bright, image.exposure, image.clipped)


def _figures(result: Path, system: Name, out: Path, stages: Stages, threads: int | None) -> None:
    """The rendered figures of a paper, from a result of any of its procedures."""
    from impasto import systems
    from impasto.cli.maps import load_result

    procedure = systems.get(system)
    if not procedure.pictures:
        raise CycloptsError(msg=f"--system {system} has no figures; give a light instead")
    sbrdf, reflectance = load_result(result)
    if procedure.estimator is not None and reflectance is None:
        raise ArgumentError(
            f"--system {system}: its figures need spectra, and {result} has none; fit again with "
            "--camera"
        )
    with stages.stage("pictures") as stage:
        out.mkdir(parents=True, exist_ok=True)
        images = procedure.render(sbrdf, reflectance, threads=threads)
        for name, image in images.items():
            image.save(out / f"{name}.png")
        stage.note = f"{out}: {', '.join(images)}"


def _tell(stages: Stages, bright: float, exposure: float, clipped: dict[str, float]) -> None:
    """Report clipped pixels, and a picture that leaves most of the display unused.

    ``bright``: linear light that 99 % of the pixels do not exceed. Both messages suggest the same
    exposure: 99 % of the pixels then reach up to 0.9 of the display's light. Fewer clipped pixels
    are highlights, and no reason to change the exposure.
    """
    exposure = 0.9 * exposure / bright if bright > 0.0 else exposure
    worst = max(clipped, key=lambda name: clipped[name])
    share = clipped[worst]
    if share > CLIPPED:
        advice = f"; --exposure {exposure:.2g} clips less than 1 %" if bright > 1.0 else ""
        stages.say(
            f"  {'':14}[dim]{100 * share:.1f} % of the pixels are brighter than the display can "
            f"show ({worst} first){advice}[/]"
        )
    elif 0.0 < bright < DARK:
        stages.say(
            f"  {'':14}[dim]a dark picture: 99 % of the pixels are below {100 * bright:.0f} % "
            f"of the display's light; --exposure {exposure:.2g} uses its full range[/]"
        )

"""``impasto calibrate board``, ``linearity`` and ``monochromator``: lamps, noise, curve, bands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from cyclopts import Parameter
from rich.markup import escape

from impasto.cli.calibrate import picture_of, say_written
from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.cli.photographs import dark_of
from impasto.errors import ArgumentError

Numbers: TypeAlias = Annotated[
    list[float] | None, Parameter(consume_multiple=True, negative="", metavar="NUMBER...")
]


def board(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    lights: Path,
    out: Path,
    dark: str | None = None,
    again: Path | None = None,
    reflectance: Annotated[
        list[float] | None, Parameter(consume_multiple=True, negative="")
    ] = None,
    encoding: str | None = None,
    saturation: float | None = None,
    pitch: float | None = None,
    quiet: Flag = False,
) -> None:
    """Write the strengths of lamps from photographs of a white board, and a picture of them.

    FOLDER holds one photograph of the board for each lamp, in the plane of the painting and with
    the camera's settings for it. The strengths go with photographs that are read without the board:
    impasto fit --intensities, or lights.intensities of a session.

    Parameters
    ----------
    lights
        The light file.
    out
        The file to write, a new .txt; it is found without being named as light_intensities.txt
        beside the light file. Errors and noise are in a .json of the same name, a picture in a .png
        beside it, or in a folder named calibration where there are photographs beside it.
    dark
        A dark frame, a folder of dark frames, or the black level in codes.
    again
        A second folder like FOLDER, photographed in the same way: noise of the camera, and how well
        the lamps repeat.
    reflectance
        Of the board, one number or one for each band. Default: 1.
    encoding
        linear, srgb or a gamma. Default: 8-bit files by their profile, else sRGB; others linear.
    saturation
        Code from which samples are clipped; default: the largest.
    pitch
        Width of a pixel on the painting in mm, for lamps with positions.
    quiet
        No progress, only errors.
    """
    from impasto.calibrate import board_picture, board_strengths
    from impasto.io import write_png8

    shown = picture_of(out)
    if out.suffix.lower() != ".txt":
        raise ArgumentError(f"--out: expected a name ending in .txt, found {out.name}")
    for path in (out, out.with_suffix(".json"), shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("board") as stage:
        found = board_strengths(
            folder, lights,
            dark=dark_of(dark), again=again,
            reflectance=1.0 if reflectance is None else reflectance,
            encoding=encoding, saturation=saturation, pitch_mm=pitch,
        )  # fmt: skip
        worst = 196.0 * float(found.sigma.max())
        stage.note = f"{len(found.names)} lamps, strengths within {worst:.2g} % (95 %)"
    even = f"darkest part {100 * found.evenness.min():.0f} % of the brightest or more"
    stages.say(f"  {'':14}[dim]{even}[/]")
    for number, noise in enumerate(found.noise):
        (well, well_sigma), (read, read_sigma) = noise.full_well, noise.read
        stages.say(
            f"  {'':14}[dim]band {number}: {well:.0f} ± {well_sigma:.0f} electrons at full scale, "
            f"read noise {read:.1f} ± {read_sigma:.1f}[/]"
        )
    if found.repeatability is not None:
        stages.say(f"  {'':14}[dim]lamps repeat within {100 * found.repeatability:.2g} %[/]")
    for finding in found.findings:
        stages.say(f"[yellow]warning:[/] {escape(finding)}")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, board_picture(found))
    found.save(out)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --intensities")


def linearity(
    path: Annotated[Path, Parameter(name=["PATH"])],
    /,
    *,
    out: Path,
    patches: Path | None = None,
    times: Numbers = None,
    dark: float | None = None,
    saturation: float | None = None,
    quiet: Flag = False,
) -> None:
    """Measure the tone curve of a camera, and write a file for --encoding and a picture of it.

    PATH is one photograph of grey patches, with --patches, or a folder of photographs of the same
    by several exposure times.

    Parameters
    ----------
    out
        The file to write, a new .json; a picture of the same name, .png, lies beside it, or in a
        folder named calibration where there are photographs beside it.
    patches
        CSV file with the header column,row,size,reflectance: the middle of each patch and the side
        of the square that is read, in pixels.
    times
        Exposure times in the order of the names. Default: those of EXIF.
    dark
        Code of black.
    saturation
        Code from which samples are clipped; default: the largest.
    quiet
        No progress, only errors.
    """
    from impasto.calibrate import tone_from_exposures, tone_from_patches, tone_picture
    from impasto.io import write_png8

    shown = picture_of(out)
    if out.suffix.lower() != ".json":
        raise ArgumentError(f"--out: expected a name ending in .json, found {out.name}")
    for one in (out, shown):
        if one.exists():
            raise ArgumentError(f"--out: {one} already exists; choose another name")
    if patches is not None and times is not None:
        raise ArgumentError("linearity: give --patches for one photograph, or --times for several")
    if patches is None and path.is_file():
        raise ArgumentError(
            "--patches: one photograph needs the places and reflectances of its grey patches"
        )
    stages = Stages(quiet=quiet)
    with stages.stage("tone curve") as stage:
        if patches is not None:
            found = tone_from_patches(path, patches, dark=dark, saturation=saturation)
        else:
            found = tone_from_exposures(path, times=times, dark=dark, saturation=saturation)
        stage.note = (
            f"{len(found.samples.items)} {found.samples.series}, within "
            f"{196 * found.sigma:.2g} % (95 %)"
        )
    low, high = (100 * code for code in found.measured)
    stages.say(f"  {'':14}[dim]codes from {low:.0f} to {high:.0f} % of full scale[/]")
    stages.say(
        f"  {'':14}[dim]nearest known curve {found.nearest_words}, off by "
        f"{100 * found.deviation:.2g} %; "
        f"off a straight line by {100 * found.nonlinearity:.2g} %[/]"
    )
    for finding in found.findings:
        stages.say(f"[yellow]warning:[/] {escape(finding)}")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, tone_picture(found))
    found.save(out)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --encoding")


def monochromator(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    series: Path,
    out: Path,
    illuminant: str | None = None,
    dark: str | None = None,
    region: Annotated[
        tuple[int, int, int, int] | None, Parameter(metavar="TOP LEFT HEIGHT WIDTH", negative="")
    ] = None,
    slit: Literal["triangle", "gaussian"] = "triangle",
    no_correction: Annotated[Flag, Parameter(negative="")] = False,
    encoding: str | None = None,
    saturation: float | None = None,
    quiet: Flag = False,
) -> None:
    """Make a camera from photographs under narrow-band light of known power.

    FOLDER holds photographs of a white patch in the light of a monochromator, or of its exit slit.
    The camera file holds the sensitivities of the bands with their standard deviations: impasto fit
    --camera.

    Parameters
    ----------
    series
        CSV file with the columns photograph, wavelength and bandwidth (nm, full width at half
        maximum) and power (radiant, any unit); optional power_sigma and seconds (exposure time).
    out
        The camera file to write, a new .csv; a picture of the same name, .png, lies beside it, or
        in a folder named calibration where there are photographs beside it.
    illuminant
        The light of the painting's photographs: D50, A, FL2 or kelvin, as in 5000K. Without it, the
        fit needs --illuminant.
    dark
        A dark frame, a folder of dark frames, or the black level in codes.
    region
        The area that is read, in pixels. Default: the lit area is found.
    slit
        Shape of the bandpass: triangle (entrance and exit slit alike) or gaussian.
    no_correction
        Do not correct for the bandwidth.
    encoding
        linear, srgb or a gamma. Default: 8-bit files by their profile, else sRGB; others linear.
    saturation
        Code from which samples are clipped; default: the largest.
    quiet
        No progress, only errors.
    """
    from impasto.calibrate import camera_from_monochromator, monochromator_picture
    from impasto.colour import spectrum
    from impasto.io import write_png8

    shown = picture_of(out)
    if out.suffix.lower() != ".csv":
        raise ArgumentError(f"--out: expected a name ending in .csv, found {out.name}")
    for one in (out, shown):
        if one.exists():
            raise ArgumentError(f"--out: {one} already exists; choose another name")
    if illuminant is not None:
        spectrum(illuminant, (540.0, 560.0))
    stages = Stages(quiet=quiet)
    with stages.stage("camera") as stage:
        found = camera_from_monochromator(
            folder, series,
            dark=dark_of(dark), region=region, slit=slit, correct=not no_correction,
            encoding=encoding, saturation=saturation,
        )  # fmt: skip
        low, high = found.wavelengths[[0, -1]]
        stage.note = f"{len(found.wavelengths)} wavelengths from {low:g} to {high:g} nm"
    for number, name in enumerate(found.names):
        peak = float(found.sensitivities[number].max())
        worst = 100.0 * float(found.sigma[number].max()) / peak
        (first, last), (share, sigma) = found.passed[number], found.leakage[number]
        stages.say(
            f"  {'':14}[dim]{escape(name)}: {first:g} to {last:g} nm, "
            f"{100 * share:.2g} ± {100 * sigma:.1g} % outside; standard deviation up to "
            f"{worst:.2g} % of the largest, correction for the bandwidth up to "
            f"{100 * found.correction[number]:.2g} %[/]"
        )
    for finding in found.findings:
        stages.say(f"[yellow]warning:[/] {escape(finding)}")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, monochromator_picture(found))
    found.save(out, illuminant)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --camera")

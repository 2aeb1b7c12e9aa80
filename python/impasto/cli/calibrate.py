"""``impasto calibrate``: the rig from photographs made for that."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import App, CycloptsError, Parameter
from rich.markup import escape

from impasto.cli.console import Stages
from impasto.cli.options import Flag
from impasto.cli.photographs import dark_of
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.calibrate import PaintingFrame

Boxes: TypeAlias = Annotated[
    list[tuple[int, int, int, int]] | None,
    Parameter(metavar="TOP LEFT HEIGHT WIDTH", negative=""),
]


def application() -> App:
    """The commands below ``impasto calibrate``."""
    app = App(
        name="calibrate",
        help="Find lamps, a camera, a lens and a tone curve from photographs made for that.",
    )
    app.command("impasto.cli.calibrate:lights", help="Lamps, from mirror balls.")
    app.command(
        "impasto.cli.calibrate_painting:lights_from_painting",
        help="Lamps where there is no ball, from the painting itself.",
    )
    app.command("impasto.cli.calibrate:camera", help="A camera, from a ColorChecker.")
    app.command("impasto.cli.calibrate_light:monochromator", help="A camera, from a monochromator.")
    app.command("impasto.cli.calibrate:lens", help="A lens, from a chessboard.")
    app.command("impasto.cli.calibrate_light:board", help="Strengths of lamps, from a white board.")
    app.command(
        "impasto.cli.calibrate_light:linearity",
        help="A tone curve, from grey patches or exposures.",
    )
    return app


def lights(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    out: Path,
    ball: Boxes = None,
    diameter: float | None = None,
    focal: float | None = None,
    sensor: float | None = None,
    lens: Path | None = None,
    alignment: Path | None = None,
    circles: str | None = None,
    rule: Literal["centroid", "median"] = "centroid",
    quiet: Flag = False,
) -> None:
    """Write a light file from photographs of mirror balls, and a picture of what was found.

    FOLDER holds photographs of the painting with one ball or more beside it; or a folder of crops
    for each ball (its name contains ball, probe, sphere or chrome) and one of the object, all with
    the same lamps in the same order.

    Parameters
    ----------
    out
        The light file to write: a new .lp with directions, or .dome with positions of near lamps,
        which takes two balls and --diameter. A picture of the same name, .png, lies beside it, or
        in a folder named calibration where there are photographs beside it.
    ball
        Where a ball lies in the photographs, in pixels. Can be repeated. Default: balls are found.
    diameter
        Of the balls in mm.
    focal
        Focal length of the lens in mm, with --sensor; default: the camera is far away.
    sensor
        Width of the sensor in mm.
    lens
        File of impasto calibrate lens, in place of --focal and --sensor.
    alignment
        Report of impasto align on the same photographs (report/alignment.json), with --lens: lamps
        are then given in the frame of the painting, however askew the camera looked at it.
    circles
        Name of a file in the folder of each ball with x, y and radius of its outline, counted from
        1, y up. Default: outlines are found.
    rule
        How the place of a highlight is found: centroid, or median as published with Xiong's data.
    quiet
        No progress, only errors.
    """
    import numpy as np

    from impasto.calibrate import (
        BallCamera,
        balls_picture,
        lamp_positions,
        lights_from_balls,
        read_balls,
        read_lens,
    )
    from impasto.io import LightFile, write_lights, write_png8

    shown = picture_of(out)
    placed = out.suffix.lower() == ".dome"
    if out.suffix.lower() not in {".lp", ".dome"}:
        raise ArgumentError(f"--out: expected a name ending in .lp or .dome, found {out.name}")
    if (focal is None) != (sensor is None):
        raise CycloptsError(msg="--focal and --sensor belong together: give both")
    if lens is not None and focal is not None:
        raise CycloptsError(msg="--lens has the focal length: leave --focal and --sensor out")
    if alignment is not None and lens is None:
        raise CycloptsError(msg="--alignment needs the --lens that it was made with")
    if placed and diameter is None:
        raise CycloptsError(msg="--out: positions in a .dome need the --diameter of the balls")
    for path in (out, shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("photographs") as stage:
        read = read_balls(folder, circles=circles, boxes=ball)
        stage.note = f"{_counted(len(read.balls), 'ball')}, {_counted(len(read.names), 'lamp')}"
    for note in read.notes:
        stages.say(f"[yellow]warning:[/] {escape(note)}")
    camera = BallCamera()
    frame, width = None, None
    if read.frame is not None:
        rows, columns = read.frame
        camera = BallCamera(None, ((columns - 1) / 2, (rows - 1) / 2))
        if focal is not None and sensor is not None:
            camera = BallCamera.of_sensor(focal, sensor, read.frame)
        if lens is not None:
            matrix = read_lens(lens).matrix
            camera = BallCamera(float(matrix[0, 0]), (float(matrix[0, 2]), float(matrix[1, 2])))
            if alignment is not None:
                frame, width = _frame_of(alignment, read.names)
    elif placed or focal is not None or lens is not None:
        raise ArgumentError(
            f"path: {folder} holds crops of the balls; their places in the photographs, which a "
            "lens and positions (.dome) need, are not known: give photographs with the balls "
            "beside the painting"
        )
    with stages.stage("lamps") as stage:
        found: Any = lights_from_balls(read.balls, camera, rule=rule)
        if read.frame is not None:
            found = found.from_middle(camera)
        if frame is not None:
            found = found.in_frame(frame)
        stage.note = f"directions within {np.degrees(found.sigma.max()):.2f} degrees"
    stages.say(f"  {'':14}[dim]{escape(found.verdict)}[/]")
    written: Any = found.directions
    if placed:
        assert diameter is not None
        assert read.frame is not None
        places = lamp_positions(found, diameter, camera, frame)
        written = LightFile(
            out, "dome", None, found.directions, np.linalg.norm(places.mm, axis=1),
            positions=places.mm,
            width_mm=places.pitch_mm * read.frame[1] if width is None else width,
        )  # fmt: skip
        stages.say(f"  {'':14}[dim]positions within {places.sigma.max():.1f} mm[/]")
    elif found.near.all():
        advice = "an --out that ends in .dome and --diameter keep positions"
        stages.say(f"  {'':14}[dim]directions from the middle of the photograph; {advice}[/]")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, balls_picture(read.balls, found, camera))
    write_lights(out, written, None if placed else read.names)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --lights")


def _frame_of(path: Path, names: tuple[str, ...]) -> tuple[PaintingFrame, float]:
    """How the camera looks at the painting, and the width of that in mm."""
    from impasto.calibrate import PaintingFrame
    from impasto.io.session.alignment import read_alignment

    known = read_alignment(path)
    missing = [name for name in names if known.cameras.get(name.casefold()) is None]
    if missing:
        raise ArgumentError(
            f"--alignment: {path} says of {missing[0]} not where the camera stood; give the "
            "alignment of these photographs, made with --lens"
        )
    camera = known.cameras[names[0].casefold()]
    assert camera is not None
    return PaintingFrame(camera.rotation, camera.place_mm), known.grid.size_mm[0]


def camera(
    photograph: Annotated[Path, Parameter(name=["PHOTOGRAPH"])],
    /,
    *,
    illuminant: str,
    out: Path,
    encoding: str | None = None,
    dark: str | None = None,
    corners: Annotated[
        tuple[float, float, float, float, float, float, float, float] | None,
        Parameter(metavar="X Y X Y X Y X Y", negative=""),
    ] = None,
    quiet: Flag = False,
) -> None:
    """Make a camera from a photograph of a ColorChecker, and a picture of how good it is.

    The camera file holds the sensitivities of the bands and the light: impasto fit --camera.

    Parameters
    ----------
    illuminant
        The light on the chart: D50, A, FL2 or kelvin, as in 5000K.
    out
        The camera file to write, a new .csv; a picture of the same name, .png, lies beside it, or
        in a folder named calibration where there are photographs beside it.
    encoding
        linear, srgb or a gamma. Default: 8-bit files are sRGB, others linear.
    dark
        A dark frame, a folder of dark frames, or the black level in codes.
    corners
        x and y in pixels of the middles of the patches dark skin, bluish green, black and white.
        Default: the chart is found.
    quiet
        No progress, only errors.
    """
    import numpy as np

    from impasto.calibrate import camera_from_chart, chart_picture, linear_photograph
    from impasto.io import write_camera, write_png8

    shown = picture_of(out)
    if out.suffix.lower() != ".csv":
        raise ArgumentError(f"--out: expected a name ending in .csv, found {out.name}")
    for path in (out, shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("photograph") as stage:
        linear = linear_photograph(photograph, encoding, dark_of(dark))
        stage.note = f"{linear.shape[2]} x {linear.shape[1]} pixels, {len(linear)} bands"
    with stages.stage("camera") as stage:
        given = None if corners is None else np.reshape(corners, (4, 2))
        found = camera_from_chart(linear, illuminant, corners=given, name=str(photograph))
        stage.note = f"{found.chart.used.sum()} of 24 patches"
    stages.say(f"  {'':14}[dim]{escape(found.summary())}[/]")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, chart_picture(linear, found))
    write_camera(out, found.camera)
    say_written(stages, out, shown, "impasto fit PHOTOGRAPHS --camera")


def lens(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    target: str,
    out: Path,
    model: Literal["auto", "radial", "brown"] = "auto",
    quiet: Flag = False,
) -> None:
    """Write the distortion of a lens from photographs of a flat target, and a picture of it.

    FOLDER holds ten photographs or more of the target, tilted to all sides and in all parts of the
    frame, with the focus and aperture of the painting's photographs.

    Parameters
    ----------
    target
        chessboard:9x6:25mm with inner corners per row and column and the side of a square, or
        charuco:7x5:30mm:22mm:4x4_50 with squares per row and column, sides of a square and a
        marker, and the dictionary.
    out
        The file to write, a new .json; a picture of the same name, .png, lies beside it.
    model
        radial is the polynomial of 5th order, brown has five coefficients; auto takes the one that
        the photographs support.
    quiet
        No progress, only errors.
    """
    from impasto.calibrate import lens_from_target, lens_picture
    from impasto.io import write_png8

    shown = picture_of(out)
    if out.suffix.lower() != ".json":
        raise ArgumentError(f"--out: expected a name ending in .json, found {out.name}")
    for path in (out, shown):
        if path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    stages = Stages(quiet=quiet)
    with stages.stage("lens") as stage:
        found = lens_from_target(folder, target, model=model, progress=stage.advance)
        lens = found.lens
        stage.note = f"{lens.model}, {lens.corners} corners, residual {lens.residual_px:.3f} pixels"
    sigma = lens.matrix_sigma
    stages.say(
        f"  {'':14}[dim]focal length {lens.matrix[0, 0]:.1f} ± {sigma[0]:.1f} pixels, middle "
        f"({lens.matrix[0, 2]:.1f}, {lens.matrix[1, 2]:.1f}) ± {max(sigma[2:]):.1f}[/]"
    )
    if found.unused:
        names = escape(", ".join(found.unused))
        stages.say(f"[yellow]warning:[/] the target was not found in {names}")
    shown.parent.mkdir(parents=True, exist_ok=True)
    write_png8(shown, lens_picture(found))
    lens.save(out)
    say_written(stages, out, shown, "impasto align PHOTOGRAPHS --lens")


def say_written(stages: Stages, out: Path, shown: Path, use: str) -> None:
    """The last line: the file, the option that takes it, and the picture that shows it."""
    file, picture = shlex.quote(str(out)), shlex.quote(str(shown))
    stages.advise(f"Look at {picture}; then {use} {file}")


def picture_of(out: Path) -> Path:
    """Where the picture goes: among photographs it would be taken for one."""
    from impasto.io.images import list_images

    among = out.parent.is_dir() and bool(list_images(out.parent))
    return (out.parent / "calibration" if among else out.parent) / f"{out.stem}.png"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"

"""``impasto capture``: what to photograph; the photographs are in ``capture_run``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import App, Parameter

from impasto._internal.checks import length_mm
from impasto.cli.console import Stages, stderr, stdout
from impasto.cli.options import Flag, Whole
from impasto.errors import ArgumentError

WIDTHS = {"matte": 0.3, "satin": 0.12, "gloss": 0.075}
"""Radians: gamma of the varnishes of simulated paintings."""


def application() -> App:
    """The commands below ``impasto capture``."""
    app = App(name="capture", help="Plan photographs, take them, and check them.")
    app.command(
        "impasto.cli.capture:plan", help="Say what the lamps of a rig will tell of a painting."
    )
    app.command(
        "impasto.cli.capture:ball_joint",
        name="ball-joint",
        help="Rotations of a ball-joint rig for each light and view.",
    )
    app.command("impasto.cli.capture:exposure", help="Exposures from a pilot photograph.")
    app.command("impasto.cli.capture_run:run", help="Take the photographs, or go on with them.")
    app.command("impasto.cli.capture_run:check", help="Check photographs that were taken.")
    return app


def plan(
    rig: Annotated[str, Parameter(name=["RIG"])],
    /,
    *,
    add: int = 0,
    gloss: Literal["none", "matte", "satin", "gloss"] = "satin",
    tilt: float = 20.0,
    out: Path | None = None,
    quiet: Flag = False,
) -> None:
    """Say what the lamps of a rig can tell at best, and add those that tell most beside them.

    RIG is a light file, the name of a paper's rig (tominaga-rgb-camera,
    tominaga-six-band-adaptation, snel-lafortune), or none.

    Parameters
    ----------
    add
        How many lamps to add.
    gloss
        Of the painting.
    tilt
        Largest angle of its relief from the front, degrees.
    out
        What to write: a plan of shots for capture run --shots, a new .toml, with dark frames and
        reference shots; or a light file, .lp, or .csv for a rig with several views. A picture of
        the same name, .png, lies beside it. Photographs are called shot_001 and so on.
    quiet
        No progress, only errors.
    """
    from impasto.capture import (
        better_lights,
        expected_errors,
        plan_picture,
        plan_shots,
        write_shots,
    )
    from impasto.capture.planning import CANDIDATES
    from impasto.io import LightFile, write_lights, write_png8
    from impasto.rig import FRONTAL, Rig

    shown = None if out is None else out.with_suffix(".png")
    for path in (out, shown):
        if path is not None and path.exists():
            raise ArgumentError(f"--out: {path} already exists; choose another name")
    least = 3 if rig == "none" else 0
    if not least <= add <= CANDIDATES:
        raise ArgumentError(
            f"--add: expected a whole number from {least} to {CANDIDATES}, found {add}"
        )
    options: dict[str, Any] = {**_lobe(gloss), "tilt": np.radians(tilt)}
    there = _rig(rig)
    before = None if there is None else expected_errors(there, **options)
    directions = np.empty((0, 3)) if there is None else there.directions
    views = np.empty((0, 3)) if there is None else there.views
    added = np.empty((0, 3))
    stages = Stages(quiet=quiet)
    if add:
        with stages.stage("lamps") as stage:
            added = better_lights(there, add, **options)
            stage.note = f"{add} added"
        views = np.concatenate([views, np.broadcast_to(FRONTAL, added.shape)])
    every = np.concatenate([directions, added])
    after = expected_errors(Rig(every, views=views), **options)
    for line in _table(before if add else None, after):
        stdout().print(line, markup=False)
    if out is not None:
        assert shown is not None
        out.parent.mkdir(parents=True, exist_ok=True)
        write_png8(shown, plan_picture(directions, added, before if add else None, after))
        names = tuple(f"shot_{number:03}" for number in range(1, len(every) + 1))
        several = bool((views != views[0]).any())
        file = LightFile(
            out, out.suffix[1:], names, every, np.ones(len(every)), views=views if several else None
        )
        if out.suffix.lower() == ".toml":
            write_shots(out, plan_shots(file))
        else:
            write_lights(out, file)


def ball_joint(
    rig: Annotated[str, Parameter(name=["RIG"])],
    /,
    *,
    lamps: str = "-45,0,45",
    pan: float = 75.0,
    tilt: float = 60.0,
    roll: float = 180.0,
    camera: float = 100.0,
    separation: float = 5.0,
    every: int = 50,
    exposure: str = "10",
    darks: Whole = 3,
    distance: float | None = None,
    gloss: Literal["none", "matte", "satin", "gloss"] = "satin",
    out: Path | None = None,
    quiet: Flag = False,
) -> None:
    """Turn pairs of light and view into settings of a ball-joint rig, in an order of short travel.

    RIG is snel-lafortune, the 770 pairs of the third paper, or a light file with a view for each
    light. A pair that the rig cannot reach stops the command, with the nearest setting.

    Parameters
    ----------
    lamps
        Angles of the places of the lamp in the horizontal plane, degrees; to the right is positive.
    pan
        How far the joint turns to either side about the vertical, degrees.
    tilt
        How far it turns about the horizontal axis.
    roll
        How far it turns about the normal of the painting.
    camera
        How far the camera moves to either side, degrees.
    separation
        Least angle between camera and lamp, degrees.
    every
        Shots between two reference poses; 0: none.
    exposure
        Exposure time of each pair, ms, or several such as 2,8,32: a bracket of each. Reference
        poses have the longest but one.
    darks
        How many dark frames.
    distance
        From the middle of the painting to the lamp, mm. Default: far away.
    gloss
        Of the painting, for the least errors.
    out
        The plan to write, a new .toml for capture run --shots. A picture of the same name, .png,
        and a light file, such as shots_lights.csv, lie beside it.
    quiet
        No progress, only errors.
    """
    from impasto.capture import (
        BallJointRig,
        ball_joint_picture,
        ball_joint_plan,
        expected_errors,
        plan_ball_joint_shots,
        write_ball_joint_lights,
        write_shots,
    )
    from impasto.io import write_png8

    files = None
    if out is not None:
        if out.suffix.lower() != ".toml":
            raise ArgumentError(f"--out: expected a name that ends in .toml, found {out}")
        files = out, out.with_suffix(".png"), out.with_name(f"{out.stem}_lights.csv")
        for path in files:
            if path.exists():
                raise ArgumentError(f"--out: {path} already exists; choose another name")
    seconds = milliseconds(exposure)
    if distance is not None:
        length_mm(distance, "--distance")
    pairs = _rig(rig)
    if pairs is None:
        raise ArgumentError("RIG: expected snel-lafortune or a light file with views, found none")
    sides = {
        name: (math.radians(-side), math.radians(side))
        for name, side in (("pan", pan), ("tilt", tilt), ("roll", roll), ("camera", camera))
    }
    mechanism = BallJointRig(lamps=_degrees(lamps), separation=math.radians(separation), **sides)
    stages = Stages(quiet=quiet)
    with stages.stage("shots") as stage:
        found = plan_ball_joint_shots(pairs, mechanism, every=every)
        stage.note = f"{len(found.pairs)} pairs, {len(found.shots) - len(found.pairs)} references"
    errors = expected_errors(pairs, **_lobe(gloss))
    stdout().print(
        f"travel, degrees (as listed)         {math.degrees(found.travel):10.0f}"
        f"{math.degrees(found.travel_as_listed):10.0f}",
        markup=False,
    )
    stdout().print(f"moves of the lamp                   {found.lamp_changes:10}", markup=False)
    for line in _table(None, errors):
        stdout().print(line, markup=False)
    if files is not None:
        shots, picture, lights = files
        shots.parent.mkdir(parents=True, exist_ok=True)
        write_png8(picture, ball_joint_picture(found, errors))
        write_ball_joint_lights(lights, found)
        planned = ball_joint_plan(found, exposure_s=seconds, darks=darks, distance_mm=distance)
        write_shots(shots, planned)


def exposure(
    pilot: Annotated[Path, Parameter(name=["PILOT"])],
    /,
    *,
    seconds: float,
    dark: float = 0.0,
    read_noise: float = 0.001,
    shot_noise: float = 0.005,
    signal_to_noise: float = 30.0,
    encoding: str | None = None,
) -> None:
    """Print how many seconds to expose, one or several times, from a short pilot photograph.

    Parameters
    ----------
    seconds
        The exposure of PILOT, which must be so short that its highlights are whole.
    dark
        Code of PILOT that is no light.
    read_noise
        Standard deviation of a sample in the dark, as a share of full scale.
    shot_noise
        That of a sample at full scale, without that of the dark.
    signal_to_noise
        Least ratio of the median of the light to its noise.
    encoding
        Tone curve of the file: srgb, linear or a gamma such as 2.2. Default: srgb for 8-bit files,
        linear for all others.
    """
    from impasto.capture import Noise, exposures_from_pilot
    from impasto.io.session.linear_codes import read_photograph

    if not pilot.exists():
        raise ArgumentError(f"PILOT: {pilot} does not exist")
    photograph = read_photograph(pilot, encoding)
    full = 65535.0 if photograph.planes.dtype.kind == "u" else 1.0
    if not 0.0 <= dark < full:
        raise ArgumentError(f"--dark: expected a code from 0 to {full:g}, found {dark:g}")
    light = (photograph.planes.astype(np.float64) - dark) / (full - dark)
    noise = Noise(read=read_noise, shot=shot_noise)
    found = exposures_from_pilot(light, seconds, noise=noise, signal_to_noise=signal_to_noise)
    for one in found:
        stdout().print(f"{one:.6g}", markup=False)
    times = ",".join(f"{1000.0 * one:.4g}" for one in found)
    stderr().print(f"in a plan: --exposure {times} (ms)", markup=False)


def milliseconds(text: str) -> tuple[float, ...]:
    """Exposure times in seconds from milliseconds with commas between them."""
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError:
        raise ArgumentError(
            f"--exposure: expected milliseconds such as 10, or 2,8,32, found {text!r}"
        ) from None
    if not all(0.0 < one < 1e7 for one in found):
        raise ArgumentError(f"--exposure: expected milliseconds above 0, found {text}")
    return tuple(one / 1000.0 for one in found)


def _degrees(text: str) -> tuple[float, ...]:
    """Angles in radians from degrees with commas between them."""
    try:
        return tuple(math.radians(float(word)) for word in text.split(","))
    except ValueError:
        raise ArgumentError(f"--lamps: expected degrees such as -45,0,45, found {text!r}") from None


def _lobe(gloss: str) -> dict[str, Any]:
    """The lobe of a varnish that reflects as much as a smooth interface."""
    gamma = WIDTHS.get(gloss, WIDTHS["satin"])
    return {"beta": 0.0 if gloss == "none" else math.log(2.0) / (4.0 * gamma**2), "gamma": gamma}


def _rig(name: str) -> Any:
    """The lamps that are there."""
    from impasto.io import read_lights
    from impasto.rig import Rig
    from impasto.simulate import rig
    from impasto.simulate.rigs import RIGS

    if name == "none":
        return None
    if name in RIGS:
        return rig(name)
    path = Path(name)
    if not path.exists():
        raise ArgumentError(
            f"RIG: {name} is no file; expected a light file, none, or one of {', '.join(RIGS)}"
        )
    file = read_lights(path)
    return Rig(file.directions, views=file.views)


def _table(before: Any, after: Any) -> list[str]:
    columns = [after] if before is None else [before, after]
    rows = [
        ("normal, degrees", [np.degrees(one.normal) for one in columns]),
        ("normal of the worst tilt, degrees", [np.degrees(one.worst_normal) for one in columns]),
        ("reflectance, %", [100 * one.albedo for one in columns]),
        (f"beta of {after.pixels} pixels, %", [100 * one.beta for one in columns]),
        (f"gamma of {after.pixels} pixels, %", [100 * one.gamma for one in columns]),
        ("condition number", [one.condition for one in columns]),
        ("samples in the light, %", [100 * one.lit for one in columns]),
    ]
    head = "" if before is None else f"{'before':>10}{'after':>10}"
    lines = [f"{'least errors':36}{head}".rstrip()]
    for name, values in rows:
        cells = [f"{value:.3g}" if np.isfinite(value) else "unknown" for value in values]
        lines.append(f"{name:36}" + "".join(f"{cell:>10}" for cell in cells))
    return lines

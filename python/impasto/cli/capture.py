"""``impasto capture``: what to photograph; the photographs are in ``capture_run``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import App, Parameter

from impasto.cli.console import Stages, stdout
from impasto.cli.options import Flag
from impasto.errors import ArgumentError

WIDTHS = {"matte": 0.3, "satin": 0.12, "gloss": 0.075}
"""Radians: gamma of the varnishes of simulated paintings."""


def application() -> App:
    """The commands below ``impasto capture``."""
    app = App(name="capture", help="Plan photographs, take them, and check them.")
    app.command("impasto.cli.capture:plan")
    app.command("impasto.cli.capture_run:run")
    app.command("impasto.cli.capture_run:check")
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
        The light file to write, a new .lp, or .csv for a rig with several views; a picture of the
        same name, .png, lies beside it. Photographs are called shot_001 and so on.
    quiet
        No progress, only errors.
    """
    from impasto.capture import better_lights, expected_errors, plan_picture
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
    gamma = WIDTHS.get(gloss, WIDTHS["satin"])
    # As much as a smooth interface reflects.
    beta = 0.0 if gloss == "none" else math.log(2.0) / (4.0 * gamma**2)
    options: dict[str, Any] = {"beta": beta, "gamma": gamma, "tilt": np.radians(tilt)}
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
        write_lights(out, file)


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

"""``impasto rehearse``: a session from raw photographs to the relit picture, simulated."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.table import Table

from impasto.cli import console
from impasto.cli.console import Stages
from impasto.cli.options import Flag, SomeWhole, Whole
from impasto.errors import ArgumentError

if TYPE_CHECKING:
    from impasto.rehearsal.course import Done, Step

Rehearsed = Literal["tominaga-rgb-camera", "tominaga-six-band-adaptation", "snel-lafortune"]
MOVING: Rehearsed = "snel-lafortune"
"""The system whose camera moves."""
LEAST = 96
"""Pixels: of smaller paintings the markers cannot be read."""


def rehearse(
    system: Rehearsed = "tominaga-rgb-camera",
    /,
    *,
    out: Path = Path("rehearsal"),
    size: Whole = 256,
    views: SomeWhole = None,
    seed: Whole = 0,
    photographs: Flag = False,
    quiet: Flag = False,
) -> None:
    """Rehearse the session of a paper: photographs, calibration, alignment, fit, picture.

    A simulated painting lies between four markers and two mirror balls, under near lamps of unequal
    strength, before a camera with a lens. All its photographs are written, with those of a white
    board, a ColorChecker, the dark and a target for the lens. With snel-lafortune, a painting with
    bulges and patches of varnish lies between four markers, and each of some hundred photographs
    has a light and a view of its own. The commands that a lab would type follow, each with its time
    and memory, and the result is compared with the truth.

    Parameters
    ----------
    system
        Whose lamps and bands.
    out
        A new folder.
    size
        Height and width of the painting in pixels.
    views
        snel-lafortune: how many of its pairs of light and view, spread over all. Default: all whose
        view is at most 60 degrees from the front.
    seed
        Of painting, lamps and noise.
    photographs
        Only write the photographs and print the commands, to be typed one after the other.
    quiet
        Print no more than errors.
    """
    import json

    from impasto.io.files import atomic_bytes

    if out.exists():
        raise ArgumentError(f"--out: {out} already exists; choose another name")
    if size < LEAST:
        raise ArgumentError(f"--size: expected at least {LEAST} pixels, found {size}")
    if views is not None and system != MOVING:
        raise ArgumentError(f"--views: is for {MOVING}; {system} has one view")
    settings = {"system": system, "size": size, "seed": seed}
    run = _moving if system == MOVING else _still
    record = run(system, out, settings, views, photographs, quiet)
    if record is None:
        return
    atomic_bytes(out / "rehearsal.json", (json.dumps(record, indent=1) + "\n").encode())
    if quiet:
        return
    page = console.stdout()
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 3, 0, 0))
    for name, value in record["errors"].items():
        table.add_row(name.replace("_", " "), f"{value:.3g}")
    page.print("\nErrors against the truth:\n")
    page.print(table)
    page.print(f"\nLook at {out / 'rehearsal.png'}; rehearsal.json has all numbers.")


def _still(
    system: str,
    out: Path,
    settings: dict[str, Any],
    _: int | None,
    only_photographs: bool,
    quiet: bool,
) -> dict[str, Any] | None:
    """The session of a camera that stands; None where only its photographs are asked for."""
    import impasto
    from impasto import simulate
    from impasto.calibrate import linear_photograph
    from impasto.cli.maps import SPECTRA
    from impasto.io import read_lights, write_png8
    from impasto.rehearsal.course import steps
    from impasto.rehearsal.outcome import outcome
    from impasto.rehearsal.photographs import photograph_session
    from impasto.simulate.cameras import LAMP_KELVIN

    stages = Stages(quiet=quiet)
    size, seed = settings["size"], settings["seed"]
    with stages.stage("painting", f"{size} x {size} pixels, seed {seed}"):
        painting = simulate.painting(seed, (size, size))
    with stages.stage("photographs") as stage:
        session = photograph_session(out, system, painting, seed=seed, progress=stage.advance)
        stage.note = str(out)
    commands = steps(session, round(LAMP_KELVIN), painting.pitch_mm)
    if only_photographs:
        _listed(out, commands)
        return None
    done = _carried_out(out, commands, quiet)
    with stages.stage("truth", "the same light on the true painting"):
        sbrdf = impasto.load_sbrdf(out / "fit")
        lamps = read_lights(out / "painting" / "lights.dome").positions
        assert lamps is not None
        found = outcome(
            session.truth, sbrdf, impasto.Reflectance.load(out / "fit" / SPECTRA), lamps
        )
        first = session.names[1]
        seen, frontal = (
            linear_photograph(out / "painting" / folder / first)
            for folder in ("photographs", "aligned")
        )
        write_png8(out / "rehearsal.png", found.picture(seen, frontal, sbrdf.normal))
    return settings | {"commands": _numbers(done), "errors": found.numbers()}


def _moving(
    _: str,
    out: Path,
    settings: dict[str, Any],
    views: int | None,
    only_photographs: bool,
    quiet: bool,
) -> dict[str, Any] | None:
    """The session of a camera that moves; None where only its photographs are asked for."""
    import impasto
    from impasto import simulate
    from impasto.calibrate import linear_photograph
    from impasto.io import write_png8
    from impasto.rehearsal.course import moving_steps
    from impasto.rehearsal.moving_outcome import moving_outcome
    from impasto.rehearsal.moving_views import FLATTEST, photograph_views, steep_pairs
    from impasto.rehearsal.relief import with_bulges

    stages = Stages(quiet=quiet)
    size, seed = settings["size"], settings["seed"]
    picked, flat = steep_pairs(views)
    stages.say(
        f"  {'':14}{len(picked)} pairs of light and view; {flat} of the rig's are flatter than "
        f"{FLATTEST:g} degrees and left out: their markers cannot be read"
    )
    with stages.stage("painting", f"{size} x {size} pixels, seed {seed}"):
        flat_painting = simulate.painting(seed, (size, size), varnish="patches")
        painting = with_bulges(flat_painting, seed)
    with stages.stage("photographs") as stage:
        session = photograph_views(out, painting, views=views, seed=seed, progress=stage.advance)
        stage.note = str(out)
    commands = moving_steps(session, painting.pitch_mm)
    if only_photographs:
        _listed(out, commands)
        return None
    done = _carried_out(out, commands, quiet)
    with stages.stage("truth", "the same light and views on the true painting"):
        sbrdf = impasto.load_sbrdf(out / "fit")
        assert isinstance(sbrdf, impasto.LafortuneSbrdf)
        found = moving_outcome(session, sbrdf)
        flattest = max(range(len(session.names)), key=lambda one: session.cameras[one].tilt)
        seen, frontal = (
            linear_photograph(out / "painting" / folder / session.names[flattest])
            for folder in ("photographs", "aligned")
        )
        write_png8(out / "rehearsal.png", found.picture(seen, frontal, sbrdf.normal))
    return settings | {
        "views": len(session.names),
        "left_out": session.left_out,
        "commands": _numbers(done),
        "errors": found.numbers(),
    }


def _listed(out: Path, commands: list[Step]) -> None:
    """Print the commands, after the one that goes to the folder in which they are typed."""
    page = console.stdout()
    page.print(f"cd {shlex.quote(str(out))}", soft_wrap=True, highlight=False)
    for step in commands:
        page.print(str(step), soft_wrap=True, highlight=False)


def _carried_out(out: Path, commands: list[Step], quiet: bool) -> list[Done]:
    """Run the commands and print what each took."""
    from impasto.rehearsal.course import carried_out

    done, page = [], console.stdout()
    for finished in carried_out(out, commands):
        done.append(finished)
        if not quiet:
            page.print(f"$ {finished.step}", soft_wrap=True, highlight=False)
            peak = finished.peak_mib
            memory = "memory unknown" if peak is None else f"{peak:.0f} MiB"
            page.print(f"  [dim]{finished.seconds:.1f} s, {memory}[/]")
    return done


def _numbers(done: list[Done]) -> list[dict[str, Any]]:
    """Commands with time and memory, for the record."""
    return [
        {
            "command": str(one.step),
            "purpose": one.step.purpose,
            "seconds": one.seconds,
            "peak_mib": one.peak_mib,
        }
        for one in done
    ]

"""``impasto rehearse``: a session from raw photographs to the relit picture, simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rich.table import Table

from impasto.cli import console
from impasto.cli.console import Stages
from impasto.cli.options import Flag, Whole
from impasto.errors import ArgumentError

Rehearsed = Literal["tominaga-rgb-camera", "tominaga-six-band-adaptation"]
LEAST = 96
"""Pixels: of smaller paintings the markers cannot be read."""


def rehearse(
    system: Rehearsed = "tominaga-rgb-camera",
    /,
    *,
    out: Path = Path("rehearsal"),
    size: Whole = 256,
    seed: Whole = 0,
    photographs: Flag = False,
    quiet: Flag = False,
) -> None:
    """Rehearse the session of a paper: photographs, calibration, alignment, fit, picture.

    A simulated painting lies between four markers and two mirror balls, under near lamps of unequal
    strength, before a camera with a lens. All its photographs are written, with those of a white
    board, a ColorChecker, the dark and a target for the lens. The commands that a lab would type
    follow, each with its time and memory, and the result is compared with the truth.

    Parameters
    ----------
    system
        Whose lamps and bands.
    out
        A new folder.
    size
        Height and width of the painting in pixels.
    seed
        Of painting, lamps and noise.
    photographs
        Only write the photographs and print the commands.
    quiet
        Print no more than errors.
    """
    import json

    import impasto
    from impasto import simulate
    from impasto.calibrate import linear_photograph
    from impasto.cli.maps import SPECTRA
    from impasto.io import read_lights, write_png8
    from impasto.io.files import atomic_bytes
    from impasto.rehearsal.course import carried_out, steps
    from impasto.rehearsal.outcome import outcome
    from impasto.rehearsal.photographs import photograph_session
    from impasto.simulate.cameras import LAMP_KELVIN

    if out.exists():
        raise ArgumentError(f"--out: {out} already exists; choose another name")
    if size < LEAST:
        raise ArgumentError(f"--size: expected at least {LEAST} pixels, found {size}")
    stages = Stages(quiet=quiet)
    with stages.stage("painting", f"{size} x {size} pixels, seed {seed}"):
        painting = simulate.painting(seed, (size, size))
    with stages.stage("photographs") as stage:
        session = photograph_session(out, system, painting, seed=seed, progress=stage.advance)
        stage.note = str(out)
    commands = steps(session, round(LAMP_KELVIN), painting.pitch_mm)
    page = console.stdout()
    if photographs:
        for step in commands:
            page.print(str(step), soft_wrap=True, highlight=False)
        return
    done = []
    for finished in carried_out(session, commands):
        done.append(finished)
        if not quiet:
            page.print(f"$ {finished.step}", soft_wrap=True, highlight=False)
            page.print(f"  [dim]{finished.seconds:.1f} s, {finished.peak_mib:.0f} MiB[/]")
    with stages.stage("truth", "the same light on the true painting"):
        sbrdf = impasto.load_sbrdf(out / "fit")
        lamps = read_lights(out / "painting" / "lights.dome").positions
        assert lamps is not None
        found = outcome(
            session.truth,
            sbrdf,
            impasto.Reflectance.load(out / "fit" / SPECTRA),
            lamps,
        )
        first = session.names[1]
        seen, frontal = (
            linear_photograph(out / "painting" / folder / first)
            for folder in ("photographs", "aligned")
        )
        write_png8(out / "rehearsal.png", found.picture(seen, frontal, sbrdf.normal))
        record = {
            "system": system,
            "size": size,
            "seed": seed,
            "commands": [
                {
                    "command": str(one.step),
                    "purpose": one.step.purpose,
                    "seconds": one.seconds,
                    "peak_mib": one.peak_mib,
                }
                for one in done
            ],
            "errors": found.numbers(),
        }
        atomic_bytes(out / "rehearsal.json", (json.dumps(record, indent=1) + "\n").encode())
    if not quiet:
        table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 3, 0, 0))
        for name, value in found.numbers().items():
            table.add_row(name.replace("_", " "), f"{value:.3g}")
        page.print("\nErrors against the truth:\n")
        page.print(table)
        page.print(f"\nLook at {out / 'rehearsal.png'}; rehearsal.json has all numbers.")

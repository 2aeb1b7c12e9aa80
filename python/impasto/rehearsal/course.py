"""From raw photographs to the relit picture by the commands that a lab would type.

Each command runs in a process of its own, so that its time and its memory are known.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from impasto.errors import ArgumentError
from impasto.rehearsal.moving_outcome import PAIRS
from impasto.rehearsal.moving_views import CARD, MovingSession
from impasto.rehearsal.photographs import Session

PICTURE = "relit.png"
LIGHT = (60, 50)
"""Azimuth and elevation in degrees of a light that no photograph had."""
ILLUMINANT = "D65"


COMMAND = """
import sys
from impasto._internal.peak import peak_bytes
from impasto.cli import main

code = main(sys.argv[2:])
with open(sys.argv[1], "w") as file:
    print(peak_bytes() or "unknown", file=file)
sys.exit(code)
"""
"""Runs a command and writes its largest resident memory into a file: what it prints is its own."""


@dataclass(frozen=True)
class Step:
    """One command of a session.

    Attributes
    ----------
    words
        What a user types after ``impasto``, in the folder of the session.
    purpose
        What it is for, in a few words.
    """

    words: tuple[str, ...]
    purpose: str

    def __str__(self) -> str:
        return " ".join(("impasto", *self.words))


@dataclass(frozen=True)
class Done:
    """A command that has run.

    Attributes
    ----------
    step
        The command.
    seconds
        Wall-clock time.
    peak_mib
        The largest resident memory of its process in MiB; None where the system does not say.
    said
        What it printed.
    """

    step: Step
    seconds: float
    peak_mib: float | None
    said: str


def steps(session: Session, kelvin: int, pixel_mm: float) -> list[Step]:
    """The commands, from the lens to the relit picture."""
    width, height = session.size_mm
    rows = [
        ("the lens", "calibrate lens target --out painting/lens.json "
         f"--target chessboard:9x6:{session.lattice_mm:g}mm"),
        ("frontal photographs", "align painting/photographs --out painting/aligned "
         f"--markers aruco:4x4_50:{session.marker_mm:g}mm --size {width:g}x{height:g} "
         f"--lens painting/lens.json --pixel {pixel_mm:g} --fixed-camera"),
        ("where the lamps stand", "calibrate lights painting/photographs "
         f"--out painting/lights.dome --diameter {session.ball_mm:g} --lens painting/lens.json "
         "--alignment painting/aligned/report/alignment.json"),
        ("what the bands see", "calibrate camera chart.tif --out camera.csv "
         f"--illuminant {kelvin}K --dark painting/dark"),
        ("one file for all", "session init painting"),
        ("is all there?", "session check painting"),
        ("normals, gloss, spectra", "fit painting/session.toml --camera camera.csv --out fit"),
        ("in another light", f"render fit --light {LIGHT[0]},{LIGHT[1]} "
         f"--illuminant {ILLUMINANT} --out {PICTURE}"),
    ]  # fmt: skip
    return [Step(tuple(words.split()), purpose) for purpose, words in rows]


def moving_steps(session: MovingSession, pixel_mm: float) -> list[Step]:
    """The commands of a session with moving views, from the lens to a picture at another pair."""
    width, height = session.size_mm
    rows, columns = session.painting.size
    (turn, up), (side, high) = PAIRS[0]
    card = ",".join(f"{value:g}" for value in session.card_mm)
    rows_of = [
        ("the lens", "calibrate lens target --out painting/lens.json "
         f"--target chessboard:9x6:{session.lattice_mm:g}mm"),
        ("frontal photographs", "align painting/photographs --out painting/aligned "
         f"--markers aruco:4x4_50:{session.marker_mm:g}mm --size {width:g}x{height:g} "
         f"--lens painting/lens.json --pixel {pixel_mm:g} --depth estimate "
         f"--lights painting/lights.dome --card {card} "
         f"--card-reflectance {CARD:g} --dark painting/dark"),
        ("one file for all", "session init painting"),
        ("is all there?", "session check painting"),
        ("normals and lobes", "fit painting/session.toml --model lafortune --lobes 3 "
         f"--region {session.rim} {session.rim} {rows} {columns} --out fit"),
        ("at another pair", f"render fit --light {turn:g},{up:g} --view {side:g},{high:g} "
         f"--out {PICTURE}"),
    ]  # fmt: skip
    return [Step(tuple(words.split()), purpose) for purpose, words in rows_of]


def carried_out(folder: Path, commands: list[Step]) -> Iterator[Done]:
    """Run the commands in the folder of a session.

    Raises
    ------
    ArgumentError
        A command failed; with what it said.
    """
    for step in commands:
        start = time.perf_counter()
        with TemporaryDirectory() as own:
            peak = Path(own) / "peak"
            child = subprocess.run(
                [sys.executable, "-c", COMMAND, str(peak), *step.words],
                cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                check=False,
            )  # fmt: skip
            # A process that was killed has written nothing.
            word = peak.read_text().strip() if peak.is_file() else ""
        said = child.stdout.rstrip()
        if child.returncode != 0:
            # One line: errors show what breaks lines as codes.
            words = " / ".join(said.splitlines())
            raise ArgumentError(f"{step} ended with exit code {child.returncode}: {words}")
        mib = int(word) / (1 << 20) if word.isdigit() else None
        yield Done(step, time.perf_counter() - start, mib, said)

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
from impasto.cli import main

code = main(sys.argv[1:])
with open("/proc/self/status") as status:
    peak = next(line.split()[1] for line in status if line.startswith("VmHWM"))
print(peak)
sys.exit(code)
"""
"""Runs a command and prints its largest resident memory in KiB: what the system says of a child
includes its parent's."""


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
        The largest resident memory of its process in MiB.
    said
        What it printed.
    """

    step: Step
    seconds: float
    peak_mib: float
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
    rows_of = [
        ("the lens", "calibrate lens target --out painting/lens.json "
         f"--target chessboard:9x6:{session.lattice_mm:g}mm"),
        ("frontal photographs", "align painting/photographs --out painting/aligned "
         f"--markers aruco:4x4_50:{session.marker_mm:g}mm --size {width:g}x{height:g} "
         f"--lens painting/lens.json --pixel {pixel_mm:g} --depth estimate "
         f"--card {','.join(f'{value:g}' for value in session.card_mm)} "
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
        child = subprocess.run(
            [sys.executable, "-c", COMMAND, *step.words],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            check=False,
        )  # fmt: skip
        said, _, peak = child.stdout.rstrip().rpartition("\n")
        if child.returncode != 0:
            raise ArgumentError(f"{step} ended with exit code {child.returncode}:\n{said}")
        yield Done(step, time.perf_counter() - start, int(peak) / 1024.0, said)

"""``impasto capture run`` and ``check``: take the photographs of a plan, and examine them."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from impasto._internal.wording import counted
from impasto.cli.capture import milliseconds
from impasto.cli.codes import Exit
from impasto.cli.console import Stages, print_json, stderr, stdout
from impasto.cli.options import Flag, Whole
from impasto.errors import ArgumentError, DeviceError

if TYPE_CHECKING:
    from impasto.capture import CaptureResult, ShotPlan

DAMAGED = frozenset({"missing", "changed", "corrupt", "swapped"})
"""Codes of files that are not as they were written: exit code 3 of a check."""


def run(
    *,
    lights: Path | None = None,
    shots: Path | None = None,
    camera: Literal["simulated", "gphoto2", "folder"] = "simulated",
    dome: str | None = None,
    stage: Literal["fixed", "ball-joint"] | None = None,
    watch: Path | None = None,
    out: Path | None = None,
    exposure: str = "10",
    darks: Whole = 3,
    references: Whole = 20,
    warm_up: float = 20.0,
    resume: Flag = False,
    dry_run: Flag = False,
    faults: float = 0.0,
    seed: Whole = 0,
    size: Whole = 256,
    quiet: Flag = False,
) -> int:
    """Take the photographs of a plan, one lamp at a time, and write them with a session.toml.

    Each photograph is checked and on the disk before the next one is taken. What fails is taken
    again, up to three times; the rest is printed as a retake list. After any interruption the same
    command with --resume goes on.

    Exit code 4: shots are missing, or have to be taken again.

    Parameters
    ----------
    lights
        The light file of the rig: lamp 1 is its first line. Dark frames come first, then each lamp
        once, with reference shots between them.
    shots
        In place of a light file: a plan, as capture plan and capture ball-joint write one, and
        --dry-run prints one.
    camera
        simulated: a simulated painting, to try a plan. gphoto2: a camera at a USB port. folder: any
        camera, released by hand, which saves into the folder of --watch.
    dome
        Serial port of the lamps, such as /dev/ttyUSB0; without it you are told which lamp to
        switch on.
    stage
        fixed: nothing moves. ball-joint: the painting turns on a ball joint, and the camera beside
        it; with a camera that is not simulated you are told the angles. Default: ball-joint for a
        plan with angles.
    watch
        The folder in which new photographs appear.
    out
        The folder of the capture, new or empty.
    exposure
        Exposure time of all shots of a light file, ms, or several such as 2,8,32: each photograph
        is then taken with all of them, and read as one.
    darks
        How many dark frames.
    references
        A reference shot before every so many photographs; 0: none.
    warm_up
        Seconds between reference frames before the first shot, until three of them differ by less
        than 0.3 %; 0: no such wait.
    resume
        Go on with the capture in --out, and take again what its retake list names.
    dry_run
        Print the plan and take nothing; > shots.toml makes a file of it, to be edited.
    faults
        Of the simulated rig: percent of the photographs that go wrong.
    seed
        Of the simulated painting, its noise and faults.
    size
        Rows and columns of the simulated photographs.
    quiet
        No progress, only errors and what to do by hand.
    """
    from impasto import capture

    plan = _plan(lights, shots, out if resume else None, exposure, darks, references)
    if dry_run:
        _show(plan)
        return Exit.OK
    if out is None:
        raise ArgumentError("--out: give the folder for the photographs")
    if watch is not None and camera != "folder":
        raise ArgumentError("--watch: is for --camera folder")
    if dome is not None and camera == "simulated":
        raise ArgumentError(
            "--dome: the camera is simulated, which is the default, and sees simulated lamps only; "
            "give --camera gphoto2 or --camera folder, or leave --dome out"
        )
    if not 0.0 <= warm_up < 86400.0:
        raise ArgumentError(f"--warm-up: expected seconds from 0 on, found {warm_up:g}")
    if not 0.0 <= faults <= 100.0:
        raise ArgumentError(f"--faults: expected percent from 0 to 100, found {faults:g}")
    stages = Stages(quiet=quiet)
    turning = stage == "ball-joint" or (stage is None and bool(plan.joints()))
    if camera == "simulated":
        devices = _simulated(plan, faults / 100.0, seed, size, turning)
        wait = None if warm_up == 0.0 else 0.0  # simulated lamps are warm
    else:
        devices, wait = _devices(plan, camera, dome, watch, turning), warm_up or None
    with devices as (eye, lamps, mover), stages.stage("photographs") as shown:
        result = capture.run(
            plan, eye, lamps, mover, out, resume=resume, warm_up_s=wait,
            progress=shown.advance, say=_warn,
        )  # fmt: skip
        shown.note = f"{result.taken} of {result.planned}"
    _report(result)
    if result.session is not None:
        stdout().out(f"written  {result.session}")
    elif result.taken:
        stdout().out("kept     session.toml as it is, since it was edited by hand")
    return Exit.OK if result.complete else Exit.PARTIAL


def check(
    folder: Annotated[Path, Parameter(name=["FOLDER"])],
    /,
    *,
    json: Flag = False,
    quiet: Flag = False,
) -> int:
    """Examine all photographs of a capture again, and print the retake list; changes nothing.

    Files are read to their end and compared with their hashes, photographs with those under
    neighbouring lamps, reference shots with the first one.

    Exit code 0: complete. 3: a file is missing, damaged or another one. 4: shots have to be taken.

    Parameters
    ----------
    folder
        That of --out.
    json
        Print JSON for programs.
    quiet
        No progress.
    """
    from impasto import capture

    with Stages(quiet=quiet or json).stage("check") as stage:
        result = capture.check(folder, progress=stage.advance)
        stage.note = f"{result.taken} of {result.planned}"
    if json:
        retakes = [
            {"name": one.name, "lamp": one.lamp, "code": one.misfire.code, "why": one.misfire.why}
            for one in result.retakes
        ]
        numbers = {"planned": result.planned, "taken": result.taken}
        print_json({**numbers, "retakes": retakes, "notes": list(result.notes)})
    else:
        _report(result)
    if any(one.misfire.code in DAMAGED for one in result.retakes):
        return Exit.CORRUPT_INPUT
    return Exit.OK if result.complete else Exit.PARTIAL


def _plan(
    lights: Path | None,
    shots: Path | None,
    out: Path | None,
    exposure: str,
    darks: int,
    references: int,
) -> ShotPlan:
    from impasto.capture import plan_shots, read_shots
    from impasto.capture.folder import CaptureFolder
    from impasto.io import read_lights

    if lights is not None and shots is not None:
        raise ArgumentError("--shots: has lamps of its own; leave --lights out")
    seconds = milliseconds(exposure)
    if shots is not None:
        return read_shots(shots)
    if lights is not None:
        return plan_shots(
            read_lights(lights), exposure_s=seconds, darks=darks, references=references
        )
    if out is not None and (own := CaptureFolder(out).shots).is_file():
        return read_shots(own)
    if out is not None:
        raise ArgumentError(
            f"--resume: {out} holds no capture that was begun; start it with --lights or --shots"
        )
    raise ArgumentError("--lights: give the light file of the rig, or a plan with --shots")


def _show(plan: ShotPlan) -> None:
    """The plan as a file on stdout, its numbers on stderr."""
    from impasto.capture.shots_file import shots_text

    sys.stdout.write(shots_text(plan))
    kinds = Counter(shot.kind for shot in plan)
    words = ", ".join(counted(count, f"{kind} shot") for kind, count in kinds.items())
    stderr().print(f"{len(plan)} shots: {words}; nothing is taken", markup=False)


@contextmanager
def _given(camera: Any, lights: Any, stage: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Devices that are closed at the end."""
    try:
        yield camera, lights, stage
    finally:
        for device in (camera, lights):
            if close := getattr(device, "close", None):
                close()


@contextmanager
def _simulated(
    plan: ShotPlan, faults: float, seed: int, size: int, turning: bool
) -> Iterator[tuple[Any, Any, Any]]:
    from impasto import simulate
    from impasto.capture.drivers.faults import random_faults
    from impasto.capture.drivers.simulated import SimulatedBallJoint, SimulatedRig

    painting = simulate.painting(seed=seed, size=(size, size))
    kind = SimulatedBallJoint if turning else SimulatedRig
    rig = kind(painting, plan.directions, random_faults(len(plan), faults, seed), seed)
    yield rig, rig, rig


def _devices(
    plan: ShotPlan, camera: str, dome: str | None, watch: Path | None, turning: bool
) -> Any:
    from impasto.capture.ball_joint import JOINTS
    from impasto.capture.drivers.by_hand import FolderCamera, HandLights, HandStage

    # The photograph of a camera in the hand says that all is set.
    confirm = None if camera == "folder" else _confirmed
    if camera == "folder":
        if watch is None:
            raise ArgumentError("--watch: give the folder into which the camera saves")
        eye: Any = FolderCamera(watch, _order)
    else:
        from impasto.capture.drivers.gphoto2_camera import GPhoto2Camera

        eye = GPhoto2Camera()
    if dome is not None:
        from impasto.capture.drivers.dome import Dome

        lamps: Any = Dome(dome)
        if lamps.lamps < len(plan.directions):
            count, has = len(plan.directions), lamps.lamps
            lamps.close()
            raise ArgumentError(f"--dome: the plan has {count} lamps, the dome only {has}")
    else:
        lamps = HandLights(plan.directions, _order, confirm)
    return _given(eye, lamps, HandStage(JOINTS, _order, confirm) if turning else None)


def _order(words: str) -> None:
    """What a person has to do now; also shown with --quiet."""
    stderr().print(words, style="bold", markup=False)


def _warn(words: str) -> None:
    stderr().print(f"retake: {words}" if ":" in words else words, style="yellow", markup=False)


def _confirmed() -> None:
    stderr().print("then press Enter", markup=False)
    if not sys.stdin.readline():
        raise DeviceError(
            "nobody confirms the lamps: run the command in a terminal, or give --dome"
        )


def _report(result: CaptureResult) -> None:
    page = stdout()
    page.out(f"taken    {result.taken} of {result.planned} shots")
    for one in result.retakes:
        page.out(f"retake   {one}")
        page.out(f"         -> {one.misfire.advice}")
    for note in result.notes:
        page.out(f"note     {note}")
    if result.retakes:
        page.out(
            f"go on    impasto capture run --resume --out {result.folder}, with the same devices"
        )

"""The run of a capture: shot by shot, each on the disk before the next one is taken."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from impasto.capture import to_session
from impasto.capture.acceptance import MisfireError, accepted, refuse
from impasto.capture.devices import CameraDevice, FixedStage, Frame, Lights, Stage
from impasto.capture.examine import (
    Known,
    read_known,
    reference_notes,
    retakes_of,
)
from impasto.capture.folder import CaptureFolder
from impasto.capture.frames import Picture, read_picture
from impasto.capture.joints import check_stage
from impasto.capture.journal import Entry, Journal
from impasto.capture.misfires import (
    Misfire,
    clock_jump,
    dark_reference,
    drifted,
    warmed_up,
    wrong_exposure,
    wrong_pose,
)
from impasto.capture.result import CaptureResult
from impasto.capture.shots import Shot, ShotPlan
from impasto.capture.shots_file import shots_text
from impasto.errors import (
    CorruptInputError,
    DeviceError,
    DisconnectedError,
    ResumeMismatchError,
)
from impasto.io.files import atomic_bytes, atomic_path
from impasto.jobs.lock import locked

TRIES = 4
"""Photographs of a shot: the first, and three more."""
ROUNDS = 3
"""Times that photographs are taken again of which the comparison with the others says so."""
GIVEN_UP = 3
"""Shots in sequence that are given up for one reason: it is no misfire, but a fault that stays."""
WARM_UP_FRAMES = 120
"""Reference frames after which a lamp that does not settle is reported: 40 minutes at 20 s."""
RETURN_FRAMES = 45
"""Reference frames for which a lamp that has drifted is waited for: 15 minutes at 20 s, after which
the halogen lamp of [@snel] was constant."""

Advance = Callable[[int, int], None]
Say = Callable[[str], None]


def run(
    plan: ShotPlan,
    camera: CameraDevice,
    lights: Lights,
    stage: Stage | None,
    folder: str | os.PathLike[str],
    *,
    resume: bool = False,
    warm_up_s: float | None = 20.0,
    progress: Advance | None = None,
    say: Say | None = None,
) -> CaptureResult:
    """Take all photographs of a plan.

    For each shot: set the exposure and read it back, go to the pose, switch the lamp on and wait
    for its acknowledgement, release, download, check the file, and write it to the disk, then a
    line into the journal. What fails is repeated three times, then the shot is named in the
    retake list. At the end photographs are compared with their neighbours, and those that stand out
    are taken again, up to three times. Then ``session.toml`` is written.

    A run that ends early, however it does, loses the shot that it was at, and no other one; the
    same call with ``resume=True`` goes on.

    Parameters
    ----------
    plan
        Of :func:`plan_shots`, :func:`ball_joint_plan` or :func:`read_shots`.
    camera, lights, stage
        The devices; ``stage`` None: nothing moves.
    folder
        For the capture, new or empty.
    resume
        Go on with the capture that is there, and take again what its retake list names.
    warm_up_s
        Seconds between reference frames before the first shot with light, until three of them
        differ by less than 0.3 %; None: no such wait.
    progress
        Called with (done, total) shots.
    say
        Called with one sentence for each thing that a person should know at once.

    Returns
    -------
    CaptureResult
        With the retake list.

    Raises
    ------
    ArgumentError
        The folder holds another capture, or another run is at it; a plan that the stage cannot
        take.
    ResumeMismatchError
        The capture in the folder has another plan.
    DisconnectedError
        A device is gone; everything that was taken is on the disk.
    DeviceError
        Several shots in sequence failed for one reason, or the lamp does not settle.
    CorruptInputError
        The journal of the capture is damaged.
    """
    stage = FixedStage() if stage is None else stage
    check_stage(plan, stage)
    where = CaptureFolder(Path(folder))
    where.prepare(resume=resume)
    with locked(where.notes):
        text = shots_text(plan)
        digest = hashlib.sha256(text.encode()).hexdigest()
        journal = Journal(where.journal, digest)
        try:
            if journal.log.plan != digest:
                raise ResumeMismatchError(
                    f"out: {where.root} holds a capture of another plan than this one; give "
                    f"--shots {where.shots}, or another folder"
                )
            atomic_bytes(where.shots, text.encode())
            going = _Run(plan, camera, lights, stage, where, journal, warm_up_s, progress, say)
            return going.all()
        finally:
            journal.close()


@dataclass
class _Run:
    """A run, with what it knows of the photographs so far."""

    plan: ShotPlan
    camera: CameraDevice
    lights: Lights
    stage: Stage
    folder: CaptureFolder
    journal: Journal
    warm_up_s: float | None
    progress: Advance | None
    say: Say | None
    known: Known = field(init=False)
    failures: list[str] = field(default_factory=list)
    """Codes of the shots that were given up since the last one that was taken."""
    since: list[str] = field(default_factory=list)
    """Names of photographs since the last reference shot that was right."""
    drifting: bool = False
    clock: float | None = None
    """Clock of the camera minus that of the computer, seconds."""
    warm: bool = False
    last: tuple[Path, bytes] | None = None
    """The last photograph that was not kept."""
    seen: dict[str, str] = field(default_factory=dict)
    """Shots by the hashes of all photographs, those that were not kept among them."""

    def all(self) -> CaptureResult:
        """All shots that are not there, then those that the comparison finds."""
        log = self.journal.log
        self.known, changed = read_known(self.folder, self.plan, log)
        for name, misfire in changed.items():
            self.journal.fail(name, misfire)
        self.seen = {entry.sha256: entry.name for entry in log.entries.values()}
        kinds = {shot.name: shot.kind for shot in self.plan}
        since: list[str] = []
        for name in log.entries:
            since = [] if kinds[name] == "reference" else [*since, name]
        try:
            self._shoot([shot for shot in self.plan if shot.name not in log.entries], since)
            for _ in range(ROUNDS):
                for name, misfire in self.known.compare().items():
                    self._withdraw(name, misfire)
                again = [shot for shot in self.plan if shot.name in log.failed]
                if not again or self._still_drifts():
                    break
                self._tell(f"{len(again)} of {len(self.plan)} shots are taken again")
                self._shoot(again, [])
                if (drift := self._drift_now()) is not None:
                    self._withdraw_since(drift)
            for name, misfire in self.known.compare().items():
                self._withdraw(name, misfire)
        finally:
            self._lamps_off()
        stated = None if self.known.first is None else self.known.first.exif.camera
        camera = stated or self.camera.name
        session = to_session.write(self.folder.root, self.plan, self.journal, camera)
        notes = tuple(reference_notes(self.known))
        return CaptureResult(
            self.folder.root, len(self.plan), len(log.entries),
            retakes_of(self.plan, log.failed), notes, session,
        )  # fmt: skip

    def _shoot(self, shots: list[Shot], since: list[str]) -> None:
        """Shots in their order; ``since``: photographs since the last reference shot."""
        self.failures, self.since, self.drifting = [], since, False
        for shot in shots:
            if self.progress is not None:
                self.progress(len(self.journal.log.entries), len(self.plan))
            if shot.lamp is not None and not self.warm:
                self._warm_up()
            self._take(shot)
        if self.progress is not None:
            self.progress(len(self.journal.log.entries), len(self.plan))

    def _take(self, shot: Shot) -> None:
        """One shot, up to four times; then it is given up."""
        self.last = None
        for number in range(1, TRIES + 1):
            try:
                self._try(shot, number)
            except MisfireError as error:
                misfire = error.misfire
            except DisconnectedError as error:
                misfire = Misfire("disconnected", str(error), "see to its cable and power")
                if number == TRIES:
                    raise DisconnectedError(self._stopped(shot, str(error))) from error
            except DeviceError as error:
                misfire = Misfire("device", str(error), "see to this device")
            else:
                self.failures = []
                return
            self.journal.tried(shot.name, misfire)
            if misfire.code in {"device", "disconnected", "missing", "duplicate"}:
                self._reconnect()
        if misfire.code == "lamp-drift":
            self._drift(shot, misfire)
        else:
            self._give_up(shot, misfire)
        # Without a first reference shot nothing could be compared with it.
        first = self.known.base is None
        if shot.kind == "reference" and (first or misfire.code in {"moved", "blurred"}):
            self._withdraw_since(misfire)
            raise DeviceError(self._stopped(shot, f"{misfire.why}; {misfire.advice}"))

    def _try(self, shot: Shot, number: int) -> None:
        """Set, read back, light, release, download, check, and commit."""
        frame, exposure = self._frame(shot)
        path = self.folder.file_of(shot, frame.suffix)
        self.last = (path, frame.data)
        with atomic_path(path) as temporary:
            temporary.write_bytes(frame.data)
            picture = accepted(shot, frame, temporary, self.known, self.seen)
            self.folder.withdraw(path)
        entry = Entry(
            shot.name, self.folder.relative(path), picture.sha256, shot.lamp, exposure,
            time.time(), number, picture.level,
        )  # fmt: skip
        self.journal.commit(entry)
        self.known.take(shot, picture)
        self._clock(frame, picture)
        if shot.kind == "photograph":
            self.since.append(shot.name)
        elif shot.kind == "reference":
            if self.drifting:
                why = "the lamp had drifted at the reference shot before it"
                advice = "let the lamps warm up, and see to a stable power supply"
                self._withdraw_since(Misfire("lamp-drift", why, advice))
            self.since, self.drifting = [], False

    def _frame(self, shot: Shot) -> tuple[Frame, float]:
        """A photograph under the lamp that is acknowledged, and its exposure time."""
        set_s = self.camera.set_exposure(shot.exposure_s)
        refuse(wrong_exposure(shot.exposure_s, set_s))
        refuse(wrong_pose(shot.pose, self.stage.move(shot.pose)))
        if shot.lamp is None:
            self.lights.switch_off()
        else:
            lamp = self.lights.switch_on(shot.lamp)
            if lamp != shot.lamp:
                raise MisfireError(
                    Misfire(
                        "wrong-lamp",
                        f"lamp {shot.lamp} was ordered, lamp {lamp} is on",
                        "see to the wiring of the lamps",
                    )
                )
        frame = self.camera.trigger()
        if not frame.data:
            raise MisfireError(
                Misfire("missing", "the camera has sent no photograph", "see to its memory card")
            )
        return frame, shot.exposure_s if set_s is None else set_s

    def _warm_up(self) -> None:
        """Reference frames until three of them differ by less than 0.3 %."""
        self.warm = True
        references = self.plan.of("reference")
        if self.warm_up_s is None or not references:
            return
        levels: list[float] = []
        for number in range(WARM_UP_FRAMES):
            if number:
                time.sleep(self.warm_up_s)
            if (level := self._probe(references[0])) is not None:
                levels.append(level)
            if number + 1 >= TRIES and levels and (misfire := dark_reference(levels[-1])):
                words = f"{misfire.why}; {misfire.advice}"
                raise DeviceError(self._stopped(references[0], words))
            if warmed_up(levels):
                self.journal.note("warm", f"settled after {len(levels)} reference frames")
                return
        raise DeviceError(
            self._stopped(
                references[0],
                f"lamp {references[0].lamp} does not settle: three reference frames in sequence "
                "never differed by less than 0.3 %; see to a stable power supply, or leave the "
                "wait out (warm_up_s=None, --no-warm-up)",
            )
        )

    def _probe(self, shot: Shot) -> float | None:
        """Light of a reference shot above the dark frames, not kept; None after misfires."""
        for _ in range(TRIES):
            try:
                frame, _ = self._frame(shot)
                probe = self.folder.notes / f"probe{frame.suffix.lower()}"
                probe.write_bytes(frame.data)
                try:
                    return read_picture(probe).level - self.known.dark
                finally:
                    probe.unlink(missing_ok=True)
            except DisconnectedError:
                self._reconnect()
            except (MisfireError, DeviceError, CorruptInputError):
                continue
        return None

    def _drift_now(self) -> Misfire | None:
        """Whether the reference lamp differs from the beginning."""
        references = self.plan.of("reference")
        if not references or self.known.base is None:
            return None
        level = self._probe(references[0])
        return None if level is None else drifted(level, self.known.base)

    def _still_drifts(self) -> bool:
        """Whether it does so for a quarter of an hour, so that a retake is no use."""
        for number in range(RETURN_FRAMES):
            if number:
                time.sleep(self.warm_up_s or 0.0)
            if self._drift_now() is None:
                return False
        return True

    def _drift(self, shot: Shot, misfire: Misfire) -> None:
        """Photographs between this reference shot and the last right one do not count."""
        self._tell(f"{shot.name}: {misfire.why}; {misfire.advice}")
        self.journal.fail(shot.name, misfire)
        self._withdraw_since(misfire)
        self.since, self.drifting = [], True

    def _withdraw_since(self, misfire: Misfire) -> None:
        """What a reference shot says, of all photographs since the last one that was right."""
        for name in self.since:
            self._withdraw(name, misfire)

    def _withdraw(self, name: str, misfire: Misfire) -> None:
        if name in self.journal.log.entries:
            self.journal.fail(name, misfire)
            self.known.drop(name)

    def _give_up(self, shot: Shot, misfire: Misfire) -> None:
        """Name a shot in the retake list; stop where a fault stays."""
        self._tell(f"{shot.name}: {misfire.why}; {misfire.advice}")
        self.journal.fail(shot.name, misfire)
        if self.last is not None:
            self.folder.keep(*self.last)
        self.failures.append(misfire.code)
        if self.failures[-GIVEN_UP:] == [misfire.code] * GIVEN_UP:
            why = f"{GIVEN_UP} shots in sequence failed {TRIES} times each; {misfire.why}"
            raise DeviceError(self._stopped(shot, f"{why}; {misfire.advice}"))

    def _stopped(self, shot: Shot, why: str) -> str:
        count = len(self.journal.log.entries)
        return (
            f"the capture stopped at {shot.name}: {why}. {count} of {len(self.plan)} shots are in "
            f"{self.folder.root}, and none of them is lost; go on with the same command and "
            "--resume (resume=True)"
        )

    def _clock(self, frame: Frame, picture: Picture) -> None:
        """Notice a jump of the camera's clock: the order is that of the journal."""
        taken = frame.taken or picture.exif.taken
        if taken is None:
            return
        now = taken.timestamp() - time.time()
        if self.clock is not None and (words := clock_jump(self.clock, now)):
            self.journal.note("clock-jump", words)
            self._tell(words)
        self.clock = now

    def _reconnect(self) -> None:
        try:
            self.camera.reconnect()
        except DeviceError as error:
            self.journal.note("reconnect", str(error))

    def _lamps_off(self) -> None:
        try:
            self.lights.switch_off()
        except DeviceError as error:
            self.journal.note("lamps", str(error))

    def _tell(self, words: str) -> None:
        if self.say is not None:
            self.say(words)

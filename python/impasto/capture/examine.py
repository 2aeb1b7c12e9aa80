"""``impasto capture check``: everything in a capture once more, from its files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from impasto.capture.evidence import Evidence, Judged, Place, compare
from impasto.capture.folder import CaptureFolder
from impasto.capture.frames import Image, Picture, read_picture
from impasto.capture.journal import CaptureLog, read_log
from impasto.capture.misfires import Misfire, drifted, wrong_kind
from impasto.capture.result import CaptureResult, Retake
from impasto.capture.shots import Shot, ShotPlan
from impasto.capture.shots_file import read_shots
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.session_toml import SESSION_FILE

Advance = Callable[[int, int], None]


@dataclass
class Known:
    """What is known of the photographs of a capture, as they come in or are read again.

    Attributes
    ----------
    plan
        Of the capture.
    kept
        Evidence of photographs, by the names of shots.
    levels
        Mean light of dark frames and reference shots, by the names of shots.
    place
        Of the patches; None before the first photograph with light.
    first
        The first photograph, whose kind all others share.
    reference
        The patch of the first reference shot.
    patches
        The patch of the first reference shot of each lamp, exposure and pose, by the name of the
        plan's first of them.
    judged
        What the last comparison found.
    """

    plan: ShotPlan
    kept: dict[str, Evidence] = field(default_factory=dict)
    levels: dict[str, float] = field(default_factory=dict)
    place: Place | None = None
    first: Picture | None = None
    reference: Image | None = None
    patches: dict[str, Image] = field(default_factory=dict)
    judged: Judged = field(default_factory=dict)

    @property
    def dark(self) -> float:
        """Mean level of the dark frames; 0 without any."""
        return float(np.mean(self.darks)) if self.darks else 0.0

    @property
    def darks(self) -> list[float]:
        """Levels of the dark frames."""
        return [self.levels[s.name] for s in self.plan.of("dark") if s.name in self.levels]

    @property
    def base(self) -> float | None:
        """Level of the first reference shot above the dark frames; None without one."""
        return self._first_level(self.plan.of("reference"))

    def base_of(self, shot: Shot) -> float | None:
        """The same of the first reference shot with the lamp, exposure and pose of this one."""
        return self._first_level(self._alike(shot))

    def patch_of(self, shot: Shot) -> Image | None:
        """The patch of that reference shot; None without one."""
        return self.patches.get(self._alike(shot)[0].name)

    def _first_level(self, shots: Sequence[Shot]) -> float | None:
        found = (self.levels[shot.name] for shot in shots if shot.name in self.levels)
        level = next(found, None)
        return None if level is None else level - self.dark

    def _alike(self, shot: Shot) -> list[Shot]:
        """The plan's reference shots with the lamp, exposure and pose of one of them."""
        own = shot.lamp, shot.exposure_s, shot.pose
        every = self.plan.of("reference")
        return [one for one in every if (one.lamp, one.exposure_s, one.pose) == own]

    def take(self, shot: Shot, picture: Picture) -> None:
        """A photograph that counts."""
        if self.first is None:
            self.first = picture
        if shot.kind in {"dark", "reference"}:
            self.levels[shot.name] = picture.level
        if shot.kind in {"photograph", "reference"} and self.place is None:
            self.place = Place.of(picture.light)
        if self.place is None:
            return
        if shot.kind == "photograph":
            self.kept[shot.name] = self.place.evidence(picture)
        elif shot.kind == "reference":
            first = self._alike(shot)[0].name
            if first not in self.patches:
                self.patches[first] = self.place.evidence(picture).patch
            if self.reference is None:
                self.reference = self.patches[first]

    def drop(self, name: str) -> None:
        """A photograph that does not count any more."""
        self.kept.pop(name, None)

    def compare(self) -> dict[str, Misfire]:
        """What the photographs say of each other."""
        return compare(self.plan, self.kept, self.dark, self.reference, self.judged)


def read_known(
    folder: CaptureFolder, plan: ShotPlan, log: CaptureLog, progress: Advance | None = None
) -> tuple[Known, dict[str, Misfire]]:
    """Read all photographs of a capture again; those that are not as they were written."""
    known, found = Known(plan), dict[str, Misfire]()
    hashes = {entry.sha256: name for name, entry in log.entries.items()}
    shots = {shot.name: shot for shot in plan}
    # The first reference shot says where the patches lie, in a run as in a check.
    order = sorted(log.entries.values(), key=lambda entry: shots[entry.name].kind != "reference")
    for number, entry in enumerate(order):
        if progress is not None:
            progress(number, len(order))
        path = folder.root / entry.file
        if not path.is_file():
            found[entry.name] = Misfire(
                "missing", f"{entry.file} is not there any more", "bring it back"
            )
            continue
        try:
            picture = read_picture(path)
        except CorruptInputError as error:
            found[entry.name] = Misfire(
                "corrupt", f"{entry.file} {error.problem}", "bring back a copy"
            )
            continue
        if picture.sha256 != entry.sha256:
            other = hashes.get(picture.sha256)
            why = f"{entry.file} is not the photograph that was taken"
            if other is not None:
                why = f"{entry.file} is the photograph of {other}: files were exchanged"
            found[entry.name] = Misfire(
                "swapped" if other else "changed", why, "bring the file back"
            )
            continue
        if known.first is not None and (misfire := wrong_kind(picture, known.first)):
            found[entry.name] = misfire
            continue
        known.take(shots[entry.name], picture)
    if progress is not None:
        progress(len(order), len(order))
    return known, found


def check(folder: str | os.PathLike[str], *, progress: Advance | None = None) -> CaptureResult:
    """Examine all photographs of a capture again; nothing is changed.

    Every file is read to its end and compared with its hash; photographs are compared with those
    under neighbouring lamps, reference shots with the first one.

    Parameters
    ----------
    folder
        Of the capture.
    progress
        Called with (done, total) photographs.

    Returns
    -------
    CaptureResult
        Its ``retakes`` are the shots to take again: those that the run gave up, and what is found
        now.

    Raises
    ------
    ArgumentError
        No capture there.
    CorruptInputError
        Journal or plan are damaged.
    """
    where = CaptureFolder(Path(folder))
    if not where.journal.is_file():
        raise ArgumentError(
            f"folder: {where.root} holds no capture; expected {where.relative(where.journal)} in it"
        )
    plan, log = read_shots(where.shots), read_log(where.journal)
    names = {shot.name for shot in plan}
    if odd := sorted(log.entries.keys() - names):
        raise CorruptInputError(where.journal, f"names {odd[0]!r}, which is no shot of the plan")
    known, found = read_known(where, plan, log, progress)
    found = known.compare() | found
    for name, misfire in log.failed.items():
        found.setdefault(name, misfire)
    notes = tuple(reference_notes(known))
    session = where.root / SESSION_FILE
    return CaptureResult(
        where.root,
        len(plan),
        sum(shot.name in log.entries and shot.name not in found for shot in plan),
        retakes_of(plan, found),
        notes,
        session if session.is_file() else None,
    )


def reference_notes(known: Known) -> list[str]:
    """What reference shots say of the lamp."""
    if known.base is None:
        return []
    notes = []
    for shot in known.plan.of("reference"):
        if shot.name in known.levels:
            base = known.base_of(shot)
            assert base is not None  # its own level, if it is the first of its kind
            misfire = drifted(known.levels[shot.name] - known.dark, base)
            if misfire is not None:
                notes.append(f"{shot.name}: {misfire.why}; {misfire.advice}")
    return notes


def retakes_of(plan: ShotPlan, found: dict[str, Misfire]) -> tuple[Retake, ...]:
    """The retake list, in the order of the plan."""
    return tuple(
        Retake(shot.name, shot.lamp, found[shot.name]) for shot in plan if shot.name in found
    )

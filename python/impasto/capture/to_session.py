"""From a capture to the ``session.toml`` that :func:`impasto.read_stack` takes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impasto.capture.folder import FOLDERS
from impasto.capture.journal import Entry, Journal
from impasto.capture.shots import Shot, ShotPlan
from impasto.io.files import atomic_bytes
from impasto.io.session_toml import SESSION_FILE, Session, session_text
from impasto.rig import FRONTAL

SAME_EXPOSURE = 1e-6
"""Relative difference of two exposure times that is a rounding error."""


def session_of(plan: ShotPlan, entries: Mapping[str, Entry], camera: str | None) -> Session:
    """The session of all photographs that count.

    Parameters
    ----------
    plan
        Of the capture.
    entries
        From its journal.
    camera
        Its name.
    """
    # The shortest exposure stands for a bracket.
    shots = [bracket[0] for bracket in _whole(plan, entries)]
    names = [Path(entries[shot.name].file).name for shot in shots]
    lights: dict[str, Any] = {}
    positions = [_position(plan, shot) for shot in shots]
    known = [one for one in positions if one is not None]
    if known and len(known) == len(shots):
        lights["positions_mm"] = dict(zip(names, known, strict=True))
    else:
        lights["directions"] = {
            name: plan.light_of(shot) for name, shot in zip(names, shots, strict=True)
        }
    if any(shot.pose.view is not None for shot in shots):
        lights["views"] = {
            name: shot.pose.view or FRONTAL for name, shot in zip(names, shots, strict=True)
        }
    brackets = {}
    for shot, name in zip(shots, names, strict=True):
        if shot.bracket is not None:
            frames = [entries[one.name] for one in plan.photographs()[shot.bracket]]
            brackets[name] = tuple((Path(one.file).name, one.exposure_s) for one in frames)
    exposures = [entries[shot.name].exposure_s for shot in shots]
    boards = _boards(plan, entries, shots)
    if max(exposures) > min(exposures) * (1.0 + SAME_EXPOSURE):
        lights["intensities"] = tuple(one / max(exposures) for one in exposures)
    # Photographs are divided by boards, of another exposure perhaps.
    times = [entries[one.name].exposure_s for one in boards]
    times *= len(exposures) // max(len(times), 1)
    ratios = tuple(own / board for own, board in zip(exposures, times, strict=False))
    if any(abs(one - 1.0) > SAME_EXPOSURE for one in ratios):
        lights["board_exposure"] = ratios
    white = tuple(entries[one.name].file for one in boards)
    darks = tuple(entries[shot.name].file for shot in plan.of("dark") if shot.name in entries)
    return Session(
        camera=camera or None,
        images=FOLDERS["photograph"],
        brackets=brackets or None,
        dark=darks or None,
        white=white[0] if len(white) == 1 else white or None,
        sha256={entry.file: entry.sha256 for entry in entries.values()},
        **lights,
    )


def write(root: Path, plan: ShotPlan, journal: Journal, camera: str | None) -> Path | None:
    """Write the session file of a capture; one that was edited by hand is never replaced."""
    path, log = root / SESSION_FILE, journal.log
    if not _whole(plan, log.entries):
        return None
    if path.exists() and _hash(path.read_bytes()) != log.session:
        return None
    data = session_text(session_of(plan, log.entries, camera)).encode()
    journal.session(_hash(data))
    atomic_bytes(path, data)
    return path


def _whole(plan: ShotPlan, entries: Mapping[str, Entry]) -> list[tuple[Shot, ...]]:
    """The shots of each photograph of which no exposure is missing."""
    every = plan.photographs().values()
    return [shots for shots in every if all(shot.name in entries for shot in shots)]


def _boards(plan: ShotPlan, entries: Mapping[str, Entry], shots: list[Shot]) -> list[Shot]:
    """One board for all, or that of each photograph's lamp; none where some lamp has none."""
    boards = [shot for shot in plan.of("board") if shot.name in entries]
    if len(boards) <= 1:
        return boards
    by_lamp = {(shot.lamp, shot.pose.view): shot for shot in boards}
    found = [by_lamp.get((shot.lamp, shot.pose.view)) for shot in shots]
    return [one for one in found if one is not None] if None not in found else []


def _position(plan: ShotPlan, shot: Shot) -> tuple[float, float, float] | None:
    """Of the lamp in the frame of the painting, mm; None: not known."""
    if plan.positions_mm is None or shot.lamp is None:
        return None
    position = plan.positions_mm[shot.lamp - 1]
    if shot.pose.light is None:
        return _three(position)
    # A joint turns the painting about its middle: the lamp keeps its distance. Where a pose moves
    # the lamp itself, that is not known.
    far = float(np.linalg.norm(position))
    return _three([far * x for x in shot.pose.light]) if shot.pose.angles else None


def _three(vector: Any) -> tuple[float, float, float]:
    x, y, z = (float(one) for one in vector)
    return x, y, z


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()

"""What the tests of captures share: a small simulated rig, and what really happened in it."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import impasto
from impasto import capture, simulate
from impasto.capture import Shot, ShotPlan, hemisphere
from impasto.capture.drivers.faults import Faults
from impasto.capture.drivers.simulated import SimulatedRig
from impasto.capture.journal import CaptureLog, read_log
from impasto.io import LightFile

SIZE = (80, 80)
PITCH_MM = 0.4
"""The smallest photographs of which shifts can be estimated."""


@cache
def painting() -> simulate.Painting:
    """Relief of a few tenths of a millimetre in three pigments under a satin varnish.

    ``simulate.painting`` would take five seconds.
    """
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((5, *SIZE)).astype(np.float32)
    fields = np.stack([cv2.GaussianBlur(one, (0, 0), 1.5) for one in noise])
    fields /= fields.std(axis=(1, 2), keepdims=True)
    height = np.asarray(0.1 * fields[0] + 0.2 * cv2.GaussianBlur(fields[1], (0, 0), 6.0))
    slopes = np.stack(np.gradient(height, PITCH_MM))
    normal = np.stack([-slopes[1], slopes[0], np.ones(SIZE)])  # rows run down, y up
    normal /= np.linalg.norm(normal, axis=0)
    shares = np.exp(fields[2:])
    coefficients = 0.9 * shares / shares.sum(axis=0)
    wavelengths = np.arange(400.0, 701.0, 10.0)
    basis = np.stack([1 / (1 + np.exp((at - wavelengths) / 20.0)) for at in (450.0, 540.0, 620.0)])
    gamma = 0.12
    return simulate.Painting(
        height=height.astype(np.float32),
        normal=normal.astype(np.float32),
        coefficients=coefficients.astype(np.float32),
        basis=basis,
        wavelengths=wavelengths,
        beta=np.full((1, *SIZE), np.log(2.0) / (4.0 * gamma**2), np.float32),
        gamma=np.full((1, *SIZE), gamma, np.float32),
        varnish=np.full(SIZE, 2, np.uint8),
        pitch_mm=PITCH_MM,
        seed=3,
    )


def light_file(lamps: int) -> LightFile:
    directions = hemisphere(lamps, np.radians(20.0))
    return LightFile(Path("rig.lp"), "lp", None, directions, np.ones(lamps))


def plan(lamps: int = 24, **options: Any) -> ShotPlan:
    return capture.plan_shots(light_file(lamps), **{"darks": 2, "references": 10} | options)


@cache
def camera() -> impasto.Camera:
    """Bands 80 nm wide under equal energy; the measured camera takes seconds to load."""
    wavelengths = np.arange(400.0, 701.0, 10.0)
    curves = np.exp(-(((wavelengths - np.array([[620.0], [550.0], [450.0]])) / 40.0) ** 2))
    return impasto.Camera(wavelengths, curves, np.ones(len(wavelengths)))


def rig(shots: ShotPlan, faults: Faults | None = None, seed: int = 5) -> SimulatedRig:
    return SimulatedRig(painting(), shots.directions, faults or Faults(), seed, camera())


def taken(
    shots: ShotPlan, devices: SimulatedRig, out: Path, **options: Any
) -> capture.CaptureResult:
    return capture.run(shots, devices, devices, devices, out, **{"warm_up_s": None} | options)


def log_of(out: Path) -> CaptureLog:
    return read_log(out / "capture" / "journal.jsonl")


def lines_of(out: Path, kind: str) -> list[dict[str, Any]]:
    """Lines of the journal of one kind: shot, tried, failed, note."""
    text = (out / "capture" / "journal.jsonl").read_text()
    return [line for line in map(json.loads, text.splitlines()) if kind in line]


def wrong_pairings(out: Path, *rigs: SimulatedRig) -> list[str]:
    """Shots whose file is not a photograph of exactly their lamp, by what the rigs remember."""
    lamps: dict[str, tuple[int, ...]] = {}
    for one in rigs:
        for photograph in one.taken:  # a duplicate is the photograph that was taken first
            lamps.setdefault(hashlib.sha256(photograph.data).hexdigest(), photograph.lamps)
    found = []
    for name, entry in log_of(out).entries.items():
        digest = hashlib.sha256((out / entry.file).read_bytes()).hexdigest()
        expected = () if entry.lamp is None else (entry.lamp,)
        if digest != entry.sha256 or lamps[digest] != expected:
            found.append(name)
    return found


def shot(name: str, shots: ShotPlan) -> Shot:
    return next(one for one in shots if one.name == name)

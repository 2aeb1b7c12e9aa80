"""Calibration of a rig: light directions from photographs of mirror balls."""

from impasto.calibrate.adjustment import Adjustment, adjust
from impasto.calibrate.folder import BallFolder, read_balls
from impasto.calibrate.geometry import BallCamera
from impasto.calibrate.highlight import Highlight, luma
from impasto.calibrate.lights import (
    BallLights,
    BallPhotographs,
    LampPositions,
    lamp_positions,
    lights_from_balls,
)
from impasto.calibrate.outline import Outline, given_outline
from impasto.calibrate.picture import balls_picture

__all__ = [
    "Adjustment",
    "BallCamera",
    "BallFolder",
    "BallLights",
    "BallPhotographs",
    "Highlight",
    "LampPositions",
    "Outline",
    "adjust",
    "balls_picture",
    "given_outline",
    "lamp_positions",
    "lights_from_balls",
    "luma",
    "read_balls",
]

"""Calibration of a rig: light directions from mirror balls, the lens from a flat target."""

from impasto.calibrate.adjustment import Adjustment, adjust
from impasto.calibrate.folder import BallFolder, read_balls
from impasto.calibrate.geometry import BallCamera
from impasto.calibrate.highlight import Highlight, luma
from impasto.calibrate.lens import Lens, read_lens
from impasto.calibrate.lens_calibration import LensCalibration, TargetView, lens_from_target
from impasto.calibrate.lens_picture import lens_picture
from impasto.calibrate.lights import BallLights, BallPhotographs, lights_from_balls
from impasto.calibrate.outline import Outline, given_outline
from impasto.calibrate.picture import balls_picture
from impasto.calibrate.target import Target, target_from

__all__ = [
    "Adjustment",
    "BallCamera",
    "BallFolder",
    "BallLights",
    "BallPhotographs",
    "Highlight",
    "Lens",
    "LensCalibration",
    "Outline",
    "Target",
    "TargetView",
    "adjust",
    "balls_picture",
    "given_outline",
    "lens_from_target",
    "lens_picture",
    "lights_from_balls",
    "luma",
    "read_balls",
    "read_lens",
    "target_from",
]

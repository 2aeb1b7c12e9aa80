"""Calibration: lamps from mirror balls, a camera from a ColorChecker, a lens from a flat target."""

from impasto.calibrate.adjustment import Adjustment, adjust
from impasto.calibrate.camera import ChartCamera, camera_from_chart, linear_photograph
from impasto.calibrate.chart import Chart, read_chart
from impasto.calibrate.chart_picture import chart_picture
from impasto.calibrate.folder import BallFolder, read_balls
from impasto.calibrate.geometry import BallCamera
from impasto.calibrate.highlight import Highlight, luma
from impasto.calibrate.lens_calibration import LensCalibration, TargetView, lens_from_target
from impasto.calibrate.lens_picture import lens_picture
from impasto.calibrate.lights import (
    BallLights,
    BallPhotographs,
    LampPositions,
    lamp_positions,
    lights_from_balls,
)
from impasto.calibrate.outline import Outline, given_outline
from impasto.calibrate.picture import balls_picture
from impasto.calibrate.target import Target, target_from
from impasto.lens import Lens, read_lens

__all__ = [
    "Adjustment",
    "BallCamera",
    "BallFolder",
    "BallLights",
    "BallPhotographs",
    "Chart",
    "ChartCamera",
    "Highlight",
    "LampPositions",
    "Lens",
    "LensCalibration",
    "Outline",
    "Target",
    "TargetView",
    "adjust",
    "balls_picture",
    "camera_from_chart",
    "chart_picture",
    "given_outline",
    "lamp_positions",
    "lens_from_target",
    "lens_picture",
    "lights_from_balls",
    "linear_photograph",
    "luma",
    "read_balls",
    "read_chart",
    "read_lens",
    "target_from",
]

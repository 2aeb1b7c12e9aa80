"""Calibration: lamps from balls and a white board; camera, lens and tone curve from targets."""

from impasto.calibrate.adjustment import Adjustment, adjust
from impasto.calibrate.board import Board, board_strengths
from impasto.calibrate.board_picture import board_picture
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
from impasto.calibrate.linearity import ToneCurve, tone_from_exposures, tone_from_patches
from impasto.calibrate.monochromator import MonochromatorCamera, camera_from_monochromator
from impasto.calibrate.monochromator_picture import monochromator_picture
from impasto.calibrate.outline import Outline, given_outline
from impasto.calibrate.painting_frame import PaintingFrame
from impasto.calibrate.photon_transfer import PhotonTransfer, photon_transfer
from impasto.calibrate.picture import balls_picture
from impasto.calibrate.target import Target, target_from
from impasto.calibrate.tone_picture import tone_picture
from impasto.calibrate.uncalibrated import (
    PanelLights,
    Patches,
    lights_from_panel,
    panel_lights_picture,
    patches_of,
    read_patches,
)
from impasto.lens import Lens, read_lens

__all__ = [
    "Adjustment",
    "BallCamera",
    "BallFolder",
    "BallLights",
    "BallPhotographs",
    "Board",
    "Chart",
    "ChartCamera",
    "Highlight",
    "LampPositions",
    "Lens",
    "LensCalibration",
    "MonochromatorCamera",
    "Outline",
    "PaintingFrame",
    "PanelLights",
    "Patches",
    "PhotonTransfer",
    "Target",
    "TargetView",
    "ToneCurve",
    "adjust",
    "balls_picture",
    "board_picture",
    "board_strengths",
    "camera_from_chart",
    "camera_from_monochromator",
    "chart_picture",
    "given_outline",
    "lamp_positions",
    "lens_from_target",
    "lens_picture",
    "lights_from_balls",
    "lights_from_panel",
    "linear_photograph",
    "luma",
    "monochromator_picture",
    "panel_lights_picture",
    "patches_of",
    "photon_transfer",
    "read_balls",
    "read_chart",
    "read_lens",
    "read_patches",
    "target_from",
    "tone_from_exposures",
    "tone_from_patches",
    "tone_picture",
]

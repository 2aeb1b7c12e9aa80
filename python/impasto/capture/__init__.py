"""Capture: what a rig will tell before a photograph is made, and the photographs themselves.

:func:`run` takes the photographs of a plan with a camera and lamps; drivers of devices are in
``impasto.capture.drivers``.
"""

from impasto.capture.devices import Camera, FixedStage, Frame, Lights, Pose, Stage
from impasto.capture.examine import check
from impasto.capture.expected import ExpectedErrors, Noise, expected_errors
from impasto.capture.misfires import Misfire
from impasto.capture.plan_picture import plan_picture
from impasto.capture.planning import better_lights, hemisphere
from impasto.capture.result import CaptureResult, Retake
from impasto.capture.run import run
from impasto.capture.shots import Shot, ShotPlan, plan_shots, read_shots, write_shots

__all__ = [
    "Camera",
    "CaptureResult",
    "ExpectedErrors",
    "FixedStage",
    "Frame",
    "Lights",
    "Misfire",
    "Noise",
    "Pose",
    "Retake",
    "Shot",
    "ShotPlan",
    "Stage",
    "better_lights",
    "check",
    "expected_errors",
    "hemisphere",
    "plan_picture",
    "plan_shots",
    "read_shots",
    "run",
    "write_shots",
]

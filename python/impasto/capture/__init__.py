"""Capture: what a rig will tell before a photograph is made, and the photographs themselves.

:func:`run` takes the photographs of a plan with a camera and lamps; drivers of devices are in
``impasto.capture.drivers``.
"""

from impasto.capture.ball_joint import BallJointRig, Setting
from impasto.capture.ball_joint_picture import ball_joint_picture
from impasto.capture.ball_joint_shots import (
    BallJointPlan,
    BallJointShot,
    ball_joint_plan,
    plan_ball_joint_shots,
    write_ball_joint_lights,
)
from impasto.capture.devices import CameraDevice, FixedStage, Frame, Lights, Pose, Stage
from impasto.capture.examine import check
from impasto.capture.expected import ExpectedErrors, Noise, expected_errors
from impasto.capture.exposure import exposures_from_pilot
from impasto.capture.misfires import Misfire
from impasto.capture.plan_picture import plan_picture
from impasto.capture.planning import better_lights, hemisphere
from impasto.capture.result import CaptureResult, Retake
from impasto.capture.run import run
from impasto.capture.shots import Shot, ShotPlan, plan_shots
from impasto.capture.shots_file import read_shots, write_shots

__all__ = [
    "BallJointPlan",
    "BallJointRig",
    "BallJointShot",
    "CameraDevice",
    "CaptureResult",
    "ExpectedErrors",
    "FixedStage",
    "Frame",
    "Lights",
    "Misfire",
    "Noise",
    "Pose",
    "Retake",
    "Setting",
    "Shot",
    "ShotPlan",
    "Stage",
    "ball_joint_picture",
    "ball_joint_plan",
    "better_lights",
    "check",
    "expected_errors",
    "exposures_from_pilot",
    "hemisphere",
    "plan_ball_joint_shots",
    "plan_picture",
    "plan_shots",
    "read_shots",
    "run",
    "write_ball_joint_lights",
    "write_shots",
]

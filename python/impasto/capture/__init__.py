"""Capture: what a rig will tell before a photograph is made, which lamp to add, and which shots."""

from impasto.capture.ball_joint import BallJointRig, Setting
from impasto.capture.expected import ExpectedErrors, Noise, expected_errors
from impasto.capture.exposure import exposures_from_pilot
from impasto.capture.plan_picture import plan_picture
from impasto.capture.planning import better_lights, hemisphere
from impasto.capture.shots import Shot, ShotPlan, plan_shots, write_shot_lights, write_shots
from impasto.capture.shots_picture import shots_picture

__all__ = [
    "BallJointRig",
    "ExpectedErrors",
    "Noise",
    "Setting",
    "Shot",
    "ShotPlan",
    "better_lights",
    "expected_errors",
    "exposures_from_pilot",
    "hemisphere",
    "plan_picture",
    "plan_shots",
    "shots_picture",
    "write_shot_lights",
    "write_shots",
]

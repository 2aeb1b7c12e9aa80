"""Capture: what a rig will tell before a photograph is made, and which lamp to add."""

from impasto.capture.expected import ExpectedErrors, Noise, expected_errors
from impasto.capture.plan_picture import plan_picture
from impasto.capture.planning import better_lights, hemisphere

__all__ = [
    "ExpectedErrors",
    "Noise",
    "better_lights",
    "expected_errors",
    "hemisphere",
    "plan_picture",
]

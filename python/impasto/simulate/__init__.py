"""Simulated paintings with a known true surface, and rigs to photograph them.

>>> from impasto import simulate
>>> painting = simulate.painting(seed=1, size=(64, 64))
>>> len(simulate.rig("tominaga-rgb-camera"))
9
"""

from impasto.simulate.cameras import camera
from impasto.simulate.lobes import Lobes
from impasto.simulate.optics import Optics
from impasto.simulate.paintings import Painting, painting
from impasto.simulate.photography import capture, default_capture, plan
from impasto.simulate.planning import Capture, CaptureCheck, CapturePlan, Truth
from impasto.simulate.rigs import rig
from impasto.simulate.score import Score, score
from impasto.simulate.sensor import Noise

__all__ = [
    "Capture",
    "CaptureCheck",
    "CapturePlan",
    "Lobes",
    "Noise",
    "Optics",
    "Painting",
    "Score",
    "Truth",
    "camera",
    "capture",
    "default_capture",
    "painting",
    "plan",
    "rig",
    "score",
]

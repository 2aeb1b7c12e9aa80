"""Simulated paintings with a known true surface, and rigs to photograph them.

>>> from impasto import simulate
>>> painting = simulate.painting(seed=1, size=(64, 64))
>>> len(simulate.rig("tominaga-rgb-camera"))
9
"""

from impasto.simulate.cameras import camera
from impasto.simulate.lobes import Lobes
from impasto.simulate.paintings import Painting, painting
from impasto.simulate.photography import Capture, Noise, Truth, capture, default_capture
from impasto.simulate.rigs import rig
from impasto.simulate.score import Score, score

__all__ = [
    "Capture",
    "Lobes",
    "Noise",
    "Painting",
    "Score",
    "Truth",
    "camera",
    "capture",
    "default_capture",
    "painting",
    "rig",
    "score",
]

"""Directions to lights, in plain numpy."""

from __future__ import annotations

import numpy as np


def spiral(count=60):
    """``(obs, 3)`` directions over the hemisphere, 10 to 80 degrees from the zenith."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    z = np.linspace(np.cos(np.radians(10.0)), np.cos(np.radians(80.0)), count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)

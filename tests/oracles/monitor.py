"""A made-up but typical CRT, measured: gain, offset and gamma per channel, leakage, room flare.

The forward model is Berns' (1996) and shares nothing with impasto: XYZ = flare + sum over channels
of peak x max(gain code + offset, 0)^gamma. Units are cd/m^2; the white is near 60 cd/m^2 as in the
six-band paper's experiment.
"""

from __future__ import annotations

import numpy as np

CHROMATICITIES = np.array([[0.625, 0.340], [0.280, 0.605], [0.155, 0.070]])
LUMINANCES = np.array([13.4, 42.1, 5.2])
GAMMAS = np.array([2.35, 2.25, 2.42])
OFFSETS = np.array([0.010, 0.004, 0.015])
FLARE = np.array([0.31, 0.33, 0.36])


def channel_light(code: np.ndarray) -> np.ndarray:
    """Relative light ``(3, ...)`` of codes ``(3, ...)`` in [0, 1]; 1 at full drive."""
    shape = (3,) + (1,) * (np.ndim(code) - 1)
    offset, gamma = OFFSETS.reshape(shape), GAMMAS.reshape(shape)
    return ((1.0 - offset) * code + offset) ** gamma


def xyz(code: np.ndarray) -> np.ndarray:
    """What a colorimeter reads ``(3, ...)`` in cd/m^2 for codes ``(3, ...)`` in [0, 1]."""
    x, y = CHROMATICITIES.T
    columns = np.stack([x / y, np.ones(3), (1.0 - x - y) / y]) * LUMINANCES
    flare = FLARE.reshape((3,) + (1,) * (np.ndim(code) - 1))
    return flare + np.tensordot(columns, channel_light(np.asarray(code, dtype=float)), axes=1)


def session(steps: int = 52, noise: float = 0.0, seed: int = 0) -> dict[str, object]:
    """White, primaries, black and ramps as a calibration session would read them."""
    random = np.random.default_rng(seed)
    codes = np.linspace(0.0, 255.0, steps)
    ramps = np.zeros((3, steps))
    for channel in range(3):
        drive = np.zeros((3, steps))
        drive[channel] = codes / 255.0
        ramps[channel] = xyz(drive)[1]
    ramps *= 1.0 + noise * random.standard_normal(ramps.shape)
    return {
        "white": xyz(np.ones(3)),
        "primaries": np.stack([xyz(row) for row in np.eye(3)]),
        "black": xyz(np.zeros(3)),
        "ramp": (codes, ramps),
    }

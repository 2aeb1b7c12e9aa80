"""Which side does each lamp light more? Its own, unless it is infinitely far away.

This knows left from right and a half turn from none, which the curl does not. A hollow painting
under distant lamps looks the same as a flat one under near lamps on the other side, so fall-off
alone is never more than a warning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.doctor.sampled_tiles import SampledTiles

Floats = NDArray[np.float64]

_STEEP = 0.05
"""Logarithm of light from one side of the picture to the other that is worth a word."""
_RANDOM = 7.0
"""exp(-7): how rarely n gradients without any order reach a coherence of sqrt(7 / n)."""
_COHERENT = 0.5
_CLEARER = 1.5


@dataclass(frozen=True, slots=True)
class FallOff:
    """How the brightness gradients of the photographs agree with the directions of their lights.

    Attributes
    ----------
    strength
        Typical size: logarithm of light from one side of the picture to the other.
    straight, mirrored
        Coherence 0..1 with the lights as given up to a turn, or mirrored in y and turned.
    straight_turn_deg, mirrored_turn_deg
        Those turns, -180 to 180.
    decided
        Whether one of the two explains the gradients beyond doubt.
    """

    strength: float
    straight: float
    mirrored: float
    straight_turn_deg: float
    mirrored_turn_deg: float
    decided: bool

    @property
    def is_mirrored(self) -> bool:
        """Which of the two is the better one."""
        return self.mirrored > self.straight

    @property
    def turn_deg(self) -> float:
        """The turn of the better one."""
        return self.mirrored_turn_deg if self.is_mirrored else self.straight_turn_deg


def measure_falloff(sampled: SampledTiles, directions: Floats) -> FallOff:
    """Fit a gradient to each photograph and compare its azimuth with the light's.

    Parameters
    ----------
    sampled
        Where to look; fall-off that the rig already knows is divided out.
    directions
        ``(obs, 3)`` of the lights.
    """
    gradient = _gradients(sampled)
    listed = directions[:, 0] + 1j * directions[:, 1]
    usable = np.isfinite(gradient) & (np.abs(listed) > 0.1)
    gradient, listed = gradient[usable], listed[usable]
    scale = np.sqrt((np.abs(gradient) ** 2).sum() * (np.abs(listed) ** 2).sum())
    if len(gradient) < 4 or scale == 0.0:
        return FallOff(0.0, 0.0, 0.0, 0.0, 0.0, decided=False)
    straight = complex((gradient * listed.conj()).sum() / scale)
    mirrored = complex((gradient * listed).sum() / scale)
    strength = float(np.median(np.abs(gradient)))
    high, low = sorted((abs(straight), abs(mirrored)), reverse=True)
    return FallOff(
        strength,
        abs(straight),
        abs(mirrored),
        float(np.degrees(np.angle(straight.conjugate()))),
        float(np.degrees(np.angle(mirrored))),
        decided=strength > _STEEP
        and high > max(_COHERENT, _CLEARER * low)
        and len(gradient) * high**2 > _RANDOM,
    )


def _gradients(sampled: SampledTiles) -> NDArray[np.complex128]:
    """Gradient of the logarithm of each photograph, x + i y, per longer side of the picture."""
    modelled = sampled.lights[..., 2]
    modelled = modelled[:, None] if modelled.ndim == 1 else modelled
    with np.errstate(divide="ignore", invalid="ignore"):
        bright = np.log(np.where(sampled.grey > 0, sampled.grey, np.nan))
        bright = bright - np.log(np.where(modelled > 0, modelled, np.nan))
    counted = np.isfinite(bright).sum(axis=0)
    enough = counted >= max(3, len(bright) // 2)
    bright = bright[:, enough]
    design = np.stack([np.ones(enough.sum()), sampled.x[enough], sampled.y[enough]], axis=1)
    result = np.full(len(bright), np.nan, dtype=np.complex128)
    if bright.shape[1] < 30:
        return result
    # The middle photograph of each pixel stands for its colour and slope.
    bright = bright - np.nanmedian(bright, axis=0)
    for index, row in enumerate(bright):
        known = np.isfinite(row)
        if known.sum() < 30:
            continue
        middle = np.median(row[known])
        spread = 1.4826 * np.median(np.abs(row[known] - middle)) + 1e-9
        held = np.clip(row[known], middle - 3 * spread, middle + 3 * spread)
        _, x, y = np.linalg.lstsq(design[known], held, rcond=None)[0]
        result[index] = complex(x, y)
    return result

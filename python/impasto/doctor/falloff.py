"""Fall-off: a near lamp lights its own side of the painting more.

It distinguishes left from right and detects rotation by 180 degrees, which the curl cannot. A
hollow painting under distant lamps looks the same as a flat one under near lamps on the other
side, so fall-off alone gives at most a warning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.doctor.sampled_tiles import SampledTiles

Floats = NDArray[np.float64]

_STEEP = 0.05
"""Smallest change to report: logarithm of light from one side of the picture to the other."""
_RANDOM = 7.0
"""exp(-7) is the probability that n random gradients reach a coherence of sqrt(7 / n)."""
_COHERENT = 0.5
_CLEARER = 1.5


@dataclass(frozen=True, slots=True)
class FallOff:
    """Agreement of the photographs' brightness gradients with the directions of their lights.

    Attributes
    ----------
    strength
        Median gradient: logarithm of light from one side of the picture to the other.
    straight, mirrored
        Coherence, 0 to 1, with the lights rotated, or mirrored in y and rotated.
    straight_rotation_deg, mirrored_rotation_deg
        These rotations, -180 to 180.
    decided
        Whether one of the two explains the gradients significantly better.
    """

    strength: float
    straight: float
    mirrored: float
    straight_rotation_deg: float
    mirrored_rotation_deg: float
    decided: bool

    @property
    def is_mirrored(self) -> bool:
        """Whether the mirrored lights agree better."""
        return self.mirrored > self.straight

    @property
    def rotation_deg(self) -> float:
        """The rotation of the better one."""
        return self.mirrored_rotation_deg if self.is_mirrored else self.straight_rotation_deg


def measure_falloff(sampled: SampledTiles, directions: Floats) -> FallOff:
    """Fit a gradient to each photograph and compare its azimuth with the light's.

    Parameters
    ----------
    sampled
        The pixels examined; they are divided by the fall-off that the rig already contains.
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
    # The median photograph of each pixel stands for its colour and slope.
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

"""Rigs and stacks as the numerics take them: plain arrays.

Everything here is checked and C-contiguous, so that the border only has to borrow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.casts import contiguous, quiet_cast
from impasto._internal.direct_light import DirectStack, InterreflectionArguments
from impasto.rig import Rig
from impasto.stack import Stack, checked_stack


@dataclass(frozen=True, slots=True)
class RigArguments:
    """A :class:`~impasto.Rig` as plain arrays."""

    lights: NDArray[np.float64]
    point: NDArray[np.bool_]
    falloff: NDArray[np.bool_]
    views: NDArray[np.float64]
    point_view: NDArray[np.bool_]
    pitch_mm: float
    origin: tuple[float, float]

    @classmethod
    def of(cls, rig: Rig) -> RigArguments:
        """Directions of distant lights and views, positions of near ones."""
        near_views = rig.near_views
        return cls(
            lights=rig.vectors,
            point=rig.near,
            falloff=rig.falloff,
            views=np.where(near_views[:, None], rig.view_positions, rig.views),
            point_view=near_views,
            pitch_mm=1.0 if rig.pitch_mm is None else float(rig.pitch_mm),
            origin=rig.origin,
        )


@dataclass(frozen=True, slots=True)
class StackArguments:
    """A :class:`~impasto.Stack` as plain arrays; samples are divided by their light's intensity."""

    samples: NDArray[Any]
    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    saturation: NDArray[np.float32]
    mask: NDArray[np.bool_] | None
    rig: RigArguments
    interreflections: InterreflectionArguments | None

    @classmethod
    def of(cls, stack: Stack) -> StackArguments:
        """The samples stay where they are; the rest is a few numbers per observation."""
        checked_stack(stack)
        rig = stack.rig
        observations, bands = stack.shape[:2]
        saturation = np.full(bands, np.inf) if stack.saturation is None else stack.saturation
        with quiet_cast():
            exact = stack.scale[None, :] / rig.intensities[:, None]
            gain = exact.astype(np.float32)
            offset = (-stack.black[None, :] * exact).astype(np.float32)
        return cls(
            samples=stack.samples,
            gain=gain,
            offset=offset,
            saturation=contiguous(np.broadcast_to(saturation, (observations, bands)), np.float32),
            mask=stack.mask,
            rig=RigArguments.of(rig),
            interreflections=stack.interreflections if isinstance(stack, DirectStack) else None,
        )

"""Where a fit of the gloss begins: the maps of photometric stereo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.waiting import floats
from impasto.fit.normals import Normals


@dataclass(frozen=True, slots=True)
class StartArguments:
    """What photometric stereo found, as plain arrays: where a fit of the gloss begins."""

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    status: NDArray[np.uint8]

    @classmethod
    def of(cls, stereo: Normals) -> StartArguments:
        """The maps, copied only where they are not contiguous."""
        return cls(
            normal=floats(stereo.normal),
            diffuse=floats(stereo.albedo),
            status=np.ascontiguousarray(stereo.status, dtype=np.uint8),
        )

"""What the pooled fit learns of a painting, small and saveable, and the maps of its application."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impasto.fit.saved import over


@dataclass(frozen=True, eq=False)
class LearnedLobe:
    """One lobe for a painting, and all that a tile's fit needs to know of the rest of the painting.

    Attributes
    ----------
    beta, gamma, index, covariance, verdict, curve, path, describes, converged
        As in :class:`~impasto.PooledSbrdf`, of the pixels that it was learned from.
    log_sharpness
        Logarithm of ``ln 2 / gamma^2``: the width as the fit has it, to the last bit.
    refined
        Whether every pixel's normal and colours are fitted with the lobe; else they stay those of
        photometric stereo.
    coated
        Whether diffuse light crosses a smooth interface; only where ``refined``.
    brightness
        A bright colour of the painting; its power of two is the unit that samples are counted in.
    noise
        ``(512,)`` float32 standard deviation of a sample by class of brightness, two classes per
        octave, in that unit; infinite where no pixel was.
    noise_floor
        Squared scale of the residuals that is taken for noise, in that unit squared.
    """

    beta: float = field(metadata=over(dtype=np.float64))
    gamma: float = field(metadata=over(dtype=np.float64, unit="rad"))
    log_sharpness: float = field(metadata=over(dtype=np.float64))
    index: float = field(metadata=over(dtype=np.float64))
    refined: bool = field(metadata=over(dtype=np.bool_))
    coated: bool = field(metadata=over(dtype=np.bool_))
    brightness: float = field(metadata=over(dtype=np.float64))
    noise: NDArray[np.float32] = field(metadata=over("brightness"))
    noise_floor: float = field(metadata=over(dtype=np.float64))
    covariance: NDArray[np.float64] = field(metadata=over("row", "column", dtype=np.float64))
    verdict: str = field(metadata=over(dtype=np.str_))
    describes: float = field(metadata=over(dtype=np.float64))
    converged: bool = field(metadata=over(dtype=np.bool_))
    curve: NDArray[np.float64] = field(metadata=over("tilt", "measured", dtype=np.float64))
    path: NDArray[np.float64] = field(metadata=over("step", "parameter", dtype=np.float64))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every number as an array, for ``np.savez``."""
        return {one.name: np.asarray(getattr(self, one.name)) for one in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """What :meth:`arrays` gave, to the last bit."""
        values: dict[str, Any] = {}
        for one in fields(cls):
            array = np.asarray(arrays[one.name])
            values[one.name] = array if array.ndim else array.item()
        return cls(**values)


@dataclass(frozen=True, eq=False)
class PooledMaps:
    """Maps that :func:`impasto.fit.pooled.apply_pooled` fills: C-contiguous, memory maps included.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32.
    diffuse
        ``(band, y, x)`` float32.
    residual, sigma, misfit
        ``(y, x)`` float32.
    status
        ``(y, x)`` uint8.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    misfit: NDArray[np.float32]
    status: NDArray[np.uint8]

    @classmethod
    def empty(cls, bands: int, shape: tuple[int, int]) -> Self:
        """Memory for a picture of ``(y, x)`` pixels."""

        def planes(*leading: int) -> NDArray[np.float32]:
            return np.empty((*leading, *shape), dtype=np.float32)

        return cls(
            normal=planes(3),
            diffuse=planes(bands),
            residual=planes(),
            sigma=planes(),
            misfit=planes(),
            status=np.empty(shape, dtype=np.uint8),
        )

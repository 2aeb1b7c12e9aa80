"""Errors of a fit against held-out photographs and true normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impasto.colour import delta_e, lab_from_xyz
from impasto.encoding import Encoding
from impasto.rig import Rig
from impasto.simulate.score import normal_error
from impasto.status import Status
from impasto.study.relative_error import relative_error
from study.data_sets import Paintings

CODES = Encoding("srgb", 255.0)
"""Display codes on which decibels are computed."""

XYZ_FROM_SRGB = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""IEC 61966-2-1: the three bands are compared as the primaries of a display."""

COMPARED = 50_000
"""Largest number of pixels whose colours are compared: this is slower than most fits."""


class Fitted(Protocol):
    """What a fit, ours or a peer's, offers."""

    @property
    def normal(self) -> NDArray[Any] | None:
        """``(3, y, x)``; None if the method estimates none."""

    @property
    def status(self) -> NDArray[np.uint8]:
        """``(y, x)``."""

    def predict(self, lights: Rig) -> NDArray[Any]:
        """``(obs, band, y, x)`` linear light."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Against photographs that were held out, and the true normals, over all pixels of a data set.

    Attributes
    ----------
    relative
        Root mean square error of the held-out photographs over their root mean square, both cut
        off where the camera is. A pixel that was not estimated counts as black.
    psnr
        Decibels on 8-bit sRGB codes: the mean over the photographs.
    colour
        Mean CIEDE2000 of the held-out photographs.
    normal, normal_p95
        Degrees, mean and 95th percentile; None where the truth is unknown.
    flagged
        Share of the pixels whose status is not ``FITTED``.
    """

    relative: float
    psnr: float
    colour: float
    normal: float | None
    normal_p95: float | None
    flagged: float


def lobes_of(fits: Sequence[Fitted]) -> list[float] | None:
    """Shares of the pixels that have no lobe, one, two ...; None where none is counted."""
    maps: list[Any] = [getattr(fitted, "lobes", None) for fitted in fits]
    if any(lobes is None for lobes in maps):
        return None
    lobes = _side_by_side(maps)
    return [float(count) / lobes.size for count in np.bincount(lobes.ravel(), minlength=4)]


def compared(fits: Sequence[Fitted], paintings: Paintings) -> Errors:
    """Errors of the fits of a data set, one per painting, over all their pixels together."""
    pairs = list(zip(fits, paintings, strict=True))
    exposure = paintings[0].exposure
    top = 1.0 / exposure
    shown = _side_by_side([np.nan_to_num(f.predict(p.rig), nan=0.0) for f, p in pairs]).clip(
        0.0, top
    )
    held = _side_by_side([p.held for p in paintings]).clip(0.0, top)
    codes = CODES.encode(shown * exposure) - CODES.encode(held * exposure)
    squared = (codes.astype(np.float64) ** 2).mean(axis=(1, 2, 3))
    angles = None
    known = [(f.normal, p.normal) for f, p in pairs]
    apart = [normal_error(a, b) for a, b in known if a is not None and b is not None]
    if apart:
        angles = _side_by_side(apart).astype(np.float64)
        # A normal that was not estimated counts as a right angle.
        angles = np.nan_to_num(angles, nan=90.0)
    return Errors(
        relative=relative_error(shown, held, top),
        psnr=float((10.0 * np.log10(255.0**2 / np.maximum(squared, 1e-12))).mean()),
        colour=_colour_difference(shown * exposure, held * exposure),
        normal=None if angles is None else float(angles.mean()),
        normal_p95=None if angles is None else float(np.percentile(angles, 95)),
        flagged=float((_side_by_side([f.status for f in fits]) != Status.FITTED).mean()),
    )


def _side_by_side(maps: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate(maps, axis=-1)


def _colour_difference(shown: NDArray[Any], held: NDArray[Any]) -> float:
    flat = [np.moveaxis(images, 1, 0).reshape(3, -1) for images in (shown, held)]
    step = max(1, flat[0].shape[1] // COMPARED)
    first, second = (lab_from_xyz(XYZ_FROM_SRGB @ image[:, ::step]) for image in flat)
    return float(delta_e(first, second).mean())

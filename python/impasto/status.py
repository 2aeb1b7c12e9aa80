"""The status of a pixel: why it has a result, or none."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """The status of a pixel, stored as ``uint8``.

    Below 16 the quantity was estimated. From 16 on it was not: its maps are NaN there, and nowhere
    else. The values are those of ``impasto::Status`` in Rust (a test compares them).
    """

    FITTED = 0
    """Estimated from enough samples."""
    RELAXED = 1
    """Estimated, but too few samples passed the selection, so some rejected ones were used."""
    EXACT = 2
    """Estimated from exactly as many samples as unknowns: no residual, no predicted error."""
    ILL_CONDITIONED = 3
    """Estimated, but the usable lights hardly determine it; see the condition map."""
    POOLED = 4
    """Estimated, but the samples of the pixel do not determine its specular parameters: they are
    those of the painting. In a pooled fit, its normal and colours are those of photometric
    stereo."""

    DARK = 16
    """No signal in any observation: albedo 0, everything else unknown."""
    SATURATED = 17
    """Too few samples below the saturation level."""
    TOO_FEW_SAMPLES = 18
    """Fewer usable samples than unknowns."""
    RANK_DEFICIENT = 19
    """The usable lights lie in one plane or one line."""
    INVALID_INPUT = 20
    """No finite sample."""
    MASKED = 21
    """Excluded by the mask."""

    NOT_COMPUTED = 255
    """Not computed (an interrupted or partial job)."""

    @property
    def reason(self) -> str:
        """Why a pixel has this status, in a few words."""
        return _REASONS[self.name]

    @property
    def estimated(self) -> bool:
        """Whether the pixel's quantity was estimated (its maps hold numbers)."""
        return self < 16


_REASONS = {
    "FITTED": "estimated from enough samples",
    "RELAXED": "estimated; too few samples passed the selection, so rejected ones were used",
    "EXACT": "estimated from as many samples as unknowns, so without a residual",
    "ILL_CONDITIONED": "estimated, but the usable lights hardly determine it",
    "POOLED": "estimated; its samples do not determine its gloss, which is that of the painting",
    "DARK": "no signal in any photograph",
    "SATURATED": "too few samples are below saturation",
    "TOO_FEW_SAMPLES": "fewer usable samples than unknowns",
    "RANK_DEFICIENT": "the usable lights lie in one plane or line",
    "INVALID_INPUT": "no finite sample",
    "MASKED": "outside the mask",
    "NOT_COMPUTED": "not computed",
}

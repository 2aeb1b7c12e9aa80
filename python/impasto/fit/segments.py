"""One lobe for every part of a painting: old varnish beside cleaned paint, matte beside gloss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError
from impasto.fit.forward import predict
from impasto.fit.normals import Normals
from impasto.rig import Rig
from impasto.status import Status

if TYPE_CHECKING:
    from impasto.fit.sbrdf import Sbrdf

FEWEST = 64
"""Pixels that a lobe of their own takes: fewer have too few tilts to sample its flanks."""

KNOWN = 1.0 / 3.0
"""Largest standard deviation of log beta and log gamma of a lobe that is determined."""


@dataclass(frozen=True)
class Segment:
    """One part of a painting and its lobe.

    Attributes
    ----------
    label
        Its number in ``labels``.
    pixels
        Pixels whose normals were estimated.
    beta, gamma
        Its lobe, or the painting's (:attr:`own`).
    covariance
        ``(2, 2)`` of (log beta, log gamma) from its own pixels; infinite where they show none.
    verdict
        As :attr:`Sbrdf.verdict <impasto.Sbrdf>`, of its own pixels; ``"too-few"``: not tried.
    own
        Whether the lobe is its own; else its pixels do not determine one, and have the painting's.
    """

    label: int
    pixels: int
    beta: float
    gamma: float
    covariance: NDArray[np.float64]
    verdict: str
    own: bool


@dataclass(frozen=True, eq=False, repr=False)
class SegmentSbrdf:
    """A painting whose parts have a lobe each; :func:`impasto.render` takes it.

    Attributes
    ----------
    normal
        ``(3, y, x)`` float32 unit vectors.
    diffuse
        ``(band, y, x)`` float32, relative to the white board.
    beta, gamma
        ``(y, x)`` float32: the lobe of every pixel's segment.
    segments
        One per label, in the order of their numbers.
    labels
        ``(y, x)`` int64 as given; below 0: no segment, the painting's lobe.
    residual, sigma, misfit
        ``(y, x)`` float32 as in :class:`Sbrdf`, against the lobe that the pixel has.
    status
        ``(y, x)`` uint8, :class:`~impasto.Status`: ``POOLED``, too, where a segment has the
        painting's lobe. NaN stands in the maps as in :class:`Sbrdf`.
    painting
        The fit with one lobe for all.
    """

    normal: NDArray[np.float32]
    diffuse: NDArray[np.float32]
    beta: NDArray[np.float32]
    gamma: NDArray[np.float32]
    segments: tuple[Segment, ...]
    labels: NDArray[np.int64]
    residual: NDArray[np.float32]
    sigma: NDArray[np.float32]
    misfit: NDArray[np.float32]
    status: NDArray[np.uint8]
    painting: Sbrdf

    @property
    def index(self) -> float:
        """Index of refraction of the interface."""
        return self.painting.index

    @property
    def normals(self) -> Normals:
        """The photometric stereo that the fit began with."""
        return self.painting.normals

    @property
    def rig(self) -> Rig:
        """Who lit and who looked."""
        return self.painting.rig

    @property
    def bands(self) -> tuple[str, ...]:
        """One name per band."""
        return self.painting.bands

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        return self.painting.shape

    @property
    def pitch_mm(self) -> float | None:
        """Width of a pixel on the painting in mm, if known."""
        return self.painting.pitch_mm

    def predict(
        self, lights: Any = None, views: ArrayLike | None = None, *, threads: int | None = None
    ) -> NDArray[np.float32]:
        """Samples that the surface shows; arguments and result as :meth:`Sbrdf.predict`'s."""
        rig = Rig(
            self.rig if lights is None else lights,
            views=views,
            pitch_mm=lights.pitch_mm if isinstance(lights, Rig) else self.pitch_mm,
        )
        return predict(
            self.normal, self.diffuse, self.beta, self.gamma, rig, index=self.index, threads=threads
        )

    def __repr__(self) -> str:
        height, width = self.shape
        lobes = ", ".join(
            f"{one.label}: beta {one.beta:.4g}, gamma {one.gamma:.4g} rad"
            + ("" if one.own else f" (the painting's; {one.verdict})")
            for one in self.segments
        )
        size = f"{height} x {width} pixels, {len(self.bands)} bands"
        return f"<SegmentSbrdf {size}, {len(self.segments)} segments: {lobes}>"


def checked_labels(segments: Any, shape: tuple[int, int]) -> NDArray[np.int64]:
    """``segments`` as labels, or a refusal that says what they should be."""
    if segments is None:
        raise ArgumentError(
            'segments: pooling="segment" needs a label per pixel, whole numbers (y, x); '
            "below 0: no segment"
        )
    labels = np.asarray(segments)
    if labels.shape != shape or labels.dtype.kind not in "iub":
        raise ArgumentError(
            f"segments: expected whole numbers of shape {shape}, found {labels.dtype} of shape "
            f"{labels.shape}"
        )
    return labels.astype(np.int64)


def fit_segments(
    labels: NDArray[np.int64], stereo: Normals, fit: Callable[[Normals], Sbrdf]
) -> SegmentSbrdf:
    """The pooled ``fit`` of the painting, then of every segment by itself.

    Parameters
    ----------
    labels
        ``(y, x)``.
    stereo
        Normals of the painting.
    fit
        The pooled fit of the pixels whose normals were estimated.

    Returns
    -------
    SegmentSbrdf
        Maps and a lobe per segment.
    """
    painting = fit(stereo)
    names = ("normal", "diffuse", "residual", "sigma", "misfit", "status")
    maps = {name: getattr(painting, name).copy() for name in names}
    maps["beta"] = np.full(labels.shape, painting.beta, dtype=np.float32)
    maps["gamma"] = np.full(labels.shape, painting.gamma, dtype=np.float32)
    segments = []
    for label in np.unique(labels[labels >= 0]):
        inside = labels == label
        segment, own = _one_segment(int(label), inside, stereo, painting, fit)
        segments.append(segment)
        if own is None:
            maps["status"][inside & (painting.status == Status.FITTED)] = Status.POOLED
            continue
        for name in names:
            maps[name][..., inside] = getattr(own, name)[..., inside]
        maps["beta"][inside], maps["gamma"][inside] = own.beta, own.gamma
    return SegmentSbrdf(segments=tuple(segments), labels=labels, painting=painting, **maps)


def _one_segment(
    label: int,
    inside: NDArray[np.bool_],
    stereo: Normals,
    painting: Sbrdf,
    fit: Callable[[Normals], Sbrdf],
) -> tuple[Segment, Sbrdf | None]:
    """A segment, and its fit if its pixels determine a lobe."""
    pixels = int(np.count_nonzero(inside & (stereo.status < Status.DARK)))
    unknown = np.diag([np.inf, np.inf])
    if pixels < FEWEST:
        lobe = (painting.beta, painting.gamma)
        return Segment(label, pixels, *lobe, unknown, "too-few", own=False), None
    # What was not estimated keeps its reason: maps outside the segment are not taken anyway.
    outside = ~inside & (stereo.status < Status.DARK)
    status = np.where(outside, np.uint8(Status.MASKED), stereo.status)
    fitted = fit(replace(stereo, status=status))
    deviations = np.sqrt(np.diag(fitted.covariance))
    own = fitted.verdict in ("fitted", "mixed") and bool((deviations < KNOWN).all())
    one = fitted if own else painting
    segment = Segment(
        label, pixels, one.beta, one.gamma, fitted.covariance, fitted.verdict, own=own
    )
    return segment, fitted if own else None

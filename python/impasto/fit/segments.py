"""One lobe for each part of a painting, such as old varnish and cleaned paint."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import unmasked
from impasto._internal.waiting import wait_for
from impasto.errors import ArgumentError
from impasto.fit.dataset import variable
from impasto.fit.gloss import Gloss
from impasto.fit.normals import Normals
from impasto.fit.pooled import PooledSbrdf
from impasto.fit.result import Sbrdf
from impasto.fit.saved import Reader, arrays_of, columns_of, over
from impasto.io.results import SavedMaps
from impasto.status import Status
from impasto.surface import Surface

if TYPE_CHECKING:
    from xarray import Dataset

FEWEST = 64
"""Fewest pixels of a segment with its own lobe; fewer have too few tilts to sample its flanks."""

_SHOWN = 4
"""Segments listed in one line."""

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
        ``(2, 2)`` of (log beta, log gamma) from its own pixels; infinite without a highlight.
    verdict
        As ``verdict`` of a :class:`PooledSbrdf`, for its own pixels; ``"too-few"``: not fitted.
    own
        Whether the lobe is its own; False: its pixels do not determine one and have the painting's.
    """

    label: int = field(metadata=over(dtype=np.int64))
    pixels: int = field(metadata=over(dtype=np.int64))
    beta: float = field(metadata=over(dtype=np.float64))
    gamma: float = field(metadata=over(dtype=np.float64, unit="rad"))
    covariance: NDArray[np.float64] = field(metadata=over("row", "column", dtype=np.float64))
    verdict: str = field(metadata=over(dtype=np.str_))
    own: bool = field(metadata=over(dtype=np.bool_))


@dataclass(frozen=True, eq=False, repr=False)
class SegmentSbrdf(Sbrdf):
    """A painting with one lobe per segment. :class:`Sbrdf` has the members of all results.

    NaN and ``status`` are as in :class:`PooledSbrdf`, for the lobe of the pixel's segment. The
    status is also ``POOLED`` where a segment has the painting's lobe. There is no ``verdict`` of
    the whole: each of ``segments`` has its own, and so has ``painting``.

    Attributes
    ----------
    beta, gamma
        ``(y, x)`` float32: the lobe of every pixel's segment.
    misfit
        ``(y, x)`` float32 as in :class:`PooledSbrdf`.
    labels
        ``(y, x)`` int64 as given; below 0: no segment, so the painting's lobe.
    segments
        One :class:`Segment` per label, in the order of their numbers.
    painting
        The fit with one lobe for all.
    """

    beta: NDArray[np.float32] = field(metadata=over("y", "x"))
    gamma: NDArray[np.float32] = field(metadata=over("y", "x", unit="rad"))
    misfit: NDArray[np.float32] = field(metadata=over("y", "x"))
    labels: NDArray[np.int64] = field(metadata=over("y", "x", dtype=np.int64))
    segments: tuple[Segment, ...]
    painting: PooledSbrdf

    @property
    def index(self) -> float:
        """Index of refraction of the interface."""
        return self.painting.index

    @property
    def gloss(self) -> Gloss:
        """That of ``painting``, the fit with one lobe for all."""
        return self.painting.gloss

    def with_bands(self, chosen: Sequence[int]) -> Self:
        """The surface in some of its bands, by number; negative ones count from the end."""
        return replace(super().with_bands(chosen), painting=self.painting.with_bands(chosen))

    def surface(self) -> Surface:
        """The painting with a lobe per segment, for rendering."""
        return Surface.torrance_sparrow(
            self.normal,
            self.diffuse,
            self.beta,
            self.gamma,
            index=self.index,
            **self._place(),
        )

    def to_xarray(self) -> Dataset:
        """Every map, and the segments as variables over ``segment``, whose coordinate is ``label``.

        ``segment_pixels``, ``segment_beta`` and so on have the names of :class:`Segment`;
        everything else is as in :meth:`Sbrdf.to_xarray`.
        """
        dataset = super().to_xarray().assign_attrs(index=self.index)
        columns = columns_of(self.segments, Segment, "")
        dataset = dataset.assign_coords(segment=("segment", columns.pop("label")))
        return dataset.assign(
            {
                f"segment_{one.name}": variable(one, columns[one.name], "segment")
                for one in fields(Segment)
                if one.name in columns
            }
        )

    def _shape_sigma(self, lobe: int, y: int, x: int) -> float:
        label = int(self.labels[y, x])
        own = [one.covariance for one in self.segments if one.label == label and one.own]
        return math.sqrt((*own, self.painting.covariance)[0][1, 1])

    def report(self) -> dict[str, Any]:
        """Plain numbers of the gloss for a report file."""
        return {
            "index": self.index,
            "segments": [
                {
                    "label": one.label,
                    "pixels": one.pixels,
                    "beta": one.beta,
                    "gamma_degrees": math.degrees(one.gamma),
                    "verdict": one.verdict,
                    "own": one.own,
                }
                for one in self.segments
            ],
        }

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return (
            arrays_of(self, leave_out={"painting"})
            | arrays_of(self.painting, "painting.", leave_out={"normals", "rig"})
            | columns_of(self.segments, Segment, "segments.")
        )

    @classmethod
    def _read(cls, reader: Reader, shared: dict[str, Any]) -> dict[str, Any]:
        return super()._read(reader, shared) | {
            "segments": reader.rows(Segment, "segments."),
            "painting": PooledSbrdf(**shared, **reader.fields(PooledSbrdf, "painting.")),
        }

    def _demand(self, maps: SavedMaps, prefix: str = "") -> None:
        self.painting._demand(maps, "painting.")

    def _gloss(self) -> str:
        if not self.segments:
            return "no segments"
        lobes = [f"{one.label}: {_lobe_words(one)}" for one in self.segments[:_SHOWN]]
        more = len(self.segments) - len(lobes)
        return f"{len(self.segments)} segments: {', '.join(lobes)}" + f" and {more} more" * (
            more > 0
        )


def _lobe_words(one: Segment) -> str:
    lobe = f"beta {one.beta:.4g}, gamma {one.gamma:.4g} rad" if one.beta > 0.0 else "no highlight"
    return lobe if one.own else f"{lobe} (the painting's; {one.verdict})"


def checked_labels(segments: Any, shape: tuple[int, int]) -> NDArray[np.int64]:
    """``segments`` as labels, or a refusal that says what they should be."""
    if segments is None:
        raise ArgumentError(
            'segments: pooling="segment" needs a label per pixel, whole numbers (y, x); '
            "below 0: no segment"
        )
    if isinstance(segments, str | os.PathLike):
        raise ArgumentError(
            f"segments: expected whole numbers (y, x), found the path {os.fspath(segments)!r}; "
            "impasto.io.read_labels(path) reads a picture of them"
        )
    labels, masked = unmasked(segments)
    if labels.shape != shape or labels.dtype.kind not in "iub":
        raise ArgumentError(
            f"segments: expected whole numbers of shape {shape}, found {labels.dtype} of shape "
            f"{labels.shape}"
        )
    if masked is not None:
        labels = np.where(masked, labels.dtype.type(0), labels)
    most = int(np.iinfo(np.int64).max)
    if labels.size and int(labels.max()) > most:
        raise ArgumentError(
            f"segments: expected labels up to {most}, found {labels.max()}; number the parts anew"
        )
    whole = labels.astype(np.int64)
    return whole if masked is None else np.where(masked, -1, whole)


def fit_segments(
    labels: NDArray[np.int64], stereo: Normals, fit: Callable[[Normals], PooledSbrdf]
) -> SegmentSbrdf:
    """The pooled ``fit`` of the painting, then of every segment by itself.

    A pooled fit visits only pixels whose normals are estimated, so that all segments together take
    the time of the painting's pixels and of one search per segment.

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
    maps = wait_for(_maps_of, painting)
    segments = []
    for label in wait_for(_known_labels, labels):
        inside = wait_for(np.equal, labels, label)
        segment, own = _one_segment(label, inside, stereo, painting, fit)
        segments.append(segment)
        wait_for(_put, maps, inside, own)
    return SegmentSbrdf(
        segments=tuple(segments),
        labels=labels,
        painting=painting,
        normals=painting.normals,
        rig=painting.rig,
        bands=painting.bands,
        **maps,
    )


def _maps_of(fitted: PooledSbrdf) -> dict[str, Any]:
    """Copies of a fit's maps, and of its lobe as maps."""
    names = ("normal", "diffuse", "residual", "sigma", "misfit", "status")
    lobe = {
        name: np.full_like(fitted.residual, getattr(fitted, name)) for name in ("beta", "gamma")
    }
    return {name: getattr(fitted, name).copy() for name in names} | lobe


def _put(maps: dict[str, NDArray[Any]], inside: NDArray[np.bool_], own: PooledSbrdf | None) -> None:
    """A segment's own fit into the maps; without one it has the painting's, and says so."""
    if own is None:
        fitted = inside & (maps["status"] == Status.FITTED)
        np.copyto(maps["status"], np.uint8(Status.POOLED), where=fitted)
        return
    for name, whole in maps.items():
        np.copyto(whole, getattr(own, name), where=inside)


def _known_labels(labels: NDArray[np.int64]) -> list[int]:
    """All labels of segments, in the order of their numbers."""
    found: list[int] = np.unique(labels[labels >= 0]).tolist()
    return found


def _only(inside: NDArray[np.bool_], status: NDArray[np.uint8]) -> tuple[int, NDArray[np.uint8]]:
    """How many pixels of a segment have a normal, and the statuses with all others masked."""
    estimated = status < Status.DARK
    # What was not estimated keeps its reason: maps outside the segment are not taken anyway.
    others = np.where(estimated & ~inside, np.uint8(Status.MASKED), status)
    return int(np.count_nonzero(inside & estimated)), others


def _one_segment(
    label: int,
    inside: NDArray[np.bool_],
    stereo: Normals,
    painting: PooledSbrdf,
    fit: Callable[[Normals], PooledSbrdf],
) -> tuple[Segment, PooledSbrdf | None]:
    """A segment, and its fit if its pixels determine a lobe."""
    pixels, status = wait_for(_only, inside, stereo.status)
    unknown = np.diag([np.inf, np.inf])
    if pixels < FEWEST:
        lobe = (painting.beta, painting.gamma)
        return Segment(label, pixels, *lobe, unknown, "too-few", own=False), None
    fitted = fit(replace(stereo, status=status))
    deviations = np.sqrt(np.diag(fitted.covariance))
    own = fitted.verdict in ("fitted", "mixed") and bool((deviations < KNOWN).all())
    one = fitted if own else painting
    segment = Segment(
        label, pixels, one.beta, one.gamma, fitted.covariance, fitted.verdict, own=own
    )
    return segment, fitted if own else None

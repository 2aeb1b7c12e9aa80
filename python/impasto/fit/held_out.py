"""Cross-validation of rigs: photographs held out, predicted by a surface fitted to the others."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import thread_count
from impasto._internal.waiting import wait_for_each
from impasto.effort import Preset, resolved
from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.cross_validation import full_scale
from impasto.fit.lobe_profile import Fitted, glossy, shaped
from impasto.fit.lobes import LobeSbrdf, fit_lobes
from impasto.fit.normals import fit_normals
from impasto.fit.subsample import subsampled_to
from impasto.rig import PointView, Rig
from impasto.stack import Stack

Surfaces = Literal["plain", "coated", "shaped"]
"""Diffuse light as Lambert says; under a varnish; lobes of a shape that the painting tells."""

DIM = 0.2
"""Share of a pixel's mean light below which shadows affect a sample more than the lamp does."""
KEPT = 0.9
"""Share of the samples, those with the smallest errors, that the trimmed mean counts."""
CODES = 255.0
"""Errors are in codes of 8 bits, whatever the files have."""
SUITS = 0.02
"""Share by which surfaces of the other kind must lower the trimmed mean to be taken."""
ROUNDED = 0.3
"""Trimmed means up to this many steps of the files, of 8 bits where samples are floats, are those
of rounding, which alone gives 0.22: nothing lowers them for a reason."""
RECENT = 8
"""Rigs that are kept for all threads: each is asked for several times in a row."""
_SMALLEST = 0.05
"""Least error in a ratio, in codes."""
_LARGEST = 1e19
"""Largest code: that of the largest light in single precision is 3e18 with the curve of sRGB."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """How much better one rig predicts photographs held out than another.

    Attributes
    ----------
    trim_before, trim
        Trimmed mean of the coded errors, in codes of 8 bits: the smallest 90 % count.
    gain, scatter
        Mean over photographs of the gain in dB of the same share of each, and its standard error.
        Highlights that a wrong camera misplaces would scatter it, however right the lamps.
    """

    trim_before: float
    trim: float
    gain: float
    scatter: float

    @property
    def fall(self) -> float:
        """Share by which the trimmed mean fell."""
        return 1.0 - max(self.trim, _SMALLEST) / max(self.trim_before, _SMALLEST)

    def better(self, fall: float, errors: float = 1.0) -> bool:
        """Whether the trim fell by this share and the gain exceeds so many standard errors."""
        return self.fall >= fall and self.gain > errors * self.scatter

    def __str__(self) -> str:
        return (
            f"{self.gain:+.2f} ± {self.scatter:.2f} dB, "
            f"trimmed error {self.trim_before:.2f} to {self.trim:.2f} codes"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Coded errors ``(obs, n)`` of photographs when they were held out; NaN where unknown."""

    coded: NDArray[np.float64]

    @property
    def trim(self) -> float:
        """Trimmed mean over all photographs."""
        return trimmed_mean(self.coded)

    def pixels(self, bands: int) -> int:
        """How many pixels have an error in some photograph and band."""
        known = np.isfinite(self.coded).any(axis=0).reshape(bands, -1)
        return int(np.count_nonzero(known.any(axis=0)))

    def fold(self, fold: int, folds: int) -> float:
        """Trimmed mean of one fold."""
        return trimmed_mean(self.coded[fold::folds])

    def than(self, before: Errors) -> Comparison:
        """Compared with those of another rig, photograph by photograph."""
        power = [_trimmed_squares(each.coded) for each in (before, self)]
        least = _SMALLEST**2
        gain = 10.0 * np.log10((power[0] + least) / (power[1] + least))
        gain = gain[np.isfinite(gain)]
        scatter = float(gain.std() / np.sqrt(max(len(gain) - 1, 1))) if len(gain) else np.inf
        mean = float(gain.mean()) if len(gain) else 0.0
        return Comparison(before.trim, self.trim, mean, scatter)


class HeldOut:
    """A sample of pixels spread over a painting, to compare rigs by photographs held out.

    A photograph that is held out has a strength of its own: one number, the
    median of sample / predicted sample, is taken from it. What is compared is then the surface,
    with strengths of lamps that no rule predicts as well as with those of a dome.

    ``effort``: of surfaces with one lobe. Rigs are told apart as well by those of a draft.
    ``surfaces``: which are fitted. Wrong strengths stand for what a varnish keeps back, and a wrong
    distance hides it; where most light is in the lobes they stand for the shape of these.
    """

    def __init__(
        self,
        stack: Stack,
        pixels: int,
        *,
        index: float,
        threads: int | None,
        surfaces: Surfaces = "plain",
        effort: Preset = "draft",
    ) -> None:
        self.surfaces: Surfaces = surfaces
        self._effort: Preset = effort
        self._others: tuple[Surfaces, Surfaces] = ("plain", "coated")
        pitch = 1.0 if stack.rig.pitch_mm is None else stack.rig.pitch_mm
        # A point view says where the middle of the subsample lies, and forbids to pack it.
        eye = PointView((0.0, 0.0, 1.0))
        probe = Rig(stack.rig.directions, views=eye, pitch_mm=pitch)
        self._few = subsampled_to(stack._replace(rig=probe, sources=()), pixels)
        x, y, _ = self._few.rig.view_positions[0].tolist()
        self._middle = (-x, -y)
        self._origin = (pitch * stack.rig.origin[0], pitch * stack.rig.origin[1])
        self._index, self._threads = index, threads
        linear = np.array([self._few.linear(photograph) for photograph in range(len(probe))])
        if stack.encoding.curve == "linear":
            # Single precision holds squares of residuals at 2^40 as little as at 2^-40.
            unit = math.ldexp(1.0, -math.frexp(full_scale(linear))[1])
            self._few = self._few._replace(scale=unit * self._few.scale)
            linear *= np.float32(unit)
        with np.errstate(over="ignore"):
            # A sample near the largest float is as good as clipped.
            self.samples = linear.mean(axis=1)
        """``(obs, y, x)`` linear light, mean of the bands; +inf where clipped."""
        self._curve, self.white = stack.encoding, 1.0
        if stack.encoding.curve == "linear":
            self._curve, self.white = Encoding("srgb"), full_scale(linear)
        self.truth = np.where(np.isfinite(linear), self.coded(linear), np.nan)
        """``(obs, band, y, x)`` codes of 8 bits; not finite where clipped or unknown."""
        self.rounded = ROUNDED * self._step(linear)
        """Trimmed mean up to which errors are those of rounding."""
        self.lit = _lighting(self._few, self._middle)
        """The sample under a rig of the whole painting."""

    @property
    def coated(self) -> bool:
        """Whether the diffuse part lies under a varnish."""
        return self.surfaces == "coated"

    def otherwise(self) -> HeldOut:
        """The same photographs with surfaces of the other kind.

        That is under a varnish, or on metal with shaped lobes; or plain.
        """
        plain, other = self._others
        return self.of(other if self.surfaces == plain else plain)

    def of(self, surfaces: Surfaces) -> HeldOut:
        """The same photographs with surfaces of some kind."""
        one = copy(self)
        one.surfaces = surfaces
        return one

    def suited(self, rig: Rig, folds: int) -> HeldOut:
        """The better of this and :meth:`otherwise`, by what its surfaces predict under a rig."""
        other = self.otherwise()
        fall = other.errors(rig, folds).than(self.errors(rig, folds)).fall
        return other if fall > SUITS else self

    def for_metal(self, rig: Rig) -> HeldOut:
        """The same; where most light is in the lobes, :meth:`otherwise` has shaped ones."""
        lit = self.lit(rig)
        if not glossy(self._fitted(lit), lit.rig, self._threads):
            return self
        one = copy(self)
        one._others = ("plain", "shaped")
        return one

    def rotated(self) -> HeldOut:
        """The photographs after half a turn under lamps and cameras that did not turn.

        The turn is about the middle of the painting, also for a part of it. What depends on the
        place of a pixel then has the opposite sign: a camera in front of the painting counts as one
        behind it, and lamps as well.
        """
        other = copy(self)
        rotated = (..., slice(None, None, -1), slice(None, None, -1))
        few, mask = self._few, self._few.mask
        other._few = few._replace(
            samples=np.ascontiguousarray(few.samples[rotated]),
            mask=None if mask is None else mask[rotated],
        )
        other.samples, other.truth = self.samples[rotated], self.truth[rotated]
        x, y = self._middle
        other._middle = (-x - 2.0 * self._origin[0], -y - 2.0 * self._origin[1])
        other.lit = _lighting(other._few, other._middle)
        return other

    def undetermined(self, rig: Rig, folds: int) -> str | None:
        """Why the lights of the photographs without those of a fold determine no normal.

        Raises
        ------
        GeometryError
            Those of all photographs determine none, either.
        """
        stack, count = self.lit(rig), len(rig)
        # Photometric stereo takes a millisecond and refuses what any fit would refuse.
        fit_normals(stack, method="least-squares", threads=self._threads)
        for fold in range(folds):
            seen = np.flatnonzero(np.arange(count) % folds != fold)
            try:
                fit_normals(stack.take(seen), method="least-squares", threads=self._threads)
            except GeometryError:
                return f"the lights of {len(seen)} of the photographs determine no normal"
        return None

    def surface(self, stack: Stack, lobes: int = 1) -> Fitted:
        """The surface of (some photographs of) the sample; of several lobes none is shaped."""
        if self.surfaces == "shaped" and lobes == 1:
            return shaped(self._fitted, stack, self._threads)
        return Fitted(self._fitted(stack, lobes))

    def _fitted(self, stack: Stack, lobes: int = 1) -> LobeSbrdf:
        return fit_lobes(
            stack,
            fit_normals(stack, threads=self._threads),
            lobes=lobes,
            ambient=True,
            coated=self.coated,
            # Rigs are told apart as well without the painting's prior, for which a sample of 256
            # pixels has too few seeds: all of them would start from fixed widths.
            typical=False,
            index=self._index,
            effort=resolved(self._effort if lobes == 1 else "standard"),
            threads=self._threads,
            progress=False,
        )

    def errors(self, rig: Rig, folds: int, lobes: int = 1) -> Errors:
        """Errors of every photograph when it was held out."""
        stack, count = self.lit(rig), len(self.samples)

        def errors_of(held: NDArray[np.intp]) -> NDArray[np.float64]:
            seen = np.delete(np.arange(count), held)
            new = stack.rig.take(held)
            shown = self.surface(stack.take(seen), lobes).shown(new, self._threads)
            own = log_ratios(self.samples[held], shown.mean(axis=1), new.intensities)
            light = shown * np.exp(np.where(np.isfinite(own), own, 0.0))[:, None, None, None]
            return (self.coded(light) - self.truth[held]).reshape(len(held), -1)

        parts = [np.arange(fold, count, folds) for fold in range(folds)]
        coded = np.full((count, self.truth[0].size), np.nan)
        found = wait_for_each(errors_of, parts, thread_count(self._threads))
        for held, errors in zip(parts, found, strict=True):
            coded[held] = errors
        return Errors(coded)

    def _step(self, linear: NDArray[np.float32]) -> float:
        """One step of the files in codes: of the median lit sample, or 1 of linear floats."""
        if self._few.samples.dtype.kind not in "iu":
            # Decoded by a tone curve, they were codes of a file; full scale says of how many bits.
            white = self._curve.white
            return CODES / white if white > 1.0 else 1.0
        next_one = linear + self._few.scale[:, None, None]
        steps = self.coded(next_one) - self.truth
        # The steep foot of the curve makes steps of shadows large, and of what the mask leaves out.
        lit = np.isfinite(steps) & (linear > DIM * np.ma.masked_invalid(linear).mean(axis=0))
        if self._few.mask is not None:
            lit &= self._few.mask
        return float(np.median(steps[lit])) if lit.any() else 1.0

    def coded(self, linear: NDArray[Any]) -> NDArray[np.float64]:
        """Linear light in codes of 8 bits; what is brighter than white goes on above 255.

        Clipped there, a strong lamp would tell nothing, and what is shown too bright be right.
        Light that overflows is a very large error, not an unknown one.
        """
        # In place, and converted block by block: each new array is memory that the system first
        # fills with zeros.
        light = np.empty(np.shape(linear), np.float32)
        with np.errstate(over="ignore"):  # of samples near the largest float
            np.divide(linear, self.white, out=light, casting="same_kind")
            codes = self._curve.encode(light, clip=False)
        eight_bits = np.multiply(codes, CODES / self._curve.white, dtype=np.float64)
        return np.minimum(eight_bits, _LARGEST, out=eight_bits)


def _lighting(few: Stack, middle: tuple[float, float]) -> Callable[[Rig], Stack]:
    """What puts a sample under a rig, from where its middle lies; the last ones are kept."""

    @lru_cache(maxsize=RECENT)
    def lit(rig: Rig) -> Stack:
        local = Rig(rig.seen_from(*middle), pitch_mm=few.rig.pitch_mm)
        return few._replace(rig=local)

    return lit


def log_ratios(
    samples: NDArray[Any],
    expected: NDArray[Any],
    intensities: NDArray[np.float64],
    wanted: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """``(obs,)`` median logarithm of sample / expected sample; NaN where no pixel determines it.

    ``wanted`` ``(obs,)``: of these photographs alone; default: of all.
    """
    even = expected / intensities.reshape(-1, *[1] * (expected.ndim - 1))
    bright = DIM * even.mean(axis=0)
    if wanted is not None:
        samples, expected, even = samples[wanted], expected[wanted], even[wanted]
    with np.errstate(divide="ignore", invalid="ignore"):
        usable = np.isfinite(samples) & (samples > 0.0) & (even > bright)
        log = np.where(usable, np.log(samples / expected), np.nan)
    rows = np.sort(log.reshape(len(log), -1), axis=1)  # NaN are last
    count = np.count_nonzero(~np.isnan(rows), axis=1)
    middle = np.stack([(count - 1) // 2, count // 2], axis=1)
    return np.asarray(np.take_along_axis(rows, middle, axis=1).mean(axis=1), np.float64)


def fold_count(lights: int, fewest: int, folds: int) -> int:
    """Folds that leave at least ``fewest`` photographs to fit; 0 if there are none."""
    if lights - -(-lights // folds) >= fewest:
        return folds
    return lights if lights - 1 >= fewest else 0


def _trimmed_squares(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trimmed mean of the squares of each row; NaN of a photograph that shows nothing known."""
    squares = np.sort(errors**2, axis=1)  # NaN are last
    count = np.ceil(KEPT * np.isfinite(squares).sum(axis=1)).astype(int)
    return np.array(
        [one[:n].mean() if n else np.nan for one, n in zip(squares, count, strict=True)]
    )


def trimmed_mean(errors: NDArray[np.float64]) -> float:
    """Mean of the smallest :data:`KEPT` of the sizes of known errors; infinite if none is known."""
    size = np.abs(errors[np.isfinite(errors)])
    if not size.size:
        return float("inf")
    count = max(1, int(KEPT * size.size))
    return float(np.partition(size, count - 1)[:count].mean())

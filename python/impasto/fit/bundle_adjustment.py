"""Bundle adjustment: the numbers of a rig and the surfaces of all sampled pixels, together.

Gauss-Newton on all unknowns at once [@triggs2000bundle]. Those of a pixel appear in its own samples
only and are eliminated by their Schur complement, so that a step costs no more than the lamps
(``crates/impasto/src/sbrdf/bundle_adjustment``). A
search that changes rig and surfaces in turn needs many rounds instead, because each hides most of
the other's error. The surfaces are fitted anew before every step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import thread_count
from impasto._internal.waiting import wait_for_each
from impasto.fit.gauge import fall_off, log_cosine, log_elevation, log_strengths_of_tilt
from impasto.fit.held_out import KEPT, HeldOut, log_ratios, trimmed_mean
from impasto.fit.lobe_profile import Fitted, LobeProfile, shown_by
from impasto.fit.strength_search import FEWEST, OUTLIER
from impasto.rig import Rig
from impasto.surface import Surface

Array = NDArray[np.float64]
Kind = Literal["given", "held", "free"]
"""Strengths as given; estimated while mean normal and fall-off with elevation are held; free."""

_ROUNDS = 15
_STILL, _STILL_LOG = 0.0005, 0.001
"""A step that moves inverse distances and logarithms of strengths by less is the last, by the error
of photographs held out; four times as much, by that of those fitted, which is biased by more."""
_LONGEST, _LONGEST_LOG = 0.15, 0.5
"""The longest step of inverse distances and of logarithms of strengths: beyond, derivatives of
highlights no longer hold."""
_WORSE, _NOISE = 2, 1.002
"""So many steps in a row that raise the error by more than this factor are the last; searches of
single pixels scatter it by less."""
_MET, _MET_LOG = 0.02, 0.05
"""A path that comes so close to numbers found from another start ends there."""
_LIKE = 0.8
"""The largest ratio of two steps in a row that is believed."""
_RETURN = 3
"""Steps in which a gauge that is held returns, and with it a part of the error: what came before
does not count."""
_LEAST = 1e-3
"""A lamp has no equation if its squared derivatives are this small a share of the median lamp's:
its strength is so wrong that all its samples are outliers, or its photograph is black."""
_MOSTLY = 0.5
"""Nor if it keeps less than this share of the samples that the median lamp keeps: where most are
trimmed, those that are left agree with any strength, and a median is more robust."""
_PRIOR = 0.7
"""Standard deviation of the logarithms of strengths before any photograph: lamps that are alike
differ by a factor of two. Without it a lamp that no pixel shows has no equation."""
_DAMPING = 1e-3
"""Relative addition to the diagonal of the equations of the rig, which what is not determined makes
singular."""
_TILT, _PLACE, _SLOPE = 0.01, 0.01, 0.01
"""Steps of derivatives: of the mean normal, of inverse distances, of samples (relative)."""
_DARK = 1e-6
"""Least step of a sample, in shares of white."""


@dataclass(frozen=True, slots=True, eq=False)
class RigNumbers:
    """Inverse distances of camera and lamps, and ``(obs,)`` logarithms of strengths."""

    place: Array
    log: Array

    @property
    def spread(self) -> float:
        """The largest strength divided by the smallest."""
        return float(np.exp(np.ptp(self.log)))

    def meets(self, other: RigNumbers, place: float, log: float) -> bool:
        """Whether no number differs by as much."""
        far = np.abs(self.place - other.place).max(), np.abs(self.log - other.log).max()
        return bool(far[0] < place and far[1] < log)


class BundleAdjustment:
    """Bundle adjustment on the sample of a cross-validation.

    Parameters
    ----------
    test
        The sample of pixels.
    at
        The rig of some numbers, for the whole painting.
    directions
        ``(obs, 3)`` of the lights as given.
    """

    def __init__(
        self, test: HeldOut, at: Callable[[RigNumbers], Rig], directions: Array, threads: int | None
    ) -> None:
        self._test, self._at, self._threads = test, at, threads
        self._directions = directions

    def solve(
        self,
        start: RigNumbers,
        free: NDArray[np.bool_],
        strengths: Kind,
        *,
        nearest: float,
        folds: int = 1,
        known: Sequence[RigNumbers] = (),
    ) -> RigNumbers:
        """The numbers with the least trimmed error; of those within 0.2 % of it, the last.

        Parameters
        ----------
        start
            Where to begin. What is neither ``free`` nor of ``strengths`` stays.
        free
            ``(2,)`` which of the inverse distances are free, in 0 to ``nearest``.
        strengths
            Whether strengths are, and whether their gauge is held as the given strengths say.
        folds
            1: the error of the photographs that are fitted. Surfaces absorb a part of a wrong
            distance, so that cameras are found too far away. More: the error of photographs that
            are held out in turn, which takes so many times as long.
        known
            Numbers that were found from other starts: a path that meets one of them ends there.
        """
        axes = np.flatnonzero(free).tolist()
        if not axes and strengths == "given":
            return start
        mean = None
        if strengths == "held":
            first, _ = self._fitted(replace(start, log=0.0 * start.log), folds)
            if not first[0].fine.any():
                return start
            mean = first[0].mean_normal
        state, best, least, worse = start, None, np.inf, 0
        before: Array | None = None
        loose = 4.0 if folds == 1 else 1.0
        for number in range(_ROUNDS):
            surfaces, error = self._fitted(state, folds)
            if not all(found.fine.any() for found in surfaces):
                break  # a lamp so weak that samples overflow when they are divided by it
            if mean is None or number >= _RETURN:
                if error < _NOISE * least:
                    best, least, worse = state, min(error, least), 0
                else:
                    worse += 1
            if worse == _WORSE:
                break
            step, determined = self._step(state, surfaces, axes, strengths, nearest)
            if before is None or mean is not None:
                before = step  # of what is held, most steps are alike and do not shrink
            else:
                step, before = _extrapolated(step, before), None
            place, log = state.place.copy(), state.log
            moved = np.clip(step[: len(axes)], -_LONGEST, _LONGEST)
            place[axes] = np.clip(place[axes] + moved, 0.0, nearest)
            if strengths != "given":
                moved = np.clip(step[len(axes) :], -_LONGEST_LOG, _LONGEST_LOG)
                log = log + (moved if mean is None else self._held(moved, log, surfaces[0], mean))
                log = log - np.median(log[determined])
                if not determined.all():
                    log[~determined] = self._medians(state, surfaces[0], ~determined)
            after = RigNumbers(place, log)
            if after.meets(state, loose * _STILL, loose * _STILL_LOG):
                break
            for one in known:
                if after.meets(one, _MET, _MET_LOG):
                    return one
            state = after
        return state if best is None else best

    # --- the surface under a rig

    def _fitted(self, state: RigNumbers, folds: int = 1) -> tuple[list[Fitted], float]:
        """The surface, or one without each fold, and their trimmed error."""
        stack = self._test.lit(self._at(state))
        count = len(stack.rig)

        def without(fold: int) -> tuple[Fitted, Array]:
            held = _photographs(count, fold, folds)
            found = self._test.surface(stack if folds == 1 else stack.take(np.flatnonzero(~held)))
            shown = found.shown(stack.rig.take(np.flatnonzero(held)), self._threads)
            error = self._test.truth[held] - self._test.coded(shown)
            return found, error[..., found.fine].ravel()

        both = wait_for_each(without, range(folds), thread_count(self._threads))
        surfaces, errors = zip(*both, strict=True)
        return list(surfaces), trimmed_mean(np.concatenate(errors))

    def _medians(self, state: RigNumbers, found: Fitted, lamps: NDArray[np.bool_]) -> Array:
        """Logarithms of their strengths by median ratios; 0, as given, where one is black."""
        rig = self._test.lit(self._at(state)).rig
        shown = found.shown(rig, self._threads)
        ratios = log_ratios(self._test.samples, shown.mean(axis=1), rig.intensities, lamps)
        return np.where(np.isfinite(ratios), state.log[lamps] + ratios, 0.0)

    # --- one step

    def _step(
        self,
        state: RigNumbers,
        surfaces: list[Fitted],
        axes: list[int],
        strengths: Kind,
        nearest: float,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """What to add to the free inverse distances, then to the logarithms of strengths.

        And ``(obs,)`` of which lamps the photographs tell the strength.
        """
        places, lamps = len(axes), strengths != "given"
        numbers = places + len(state.log) * lamps
        matrix, right = np.zeros((numbers, numbers)), np.zeros(numbers)
        squares, kept = 0.0, np.zeros(len(state.log), np.int64)

        def equations_of(fold: int) -> tuple[Array, Array, float, NDArray[np.intp]]:
            held, found = _photographs(len(state.log), fold, len(surfaces)), surfaces[fold]
            surface = found.result.surface()
            errors, slopes = self._samples(state, found, surface, held)
            product, by_error = self._equations(
                state, surface, found.profile, axes, lamps, errors, slopes, held
            )
            used = np.where(held, np.count_nonzero(slopes, axis=(1, 2, 3)), 0)
            return product, by_error, float((errors[held] ** 2).sum()), used

        folds = range(len(surfaces))
        for product, by_error, square, used in wait_for_each(
            equations_of, folds, thread_count(self._threads)
        ):
            matrix, right = matrix + product, right + by_error
            squares, kept = squares + square, kept + used
        squared = np.diag(matrix)[places:]
        determined = np.ones(len(state.log), np.bool_)
        if lamps:
            determined = squared > _LEAST * np.median(squared)
            determined &= kept >= _MOSTLY * np.median(kept)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + _DAMPING
        use = np.r_[np.ones(places, np.bool_), determined] if lamps else np.ones(places, np.bool_)
        row = np.zeros(numbers)
        if lamps:
            # Errors count twice: neighbouring photographs err alike. What the shape of the lobes
            # leaves of metal is alike in all pixels of a photograph: there are no more independent
            # errors than photographs. Directions in which strengths do little would else take it,
            # times its inverse. On matte paintings that weight would hold true strengths back.
            metal = self._test.surfaces == "shaped"
            independent = len(state.log) if metal else 0.5 * max(int(kept.sum()), 1)
            prior = squares / independent / _PRIOR**2
            each = np.arange(places, numbers)
            matrix[each, each] += prior
            right[each] -= prior * state.log
            row[each] = 1.0
        step = _solved(matrix, right, row, use)
        now, by = state.place[axes], step[:places]
        blocked = ((now <= 0.0) & (by < 0.0)) | ((now >= nearest) & (by > 0.0))
        if blocked.any():
            use[:places] = ~blocked
            step = _solved(matrix, right, row, use)
        return step, determined

    def _held(self, step: Array, log: Array, found: Fitted, mean: Array) -> Array:
        """The step without the gauge: tilt and fall-off stay, or return, where they are held.

        Taken from all lamps alike: as conditions on the step they would be met by the few lamps
        that photographs determine least.
        """
        lights, now = self._directions, found.mean_normal
        tilts = [log_strengths_of_tilt(lights, mean, _TILT * way) / _TILT for way in np.eye(2)]
        ways = np.column_stack([np.ones(len(step)), *tilts])
        usual = np.abs(log + step) <= OUTLIER
        if usual.sum() >= FEWEST:
            step = step - ways @ np.linalg.lstsq(ways[usual], step[usual], rcond=None)[0]
        step = step + log_cosine(lights, now) - log_cosine(lights, mean)
        return step - fall_off(log + step, log_elevation(lights), usual, FEWEST)

    def _samples(
        self, state: RigNumbers, found: Fitted, surface: Surface, held: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """``(obs, band, y, x)`` errors in codes, and codes per light.

        Both are 0 of samples that are unknown or trimmed, by the errors of those ``held``.
        """
        rig = self._test.lit(self._at(state)).rig
        light = shown_by(surface, found.profile, rig, self._threads).astype(np.float64)
        coded = self._test.coded(light)
        by = _SLOPE * light
        by += _DARK * self._test.white
        light += by
        slope = self._test.coded(light)
        slope -= coded
        slope /= by
        error = np.subtract(self._test.truth, coded, out=coded)
        error[..., ~found.fine] = np.nan
        size = np.abs(error, out=by)
        known = np.isfinite(size)
        # Least trimmed squares: samples that the model does not describe do not count.
        judged = size[held][known[held]]
        last = int(KEPT * (judged.size - 1)) if judged.size else 0
        limit = np.partition(judged, last)[last] if judged.size else -np.inf
        unused = ~(known & (size <= limit))
        error[unused] = slope[unused] = 0.0
        return error, slope

    def _equations(
        self,
        state: RigNumbers,
        surface: Surface,
        profile: LobeProfile | None,
        axes: list[int],
        lamps: bool,
        errors: Array,
        slopes: Array,
        held: NDArray[np.bool_],
    ) -> tuple[Array, Array]:
        """Normal equations of the rig, whose surfaces follow it; errors of those ``held``."""
        rigs = [self._test.lit(self._at(state)).rig]
        for axis in axes:
            near = state.place.copy()
            near[axis] += _PLACE
            rigs.append(self._test.lit(self._at(replace(state, place=near))).rig)
        rig, *moved = map(RigArguments.of, rigs)
        return _core.rig_equations(
            surface,
            None if profile is None else (profile.knots, profile.factor),
            rig,
            rigs[0].intensities,
            moved,
            _PLACE,
            lamps,
            errors,
            slopes,
            held,
            thread_count(self._threads),
        )


def _solved(matrix: Array, right: Array, row: Array, use: NDArray[np.bool_]) -> Array:
    """The least squares step of the numbers in ``use``, 0 of the others.

    ``row @ step = 0`` where the row is not 0 (Lagrange multiplier).
    """
    scale = np.sqrt(np.maximum(np.diag(matrix)[use], np.finfo(np.float64).tiny))
    system, right = matrix[np.ix_(use, use)] / np.outer(scale, scale), right[use] / scale
    row = row[use] / scale
    if row.any():
        row = row[None] / np.linalg.norm(row)
        system = np.block([[system, row.T], [row, np.zeros((1, 1))]])
        right = np.append(right, 0.0)
    step = np.zeros(len(use))
    step[use] = np.linalg.lstsq(system, right, rcond=None)[0][: len(scale)] / scale
    return step


def _extrapolated(step: Array, before: Array) -> Array:
    """The sum of the steps that follow, if each is shorter by the same factor (Aitken).

    Surfaces do not follow a rig as far as their derivatives say: the last steps shrink slowly.
    """
    size = float(before @ before)
    ratio = float(step @ before) / size if size > 0.0 else 0.0
    return step / (1.0 - min(max(ratio, 0.0), _LIKE))


def _photographs(count: int, fold: int, folds: int) -> NDArray[np.bool_]:
    """``(obs,)`` which photographs count: those of a fold."""
    return np.asarray(np.arange(count) % folds == fold)

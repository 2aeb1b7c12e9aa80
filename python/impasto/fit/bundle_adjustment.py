"""Bundle adjustment: the numbers of a rig and the surfaces of all sampled pixels, together.

Gauss-Newton on all unknowns at once [@triggs2000bundle]. Those of a pixel appear in its own samples
only and are eliminated by their Schur complement, so that a step costs no more than the lamps. A
search that changes rig and surfaces in turn needs many rounds instead, because each hides most of
the other's error. The surfaces are fitted anew before every step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto.fit.held_out import KEPT, HeldOut, log_ratios
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.strength_search import (
    FEWEST,
    OUTLIER,
    fall_off,
    gauge,
    log_cosine,
    log_elevation,
)
from impasto.rig import Rig
from impasto.status import Status
from impasto.surface import Lobe, Surface

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
_LIKE = 0.8
"""The largest ratio of two steps in a row that is believed."""
_RETURN = 3
"""Steps in which a gauge that is held returns, and with it a part of the error: what came before
does not count."""
_TOLD = 1e-3
"""A lamp has no equation if its squared derivatives are this small a share of the median lamp's:
its strength is so wrong that all its samples are outliers, or its photograph is black."""
_PRIOR = 0.7
"""Standard deviation of the logarithms of strengths before any photograph: lamps that are alike
differ by a factor of two. Without it a lamp that no pixel shows has no equation."""
_RIDGE, _DAMPING = 1e-4, 1e-3
"""Relative additions to the diagonals of the equations of a pixel and of the rig, which what is not
determined makes singular."""
_TILT, _WIDTH, _PLACE, _SLOPE = 0.01, 0.02, 0.01, 0.01
"""Steps of derivatives: of normals, of log gamma, of inverse distances, of samples (relative)."""
_DARK = 1e-6
"""Least step of a sample."""
_BLOCK = 128
"""Pixels whose derivatives are in memory at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class RigNumbers:
    """Inverse distances of camera and lamps, and ``(obs,)`` logarithms of strengths."""

    place: Array
    log: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """Weighted errors of samples ``(n, band, obs)``, and their derivatives.

    ``pixel`` ``(n, band, obs, p)`` by the unknowns of the pixel, ``place`` ``(n, band, obs, q)`` by
    free inverse distances, ``lamp`` ``(n, band, obs)`` by the logarithm of the photograph's own
    strength, None where strengths are given.
    """

    error: Array
    pixel: Array
    place: Array
    lamp: Array | None

    def of(self, pixels: slice, photographs: NDArray[np.bool_]) -> _Linear:
        """Some pixels in some photographs."""
        part = [
            None if one is None else one[pixels][:, :, photographs]
            for one in (self.error, self.pixel, self.place, self.lamp)
        ]
        return _Linear(*part)  # type: ignore[arg-type]

    def weighted(self, weight: Array) -> _Linear:
        """With a weight ``(n,)`` for each pixel."""
        root = np.sqrt(weight)[:, None, None]
        lamp = None if self.lamp is None else self.lamp * root
        wide = root[..., None]
        return _Linear(self.error * root, self.pixel * wide, self.place * wide, lamp)

    def squares(self, photographs: NDArray[np.bool_]) -> Array:
        """``(n, q)`` sums of squares of the derivatives of each pixel by numbers of the rig."""
        places = (self.place**2).sum(axis=(1, 2))
        if self.lamp is None:
            return np.asarray(places)
        lamps = np.zeros((len(places), len(photographs)))
        lamps[:, photographs] = (self.lamp**2).sum(axis=1)
        return np.concatenate([places, lamps], axis=1)

    def products(self, photographs: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Sums of products: pixel by pixel, pixel by rig, rig by rig with the errors last.

        Numbers of the rig are the inverse distances, the strengths of all lamps, those of the
        ``photographs`` here among them, and the error as one more column.
        """
        pixel = self.pixel.reshape(len(self.pixel), -1, self.pixel.shape[-1])
        dense = np.concatenate([self.place, self.error[..., None]], axis=-1)
        flat = dense.reshape(len(pixel), -1, dense.shape[-1])
        along = pixel.transpose(0, 2, 1)
        by_rig, among = along @ flat, _sum_of_products(flat, flat)
        if self.lamp is None:
            return along @ pixel, by_rig, among
        lamps = np.flatnonzero(photographs)
        places = self.place.shape[-1]
        at = places + lamps
        size = places + len(photographs) + 1
        ends = np.r_[0:places, size - 1]
        both = np.zeros((len(pixel), pixel.shape[-1], size))
        both[..., ends] = by_rig
        # A strength changes its own photograph alone.
        both[..., at] = (self.pixel * self.lamp[..., None]).sum(axis=1).transpose(0, 2, 1)
        total = np.zeros((size, size))
        total[np.ix_(ends, ends)] = among
        total[at, at] = (self.lamp**2).sum(axis=(0, 1))
        cross = (dense * self.lamp[..., None]).sum(axis=(0, 1))
        total[np.ix_(at, ends)], total[np.ix_(ends, at)] = cross, cross.T
        return along @ pixel, both, total


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
    ) -> RigNumbers:
        """The numbers with the least trimmed error.

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
        """
        axes = np.flatnonzero(free).tolist()
        if not axes and strengths == "given":
            return start
        mean = None
        if strengths == "held":
            mean = _mean_normal(self._fitted(replace(start, log=0.0 * start.log), folds)[0][0])
        state, best, least, worse = start, None, np.inf, 0
        before: Array | None = None
        loose = 4.0 if folds == 1 else 1.0
        for number in range(_ROUNDS):
            surfaces, error = self._fitted(state, folds)
            if mean is None or number >= _RETURN:
                if error < _NOISE * least:
                    best, least, worse = state, min(error, least), 0
                else:
                    worse += 1
            if worse == _WORSE:
                break
            step, told = self._step(state, surfaces, axes, strengths, nearest)
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
                log = log - np.median(log[told])
                if not told.all():
                    log = np.where(told, log, self._medians(state, surfaces[0]))
            still = np.abs(place - state.place).max() < loose * _STILL
            if still and np.abs(log - state.log).max() < loose * _STILL_LOG:
                break
            state = RigNumbers(place, log)
        return state if best is None else best

    # --- the surface under a rig

    def _fitted(self, state: RigNumbers, folds: int = 1) -> tuple[list[LobeSbrdf], float]:
        """The surface, or one without each fold, and their trimmed error."""
        stack = self._test.lit(self._at(state))
        count, surfaces, errors = len(stack.rig), [], []
        for fold in range(folds):
            held = _photographs(count, fold, folds)
            found = self._test.surface(stack if folds == 1 else stack.take(np.flatnonzero(~held)))
            shown = found.predict(stack.rig.take(np.flatnonzero(held)), threads=self._threads)
            error = np.abs(self._test.truth[held] - self._test.coded(shown))
            errors.append(error[..., found.status < Status.DARK].ravel())
            surfaces.append(found)
        size = np.sort(np.concatenate(errors))
        size = size[np.isfinite(size)]
        return surfaces, float(size[: int(KEPT * size.size)].mean()) if size.size else np.inf

    def _medians(self, state: RigNumbers, found: LobeSbrdf) -> Array:
        """Logarithms of strengths by median ratios; 0, as given, where a photograph is black."""
        rig = self._test.lit(self._at(state)).rig
        shown = found.predict(rig, threads=self._threads).astype(np.float64)
        shown[..., found.status >= Status.DARK] = np.nan
        ratios = log_ratios(self._test.samples, shown.mean(axis=1), rig.intensities)
        return np.where(np.isfinite(ratios), state.log + ratios, 0.0)

    # --- one step

    def _step(
        self,
        state: RigNumbers,
        surfaces: list[LobeSbrdf],
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
        squares, used = 0.0, 0
        for fold, found in enumerate(surfaces):
            held = _photographs(len(state.log), fold, len(surfaces))
            linear = self._linear(state, found, axes, held, lamps=lamps)
            product, by_error = _eliminated(linear, held)
            matrix, right = matrix + product, right + by_error
            squares += float((linear.error[..., held] ** 2).sum())
            used += int(np.count_nonzero(linear.error[..., held]))
        squared = np.diag(matrix)[places:]
        told = squared > _TOLD * np.median(squared) if lamps else np.ones(len(state.log), np.bool_)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + _DAMPING
        use = np.r_[np.ones(places, np.bool_), told] if lamps else np.ones(places, np.bool_)
        row = np.zeros(numbers)
        if lamps:
            # Errors count twice: neighbouring photographs err alike.
            prior = 2.0 * squares / max(used, 1) / _PRIOR**2
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
        return step, told

    def _held(self, step: Array, log: Array, found: LobeSbrdf, mean: Array) -> Array:
        """The step without the gauge: tilt and fall-off stay, or return, where they are held.

        Taken from all lamps alike: as conditions on the step they would be met by the few lamps
        that photographs determine least.
        """
        lights, now = self._directions, _mean_normal(found)
        tilts = [gauge(lights, mean, _TILT * way) / _TILT for way in np.eye(3)[:2]]
        ways = np.column_stack([np.ones(len(step)), *tilts])
        usual = np.abs(log + step) <= OUTLIER
        if usual.sum() >= FEWEST:
            step = step - ways @ np.linalg.lstsq(ways[usual], step[usual], rcond=None)[0]
        step = step + log_cosine(lights, now) - log_cosine(lights, mean)
        return step - fall_off(log + step, log_elevation(lights), usual)

    def _linear(
        self,
        state: RigNumbers,
        found: LobeSbrdf,
        axes: list[int],
        held: NDArray[np.bool_],
        *,
        lamps: bool,
    ) -> _Linear:
        """Errors in codes, weighted, and their derivatives; those ``held`` are to be small."""
        fine = found.status < Status.DARK
        rig, surface = self._test.lit(self._at(state)).rig, found.surface()

        def shown(one: Surface, rig: Rig = rig) -> Array:
            light = one.predict(rig, threads=self._threads)[:, :, fine]
            return np.ascontiguousarray(light.transpose(2, 1, 0), dtype=np.float64)

        light = shown(surface)
        count, bands, lights = light.shape
        coded = self._test.coded(light)
        error = self._test.truth[:, :, fine].transpose(2, 1, 0) - coded
        size = np.abs(error)
        known = np.isfinite(size)
        # Least trimmed squares: samples that the model does not describe do not count.
        judged = size[..., held][known[..., held]]
        used = known & (size <= np.quantile(judged, KEPT)) if judged.size else known & False
        by = _SLOPE * light + _DARK
        weight = np.where(used, (self._test.coded(light + by) - coded) / by, 0.0)[..., None]

        pixel = np.zeros((count, bands, lights, 3 + 3 * bands))
        pixel[..., :2] = _by_tilt(surface, fine, shown)
        pixel[..., 2] = _by_width(surface, shown)
        band = np.arange(bands)
        for kind, linear in enumerate(_by_strength(surface, fine, shown)):
            pixel[:, band, :, 3 + kind * bands + band] = linear.transpose(1, 0, 2)
        place = np.zeros((count, bands, lights, len(axes)))
        for column, axis in enumerate(axes):
            near = state.place.copy()
            near[axis] += _PLACE
            there = self._test.lit(self._at(replace(state, place=near))).rig
            place[..., column] = (shown(surface, there) - light) / _PLACE
        return _Linear(
            np.where(used, error, 0.0),
            pixel * weight,
            place * weight,
            light * weight[..., 0] if lamps else None,
        )


def _by_tilt(surface: Surface, fine: NDArray[np.bool_], shown: Callable[[Surface], Array]) -> Array:
    """Derivatives by tilts of the normals along two axes of each."""
    normal = surface.normal.astype(np.float64)
    each = normal[:, fine].T
    # The axis that is farthest from the normal.
    across = np.eye(3)[np.argmin(np.abs(each), axis=1)]
    first = np.cross(each, across)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frame = (first, np.cross(each, first))

    def tilted(by: Array) -> Array:
        leaning = each + by
        moved = normal.copy()
        moved[:, fine] = (leaning / np.linalg.norm(leaning, axis=1, keepdims=True)).T
        return shown(replace(surface, normal=moved.astype(np.float32)))

    found = [(tilted(_TILT * way) - tilted(-_TILT * way)) / (2.0 * _TILT) for way in frame]
    return np.stack(found, axis=-1)


def _by_width(surface: Surface, shown: Callable[[Surface], Array]) -> Array:
    """Derivative by the logarithm of the lobe's width."""
    (lobe,) = surface.lobes

    def wider(by: float) -> Array:
        (gamma,) = lobe.shape
        return shown(replace(surface, lobes=(Lobe(lobe.strength, (gamma * by,)),)))

    by = wider(1.0 + _WIDTH) - wider(1.0 / (1.0 + _WIDTH))
    return np.asarray(by / (2.0 * np.log1p(_WIDTH)))


def _by_strength(
    surface: Surface, fine: NDArray[np.bool_], shown: Callable[[Surface], Array]
) -> list[Array]:
    """Derivatives by diffuse reflectance, ambient light and strength of the lobe, per band."""
    (lobe,) = surface.lobes
    one, none = np.ones_like(surface.diffuse), np.zeros_like(surface.diffuse)
    matte = (Lobe(none, lobe.shape),)
    alone = [
        replace(surface, diffuse=one, ambient=none, lobes=matte),
        replace(surface, diffuse=none, ambient=one, lobes=matte),
        replace(surface, diffuse=none, ambient=none, lobes=(Lobe(one, lobe.shape),)),
    ]
    ambient = none if surface.ambient is None else surface.ambient
    strength = np.broadcast_to(lobe.strength, one.shape)
    # What is at its bound of 0 stays there; a pixel without a lobe has no width, either.
    return [
        np.where((now[:, fine].T > 0.0)[..., None], shown(part), 0.0)
        for part, now in zip(alone, (surface.diffuse, ambient, strength), strict=True)
    ]


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


def _eliminated(linear: _Linear, held: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Normal equations of the rig without the unknowns of the pixels.

    The pixels follow the rig as the photographs say that are fitted, all or those not ``held``;
    the errors are those of the photographs held. With all, this is the Schur complement.
    """
    blocks = [slice(at, at + _BLOCK) for at in range(0, len(linear.error), _BLOCK)]
    if not held.all():
        linear = linear.weighted(
            _bounded(np.concatenate([_Followed.of(linear, one, held).leverage for one in blocks]))
        )
    size = 1 + linear.place.shape[-1] + (0 if linear.lamp is None else len(held))
    total = sum(
        (_Followed.of(linear, one, held).equations for one in blocks), np.zeros((size, size))
    )
    return total[:-1, :-1].copy(), total[:-1, -1].copy()


def _bounded(leverage: Array) -> Array:
    """Weights ``(n,)`` of pixels: bounded influence [@krasker1982bounded], as Mallows weighs.

    A few pixels whose lobe the fitted photographs hardly determine would follow the rig without
    bound, and the rig hardly move.
    """
    usual = np.median(leverage, axis=0)
    usual = np.where(usual > 0.0, usual, np.inf)
    return np.asarray(1.0 / np.maximum((leverage / usual).max(axis=1), 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Followed:
    """Products of some pixels, and how their unknowns ``follow`` the rig, ``(n, p, q)``.

    ``alone`` ``(n, q)``: squares of the derivatives by the rig if nothing followed. The first
    ``places`` numbers of the rig are inverse distances.
    """

    pixel: Array
    by_rig: Array
    rig: Array
    follow: Array
    alone: Array
    places: int

    @classmethod
    def of(cls, linear: _Linear, pixels: slice, held: NDArray[np.bool_]) -> _Followed:
        """Of the pixels' photographs."""
        part = linear.of(pixels, held)
        shown = part.products(held)
        to_fit = shown if held.all() else linear.of(pixels, ~held).products(~held)
        # What shows in the photographs held alone, as a highlight may, does not follow.
        both = shown[0] if held.all() else shown[0] + to_fit[0]
        scale = np.sqrt(np.einsum("nkk->nk", both))
        scale[scale == 0.0] = 1.0
        among = to_fit[0] / (scale[:, :, None] * scale[:, None])
        along = to_fit[1] / scale[..., None]
        if not held.all():
            along[..., -1] = 0.0  # they are at their least squares
        follow = np.linalg.solve(among + _RIDGE * np.eye(scale.shape[1]), along)
        return cls(*shown, follow / scale[..., None], part.squares(held), linear.place.shape[-1])

    @property
    def equations(self) -> Array:
        """Normal equations, the errors last."""
        cross = _sum_of_products(self.follow, self.by_rig)
        both = _sum_of_products(self.follow, self.pixel @ self.follow)
        return self.rig - cross - cross.T + both

    @property
    def leverage(self) -> Array:
        """``(n, k)`` sums of squares of the derivatives of each pixel's errors.

        By every free inverse distance, and by all strengths together.
        """
        apart = self.pixel @ self.follow - 2.0 * self.by_rig
        squares = (self.follow * apart).sum(axis=1)[:, :-1] + self.alone
        places, lamps = np.split(squares, [self.places], axis=1)
        return np.column_stack([places, lamps.sum(axis=1)])


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


def _sum_of_products(one: Array, other: Array) -> Array:
    """The sum over pixels of ``one.T @ other``, ``(n, k, q)`` and ``(n, k, r)`` to ``(q, r)``.

    Pixel by pixel: BLAS divides a large product among its threads, and the bits of the sum would
    depend on their number.
    """
    total = np.zeros((one.shape[2], other.shape[2]))
    for left, right in zip(one, other, strict=True):
        total += left.T @ right
    return total


def _mean_normal(found: LobeSbrdf) -> Array:
    mean = found.normal[:, found.status < Status.DARK].mean(axis=1, dtype=np.float64)
    return np.asarray(mean / np.linalg.norm(mean))

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

from impasto.fit.held_out import KEPT, HeldOut
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

ROUNDS = 15
_STILL, _STILL_LOG = 0.001, 0.002
"""A step that moves inverse distances and logarithms of strengths by less is the last."""
_LONGEST, _LONGEST_LOG = 0.15, 0.5
_WORSE = 2
"""So many steps in a row that raise the error are the last."""
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

    @property
    def uneven(self) -> bool:
        """Whether strengths differ from those given."""
        return bool(self.log.any())


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """Errors of the sampled pixels, and their derivatives.

    ``error`` ``(n, k)``; ``pixel`` ``(n, k, p)`` by the unknowns of the pixel, ``rig``
    ``(n, k, q)`` by the numbers of the rig.
    """

    error: Array
    pixel: Array
    rig: Array


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
        self, start: RigNumbers, free: NDArray[np.bool_], strengths: Kind, *, nearest: float
    ) -> RigNumbers:
        """The numbers with the least trimmed error of the photographs fitted.

        Parameters
        ----------
        start
            Where to begin. What is neither ``free`` nor of ``strengths`` stays.
        free
            ``(2,)`` which of the inverse distances are free, in 0 to ``nearest``.
        strengths
            Whether strengths are, and whether their gauge is held as the given strengths say.
        """
        axes = np.flatnonzero(free).tolist()
        if not axes and strengths == "given":
            return start
        mean = self._mean(replace(start, log=0.0 * start.log)) if strengths == "held" else None
        state, best, least, worse = start, start, np.inf, 0
        for _ in range(ROUNDS):
            found, error = self._fitted(state)
            if error < least:
                best, least, worse = state, error, 0
            else:
                worse += 1
            if worse == _WORSE and mean is None:
                break
            step = self._step(state, found, axes, strengths)
            place, log = state.place.copy(), state.log
            moved = np.clip(step[: len(axes)], -_LONGEST, _LONGEST)
            place[axes] = np.clip(place[axes] + moved, 0.0, nearest)
            if strengths != "given":
                moved = np.clip(step[len(axes) :], -_LONGEST_LOG, _LONGEST_LOG)
                log = log + (moved if mean is None else self._held(moved, log, found, mean))
                log = log - np.median(log)
            still = np.abs(place - state.place).max() < _STILL
            if still and np.abs(log - state.log).max() < _STILL_LOG:
                break
            state = RigNumbers(place, log)
        # What is held returns at the end, and with it a part of the error.
        return best if mean is None else state

    # --- the surface under a rig

    def _fitted(self, state: RigNumbers) -> tuple[LobeSbrdf, float]:
        """The surface, and its trimmed error."""
        stack = self._test.lit(self._at(state))
        found = self._test.surface(stack)
        shown = self._test.coded(found.predict(stack.rig, threads=self._threads))
        size = np.abs(self._test.truth - shown)[..., found.status < Status.DARK]
        size = np.sort(size[np.isfinite(size)])
        return found, float(size[: int(KEPT * size.size)].mean()) if size.size else np.inf

    def _mean(self, state: RigNumbers) -> Array:
        found, _ = self._fitted(state)
        return _mean_normal(found)

    # --- one step

    def _step(
        self, state: RigNumbers, found: LobeSbrdf, axes: list[int], strengths: Kind
    ) -> Array:
        """What to add to the free inverse distances, then to the logarithms of strengths."""
        linear = self._linear(state, found, axes, lamps=strengths != "given")
        matrix, right = _eliminated(linear)
        places = len(axes)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + _DAMPING
        if strengths == "given":
            return _solved(matrix, right)
        # Errors count twice: neighbouring photographs err alike.
        used = max(np.count_nonzero(linear.error), 1)
        prior = 2.0 * float((linear.error**2).sum()) / used / _PRIOR**2
        lamps = np.arange(places, len(right))
        matrix[lamps, lamps] += prior
        right[lamps] -= prior * state.log
        row = np.zeros(len(right))
        row[lamps] = 1.0
        return _solved(matrix, right, row)

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
        self, state: RigNumbers, found: LobeSbrdf, axes: list[int], *, lamps: bool
    ) -> _Linear:
        """Errors in codes, weighted, and their derivatives."""
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
        used = known & (size <= np.quantile(size[known], KEPT)) if known.any() else known
        by = _SLOPE * light + _DARK
        weight = np.where(used, (self._test.coded(light + by) - coded) / by, 0.0)[..., None]

        pixel = np.zeros((count, bands, lights, 3 + 3 * bands))
        pixel[..., :2] = _by_tilt(surface, fine, shown)
        pixel[..., 2] = _by_width(surface, shown)
        band = np.arange(bands)
        for kind, linear in enumerate(_by_strength(surface, fine, shown)):
            pixel[:, band, :, 3 + kind * bands + band] = linear.transpose(1, 0, 2)
        columns = [*_by_place(self._test, self._at, state, axes, shown, surface, light)]
        by_rig = np.zeros((count, bands, lights, len(axes) + lamps * lights))
        for column, values in enumerate(columns):
            by_rig[..., column] = values
        if lamps:
            each = np.arange(lights)
            by_rig[:, :, each, len(axes) + each] = light
        flat = (count, bands * lights)
        return _Linear(
            np.where(used, error, 0.0).reshape(flat),
            np.nan_to_num(pixel * weight).reshape(*flat, -1),
            np.nan_to_num(by_rig * weight).reshape(*flat, -1),
        )


def _by_place(
    test: HeldOut,
    at: Callable[[RigNumbers], Rig],
    state: RigNumbers,
    axes: list[int],
    shown: Callable[[Surface, Rig], Array],
    surface: Surface,
    light: Array,
) -> list[Array]:
    """Derivatives by inverse distances."""
    found = []
    for axis in axes:
        place = state.place.copy()
        place[axis] += _PLACE
        there = test.lit(at(replace(state, place=place))).rig
        found.append((shown(surface, there) - light) / _PLACE)
    return found


def _by_tilt(
    surface: Surface, fine: NDArray[np.bool_], shown: Callable[[Surface], Array]
) -> Array:
    """Derivatives by tilts of the normals along two axes of each."""
    normal = surface.normal.astype(np.float64)
    each = normal[:, fine].T
    # The axis that is farthest from the normal.
    aside = np.eye(3)[np.argmin(np.abs(each), axis=1)]
    first = np.cross(each, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frame = (first, np.cross(each, first))

    def tilted(by: Array) -> Array:
        turned = each + by
        moved = normal.copy()
        moved[:, fine] = (turned / np.linalg.norm(turned, axis=1, keepdims=True)).T
        return shown(replace(surface, normal=moved.astype(np.float32)))

    found = [(tilted(_TILT * way) - tilted(-_TILT * way)) / (2.0 * _TILT) for way in frame]
    return np.stack(found, axis=-1)


def _by_width(surface: Surface, shown: Callable[[Surface], Array]) -> Array:
    """Derivative by the logarithm of the lobe's width."""
    (lobe,) = surface.lobes

    def wider(by: float) -> Array:
        (gamma,) = lobe.shape
        return shown(replace(surface, lobes=(Lobe(lobe.strength, (gamma * by,)),)))

    return (wider(1.0 + _WIDTH) - wider(1.0 / (1.0 + _WIDTH))) / (2.0 * np.log1p(_WIDTH))


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
    # What is at its bound of 0 stays there.
    return [
        shown(part) * (now[:, fine].T > 0.0)[..., None]
        for part, now in zip(alone, (surface.diffuse, ambient, strength), strict=True)
    ]


def _eliminated(linear: _Linear) -> tuple[Array, Array]:
    """Normal equations of the rig without the unknowns of the pixels (Schur complement)."""
    total = np.zeros((linear.rig.shape[2] + 1,) * 2)
    for start in range(0, len(linear.error), _BLOCK):
        part = slice(start, start + _BLOCK)
        pixel, error = linear.pixel[part], linear.error[part]
        scale = np.sqrt((pixel**2).sum(axis=1))
        scale[scale == 0.0] = 1.0
        own = (pixel / scale[:, None]).transpose(0, 2, 1)
        other = np.concatenate([linear.rig[part], error[..., None]], axis=2)
        among = own @ own.transpose(0, 2, 1) + _RIDGE * np.eye(own.shape[1])
        between = own @ other
        solved = np.linalg.solve(among, between)
        other, between, solved = (one.reshape(-1, len(total)) for one in (other, between, solved))
        total += other.T @ other - between.T @ solved
    return total[:-1, :-1].copy(), total[:-1, -1].copy()


def _solved(matrix: Array, right: Array, row: Array | None = None) -> Array:
    """The least squares step, with ``row @ step = 0`` (Lagrange multiplier)."""
    scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    system, right = matrix / np.outer(scale, scale), right / scale
    if row is not None:
        row = row / scale
        row = row[None] / np.linalg.norm(row)
        system = np.block([[system, row.T], [row, np.zeros((1, 1))]])
        right = np.append(right, 0.0)
    return np.asarray(np.linalg.lstsq(system, right, rcond=None)[0][: len(scale)] / scale)


def _mean_normal(found: LobeSbrdf) -> Array:
    mean = found.normal[:, found.status < Status.DARK].mean(axis=1, dtype=np.float64)
    return np.asarray(mean / np.linalg.norm(mean))

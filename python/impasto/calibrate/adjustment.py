"""Directions and positions of lamps from their highlights on balls, with covariances.

A bundle adjustment [@triggs2000bundle]: the unknowns are the outlines of all balls, observed with
the covariance of their fit, and the lamps, observed by their highlights. A lamp at X is (u, q) with
the unit direction u from the middle of the balls and the inverse distance q = 1 / |X|
[@civera2008inverse]: q = 0 is a distant lamp, and nothing is singular there. From a point p of a
ball the lamp is seen along u - q p.

The residual of a highlight is the first-order distance in pixels to the place where the law of
reflection would put it (Sampson's error [@sampson1982conic]); the sum of their squares over their
variances is minimised by Gauss and Newton's method, from the point closest to all rays and from
q = 0. Unknowns of the lamps are eliminated (Schur complement), so that the cost grows with their
number alone.

Variances are multiplied by the sum of squares per degree of freedom where this exceeds 1 (Birge
ratio [@birge1932errors]): errors that no single photograph shows, such as a ball that is not round,
then count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.student import upper_tail
from impasto.calibrate.geometry import Array, BallCamera, tangents
from impasto.errors import GeometryError

ROUNDS = 60
CONVERGED = 1e-9
"""Relative change of the sum of squares that ends the iteration."""
STEP = 1e-6
"""Of difference quotients: radians, or parts of a radius."""
LEVEL = 0.00135
"""Of the test whether a lamp is near: the upper tail of three standard deviations."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Lamps and outlines that fit all highlights best.

    Parameters
    ----------
    direction
        ``(lamp, 3)`` unit vectors from ``origin``, in the camera frame.
    inverse_distance
        ``(lamp,)`` q: one over the distance from ``origin``, in the units of
        :meth:`BallCamera.balls`.
    covariance
        ``(lamp, 3, 3)`` of the two angles across ``direction`` (``tangents``) and of q.
    outlines
        ``(ball, 3)`` as adjusted.
    residual
        ``(ball, lamp, 2)`` pixels.
    freedom
        Degrees of freedom: observations less unknowns.
    ratio
        Birge ratio: the root of the sum of squares per degree of freedom; 1 if there is none.
    origin
        ``(3,)``: the middle of the balls, in the camera frame.
    """

    direction: Array
    inverse_distance: Array
    covariance: Array
    outlines: Array
    residual: Array
    freedom: int
    ratio: float
    origin: Array

    @property
    def t(self) -> Array:
        """``(lamp,)``: q over its standard deviation; NaN where q was not estimated."""
        variance = self.covariance[:, 2, 2]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(variance > 0.0, self.inverse_distance / np.sqrt(variance), np.nan)

    @property
    def probability(self) -> Array:
        """``(lamp,)``: chance of a t as large for a distant lamp (Student's t, one-sided)."""
        return np.array(
            [
                upper_tail(t, self.freedom) if np.isfinite(t) and self.freedom > 0 else 1.0
                for t in self.t.tolist()
            ]
        )

    @property
    def near(self) -> NDArray[np.bool_]:
        """``(lamp,)``: whether q > 0 at the level ``LEVEL`` of Student's one-sided t test."""
        return np.asarray(self.probability < LEVEL)


def adjust(
    camera: BallCamera,
    outlines: Array,
    outline_covariance: Array,
    highlights: Array,
    sigma: Array,
    *,
    distant: bool,
) -> Adjustment:
    """Fit lamps, and outlines within their errors, to highlights.

    Parameters
    ----------
    camera
        Of all balls: one frame.
    outlines
        ``(ball, 3)``.
    outline_covariance
        ``(ball, 3, 3)``.
    highlights
        ``(ball, lamp, 2)`` pixels.
    sigma
        ``(ball, lamp)`` standard deviation of their coordinates in pixels.
    distant
        Whether q is held at 0: directions only.

    Raises
    ------
    GeometryError
        A highlight that lies outside its ball, or positions of one ball alone.
    """
    count, lamps = sigma.shape
    if count < 2 and not distant:
        raise GeometryError(
            f"outlines: positions of lamps need two balls or more, found {count}: one ball "
            "mirrors every point of a line at one place"
        )
    problem = _Problem(camera, outlines, outline_covariance, highlights, sigma)
    ends: list[tuple[float, _State]] = []
    for closest in (False,) if distant else (True, False):
        try:
            ends.append(_minimised(problem, problem.start(not closest), free=2 if distant else 3))
        except np.linalg.LinAlgError:  # a point on the line between the balls: try the other start
            continue
    if not ends:
        raise GeometryError(
            "highlights: they determine no lamps; check the outlines and the order of the lamps"
        )
    free = 2 if distant else 3
    value, state = min(ends, key=lambda end: end[0])
    if not np.isfinite(value):
        raise GeometryError(
            "highlights: a highlight lies outside the outline of its ball; correct the outline"
        )
    freedom = 2 * count * lamps - free * lamps
    ratio = float(np.sqrt(value / freedom)) if freedom > 0 else 1.0
    covariance = problem.covariance(state, free) * max(ratio, 1.0) ** 2
    return Adjustment(
        state.direction,
        state.inverse,
        covariance,
        state.outlines,
        problem.residual(state),
        freedom,
        ratio,
        problem.origin,
    )


def _minimised(problem: _Problem, state: _State, free: int) -> tuple[float, _State]:
    """Gauss and Newton's method with steps that are halved until the sum of squares falls."""
    value = problem.value(state)
    for _ in range(ROUNDS):
        if not np.isfinite(value):
            break
        step = problem.step(state, free)
        length = 1.0
        while length > 1e-6:
            trial = state.changed(step, length)
            found = problem.value(trial)
            if np.isfinite(found) and found <= value:
                break
            length /= 2.0
        else:
            break
        fell, value, state = value - found, found, trial
        if fell <= CONVERGED * value:
            break
    return value, state


@dataclass(frozen=True, eq=False)
class _State:
    outlines: Array
    direction: Array
    inverse: Array

    def changed(self, step: tuple[Array, Array], length: float) -> _State:
        outlines, lamps = step
        right, up = tangents(self.direction)
        move = length * lamps
        moved = self.direction + move[:, :1] * right + move[:, 1:2] * up
        moved = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        inverse = self.inverse + (move[:, 2] if move.shape[1] > 2 else 0.0)
        return _State(self.outlines + length * outlines, moved, inverse)


class _Problem:
    """Residuals of highlights and outlines, and their derivatives."""

    def __init__(
        self,
        camera: BallCamera,
        outlines: Array,
        outline_covariance: Array,
        highlights: Array,
        sigma: Array,
    ) -> None:
        self.camera, self.given = camera, np.asarray(outlines, dtype=np.float64)
        self.weight = np.linalg.inv(outline_covariance)
        self.highlights, self.sigma = highlights, sigma
        self.radius = self.given[:, 2]
        # Fixed: an origin that moved with the outlines would move all lamps.
        self.origin = camera.balls(self.given)[0].mean(axis=0)

    def start(self, distant: bool) -> _State:
        """The point closest to the rays of each lamp, or their mean direction."""
        lamps = self.sigma.shape[1]
        point, towards = self._rays(self.given, self.highlights)
        mean = towards.mean(axis=0)
        mean = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        inverse = np.zeros(lamps)
        if not distant:
            across = np.eye(3) - towards[..., :, None] * towards[..., None, :]
            matrix = across.sum(axis=0)
            right = np.einsum("blij,blj->li", across, point - self.origin)
            try:
                closest = np.linalg.solve(matrix, right[..., None])[..., 0]
            except np.linalg.LinAlgError:  # parallel rays
                closest = np.full((lamps, 3), np.inf)
            far = np.linalg.norm(closest, axis=1)
            with np.errstate(invalid="ignore", divide="ignore"):
                ahead = np.einsum("li,li->l", closest, mean) > 0.5 * far
                usable = ahead & np.isfinite(far)
                inverse = np.where(usable, 1.0 / far, 0.0)
                mean = np.where(usable[:, None], closest / far[:, None], mean)
        return _State(self.given.copy(), mean, inverse)

    def _rays(self, outlines: Array, pixels: Array) -> tuple[Array, Array]:
        shape = (*pixels.shape[:2], 3)
        return self.camera.reflected(np.broadcast_to(outlines[:, None], shape), pixels)

    def _miss(self, state: _State, pixels: Array, frame: tuple[Array, Array]) -> Array:
        """``(ball, lamp, 2)`` radians from the lamp to what a pixel sees, along two axes."""
        point, towards = self._rays(state.outlines, pixels)
        lamp = state.direction - state.inverse[:, None] * (point - self.origin)
        lamp = lamp / np.linalg.norm(lamp, axis=-1, keepdims=True)
        off = towards - lamp
        return np.stack([np.einsum("bli,bli->bl", off, axis) for axis in frame], axis=-1)

    def _frame(self, state: _State) -> tuple[Array, Array]:
        return tangents(self._rays(state.outlines, self.highlights)[1])

    def _by_pixel(self, state: _State, frame: tuple[Array, Array]) -> Array:
        """``(ball, lamp, 2, 2)``: derivatives of that angle by the pixel."""
        columns = []
        for axis in range(2):
            change = np.zeros((len(self.radius), 1, 2))
            change[..., axis] = STEP * self.radius[:, None]
            more = self._miss(state, self.highlights + change, frame)
            less = self._miss(state, self.highlights - change, frame)
            columns.append((more - less) / (2.0 * STEP * self.radius[:, None, None]))
        return np.stack(columns, axis=-1)

    def residual(self, state: _State) -> Array:
        """``(ball, lamp, 2)`` pixels from the expected highlight to the observed one."""
        frame = self._frame(state)
        miss = self._miss(state, self.highlights, frame)
        solved = np.linalg.solve(self._by_pixel(state, frame), miss[..., None])
        return np.asarray(solved[..., 0], dtype=np.float64)

    def value(self, state: _State) -> float:
        """Sum of squares over variances, of highlights and outlines."""
        try:
            residual = self.residual(state) / self.sigma[..., None]
        except np.linalg.LinAlgError:
            return float("inf")
        change = state.outlines - self.given
        prior = np.einsum("bi,bij,bj->", change, self.weight, change)
        return float(np.square(residual).sum() + prior)

    def _slopes(self, state: _State, free: int) -> tuple[Array, Array, Array]:
        """Residuals over sigma, and their derivatives by outlines and by lamps."""
        frame = self._frame(state)
        inverse = np.linalg.inv(self._by_pixel(state, frame)) / self.sigma[..., None, None]

        def whitened(angles: Array) -> Array:
            return np.asarray((inverse @ angles[..., None])[..., 0])

        now = whitened(self._miss(state, self.highlights, frame))
        by_outline, by_lamp = [], []
        none = (np.zeros_like(state.outlines), np.zeros((len(state.direction), free)))
        for number in range(3):
            change = np.zeros_like(state.outlines)
            change[:, number] = STEP * self.radius
            ends = [
                self._miss(state.changed((side * change, none[1]), 1.0), self.highlights, frame)
                for side in (1.0, -1.0)
            ]
            scale = 2.0 * STEP * self.radius[:, None, None]
            by_outline.append(whitened((ends[0] - ends[1]) / scale))
        for number in range(free):
            moved = np.zeros_like(none[1])
            # q is one over a length: in units of the largest ball's inverse radius.
            unit = STEP / float(self.camera.balls(self.given)[1].max()) if number == 2 else STEP
            moved[:, number] = unit
            ends = [
                self._miss(state.changed((none[0], side * moved), 1.0), self.highlights, frame)
                for side in (1.0, -1.0)
            ]
            by_lamp.append(whitened((ends[0] - ends[1]) / (2.0 * unit)))
        return now, np.stack(by_outline, axis=-1), np.stack(by_lamp, axis=-1)

    def _blocks(self, state: _State, free: int) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Blocks of the normal equations: lamps, mixed, and the Schur complement of outlines."""
        now, by_outline, by_lamp = self._slopes(state, free)
        count, lamps = self.sigma.shape
        lamp = np.einsum("blki,blkj->lij", by_lamp, by_lamp)
        mixed = np.einsum("blki,blkj->lbij", by_lamp, by_outline)  # (lamp, ball, free, 3)
        mixed = np.moveaxis(mixed, 1, 2).reshape(lamps, free, 3 * count)
        own = np.einsum("blki,blkj->bij", by_outline, by_outline) + self.weight
        outline = np.zeros((3 * count, 3 * count))
        for ball in range(count):
            outline[3 * ball : 3 * ball + 3, 3 * ball : 3 * ball + 3] = own[ball]
        change = state.outlines - self.given
        right_lamp = -np.einsum("blki,blk->li", by_lamp, now)
        right_outline = -np.einsum("blki,blk->bi", by_outline, now)
        right_outline -= np.einsum("bij,bj->bi", self.weight, change)
        solved = np.linalg.solve(lamp, mixed)
        schur = outline - np.einsum("lki,lkj->ij", mixed, solved)
        return lamp, mixed, schur, solved, right_lamp, right_outline

    def step(self, state: _State, free: int) -> tuple[Array, Array]:
        """Gauss and Newton's step of outlines ``(ball, 3)`` and lamps ``(lamp, free)``."""
        lamp, mixed, schur, solved, right_lamp, right_outline = self._blocks(state, free)
        right = right_outline.reshape(-1) - np.einsum("lki,lk->i", solved, right_lamp)
        outlines = np.linalg.solve(schur, right)
        rest = right_lamp - mixed @ outlines
        lamps = np.linalg.solve(lamp, rest[..., None])[..., 0]
        return outlines.reshape(-1, 3), np.asarray(lamps, dtype=np.float64)

    def covariance(self, state: _State, free: int) -> Array:
        """``(lamp, 3, 3)``; rows and columns of what is held fixed are 0."""
        lamp, _, schur, solved, _, _ = self._blocks(state, free)
        found = np.linalg.inv(lamp) + solved @ np.linalg.inv(schur) @ np.swapaxes(solved, 1, 2)
        whole = np.zeros((len(found), 3, 3))
        whole[:, :free, :free] = found
        return whole

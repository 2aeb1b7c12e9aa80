"""The outline of a mirror ball in a picture: gradient Hough transform, RANSAC, robust refinement.

1. *Start.* Every strong edge votes along its gradient for the middle of a circle
   [@kimme1975circles]; the circle with the longest arc of edges that face its middle wins.
2. *Edges.* Along 720 radii the steepest places of the picture, found between pixels by a parabola.
3. *Fit.* Random sample consensus [@fischler1981ransac] over three edges each, then Tukey's
   M-estimate by iteratively reweighted least squares [@holland1977robust] of the distances from the
   outline: a circle, or the ellipse of a sphere that a perspective camera sees.

Edges beside each other share their errors (reflections, blur). The covariance of independent errors
is therefore multiplied by the integrated autocorrelation time of the residuals along the outline
[@geyer1992practical].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.geometry import Array, BallCamera
from impasto.errors import ArgumentError

WORKING_SIZE = 512
"""Pixels of the longer side in the Hough transform."""
SMALLEST, LARGEST = 0.03, 0.75
"""Radii looked for, in shorter sides of the picture."""
STRONG = 0.08
"""Share of the pixels that vote: those with the steepest gradient."""
FACING = 0.96
"""Least cosine between an edge's gradient and the direction of the circle's middle."""
ANGLES = 720
"""Radii along which edges are looked for."""
SEARCH = 0.06
"""Reach of that search on either side of the start, in radii of the ball."""
TRIALS = 400
LEAST_SUPPORT = 0.4
"""Share of the outline that must be seen as edges."""
TUKEY = 4.685


@dataclass(frozen=True, eq=False)
class Outline:
    """The outline of one ball.

    Parameters
    ----------
    x, y, radius
        Pixels; see ``impasto.calibrate.geometry``.
    covariance
        ``(3, 3)`` of these, in pixels squared.
    support
        Share of the outline beside which the steepest edge was seen, within 0.6 % of the
        radius; 1 for an outline that was given.
    edges
        ``(n, 2)`` pixels of the edges it was fitted to; empty for one that was given.
    """

    x: float
    y: float
    radius: float
    covariance: Array
    support: float
    edges: Array

    @property
    def numbers(self) -> Array:
        """``(3,)``: x, y, radius."""
        return np.array([self.x, self.y, self.radius])

    @property
    def sigma(self) -> float:
        """Standard deviation of the outline's place in pixels: the worst of its three numbers."""
        return float(np.sqrt(np.diag(self.covariance).max()))


def given_outline(x: float, y: float, radius: float, sigma: float) -> Outline:
    """An outline that somebody measured, with the standard deviation of each of its numbers."""
    for name, value in (("x", x), ("y", y), ("radius", radius)):
        if not np.isfinite(value):
            raise ArgumentError(f"outline: {name} is not a number: {value!r}")
    if radius <= 0.0:
        raise ArgumentError(f"outline: expected a radius above 0 pixels, found {radius:g}")
    return Outline(x, y, radius, sigma**2 * np.eye(3), 1.0, np.empty((0, 2)))


def find_outline(picture: Array, camera: BallCamera, where: str, seed: int = 0) -> Outline:
    """The outline of the one ball in a picture.

    Parameters
    ----------
    picture
        ``(y, x)``: brightness, of any scale.
    camera
        With its principal point in pixels of this picture.
    where
        What the picture is, for messages.
    seed
        Of the random samples of RANSAC.

    Raises
    ------
    ArgumentError
        No ball, or one that a border of the picture cuts off.
    """
    start = strongest_circle(picture)
    if start is None:
        raise ArgumentError(_no_ball(where, 0.0))
    found = None
    for _ in range(2):  # the second search starts from a better circle
        found = _refined(picture, start, camera, seed)
        if found is None:
            raise ArgumentError(_no_ball(where, 0.0))
        start = _circle_about(found, camera)
    assert found is not None
    if found.support < LEAST_SUPPORT:
        raise ArgumentError(_no_ball(where, found.support))
    check_inside(found, picture.shape, camera, where)
    return found


def check_inside(outline: Outline, shape: tuple[int, ...], camera: BallCamera, where: str) -> None:
    """Refuse a ball that a border of the picture cuts off."""
    over, side = beyond_border(camera.outline_points(outline.numbers), shape)
    if over > 3.0 * outline.sigma:
        raise ArgumentError(
            f"{where}: the {side} border cuts {over:.0f} pixels off the ball (middle "
            f"{outline.x:.0f}, {outline.y:.0f}, radius {outline.radius:.0f}); crop less, or "
            "measure its outline by hand and give it (--circles, or outline= in Python)"
        )


def beyond_border(points: Array, shape: tuple[int, ...]) -> tuple[float, str]:
    """How many pixels ``(n, 2)`` points reach beyond the worst border, and its name.

    Below 0 where all lie within ``shape``, rows and columns.
    """
    over = {
        "left": -0.5 - float(points[:, 0].min()),
        "right": float(points[:, 0].max()) - (shape[1] - 0.5),
        "upper": -0.5 - float(points[:, 1].min()),
        "lower": float(points[:, 1].max()) - (shape[0] - 0.5),
    }
    side = max(over, key=lambda name: over[name])
    return over[side], side


def _no_ball(where: str, support: float) -> str:
    seen = f"edges along {100 * support:.0f} % of the best circle, " if support else ""
    return (
        f"{where}: no ball found: {seen}at least {100 * LEAST_SUPPORT:.0f} % are needed; crop the "
        "photographs to the ball, add one with a bright background whose name begins with "
        "ref, or give its outline (--circles, or outline= in Python)"
    )


def strongest_circle(picture: Array) -> Array | None:
    """``(3,)`` the circle that has the longest arc of edges: gradient Hough transform."""
    import cv2

    scale = min(1.0, WORKING_SIZE / max(picture.shape))
    small = np.sqrt(np.maximum(picture, 0.0)).astype(np.float32)
    if scale < 1.0:
        small = np.asarray(
            cv2.resize(small, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        )
    small = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.2))
    slope_x, slope_y = (cv2.Sobel(small, cv2.CV_32F, dx, 1 - dx) for dx in (1, 0))
    steep = np.hypot(slope_x, slope_y)
    rows, columns = small.shape
    limit = np.quantile(steep, 1.0 - STRONG)
    y, x = np.nonzero((steep >= limit) & (steep > 0.0) & _ridge(steep, slope_x, slope_y))
    if len(x) < 20:
        return None
    towards = np.stack([slope_x[y, x], slope_y[y, x]], axis=1) / steep[y, x][:, None]
    shorter = min(rows, columns)
    radii = np.arange(max(4.0, SMALLEST * shorter), LARGEST * shorter, 1.0)
    votes = np.zeros(rows * columns)
    edges = np.stack([x, y], axis=1).astype(np.float64)
    for sign in (-1.0, 1.0):
        for radius in radii:
            at = np.rint(edges + sign * radius * towards).astype(np.int64)
            inside = ((at >= 0) & (at < (columns, rows))).all(axis=1)
            places = at[inside, 1] * columns + at[inside, 0]
            votes += np.bincount(places, minlength=rows * columns)
    heights = np.asarray(cv2.GaussianBlur(votes.reshape(rows, columns), (0, 0), 1.5))
    best: tuple[float, Array] | None = None
    for _ in range(24):
        row, column = np.unravel_index(int(heights.argmax()), heights.shape)
        circle, arc = _best_radius(edges, towards, (float(column), float(row)), radii)
        if best is None or arc > best[0]:
            best = (arc, circle)
        heights[max(0, row - 4) : row + 5, max(0, column - 4) : column + 5] = -1.0
    assert best is not None
    x0, y0, radius = best[1]
    return np.array([(x0 + 0.5) / scale - 0.5, (y0 + 0.5) / scale - 0.5, radius / scale])


def _ridge(steep: NDArray[Any], slope_x: NDArray[Any], slope_y: NDArray[Any]) -> NDArray[Any]:
    """Where the gradient is at least as steep as on either side of it, along it."""
    along_x = np.abs(slope_x) >= np.abs(slope_y)
    padded = np.pad(steep, 1)
    left, right = padded[1:-1, :-2], padded[1:-1, 2:]
    above, below = padded[:-2, 1:-1], padded[2:, 1:-1]
    return np.asarray(
        np.where(
            along_x,
            (steep >= left) & (steep >= right),
            (steep >= above) & (steep >= below),
        )
    )


def _best_radius(
    edges: Array, towards: Array, middle: tuple[float, float], radii: Array
) -> tuple[Array, float]:
    """The radius with the longest arc about a middle, and the length of that arc in pixels."""
    away = edges - middle
    far = np.hypot(away[:, 0], away[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        facing = np.abs((away * towards).sum(axis=1)) >= FACING * far
    chosen = facing & (far >= radii[0]) & (far <= radii[-1])
    sectors = 120
    sector = np.arctan2(away[chosen, 1], away[chosen, 0])
    sector = np.floor((sector / (2 * np.pi) + 0.5) * sectors).astype(np.int64) % sectors
    ring = np.rint(far[chosen] - radii[0]).astype(np.int64)
    seen = np.zeros((len(radii) + 2, sectors), dtype=bool)
    for shift in (0, 1, 2):  # a pixel on either side belongs to the same edge
        seen[np.minimum(ring + shift, len(radii) + 1), sector] = True
    arcs = seen[1:-1].mean(axis=1) * 2.0 * np.pi * radii
    best = int(arcs.argmax())
    return np.array([*middle, radii[best]]), float(arcs[best])


def _circle_about(outline: Outline, camera: BallCamera) -> Array:
    """A circle near an outline, from which edges can be looked for."""
    if not camera.perspective:
        return outline.numbers
    points = camera.outline_points(outline.numbers)
    middle = points.mean(axis=0)
    radius = np.hypot(*(points - middle).T).mean()
    return np.array([*middle, radius])


def _refined(picture: Array, start: Array, camera: BallCamera, seed: int) -> Outline | None:
    """The outline that the edges about a circle agree on."""
    edges, known = _edges(picture, start)
    if known.any(axis=0).sum() < 8:
        return None
    tolerance = max(1.5, 0.006 * start[2])
    model = _ransac(edges, known, camera, tolerance, np.random.default_rng(seed))
    if model is None:
        return None
    for _ in range(20):
        nearest, off = _nearest(edges, known, camera, model)
        near = np.abs(off) < 2.0 * tolerance
        if near.sum() < 8:
            return None
        scale = max(1.4826 * float(np.median(np.abs(off[near]))), 1e-3)
        weight = np.where(
            near,
            np.square(np.maximum(1 - np.square(np.where(near, off, 0) / (TUKEY * scale)), 0)),
            0,
        )
        slopes = outline_slopes(camera, model, nearest)
        step = _solved(slopes, np.where(near, -off, 0.0), weight)
        model = model + step
        if np.abs(step).max() < 1e-4 * scale:
            break
    nearest, off = _nearest(edges, known, camera, model)
    good = np.abs(off) < TUKEY * scale
    slopes = outline_slopes(camera, model, nearest[good])
    variance = float(np.square(off[good]).sum()) / max(int(good.sum()) - 3, 1)
    inflation = autocorrelation_time(off[good])
    covariance = np.asarray(
        variance * inflation * np.linalg.inv(slopes.T @ slopes), dtype=np.float64
    )
    x, y, radius = model.tolist()
    steepest = np.abs(camera.off_outline(model, edges[0]))
    support = float(((steepest < tolerance) & known[0]).mean())
    return Outline(x, y, radius, covariance, support, nearest[good])


def _edges(picture: Array, start: Array) -> tuple[Array, NDArray[np.bool_]]:
    """``(3, n, 2)`` the three steepest places along each of n radii, and which of them exist."""
    import cv2

    x, y, radius = start
    count = int(np.clip(2.0 * np.pi * radius / 2.0, 90, ANGLES))
    turn = np.arange(count) * (2.0 * np.pi / count)
    reach = max(4.0, SEARCH * radius)
    step = 0.5
    away = np.arange(-reach, reach + step, step) + radius
    column = (x + away[None] * np.cos(turn)[:, None]).astype(np.float32)
    row = (y - away[None] * np.sin(turn)[:, None]).astype(np.float32)
    # Brightness itself: its root would be steepest inside of a blurred edge.
    values = picture.astype(np.float32)
    profile = np.asarray(
        cv2.remap(values, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
                  borderValue=float("nan")),
        dtype=np.float64,
    )  # fmt: skip
    unknown = ~np.isfinite(profile)
    smooth = max(1.0, 0.004 * radius) / step
    profile = np.asarray(
        cv2.GaussianBlur(np.where(unknown, 0.0, profile), (0, 0), smooth, sigmaY=1)
    )
    slope = np.abs(np.gradient(profile, axis=1))
    grown = np.asarray(cv2.dilate(unknown.astype(np.uint8), np.ones((1, int(4 * smooth) | 1))))
    slope[grown.astype(bool)] = 0.0
    inner = slope[:, 1:-1]
    peak = (inner > slope[:, :-2]) & (inner >= slope[:, 2:])
    height = np.where(peak, inner, 0.0)
    order = np.argsort(-height, axis=1)[:, :3].T
    lines = np.arange(count)[None]
    top = height[lines, order]
    known = top > 0.15 * top[0]
    known &= top > 0.0
    before, after = slope[lines, order], slope[lines, order + 2]
    bend = before - 2.0 * top + after
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where(bend < 0.0, 0.5 * (before - after) / bend, 0.0)
    far = radius - reach + step * (order + 1 + np.clip(shift, -0.5, 0.5))
    places = np.stack([x + far * np.cos(turn), y - far * np.sin(turn)], axis=-1)
    return places, known


def _nearest(
    edges: Array, known: NDArray[np.bool_], camera: BallCamera, model: Array
) -> tuple[Array, Array]:
    """Of each radius the edge nearest to an outline, and how far off it lies."""
    off = np.where(known, camera.off_outline(model, edges), np.inf)
    best = np.abs(off).argmin(axis=0)
    lines = np.arange(edges.shape[1])
    return edges[best, lines], off[best, lines]


def _ransac(
    edges: Array,
    known: NDArray[np.bool_],
    camera: BallCamera,
    tolerance: float,
    random: np.random.Generator,
) -> Array | None:
    """The outline through three edges that most radii agree with."""
    places = edges[known]
    best, most = None, 0
    for _ in range(TRIALS):
        model = outline_through(camera, places[random.choice(len(places), 3, replace=False)])
        if model is None:
            continue
        off = np.where(known, np.abs(camera.off_outline(model, edges)), np.inf).min(axis=0)
        count = int((off < tolerance / 2).sum())
        if count > most:
            best, most = model, count
    return best


def outline_through(camera: BallCamera, pixels: Array) -> Array | None:
    """``(3,)`` the outline through three pixels or, by least squares, through more of them.

    A circle: x^2 + y^2 + a x + b y + c = 0. A cone: d.w = 1 for the rays d = (x, y, -1) with the
    axis w / |w| and cos(alpha) = 1 / |w| after the rays are given length 1. None if there is none.
    """
    try:
        if camera.focal_px is None:
            middle = pixels.mean(axis=0)
            local = pixels - middle
            table = np.concatenate([local, np.ones((len(local), 1))], axis=1)
            a, b, c = np.linalg.lstsq(table, -np.square(local).sum(axis=1), rcond=None)[0]
            square = (a * a + b * b) / 4.0 - c
            if not (np.isfinite(square) and square > 0.0):
                return None
            return np.array([middle[0] - a / 2.0, middle[1] - b / 2.0, np.sqrt(square)])
        rays = camera.rays(pixels)
        w = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    except np.linalg.LinAlgError:
        return None
    length = float(np.linalg.norm(w))
    if not (np.isfinite(length) and length > 1.0 and w[2] < 0.0):
        return None
    half = np.sqrt(length * length - 1.0)  # tan(alpha)
    x, y = camera.pixels(np.asarray(w, dtype=np.float64))
    return np.array([x, y, camera.focal_px * half])


def outline_slopes(camera: BallCamera, outline: Array, pixels: Array) -> Array:
    """``(n, 3)`` derivatives of the distances of pixels from an outline by its three numbers."""
    step = 1e-4 * outline[2]
    columns = []
    for number in range(3):
        change = np.zeros(3)
        change[number] = step
        more = camera.off_outline(outline + change, pixels)
        less = camera.off_outline(outline - change, pixels)
        columns.append((more - less) / (2.0 * step))
    return np.stack(columns, axis=1)


def autocorrelation_time(residual: Array) -> float:
    """Integrated autocorrelation time of a closed series, by the initial positive sequence."""
    centred = residual - residual.mean()
    spectrum = np.square(np.abs(np.fft.rfft(centred)))
    lags = np.fft.irfft(spectrum, n=len(centred))
    if not lags[0] > 0.0:
        return 1.0
    lags = lags / lags[0]
    half = lags[1 : len(lags) // 2]
    stop = int(np.argmax(half <= 0.0)) if bool((half <= 0.0).any()) else len(half)
    return float(1.0 + 2.0 * half[:stop].sum())


def _solved(slopes: Array, values: Array, weight: Array) -> Array:
    normal = slopes.T @ (weight[:, None] * slopes)
    return np.asarray(np.linalg.solve(normal, slopes.T @ (weight * values)))

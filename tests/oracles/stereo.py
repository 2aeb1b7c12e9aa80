"""Photometric stereo, one pixel at a time, in plain float64 numpy written from the papers.

RGB-camera paper: I_i = alpha N . l_i (eq. 2), N = I' L+ / alpha (section 3.3), rule of w1 and w2
(section 3.2). Rank trimming and reweighting by their definitions:

    rank     keep int(low n) <= rank < round(high n), ties by the order of the lights
    l1       w = 1 / max(|R|, 1e-3 s), which only guards the division: s is 1.2533 mean |R| of the
             step before (of the start, in the first)
    huber    w = min(1, 1.345 s / |R|)
    cauchy   w = 1 / (1 + (R / 2.385 s)^2)
    tukey    w = (1 - (R / 4.685 s)^2)^2 inside, 0 outside
    s        1.4826 median |R|
    trimmed  rank, then l1
    robust   MM-estimation from four starts, empirical-Bayes scale, Hausman test (see `by_evidence`)

This file is to be right, not fast.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

ENOUGH = 4


@dataclass
class Pixel:
    """What one pixel's samples say; NaN where they do not."""

    status: str
    kept: np.ndarray
    b: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    weights: np.ndarray | None = None
    residual: float = np.nan
    condition: float = np.nan
    axis: np.ndarray | None = None
    covariance: np.ndarray | None = None
    margin: float = np.inf
    share: float = 0.0
    scale: float = np.nan

    @property
    def albedo(self) -> float:
        return float(np.linalg.norm(self.b))

    @property
    def normal(self) -> np.ndarray:
        return self.b / np.linalg.norm(self.b)


def ranks(values: np.ndarray) -> np.ndarray:
    """Rank of each value, ties by position."""
    rank = np.empty(len(values), int)
    rank[np.argsort(values, kind="stable")] = np.arange(len(values))
    return rank


def widened(keep: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """At least four kept, or all: the ranks nearest to the middle come back first."""
    keep = keep.copy()
    middle = (len(rank) - 1) / 2
    for index in sorted(range(len(rank)), key=lambda i: (abs(rank[i] - middle), rank[i])):
        if keep.sum() >= min(ENOUGH, len(rank)):
            break
        keep[index] = True
    return keep


def by_threshold(values: np.ndarray, w1: float, w2: float) -> tuple[np.ndarray, float]:
    mean = values.mean()
    keep = (values <= w1 * mean) & (values >= w2 * mean)
    margin = min(np.abs(values - w1 * mean).min(), np.abs(values - w2 * mean).min()) / mean
    return keep, margin


def by_rank(values: np.ndarray, low: float, high: float) -> tuple[np.ndarray, float]:
    n, rank = len(values), ranks(values)
    first, end = int(low * n), round(high * n)
    keep = (first <= rank) & (rank < end)
    gaps = np.diff(np.sort(values))
    edges = [gaps[i - 1] for i in (first, end) if 0 < i < n]
    return keep, min(edges, default=np.inf) / np.abs(values).mean()


def loss_weights(loss: str, residual: np.ndarray, before: np.ndarray, signal: float) -> np.ndarray:
    size = np.abs(residual)
    if loss == "l1":
        floor = 1e-3 * 1.2533141373155003 * np.abs(before).mean() + 2.0**-22 * signal
        return floor / np.maximum(size, floor)
    s = 1.482602218505602 * np.median(size) + 2.0**-22 * signal
    if loss == "huber":
        return np.minimum(1.0, 1.345 * s / np.maximum(size, 1e-300))
    if loss == "cauchy":
        return 1.0 / (1.0 + (size / (2.385 * s)) ** 2)
    inside = np.maximum(0.0, 1.0 - (size / (4.685 * s)) ** 2)
    return inside**2


def weighted(lights: np.ndarray, signal: np.ndarray, weights: np.ndarray) -> np.ndarray:
    root = np.sqrt(weights)
    return np.linalg.lstsq(lights * root[:, None], signal * root, rcond=None)[0]


EVIDENCE = 6.25
WINDOWS = ((0.2, 0.8), (0.0, 0.65), (0.35, 1.0))


def m_scale(residual: np.ndarray, signal: float) -> float:
    """One step towards the scale of mean loss 1/2, from the (n + 4) / 2-th smallest residual."""
    size = np.sort(np.abs(residual))
    n = len(size)
    start = 1.482602218505602 * size[(n + 4) // 2 - 1] + 2.0**-22 * signal
    loss = 1.0 - np.maximum(0.0, 1.0 - (size / (1.547 * start)) ** 2) ** 3
    return float(start * np.sqrt(loss.sum() / (0.5 * (n - 3))))


def biweight(
    l: np.ndarray,  # noqa: E741
    signal: np.ndarray,
    b: np.ndarray,
    s: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Steps of Tukey's biweight with c = 2 at a fixed scale."""
    weights = np.ones(len(l))
    for _ in range(steps):
        weights = np.maximum(0.0, 1.0 - ((signal - l @ b) / (2.0 * s)) ** 2) ** 2
        b = weighted(l, signal, weights)
    return b, weights


@dataclass
class Evidence:
    """The robust estimate before and after shrinkage."""

    b: np.ndarray
    weights: np.ndarray
    share: float
    scale: float
    bound: float
    margin: float


def by_evidence(
    l: np.ndarray,  # noqa: E741
    signal: np.ndarray,
    relative: np.ndarray,
    typical: float,
    steps: int,
) -> Evidence:
    """MM-estimation, and least squares where d'Ad / s^2 is below 6.25.

    ``typical`` is the painting's median of s / |b_LS|.
    """
    n, rank = len(l), ranks(relative)
    least = weighted(l, signal, np.ones(n))
    length = float(np.linalg.norm(least))
    starts, edges = [np.ones(n, bool)], []
    for low, high in WINDOWS:
        keep, margin = by_rank(relative, low, high)
        starts.append(widened(keep, rank))
        edges.append(margin)

    def noise(own: float) -> float:
        pooled = ((n - 3) * own**2 + 20 * typical**2) / (n + 17)
        return float(np.sqrt(max(own**2, pooled)))

    found = []
    for keep in starts:
        b = weighted(l[keep], signal[keep], np.ones(keep.sum()))
        before = signal[keep] - l[keep] @ b
        for _ in range(3):
            residual = signal[keep] - l[keep] @ b
            weights = loss_weights("l1", residual, before, float(np.linalg.norm(b)))
            before = residual
            b = weighted(l[keep], signal[keep], weights)
        found.append((m_scale(signal - l @ b, float(np.linalg.norm(b))), b))
    scale, b = min(found, key=lambda one: one[0])
    # Ranges of few samples are the same range: no choice is close between them.
    others = [s / scale - 1 for s, c in found if np.abs(c - b).max() > 1e-6 * length]
    s = float(np.hypot(scale, 0.01 * length))
    b, weights = biweight(l, signal, b, s, steps)
    d = b - least
    q = d @ (l.T * weights @ l) @ d / noise(s / length) ** 2 / length**2
    share = max(0.0, 1.0 - (EVIDENCE / q) ** 2) if q > EVIDENCE and n >= 5 and steps > 0 else 0.0
    share = 1.0 if share > 0 and q >= 100 * EVIDENCE else share
    margin = min(*edges, *others, abs(q / EVIDENCE - 1))
    inside = np.abs(signal - l @ b) / (2.0 * s)
    margin = min(margin, np.abs(inside - 1).min())
    if share > 0 and (inside < 1).sum() < ENOUGH:
        share = 0.0
    # One step from least squares settles pixels whose residuals are no larger than is typical.
    own = float(((signal - l @ least) ** 2).sum() / (n - 3)) / length**2
    if own <= 2.25 * typical**2:
        spread = noise(np.sqrt(own + 1e-4)) * length
        step, one = biweight(l, signal, least, spread, 1)
        q = (step - least) @ (l.T * one @ l) @ (step - least) / spread**2
        margin = min(margin, abs(q - 1), abs(own / (2.25 * typical**2) - 1))
        share = 0.0 if q <= 1.0 else share
    return Evidence(least + share * d, weights, share, s / length, 2.0 * s, margin)


def fit_pixel(
    samples: np.ndarray,
    lights: np.ndarray,
    method: str,
    *,
    low: float = 0.2,
    high: float = 0.8,
    w1: float = 1.2,
    w2: float = 0.1,
    steps: int | None = None,
    selection: int | None = None,
    typical: float = 0.0,
) -> Pixel:
    """One pixel.

    ``samples`` (obs, band), inf = clipped, NaN = missing; ``lights`` (obs, 3), directions times
    irradiance.
    """
    finite = np.isfinite(samples).all(axis=1)
    clipped = ~np.isnan(samples).any(axis=1) & ~finite
    kept = np.zeros(len(lights), bool)
    if finite.sum() < 3:
        if finite.sum() + clipped.sum() == 0:
            return Pixel("INVALID_INPUT", kept)
        few = not clipped.any() or finite.sum() + clipped.sum() < 3
        return Pixel("TOO_FEW_SAMPLES" if few else "SATURATED", kept)
    mean = samples[finite].mean(axis=1)
    signal = mean if selection is None else samples[finite, selection]
    l = lights[finite]  # noqa: E741
    relative = mean / np.linalg.norm(l, axis=1)
    keep, margin = np.ones(len(l), bool), np.inf
    if method == "threshold":
        keep, margin = by_threshold(relative, w1, w2)
    elif method in {"rank", "trimmed"}:
        keep, margin = by_rank(relative, low, high)
    before = keep.sum()
    keep = widened(keep, ranks(relative))
    relaxed = keep.sum() > before
    kept[np.flatnonzero(finite)[keep]] = True
    l, signal = l[keep], signal[keep]  # noqa: E741
    condition = np.linalg.cond(l)
    if signal.max() <= 0 or mean.sum() <= 0:
        return Pixel("DARK", kept)
    if condition > 256:
        return Pixel("RANK_DEFICIENT", kept)
    weights = np.ones(len(l))
    b = weighted(l, signal, weights)
    loss = {"trimmed": "l1"}.get(method, method)
    if loss in {"l1", "huber", "cauchy", "tukey"}:
        usual = {"trimmed": 5, "l1": 30}.get(method, 20)
        before = signal - l @ b
        for _ in range(usual if steps is None else steps):
            residual = signal - l @ b
            candidate = loss_weights(loss, residual, before, np.linalg.norm(b))
            before = residual
            if (candidate > 0).sum() < min(ENOUGH, len(l)):
                relaxed = True
                break
            weights = candidate
            b = weighted(l, signal, weights)
    evidence = None
    if method == "robust" and len(l) >= 5:
        evidence = by_evidence(l, signal, relative, typical, 5 if steps is None else steps)
        b, margin = evidence.b, evidence.margin
    if evidence is not None and evidence.share > 0:
        cosine = l @ b / np.linalg.norm(b)
        all_, robust = cosine @ cosine, evidence.weights * cosine @ cosine
        weights = evidence.share * evidence.weights / robust + (1 - evidence.share) / all_
        least = weighted(l, signal, np.ones(len(l)))
        d = (b - least) / evidence.share
        inside = np.abs(signal - l @ (least + d)) < evidence.bound
        kept[:] = False
        kept[np.flatnonzero(finite)[inside]] = True
        full = np.zeros(len(lights))
        full[finite] = weights
        residual = (signal - l @ b)[inside]
        condition = np.linalg.cond(l[inside])
        status = "ILL_CONDITIONED" if condition > 30 else "FITTED"
        size = float(np.sqrt((residual**2).mean()))
        return Pixel(
            status, kept, b, full, size, condition, margin=margin,
            share=evidence.share, scale=evidence.scale,
        )  # fmt: skip
    residual = signal - l @ b
    status = "RELAXED" if relaxed else "FITTED"
    status = "ILL_CONDITIONED" if condition > 30 else status
    status = "EXACT" if len(l) == 3 else status
    full = np.zeros(len(lights))
    full[kept] = weights
    scale = np.nan if evidence is None else evidence.scale
    pixel = Pixel(status, kept, b, full, condition=condition, margin=margin, scale=scale)
    if len(l) > 3:
        pixel.residual = np.sqrt((residual**2).mean())
        n = pixel.normal
        tangent = np.eye(3) - np.outer(n, n)
        s2 = (residual**2).sum() / (len(l) - 3)
        covariance = tangent @ np.linalg.inv(l.T @ l) @ tangent * s2 / pixel.albedo**2
        pixel.covariance = covariance
        pixel.axis = np.linalg.eigh(covariance)[1][:, 2]
    return pixel


def band_albedo(samples: np.ndarray, lights: np.ndarray, pixel: Pixel) -> np.ndarray:
    """Every band's albedo by weighted least squares along the normal."""
    cosine = lights @ pixel.normal
    used = pixel.weights > 0
    weight = pixel.weights[used]
    cosine = cosine[used]
    return (weight * cosine) @ samples[used] / ((weight * cosine) @ cosine)

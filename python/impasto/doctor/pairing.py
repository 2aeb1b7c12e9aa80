"""Exchanged photographs: photographs under neighbouring lights are similar.

No model of the paint is needed. What all photographs have in common is removed, and the remainders
are compared. For any gloss, photographs under neighbouring lights are more similar than others. So
two photographs whose names were exchanged stand out: each is similar to the neighbours of the
other's light.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import counted
from impasto.doctor.diagnosis import Finding
from impasto.doctor.lights import angles_between
from impasto.doctor.order import held_out_errors
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import fit_surface, shading
from impasto.stack import Stack

Floats = NDArray[np.float64]

_FEWEST = 7
_ORDERED = 0.3
"""Least correlation of similarity with proximity for a check."""
_WIDEST_DEG, _NARROWEST_DEG = 40.0, 10.0
_FAR = 1.6
"""In units of the distance between neighbouring lights: closer exchanges do little harm."""
_REVERSED = -0.5
_SLOPE = -0.35
_MOST = 8
_SIGMAS = 5.0
_BETTER, _FAR_BETTER = 1.2, 1.3
"""Errors of both photographs, as given, in units of those after the exchange: of pairs that
stand out by similarity, and of others."""
_UNLIKE = -0.3
"""Largest correlation of the others' differences: 0.05 and more without an exchange, of gilding,
and -0.58 and less with one."""
_PREDICTED = 3_000_000
"""Predicted samples, of which every photograph is compared with those under all lights."""


def pairing(stack: Stack, sampled: SampledTiles, similarity: Floats | None) -> list[Finding]:
    """Photographs whose lights were exchanged.

    Parameters
    ----------
    stack, sampled
        What is examined.
    similarity
        As from :func:`measure_similarity`.
    """
    directions = stack.rig.directions
    if similarity is None or len(directions) < _FEWEST:
        return []
    swaps = find_exchanges(sampled, similarity, directions)
    agreement = order_agreement(similarity, _swapped(directions, swaps))
    numbers: dict[str, Any] = {"agreement": round(agreement, 3)}
    if agreement < _ORDERED:
        return [
            Finding(
                "pairing",
                "ok",
                "cannot check whether photographs and lights belong together: photographs under "
                "neighbouring lights are not more similar than others",
                numbers=numbers,
            )
        ]
    if not swaps:
        return [
            Finding(
                "pairing",
                "ok",
                "every photograph is similar to those under neighbouring lights",
                numbers=numbers,
            )
        ]
    between = angles_between(directions, directions)
    text = "; ".join(
        f"{stack.names[a]} and {stack.names[b]} (lights {between[a, b]:.0f} degrees apart)"
        for a, b in swaps
    )
    concerned = tuple(sorted(i for pair in swaps for i in pair))
    return [
        Finding(
            "pairing",
            "error" if len(concerned) > 0.1 * len(directions) else "warning",
            f"{counted(len(swaps), 'pair')} of photographs exchanged: {text}",
            "exchange the two directions in the light file (impasto doctor --write FILE.lp does "
            "so), or the two file names",
            concerned,
            numbers | {"pairs": [list(pair) for pair in swaps]},
        )
    ]


def cross_predicted(sampled: SampledTiles) -> list[tuple[int, int]]:
    """Pairs of which each photograph is predicted better under the light of the other.

    Similarity cannot show an exchange with a light that has no neighbours, such as the single one
    above a ring.
    """
    count = len(sampled.grey)
    wanted = int(np.clip(_PREDICTED // count**2, 100, 600))
    pick = np.arange(0, sampled.grey.shape[1], max(1, sampled.grey.shape[1] // wanted))
    grey = sampled.grey[:, pick]
    lights = sampled.lights if sampled.lights.ndim == 2 else sampled.lights[:, pick]
    shown = np.maximum(shading(fit_surface(grey, lights), lights), 0.0)
    error = np.full((count, count), np.inf)
    for index, row in enumerate(grey):
        known = np.isfinite(row) & np.isfinite(shown).all(axis=0)
        if known.sum() >= 30:
            error[index] = np.median(np.abs(shown[:, known] - row[known]), axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = np.diag(error)[:, None] / error
        gain = np.triu(np.nan_to_num(np.minimum(gain, gain.T), posinf=0.0), 1)
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    for place in np.argsort(-gain, axis=None, kind="stable")[:count]:
        a, b = divmod(int(place), count)
        if gain[a, b] < _BETTER or len(pairs) == _MOST:
            break
        if not taken & {a, b}:
            pairs.append((a, b))
            taken |= {a, b}
    return pairs


def find_exchanges(
    sampled: SampledTiles, similarity: Floats, directions: Floats
) -> list[tuple[int, int]]:
    """Exchanges of which a surface fitted to all other photographs predicts both better."""
    swaps = [
        pair for pair in find_swaps(similarity, directions) if _explains(sampled, pair, _BETTER)
    ]
    if swaps:
        return swaps
    correlation = _slopes(similarity, directions)[1]
    return [
        pair
        for pair in cross_predicted(sampled)
        if correlation[pair] < _UNLIKE and _explains(sampled, pair, _FAR_BETTER)
    ]


def exchanged(
    sampled: SampledTiles, similarity: Floats | None, directions: Floats
) -> SampledTiles | None:
    """The tiles with the lights of exchanged photographs exchanged back; None if there are none.

    One exchange can make another order of all lights look better than the given one.
    """
    if similarity is None or len(directions) < _FEWEST:
        return None
    pairs = find_exchanges(sampled, similarity, directions)
    to = np.arange(len(sampled.grey))
    for pair in pairs:
        to[list(pair)] = to[list(pair)][::-1]
    return replace(sampled, lights=sampled.lights[to]) if pairs else None


def _explains(sampled: SampledTiles, pair: tuple[int, int], times: float) -> bool:
    """Whether a surface fitted to all others predicts both better with their lights exchanged."""
    to = np.arange(len(sampled.grey))
    both = np.array(pair)
    given = held_out_errors(sampled, to, both)
    to[both] = to[both[::-1]]
    return bool((given > times * held_out_errors(sampled, to, both)).all())


def measure_similarity(sampled: SampledTiles) -> Floats | None:
    """``(obs, obs)`` correlation of the photographs without what all have in common."""
    known = np.isfinite(sampled.grey).sum(axis=0) >= 0.7 * len(sampled.grey)
    known &= sampled.inside
    if known.sum() < 100:
        return None
    rows = sampled.grey[:, known].astype(np.float64)
    # A clipped sample counts as bright as the brightest unclipped one.
    rows = np.where(np.isfinite(rows), rows, np.nanmax(rows, axis=0))
    middle = np.median(rows, axis=0)
    scale = np.maximum(middle, 1e-3 * float(np.median(middle)))
    with np.errstate(divide="ignore", invalid="ignore"):
        rows = np.log(np.clip(rows / scale, 0.05, 8.0))
    if not np.isfinite(rows).all():
        return None
    rows -= rows.mean(axis=0)
    rows -= rows.mean(axis=1, keepdims=True)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    if not (length > 0).all():
        return None
    rows /= length
    similarity = rows @ rows.T
    off = similarity[~np.eye(len(rows), dtype=bool)]
    # Photographs of noise are correlated by chance, to 1 / sqrt(pixels).
    return np.asarray(similarity) if off.std() > _SIGMAS / np.sqrt(rows.shape[1]) else None


def find_swaps(similarity: Floats, directions: Floats) -> list[tuple[int, int]]:
    """Exchanges that put every photograph next to similar ones, most significant first.

    For photographs a and b the differences in similarity to every third photograph, S_am - S_bm,
    increase with the differences in proximity, K_am - K_bm. If a and b are exchanged, they
    decrease.
    """
    swaps: list[tuple[int, int]] = []
    current = directions.copy()
    taken: set[int] = set()
    while len(swaps) < _MOST:
        slope, correlation, far = _slopes(similarity, current)
        if not far.any():
            break
        usual = float(np.median(slope[far]))
        if usual <= 0:
            break
        suspect = far & (correlation < _REVERSED) & (slope < _SLOPE * usual)
        for index in taken:
            suspect[index] = suspect[:, index] = False
        if not suspect.any():
            break
        score = np.where(suspect, slope, np.inf)
        a, b = (int(i) for i in np.unravel_index(int(score.argmin()), score.shape))
        swaps.append((min(a, b), max(a, b)))
        taken |= {a, b}
        current[[a, b]] = current[[b, a]]
    return swaps


def order_agreement(similarity: Floats, directions: Floats) -> float:
    """Correlation of similarity and proximity over all pairs."""
    proximity = _proximity(directions)[0]
    upper = np.triu_indices(len(directions), 1)
    return float(np.corrcoef(similarity[upper], proximity[upper])[0, 1])


def _proximity(directions: Floats) -> tuple[Floats, Floats, float]:
    between = angles_between(directions, directions)
    neighbour = float(np.median(np.sort(between, axis=1)[:, 1]))
    width = float(np.clip(neighbour, _NARROWEST_DEG, _WIDEST_DEG))
    return np.exp(-0.5 * (between / width) ** 2), between, neighbour


def _slopes(similarity: Floats, directions: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Slope and correlation ``(obs, obs)`` of similarity on proximity for each exchange."""
    proximity, between, neighbour = _proximity(directions)
    product = _differences(similarity, proximity)
    # Sums of numbers near 1: anything smaller is rounding error.
    size_like, size_near = (
        np.maximum(_differences(each, each), 1e-12) for each in (similarity, proximity)
    )
    slope = product / size_near
    correlation = product / np.sqrt(size_like * size_near)
    far = (between > _FAR * neighbour) & ~np.eye(len(directions), dtype=bool)
    return slope, correlation, far


def _differences(one: Floats, other: Floats) -> Floats:
    """For all a and b the sum of (S_am - S_bm) (K_am - K_bm) over all m except a and b.

    Computed by products of the symmetric matrices, for all triples of hundreds of lights.
    """
    product = one @ other
    own = np.diag(product)
    total = own[:, None] + own[None, :] - product - product.T
    at_a = (np.diag(one)[:, None] - one) * (np.diag(other)[:, None] - other)
    return np.asarray(total - at_a - at_a.T)


def _swapped(directions: Floats, swaps: list[tuple[int, int]]) -> Floats:
    result = directions.copy()
    for a, b in swaps:
        result[[a, b]] = result[[b, a]]
    return result

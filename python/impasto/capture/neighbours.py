"""Each photograph against its prediction from those under neighbouring lamps.

Locally weighted regression [@cleveland1988locally] of the samples on the direction of the lamp: a
quadratic in two tangent coordinates through the nearest photographs, without the photograph itself.
It holds for any gloss, since light changes smoothly with the lamp. The direction from which the
light really came, and its strength, follow by least squares with the slopes of the same quadratic.
All sums are products of the small matrix of inner products of the photographs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.capture.misfires import Misfire

Floats = NDArray[np.float64]

NEAREST = 16
"""Photographs of a quadratic, which has six coefficients."""
FEWEST = 30
"""Photographs from which some can be told from the others: with fewer, lamps stand 20 degrees and
more apart, and highlights lie elsewhere in each photograph."""
FEWEST_ALIKE = 12
"""Of which the median absolute deviation is a scale: it is off by a quarter then."""
EDGE = 2.5
"""Sum of the absolute weights of a prediction: 1 to 2 among neighbours on all sides."""
SIGMAS = 8.0
"""Robust deviations beyond which a photograph stands out: errors of prediction have longer tails
than a normal distribution, and a misfire is far outside."""
HALF = 0.5
"""Of the angle to the nearest other lamp: beyond it the light came from there rather."""
LEAST_STRENGTH = 0.02
"""Relative change of the light that is searched for: lamps that are warm vary by 0.3 %."""
LEAST_RESIDUAL = 0.03
"""Of the light: what noise and a faint stray light leave behind is no fault."""
LEAST_SECOND = 0.3
"""Strength from which a second lamp counts as on, relative to its own photograph."""
BETTER = 0.5
"""Part of the residual that an explanation must leave at most."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """What neighbours say of each photograph.

    Attributes
    ----------
    offset
        ``(n,)`` radians between the lamp of the plan and the direction of the light.
    spacing
        ``(n,)`` radians from the lamp to the nearest other one.
    strength
        ``(n,)``: light over its prediction.
    residual
        ``(n,)``: root mean square of what the prediction leaves, relative to the light.
    known
        ``(n,)``: whether there are enough neighbours around the lamp.
    weights
        ``(3, n, n)``: value and two slopes of each prediction, as sums over photographs.
    products
        ``(n, n)``: inner products of the photographs, each pixel by its median.
    """

    offset: Floats
    spacing: Floats
    strength: Floats
    residual: Floats
    known: NDArray[np.bool_]
    weights: Floats
    products: Floats


def predictions(
    thumbnails: Floats, directions: Floats, usable: NDArray[np.bool_] | None = None
) -> Predictions:
    """Predict each photograph from its neighbours.

    Parameters
    ----------
    thumbnails
        ``(n, cells)``: linear light above the dark frames.
    directions
        ``(n, 3)``: unit vectors to the lamps.
    usable
        ``(n,)``: those that may be neighbours; default: all.
    """
    count = len(thumbnails)
    usable = np.ones(count, bool) if usable is None else usable
    usual = np.median(thumbnails[usable], axis=0)
    usual = np.maximum(usual, max(0.1 * float(np.median(usual)), 1e-9))
    relative = thumbnails / usual / np.sqrt(thumbnails.shape[1])
    products = relative @ relative.T
    weights = np.zeros((3, count, count))
    spacing, known = np.full(count, np.pi), np.zeros(count, bool)
    cosine = directions @ directions.T
    np.fill_diagonal(cosine, -2.0)
    for own in range(count):
        near = cosine[own].copy()
        spacing[own] = np.arccos(np.clip(near.max(), -1.0, 1.0))
        near[~usable] = -2.0
        near[own] = -2.0
        chosen = np.argsort(-near, kind="stable")[:NEAREST]
        chosen = chosen[near[chosen] > -2.0]
        if len(chosen) == NEAREST:
            fitted = _local_quadratic(directions[own], directions[chosen])
            if fitted is not None:
                weights[:, own, chosen], known[own] = fitted, True
    offset, strength = np.zeros(count), np.ones(count)
    residual = np.zeros(count)
    for own in np.flatnonzero(known).tolist():
        part = weights[:, own]
        normal, right = part @ products @ part.T, part @ products[own]
        x = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
        size = max(float(products[own, own]), 1e-12)
        offset[own] = np.hypot(x[1], x[2]) / max(abs(float(x[0])), 1e-6)
        strength[own] = right[0] / max(float(normal[0, 0]), 1e-12)
        left = products[own, own] - right[0] * strength[own]
        residual[own] = np.sqrt(max(float(left), 0.0) / size)
    return Predictions(offset, spacing, strength, residual, known, weights, products)


def _local_quadratic(own: Floats, near: Floats) -> Floats | None:
    """``(3, n)`` weights of value and slopes at a direction; None where it lies outside."""
    axis = np.eye(3)[int(np.argmin(np.abs(own)))]
    u = axis - (axis @ own) * own
    u /= np.linalg.norm(u)
    across, down = near @ u, near @ np.cross(own, u)
    far = np.hypot(across, down)
    columns = [np.ones(len(near)), across, down, across**2, across * down, down**2]
    scale = float(far.max())
    if scale <= 1e-9:
        return None
    weight = np.sqrt(np.maximum(1.0 - (far / (1.01 * scale)) ** 2, 0.05))
    inverse = np.linalg.pinv(np.stack(columns, axis=1) * weight[:, None], rcond=1e-6) * weight
    found = inverse[:3]
    # Far outside of its neighbours a quadratic says nothing: single errors would be multiplied.
    return None if np.abs(found[0]).sum() > 4.0 else found


@dataclass(frozen=True, eq=False)
class Outliers:
    """Photographs that neighbours do not predict.

    Attributes
    ----------
    misfires
        What is wrong, by the place of the photograph.
    suspects
        ``(n,)``: those that stand out.
    predictions
        Of all photographs from those that do not; None: fewer than thirty.
    """

    misfires: dict[int, Misfire]
    suspects: NDArray[np.bool_]
    predictions: Predictions | None


def find_outliers(
    thumbnails: Floats, directions: Floats, names: list[str], lamps: list[int]
) -> Outliers:
    """Photographs with wrong lamps, two lamps, another strength, or something else in them.

    By backward elimination: of neighbouring photographs that stand out the farthest is taken out,
    and its neighbours are predicted again without it.

    Parameters
    ----------
    thumbnails, directions
        As :func:`predictions` takes them.
    names, lamps
        Of the photographs; lamps by their numbers.
    """
    count = len(thumbnails)
    suspects = np.zeros(count, bool)
    if count < FEWEST:
        return Outliers({}, suspects, None)
    found = predictions(thumbnails, directions)
    cosine = directions @ directions.T
    np.fill_diagonal(cosine, -2.0)
    near = np.argsort(-cosine, axis=1, kind="stable")[:, :NEAREST]
    while True:
        score = _scores(found, suspects)
        score[suspects] = 0.0
        first = (score > 1.0) & (score >= score[near].max(axis=1))
        # Most photographs of a capture are right.
        if not first.any() or suspects.sum() + first.sum() > count // 4:
            break
        suspects |= first
        found = predictions(thumbnails, directions, ~suspects)
    other = _alternatives(found)
    misfires = {
        place: _explained(place, found, other, suspects, names, lamps)
        for place in np.flatnonzero(suspects).tolist()
    }
    return Outliers(misfires, suspects, found)


def _scores(found: Predictions, suspects: NDArray[np.bool_]) -> Floats:
    """``(n,)``: how far each photograph stands out, from 1 on.

    Lamps at the edge of a rig are predicted from one side, with larger errors: they are compared
    with each other.
    """
    score = np.zeros(len(suspects))
    other = _alternatives(found)
    better = found.residual / np.maximum(other.single, 1e-6)
    better[found.residual < LEAST_RESIDUAL] = 0.0
    edge = np.abs(found.weights[0]).sum(axis=1) > EDGE
    for members in (found.known & edge, found.known & ~edge):
        right = members & ~suspects
        if right.sum() < FEWEST_ALIKE:
            continue
        log = np.log(np.maximum(found.strength, 1e-3))
        parts = [
            found.offset / np.maximum(HALF * found.spacing, _far(found.offset[right])),
            np.abs(log - np.median(log[right]))
            / max(LEAST_STRENGTH, SIGMAS * _deviation(log[right])),
            found.residual / max(LEAST_RESIDUAL, _far(found.residual[right])),
            better / max(1.0 / BETTER, _far(better[right])),
        ]
        score[members] = np.max(parts, axis=0)[members]
    return score


def _deviation(values: Floats) -> float:
    """Standard deviation by the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _far(values: Floats) -> float:
    return float(np.median(values)) + SIGMAS * _deviation(values)


@dataclass(frozen=True, eq=False)
class _Alternatives:
    """Other explanations of each photograph, and what they leave of it.

    Attributes
    ----------
    single, lamp
        ``(n,)``: relative residual of the best prediction for another lamp, and its place.
    double, second
        ``(n,)``: that of the sum of the own prediction and one more, and its place.
    """

    single: Floats
    lamp: NDArray[np.intp]
    double: Floats
    second: NDArray[np.intp]


def _alternatives(found: Predictions) -> _Alternatives:
    """By least squares with one or two coefficients, for all pairs of photographs."""
    k, w = found.products, found.weights[0]
    size = np.maximum(np.diag(k), 1e-12)
    with_frames = w @ k  # of prediction j and photograph i at [j, i]
    among = with_frames @ w.T
    square = np.maximum(np.diag(among), 1e-12)
    # A prediction in which the photograph has a part says nothing about it.
    other = found.known[:, None] & (w == 0.0)
    np.fill_diagonal(other, False)
    left = _relative(size - with_frames**2 / square[:, None], size)
    single = np.where(other & (with_frames > 0.5 * square[:, None]), left, np.inf)
    own_frame, own_square = np.diag(with_frames), square
    mixed = among  # of prediction j and own prediction i at [j, i]
    determinant = square[:, None] * own_square - mixed**2
    with np.errstate(divide="ignore", invalid="ignore"):
        own = (square[:, None] * own_frame - mixed * with_frames) / determinant
        more = (own_square * with_frames - mixed * own_frame) / determinant
        left = _relative(size - own * own_frame - more * with_frames, size)
    right = determinant > 1e-9 * square[:, None] * own_square
    double = np.where(other & right & (own > 0.5) & (more > LEAST_SECOND), left, np.inf)
    return _Alternatives(
        single.min(axis=0), single.argmin(axis=0), double.min(axis=0), double.argmin(axis=0)
    )


def _relative(left: Floats, size: Floats) -> Floats:
    return np.asarray(np.sqrt(np.maximum(left, 0.0) / size))


def _explained(
    own: int,
    found: Predictions,
    other: _Alternatives,
    suspects: NDArray[np.bool_],
    names: list[str],
    lamps: list[int],
) -> Misfire:
    """What a photograph that stands out shows: two lamps, another lamp, another strength."""
    left, number = found.residual[own], lamps[own]
    if found.strength[own] < 0.1:
        return Misfire(
            "no-light", "no light came from the lamp", "see whether the lamp is on when it should"
        )
    single, double = other.single[own], other.double[own]
    if single < BETTER * left and single <= 1.2 * double:
        lamp = int(other.lamp[own])
        swapped = suspects[lamp] and other.lamp[lamp] == own
        return Misfire(
            "swapped" if swapped else "wrong-lamp",
            f"the light comes from lamp {lamps[lamp]}, not from lamp {number}"
            + (f": exchanged with {names[lamp]}" if swapped else ""),
            "see which lamp glows when the plan says so; compare the wiring with the light file",
        )
    if double < BETTER * left:
        return Misfire(
            "double-light",
            f"two lamps are on: lamp {number} and lamp {lamps[int(other.second[own])]}",
            "see that a lamp is off before the next one is switched on, and the room is dark",
        )
    if abs(np.log(max(found.strength[own], 1e-3))) > LEAST_STRENGTH:
        percent = 100.0 * (found.strength[own] - 1.0)
        return Misfire(
            "strength",
            f"the light is {abs(percent):.0f} % {'stronger' if percent > 0 else 'weaker'} than "
            "under the neighbouring lamps",
            "see that the exposure is fixed, and that the lamp is warm and clean",
        )
    return Misfire(
        "unlike",
        "the photograph does not look like those under neighbouring lamps",
        "look at it: something may stand in the light, or camera or painting have moved",
    )

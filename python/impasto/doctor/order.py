"""Lists of lights in a wrong order: shifted, reversed, sorted as text, or at random.

Lists of lights without file names are paired with the photographs by order. One photograph too
many, a reversed list, or ``photo10`` sorted before ``photo2`` puts nearly every photograph under a
wrong light, and no surface fits them any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto._internal.wording import factor
from impasto.doctor.diagnosis import Finding
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import fit_surface, shading

Floats = NDArray[np.float64]
Order = NDArray[np.int64]

AT_RANDOM = "random"
"""The verdict where random orders fit as well as the given one."""
_FEWEST = 6
_PIXELS = 4000
_FOLDS = 6
_BETTER = 1.3
"""An order is wrong if the residuals of another one are smaller by this factor, and so are those
of held-out photographs, by at least this many standard errors over the photographs."""
_SIGMAS = 3.0
_SHUFFLED = 8
"""Photographs from which on lights are compared with lights at random."""
_TRIALS, _TRIAL_PIXELS = 9, 1000
"""Random orders, and the pixels that they are tried on."""
_LIKE_RANDOM = 0.9
"""Least share of the residuals in random orders at which an order counts as one of them. Lights in
the right order left 0.04 to 0.55 of them, 0.81 under uneven lamps close together (photographs of an
object between two balls), and up to 0.95 where photographs are alike, of a plane under a ring of
lamps. Uneven lamps of a plane cannot be told from lamps in another order."""
_UNLIKE_ANY = 1.1
"""Least residuals, in units of those under the lights of any direction and strength that fit best.
Photographs of a plane under a ring of lamps leave 1.0: there is nothing else to explain."""


def order(sampled: SampledTiles, *, one_view: bool = True) -> tuple[list[Finding], Order | None]:
    """Whether another order of the lights fits the photographs better, and which.

    Random orders are tried where all photographs have one view: gloss that moves with the view
    leaves as much as they do.
    """
    count = len(sampled.grey)
    if count < _FEWEST:
        return [], None
    given = misfit_of(sampled, np.arange(count))
    if not given > 0:
        return [], None
    misfits = {name: misfit_of(sampled, to) for name, to in orders(count).items()}
    best = min(misfits, key=lambda name: misfits[name])
    numbers = {"misfit": round(given, 5), **{n: round(m, 5) for n, m in misfits.items()}}
    times = given / max(misfits[best], 1e-12)
    if not (times > _BETTER and _predicts_better(sampled, orders(count)[best])):
        at_random = _misfit_at_random(sampled, given) if one_view else None
        if at_random is not None:
            return [_at_random(given, at_random, numbers)], None
        message = "photographs and lights are in the same order: no shift or reversal fits better"
        return [Finding("order", "ok", message, numbers=numbers)], None
    found = Finding(
        "order",
        "error",
        f"photographs and lights are in different orders: with the list of lights {best}, a "
        f"surface fits the photographs {factor(times)} times better (the checks below use that "
        "order)",
        "correct the order of the light file, preferably with file names in it; impasto doctor "
        "--write FILE.lp does so",
        numbers=numbers | {"verdict": best, "order": orders(count)[best].tolist()},
    )
    return [found], orders(count)[best]


def _at_random(given: float, at_random: float, numbers: dict[str, float]) -> Finding:
    return Finding(
        "order",
        "warning",
        "a surface fits the photographs no better than with their lights in random order "
        f"({given:.0%} of the light is left over, there {at_random:.0%}): the light file lists "
        "them in another order or is that of others, or lamps or exposures are very uneven",
        "check the light file; file names in it leave no doubt. If it is right, give intensities=, "
        "or estimate them by fit_strengths (--strengths)",
        numbers=numbers | {"verdict": AT_RANDOM, "misfit_at_random": round(at_random, 5)},
    )


def _misfit_at_random(sampled: SampledTiles, given: float) -> float | None:
    """The median residual in random orders, if the given order is like one of them.

    A permutation test [@good2005permutation] with a margin instead of a level.
    """
    count = len(sampled.grey)
    # With residuals above the light itself photographs show noise, under any lights.
    if count < _SHUFFLED or given > 1.0:
        return None
    if not given > _UNLIKE_ANY * _misfit_of_any_lights(sampled):
        return None
    chance = np.random.default_rng(0)
    trials = [misfit_of(sampled, chance.permutation(count), _TRIAL_PIXELS) for _ in range(_TRIALS)]
    middle = float(np.median(trials))
    return middle if given > _LIKE_RANDOM * middle else None


def _misfit_of_any_lights(sampled: SampledTiles) -> float:
    """:func:`misfit_of` with the lights that fit best; NaN where few pixels have all samples.

    Of the best approximation of rank three [@hayakawa1994photometric].
    """
    whole = np.flatnonzero(np.isfinite(sampled.grey).all(axis=0))
    if len(whole) < _TRIAL_PIXELS // 10:
        return float("nan")
    grey = sampled.grey[:, whole[:: max(1, len(whole) // _TRIAL_PIXELS)]].astype(np.float64)
    left, strength, right = np.linalg.svd(grey, full_matrices=False)
    shown = (left[:, :3] * strength[:3]) @ right[:3]
    return float(np.median(np.abs(grey - shown)) / max(float(np.median(grey)), 1e-30))


def _predicts_better(sampled: SampledTiles, to: Order) -> bool:
    """Whether held-out photographs are predicted better by this order than by the given one."""
    given, other = (held_out_errors(sampled, one) for one in (np.arange(len(to)), to))
    with np.errstate(divide="ignore", invalid="ignore"):  # black photographs have no error
        gain = np.log(given / other)
    gain = gain[np.isfinite(gain)]
    if len(gain) < _FEWEST:
        return False
    doubt = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > max(np.log(_BETTER), _SIGMAS * doubt))


def held_out_errors(
    sampled: SampledTiles, to: Order, photographs: NDArray[np.int64] | None = None
) -> Floats:
    """Error of each photograph when a surface fitted to others predicts it, relative to its light.

    Parameters
    ----------
    sampled
        The pixels examined.
    to
        ``(obs,)``: the light that each photograph has.
    photographs
        Those to predict, each time without all of them; default: all of them, in folds.
    """
    pick = np.arange(0, sampled.grey.shape[1], max(1, sampled.grey.shape[1] // _PIXELS))
    grey = sampled.grey[:, pick]
    lights = sampled.lights[to]
    lights = lights if lights.ndim == 2 else lights[:, pick]
    count = len(grey)
    folds = (
        [np.arange(fold, count, _FOLDS) for fold in range(min(_FOLDS, count))]
        if photographs is None
        else [photographs]
    )
    errors = np.full(count, np.nan)
    for out in folds:
        kept = np.setdiff1d(np.arange(count), out)
        surface = fit_surface(grey[kept], lights[kept])
        shown = np.maximum(shading(surface, lights[out]), 0.0)
        for row, index in enumerate(out):
            known = np.isfinite(grey[index]) & np.isfinite(shown[row])
            if known.sum() >= 30:
                miss = np.median(np.abs(grey[index] - shown[row])[known])
                errors[index] = miss / max(float(np.median(grey[index][known])), 1e-30)
    return errors if photographs is None else errors[photographs]


def orders(count: int) -> dict[str, Order]:
    """The light that each photograph should have, for each likely mistake."""
    index = np.arange(count)
    # Numbers from 1 on: photo1, photo10, photo11, photo2 ...
    text = np.array(sorted(range(count), key=lambda i: str(i + 1)))
    found = {
        "moved by one": np.roll(index, 1),
        "moved back by one": np.roll(index, -1),
        "moved by two": np.roll(index, 2),
        "moved back by two": np.roll(index, -2),
        "reversed": index[::-1],
    }
    if (text != index).any():
        found["sorted as text"] = text
        found["sorted as numbers"] = np.argsort(text)
    return found


def misfit_of(sampled: SampledTiles, to: Order, most: int = _PIXELS) -> float:
    """Median residual of a surface fitted with the lights in this order, relative to the light.

    Of ``most`` pixels, about.
    """
    pick = np.arange(0, sampled.grey.shape[1], max(1, sampled.grey.shape[1] // most))
    grey = sampled.grey[:, pick]
    lights = sampled.lights[to]
    lights = lights if lights.ndim == 2 else lights[:, pick]
    surface = fit_surface(grey, lights)
    known = np.isfinite(surface).all(axis=0)
    used = np.isfinite(grey[:, known])
    if used.sum() < 10 * len(grey):
        return float("nan")
    shown = shading(surface[:, known], lights if lights.ndim == 2 else lights[:, known])
    light = grey[:, known][used]
    return float(np.median(np.abs(light - shown[used])) / max(float(np.median(light)), 1e-30))

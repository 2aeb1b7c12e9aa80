"""Lists of lights in a wrong order: shifted, reversed, or sorted as text.

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

_FEWEST = 6
_PIXELS = 4000
_FOLDS = 6
_BETTER = 1.3
"""An order is wrong if the residuals of another one are smaller by this factor, and so are those
of held-out photographs, by at least this many standard errors over the photographs."""
_SIGMAS = 3.0


def order(sampled: SampledTiles) -> tuple[list[Finding], Order | None]:
    """Whether another order of the lights fits the photographs better, and which."""
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


def misfit_of(sampled: SampledTiles, to: Order) -> float:
    """Median residual of a surface fitted with the lights in this order, relative to the light."""
    pick = np.arange(0, sampled.grey.shape[1], max(1, sampled.grey.shape[1] // _PIXELS))
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

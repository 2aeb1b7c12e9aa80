"""Lists of lights in a wrong order: shifted, reversed, or sorted as text.

Lists of lights without file names are paired with the photographs by order. One photograph too
many, a reversed list, or ``photo10`` sorted before ``photo2`` puts nearly every photograph under a
wrong light, and no surface fits them any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.doctor.diagnosis import Finding
from impasto.doctor.sampled_tiles import SampledTiles
from impasto.doctor.surface import fit_surface, shading

Floats = NDArray[np.float64]
Order = NDArray[np.int64]

_FEWEST = 6
_PIXELS = 4000
_BETTER = 1.4
"""An order is wrong if the residuals of another one are smaller by this factor."""


def order(sampled: SampledTiles) -> tuple[list[Finding], Order | None]:
    """Whether another order of the lights fits the photographs better, and which."""
    count = len(sampled.grey)
    if count < _FEWEST:
        return [], None
    given = _misfit(sampled, np.arange(count))
    if not given > 0:
        return [], None
    misfits = {name: _misfit(sampled, to) for name, to in orders(count).items()}
    best = min(misfits, key=lambda name: misfits[name])
    numbers = {"misfit": round(given, 5), **{n: round(m, 5) for n, m in misfits.items()}}
    times = given / max(misfits[best], 1e-12)
    if not times > _BETTER:
        message = "photographs and lights are in the same order: no shift or reversal fits better"
        return [Finding("order", "ok", message, numbers=numbers)], None
    found = Finding(
        "order",
        "error",
        f"photographs and lights are in different orders: with the list of lights {best}, a "
        f"surface fits the photographs {times:.1f} times better (the checks below use that order)",
        "correct the order of the light file, preferably with file names in it; impasto doctor "
        "--write FILE.lp does so",
        numbers=numbers | {"verdict": best, "order": orders(count)[best].tolist()},
    )
    return [found], orders(count)[best]


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


def _misfit(sampled: SampledTiles, to: Order) -> float:
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

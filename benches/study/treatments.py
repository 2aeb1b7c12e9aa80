"""Treatments of the photographs before a fit: subsets of the lights, other number formats."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.normals import fit_normals
from impasto.fit.sbrdf import fit_sbrdf
from impasto.fit.subsample import subsampled
from impasto.stack import Stack
from impasto.study.relative_error import full_scale, relative_error
from study.subsets import TooFewError

SELECTIONS = ("random", "spread", "best")
NUMBER_FORMATS = (
    "8-bit linear",
    "8-bit sRGB",
    "12-bit linear",
    "16-bit linear",
    "float16",
    "float32",
)
TRIES = 64
"""Exchanges of a photograph that are tried for the best subset."""
DRAWN = 100
"""Random subsets drawn, at most, until one determines normals. Nine in ten of the 770 views are lit
from one arc: of seven random ones, four times in ten none lies outside it."""
JUDGED = 3
"""Stride of the pixels by which a subset is judged."""


def everything(stack: Stack, seed: int) -> Stack:
    """The stack as it is."""
    del seed
    return stack


def fewer(stack: Stack, seed: int, *, count: int, choice: str) -> Stack:
    """Some photographs: random, spread evenly by a greedy choice, or the best subset found.

    A random subset whose lights lie in one plane cannot be fitted and is drawn again. The best
    subset is found by exchange from the spread one; its fit predicts all photographs best. It needs
    all photographs, so it shows what there is to gain, not how to photograph.

    Raises
    ------
    TooFewError
        No photograph would be left out.
    """
    if count >= len(stack.rig):
        raise TooFewError(f"{count} of {len(stack.rig)} photographs leave none out")
    rng = np.random.default_rng([seed, count])
    if choice == "random":
        picked = _drawn(stack, rng, count)[:count]
    else:
        picked = spread(np.hstack([stack.rig.directions, stack.rig.views]), count)
        if choice == "best":
            picked = _exchanged(stack, picked, rng)
    return stack.take(np.sort(picked))


def _drawn(stack: Stack, rng: np.random.Generator, count: int) -> NDArray[np.intp]:
    """A random order of all photographs, of which the first ``count`` determine normals.

    If none is found, the last order; the fit then says why it refuses it.
    """
    few = subsampled(stack, min(stack.shape[2:]))
    for _ in range(DRAWN):
        order = rng.permutation(len(stack.rig))
        if _determined(few.take(np.sort(order[:count]))):
            break
    return order


def _determined(stack: Stack) -> bool:
    """Whether the lights determine normals: photometric stereo refuses them at once if not."""
    try:
        fit_normals(stack, method="least-squares", threads=1)
    except GeometryError:
        return False
    return True


def _exchanged(
    stack: Stack, picked: NDArray[np.intp], rng: np.random.Generator
) -> NDArray[np.intp]:
    """Exchange algorithm with random pairs (after Fedorov 1972)."""
    part = subsampled(stack, JUDGED)
    light = np.array([part.linear(i) for i in range(len(part.rig))])
    order = np.concatenate([picked, np.setdiff1d(np.arange(len(part.rig)), picked)])
    least = _error(part, picked, light)
    for _ in range(TRIES):
        places = rng.integers(len(picked)), rng.integers(len(picked), len(order))
        other = order.copy()
        other[[*places]] = order[[*places[::-1]]]
        error = _error(part, other[: len(picked)], light)
        if error < least:
            least, order = error, other
    return order[: len(picked)]


def _error(stack: Stack, picked: NDArray[np.intp], light: NDArray[Any]) -> float:
    """Relighting error on all photographs of a fit of some."""
    many = len(np.unique(stack.rig.views, axis=0)) > 1
    options: Any = {"model": "lafortune"} if many else {"pooling": "pixel"}
    try:
        fitted = fit_sbrdf(stack.take(np.sort(picked)), **options)
    except GeometryError:
        return float("inf")
    return relative_error(fitted.predict(stack.rig), light, full_scale(stack))


def spread(places: NDArray[Any], count: int) -> NDArray[np.intp]:
    """Farthest-point sampling from the place nearest to the mean."""
    apart = ((places - places.mean(axis=0)) ** 2).sum(axis=1)
    chosen = [int(apart.argmin())]
    nearest = np.full(len(places), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, ((places - places[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)


def recoded(stack: Stack, seed: int, *, number_format: str) -> Stack:
    """The same light in another number format; clipped samples stay clipped."""
    del seed
    # Clipped samples are +inf and become full scale.
    light = np.array([stack.linear(i) for i in range(len(stack.rig))])
    white = float((np.asarray(stack.saturation) - stack.black).max() * stack.scale.max())
    if number_format.endswith("bit linear"):
        top = 2 ** int(number_format.partition("-")[0]) - 1
        codes = np.rint(np.clip(light / white, 0.0, 1.0) * top)
        kind = np.uint8 if top == 255 else np.uint16
        return Stack(
            codes.astype(kind), lights=stack.rig, bands=stack.bands, scale=white / top,
            saturation=float(top),
        )  # fmt: skip
    if number_format == "8-bit sRGB":
        curve = Encoding("srgb", 255.0)
        decoded = curve.decode(np.rint(curve.encode(light / white))) * np.float32(white)
        full = float(np.float32(white))
        return Stack(decoded, lights=stack.rig, bands=stack.bands, saturation=full)
    number = np.float16 if number_format == "float16" else np.float32
    return Stack(light.astype(number), lights=stack.rig, bands=stack.bands)

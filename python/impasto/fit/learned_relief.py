"""Whether a painting's own shadows and interreflections are part of its fit: held out, it shows.

Model selection by cross-validation [@stone1974].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.calls import thread_count
from impasto._internal.waiting import wait_for_each
from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.choice import MARGIN, predicted
from impasto.fit.cross_validation import FEWEST, Fold, folds_of, full_scale
from impasto.fit.relief import Relief, blocks
from impasto.fit.residuals import full_light, usual_residuals
from impasto.fit.subsample import stride_index
from impasto.rig import Rig
from impasto.stack import Stack

JUDGED = 64
"""Most cells a side of the reduced photographs by which it is decided."""
KEPT = 128
"""The same of the relief that is kept."""
READ = 4
"""Pixels a side that are read of a large block: the mean of sixteen has little noise, and reading
all of many photographs of a megapixel would take seconds."""
SMALLEST = 8
"""Fewest cells a side that are a relief."""
LEAST = 0.5
"""Root mean square change of the photographs, in 8-bit codes, below which nothing is tried: on a
nearly flat painting one small fit is all that this costs."""
PASSES = 2
"""How often interreflections are taken off and the fit is repeated. Errors of a deep relief's
normals were 0.97 degrees before, then 0.31, 0.26, 0.26."""

WHITER = 1.5
"""White to begin with, in units of the brightest diffuse colours."""
DOUBLED = 2
"""How often a larger white is tried: with still larger ones all reflectances are below 1/8, and
what cells send to each other is lost in the noise."""
STEP, LOWERED = 2.0**0.5, 3
"""Multiple of the best white that is compared next, on both sides, and how often downwards."""

Fit = Callable[[Stack], Any]
"""Fits photographs without a relief."""


class Reduced(NamedTuple):
    """Photographs of fewer pixels."""

    stack: Stack
    truth: Stack
    """The same, but of a block that is clipped in part nothing is known: it is not white."""
    step: int
    """Side of a block in pixels."""


def relief_sample(stack: Stack, fit: Fit, *, threads: int | None) -> Reduced | None:
    """Reduced photographs by which to judge a relief; None where there is none to speak of.

    That is with fewer than 8 photographs, several views, a picture of less than 8 pixels, or where
    the relief of a fit changes what it shows by less than :data:`LEAST`.
    """
    if len(stack.rig) < FEWEST or _core.views_differ(RigArguments.of(stack.rig)):
        return None
    few = reduced(stack, JUDGED, threads=threads)
    if min(few.stack.shape[2:]) < SMALLEST:
        return None
    try:
        first = fit(few.stack)
    except GeometryError:
        return None
    # The least white sends the most light.
    found = replace(first, relief=Relief.of(first, 1, WHITER * full_scale([first.diffuse])))
    return few if _matters(found, threads) else None


def learn_white(few: Reduced, fit: Fit, *, threads: int | None) -> float | None:
    """The white (:attr:`Relief.white`) whose interreflections predict held-out photographs best.

    A stack's own scale need not say it: photographs are exposed as one likes. The first that is
    tried is half as much again as nearly all diffuse colours; then its multiples, and a parabola
    over the logarithm, each with one sixth of the photographs held out. With their residuals: these
    keep what other errors of the fit are, and without them a deep relief seemed to have a white of
    1.4 instead of 1. None where nothing can be predicted.
    """
    folds = _folds(few, threads)[:1]
    if not folds:
        return None
    # What is fitted to the photographs as they are is the same with every white.
    first = cache(fit)
    unit = WHITER * full_scale([first(folds[0].known).diffuse])
    tried: dict[float, float] = {}

    def judged(factor: float) -> float:
        found = _judged(_with_its_own(fit, first, factor * unit, threads), folds, threads)
        tried[factor] = float(found.mean())
        return tried[factor]

    judged(1.0)
    for power in range(1, DOUBLED + 1):
        if judged(2.0**power) <= tried[2.0 ** (power - 1)]:
            break
    coarse = max(tried, key=lambda factor: tried[factor])
    judged(coarse * STEP)
    # Downwards while it helps: below, colours of unusual pixels reflect more than they get.
    factor = coarse / STEP
    for _ in range(LOWERED):
        if judged(factor) <= max(value for one, value in tried.items() if one != factor):
            break
        factor /= STEP
    best = max(tried, key=lambda factor: tried[factor])
    near = {offset: _near(tried, best * STEP**offset) for offset in (-1.0, 0.0, 1.0)}
    if all(value is not None for value in near.values()):
        # The vertex of the parabola through three values over the logarithm.
        below, middle, above = (float(value or 0.0) for value in near.values())
        bend = 2.0 * middle - below - above
        if bend > 0.0:
            judged(best * STEP ** (0.5 * (above - below) / bend))
    return max(tried, key=lambda factor: tried[factor]) * unit


def _near(tried: dict[float, float], factor: float) -> float | None:
    """The value of a factor up to its rounding."""
    return next((value for one, value in tried.items() if abs(one / factor - 1.0) < 1e-6), None)


def learn_relief(
    stack: Stack, few: Reduced, fits: Sequence[Fit], white: float, *, threads: int | None
) -> tuple[Relief, Fit] | None:
    """The relief of a painting, and the fit with it, if held-out photographs are better predicted.

    Compared are the first fit alone, with cast shadows, and all fits with interreflections, too;
    each with what it leaves interpolated where that helps. A fit of some of the photographs makes
    its own relief.

    Parameters
    ----------
    stack
        Photographs of the whole painting.
    few
        What :func:`relief_sample` made of them.
    fits
        Fits without a relief, first the one that is best without.
    white
        What :func:`learn_white` found.
    threads
        None means every allowed core.
    """
    folds = _folds(few, threads)
    if not folds:
        return None
    # All ways begin with the fit alone.
    first = [cache(fit) for fit in fits]
    alone = _judged(first[0], folds, threads)
    ways: list[tuple[Fit, Fit, float | None]] = [(fits[0], first[0], None)]
    ways += [(*both, white) for both in zip(fits, first, strict=True)]
    gains = [_judged(_with_its_own(*way, threads), folds, threads) - alone for way in ways]
    gained = max(gains, key=np.mean)
    count = len(gained)
    error = float(gained.std(ddof=1) / np.sqrt(count)) if count > 1 else 0.0
    gain = float(gained.mean())
    if gain <= max(MARGIN, error):
        return None
    fit, _, own_white = next(way for way, one in zip(ways, gains, strict=True) if one is gained)
    whole = reduced(stack, KEPT, threads=threads)
    found: Relief = with_relief(
        whole.stack, fit, own_white, step=whole.step, threads=threads
    ).relief
    return replace(found, gain=gain), fit


def with_relief(
    stack: Stack,
    fit: Fit,
    white: float | None,
    *,
    first: Fit | None = None,
    step: int = 1,
    threads: int | None,
) -> Any:
    """A fit with its own relief, without ``white`` of shadows alone; a pixel is a cell.

    ``first``: the same fit, if it may remember what it found in the photographs as they are.
    """
    result = (first or fit)(stack)
    for _ in range(0 if white is None else PASSES):
        result = fit(Relief.of(result, 1, white).removed(stack, threads=threads))
    return replace(result, relief=Relief.of(result, step, white))


def _with_its_own(fit: Fit, first: Fit, white: float | None, threads: int | None) -> Fit:
    return lambda known: with_relief(known, fit, white, first=first, threads=threads)


def _folds(few: Reduced, threads: int | None) -> list[Fold]:
    """Those that can be predicted."""
    try:
        folds = folds_of(few.stack, threads, truth=few.truth)
    except GeometryError:
        return []
    known = [fold for fold in folds if fold.unknown is None]
    return known if any(not np.isnan(fold.compared).all() for fold in known) else []


def _matters(result: Any, threads: int | None) -> bool:
    """Whether the relief of a fit changes what its photographs show."""
    curve = Encoding("srgb", white=255.0)
    model = result.surface().predict(result.rig, threads=threads)
    shown = result.modelled(result.rig, threads=threads)
    top = full_scale(model)
    with np.errstate(over="ignore"):  # samples near the largest float32: white
        shown, scaled = shown / top, model / top
    changed = curve.encode(np.nan_to_num(shown)) - curve.encode(np.nan_to_num(scaled))
    inside = np.isfinite(model)
    return bool(inside.any() and np.sqrt(np.mean(changed[inside] ** 2.0)) >= LEAST)


def reduced(stack: Stack, cells: int, *, threads: int | None) -> Reduced:
    """Photographs of at most so many pixels a side, means over blocks.

    Of large blocks a regular sample of pixels is read. A block with a clipped sample is clipped to
    fits, and unknown where predictions are compared unless all of its samples are clipped;
    one most of whose pixels lie outside the mask is outside.
    """
    size = stack.shape[2:]
    step = -(-max(size) // cells)
    if step == 1:
        return Reduced(stack, stack, 1)
    stride = max(step // READ, 1)
    side = -(-step // stride)
    step = side * stride
    some = stride_index(size, stride)
    inside = None if stack.mask is None else stack.mask[some]

    def shrunk(index: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        linear = stack._linear(stack.samples[index][some])
        if inside is not None:
            linear[:, ~inside] = np.nan
        mean = blocks(linear, side)
        infinite = np.isinf(linear)
        if not infinite.any():
            return mean, mean
        clipped = blocks(np.where(np.isnan(linear), np.nan, infinite), side)
        return mean, np.where((clipped > 0.0) & (clipped < 1.0), np.float32(np.nan), mean)

    both = wait_for_each(shrunk, range(len(stack.rig)), thread_count(threads))
    samples, known = (np.stack(one) for one in zip(*both, strict=True))
    mask = None if inside is None else blocks(inside.astype(np.float32), side) >= 0.5
    pitch = None if stack.rig.pitch_mm is None else stack.rig.pitch_mm * step
    right, up = stack.rig.origin
    rig = Rig(stack.rig, pitch_mm=pitch, origin=(right / step, up / step))
    ceiling = None if stack.saturation is None else stack.ceiling
    changes = {"mask": mask, "rig": rig, "scale": 1.0, "black": 0.0, "saturation": ceiling}
    return Reduced(
        stack._replace(samples=samples, **changes), stack._replace(samples=known, **changes), step
    )


def _judged(fit: Fit, folds: Sequence[Fold], threads: int | None) -> NDArray[np.float64]:
    """PSNR of each held-out photograph, with residuals where they help."""
    top = full_scale(one for fold in folds for one in fold.compared)

    def with_residuals(known: Stack) -> Any:
        result = fit(known)
        usual = usual_residuals(known, result, full_light(known), threads)
        return replace(result, residuals=usual)

    return max(predicted(with_residuals, folds, top, threads), key=np.mean)

"""Whether a painting's own shadows and interreflections are part of its fit: held out, it shows.

Model selection by cross-validation [@stone1974].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto import _core
from impasto._internal.border import RigArguments
from impasto._internal.waiting import wait_for
from impasto.encoding import Encoding
from impasto.errors import GeometryError
from impasto.fit.choice import MARGIN, decibels, full_scale, shown_by_process
from impasto.fit.cross_validation import FEWEST, Fold, folds_of
from impasto.fit.relief import Relief, blocks
from impasto.fit.residuals import usual_residuals
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

Fit = Callable[[Stack], Any]
"""Fits photographs without a relief."""


def relief_sample(stack: Stack, fit: Fit) -> Stack | None:
    """Reduced photographs by which to judge a relief; None where there is none to speak of.

    That is with fewer than 8 photographs, several views, a picture of less than 8 pixels, or where
    the relief of a fit changes what it shows by less than :data:`LEAST`.
    """
    if len(stack.rig) < FEWEST or _core.views_differ(RigArguments.of(stack.rig)):
        return None
    few, _ = reduced(stack, JUDGED)
    if min(few.shape[2:]) < SMALLEST:
        return None
    try:
        first = fit(few)
    except GeometryError:
        return None
    found = replace(first, relief=Relief.of(first, 1, interreflection=True))
    return few if _matters(found) else None


def learn_relief(
    stack: Stack, few: Stack, fits: Sequence[Fit], *, threads: int | None
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
    threads
        None means every allowed core.
    """
    try:
        folds = [fold for fold in folds_of(few, threads) if fold.unknown is None]
    except GeometryError:
        return None
    if all(np.isnan(fold.compared).all() for fold in folds):
        return None
    alone = _judged(fits[0], None, folds)
    ways = [(fits[0], False), *((fit, True) for fit in fits)]
    gains = [_judged(*way, folds) - alone for way in ways]
    gained = max(gains, key=np.mean)
    gain, error = float(gained.mean()), float(gained.std() / np.sqrt(len(gained)))
    if gain <= max(MARGIN, error):
        return None
    fit, interreflection = next(way for way, one in zip(ways, gains, strict=True) if one is gained)
    whole, step = reduced(stack, KEPT)
    found: Relief = with_relief(whole, fit, step, interreflection=interreflection).relief
    return replace(found, gain=gain), fit


def with_relief(stack: Stack, fit: Fit, step: int, *, interreflection: bool) -> Any:
    """A fit with its own relief; a pixel of the stack is a cell."""
    result = fit(stack)
    for _ in range(PASSES if interreflection else 0):
        relief = Relief.of(result, 1, interreflection=True)
        result = fit(relief.removed(stack))
    return replace(result, relief=Relief.of(result, step, interreflection=interreflection))


def _matters(result: Any) -> bool:
    """Whether the relief of a fit changes what its photographs show."""
    curve = Encoding("srgb", white=255.0)
    model, shown = result.surface().predict(result.rig), result.modelled(result.rig)
    top = full_scale([model])
    changed = curve.encode(np.nan_to_num(shown / top)) - curve.encode(np.nan_to_num(model / top))
    inside = np.isfinite(model)
    return bool(inside.any() and np.sqrt(np.mean(changed[inside] ** 2.0)) >= LEAST)


def reduced(stack: Stack, cells: int) -> tuple[Stack, int]:
    """Photographs of at most so many pixels a side, means over blocks; and the side of a block.

    Of large blocks a regular sample of pixels is read. A block with a clipped sample is clipped;
    one most of whose pixels lie outside the mask is outside.
    """
    size = stack.shape[2:]
    step = -(-max(size) // cells)
    if step == 1:
        return stack, 1
    stride = max(step // READ, 1)
    side = -(-step // stride)
    step = side * stride
    some = stride_index(size, stride)
    inside = None if stack.mask is None else stack.mask[some]

    def shrunk(index: int) -> NDArray[np.float32]:
        linear = stack._linear(stack.samples[index][some])
        if inside is not None:
            linear[:, ~inside] = np.nan
        return blocks(linear, side)

    samples = np.stack([wait_for(shrunk, index) for index in range(len(stack.rig))])
    mask = None if inside is None else blocks(inside.astype(np.float32), side) >= 0.5
    pitch = None if stack.rig.pitch_mm is None else stack.rig.pitch_mm * step
    right, up = stack.rig.origin
    rig = Rig(stack.rig, pitch_mm=pitch, origin=(right / step, up / step))
    changes = {"samples": samples, "mask": mask, "rig": rig}
    return stack._replace(**changes, scale=1.0, black=0.0, saturation=None), step


def _judged(fit: Fit, way: bool | None, folds: Sequence[Fold]) -> NDArray[np.float64]:
    """PSNR of each held-out photograph; ``way``: None without relief, else its interreflection."""
    top = full_scale([fold.compared for fold in folds])
    errors: dict[tuple[float, float], list[NDArray[np.float64]]] = {}
    for fold in folds:
        known = fold.known
        result = fit(known) if way is None else with_relief(known, fit, 1, interreflection=way)
        result = replace(result, residuals=usual_residuals(known, result))
        for process, shown in shown_by_process(result, fold.rig).items():
            found = decibels(shown / top, fold.compared / top)
            errors.setdefault(process, []).append(found)
    return max((np.concatenate(found) for found in errors.values()), key=np.mean)

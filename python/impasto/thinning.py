"""Some pixels of a stack that stand for all of them."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from impasto._internal.waiting import wait_for
from impasto.rig import Rig
from impasto.stack import Stack

SPARSE = 4
"""Pixels of a picture for each that is wanted, from which on those of the mask are set side by
side: outside of it, too, a pixel has its place in every map of a fit."""

Window: TypeAlias = tuple[slice, slice]
"""Rows and columns of a picture."""


def thinned(stack: Stack, stride: int) -> Stack:
    """Every so many pixels along both axes, each as wide as all those it stands for."""
    return _cut(stack, _strided(_whole(stack), stride))


def thinned_to(stack: Stack, pixels: int) -> Stack:
    """The stack of about so many pixels of the painting.

    Without a mask they are no more. A mask with a pattern of its own may have its holes where a
    stride has its places: a shorter one is taken then. Of a picture that is mostly outside the
    mask only the part with the painting is taken; what is scattered all over it stands side by
    side, but for near lamps, which shine on every place from elsewhere.
    """
    box, there = _box(stack), painted(stack)
    share = there / _size(box)
    stride = max(1, math.ceil(math.sqrt(there / pixels)))
    # A line has more places left than the square of a stride says.
    while share * _size(_strided(box, stride)) > pixels:
        stride += 1
    while stride > 1:
        window = _strided(box, stride)
        if 2 * _painted(stack, window) > share * _size(window):
            break
        stride -= 1
    window = _strided(box, stride)
    left = _painted(stack, window)
    if _size(window) > SPARSE * max(pixels, left) and left and not stack.rig.near.any():
        return _beside(stack, window)
    return _cut(stack, window)


def painted(stack: Stack) -> int:
    """How many pixels the mask leaves."""
    return _painted(stack, _whole(stack))


def every(shape: tuple[int, int], stride: int) -> Any:
    """The index of every so many pixels of an image.

    As far from the one edge as from the other: near lamps see the middle where it was.
    """
    height, width = shape
    return (..., *_strided((slice(0, height, 1), slice(0, width, 1)), stride))


def _whole(stack: Stack) -> Window:
    height, width = stack.shape[2:]
    return slice(0, height, 1), slice(0, width, 1)


def _box(stack: Stack) -> Window:
    """Where the mask leaves anything; everywhere if it leaves nothing."""
    if stack.mask is None or not stack.mask.any():
        return _whole(stack)
    along = (np.flatnonzero(stack.mask.any(axis=axis)) for axis in (1, 0))
    rows, columns = (slice(int(there[0]), int(there[-1]) + 1, 1) for there in along)
    return rows, columns


def _strided(window: Window, stride: int) -> Window:
    rows, columns = (
        slice(along.start + (along.stop - along.start - 1) % stride // 2, along.stop, stride)
        for along in window
    )
    return rows, columns


def _size(window: Window) -> int:
    return math.prod(-(-(along.stop - along.start) // along.step) for along in window)


def _painted(stack: Stack, window: Window) -> int:
    return _size(window) if stack.mask is None else int(np.count_nonzero(stack.mask[window]))


def _cut(stack: Stack, window: Window) -> Stack:
    """A window of the stack, whose middle becomes the origin of its lamps."""
    if window == _whole(stack):
        return stack
    pitch = stack.rig.pitch_mm
    rig = stack.rig
    if pitch is not None:
        (up, right), stride = _middle(stack, window), window[0].step
        rig = Rig(rig.seen_from(right * pitch, up * pitch), pitch_mm=pitch * stride)
    return stack._replace(
        samples=wait_for(np.ascontiguousarray, stack.samples[(..., *window)]),
        rig=rig,
        mask=None if stack.mask is None else stack.mask[window],
    )


def _middle(stack: Stack, window: Window) -> tuple[float, float]:
    """Pixels from the middle of the picture up and to the right to that of a window."""
    height, width = stack.shape[2:]
    rows, columns = (range(along.start, along.stop, along.step) for along in window)
    return (height - 1 - rows[0] - rows[-1]) / 2, (columns[0] + columns[-1] - width + 1) / 2


def _beside(stack: Stack, window: Window) -> Stack:
    """What the mask leaves of a window, row by row in a small picture."""
    assert stack.mask is not None
    rows, columns = np.nonzero(stack.mask[window])
    rows, columns = (
        along.start + along.step * at for along, at in zip(window, (rows, columns), strict=True)
    )
    there = len(rows)
    width = math.isqrt(there - 1) + 1
    # What fills the last row is a copy, and outside the mask.
    places = np.minimum(np.arange(-(-there // width) * width), there - 1).reshape(-1, width)
    return stack._replace(
        samples=wait_for(stack.samples.__getitem__, (..., rows[places], columns[places])),
        mask=(np.arange(places.size) < there).reshape(places.shape),
    )

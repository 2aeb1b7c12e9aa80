"""Some pixels of a stack that stand for all of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from impasto.rig import Rig
from impasto.stack import Stack


def thinned(stack: Stack, stride: int) -> Stack:
    """Every so many pixels along both axes, each as wide as all those it stands for."""
    if stride == 1:
        return stack
    window = every(stack.shape[2:], stride)
    pitch = stack.rig.pitch_mm
    return stack._replace(
        samples=np.ascontiguousarray(stack.samples[window]),
        rig=Rig(stack.rig, pitch_mm=None if pitch is None else pitch * stride),
        mask=None if stack.mask is None else stack.mask[window],
    )


def thinned_to(stack: Stack, pixels: int) -> Stack:
    """The stack of about so many pixels of the painting.

    Without a mask they are no more. A mask with a pattern of its own may have its holes where a
    stride has its places: a shorter one is taken then.
    """
    there = painted(stack)
    for stride in range(max(1, math.ceil(math.sqrt(there / pixels))), 1, -1):
        part = thinned(stack, stride)
        if 2 * painted(part) * stride**2 > there:
            return part
    return stack


def painted(stack: Stack) -> int:
    """How many pixels the mask leaves."""
    height, width = stack.shape[2:]
    return height * width if stack.mask is None else int(np.count_nonzero(stack.mask))


def every(shape: tuple[int, int], stride: int) -> Any:
    """The index of every so many pixels of an image.

    As far from the one edge as from the other: near lamps see the middle where it was.
    """
    top, left = ((size - 1) % stride // 2 for size in shape)
    return np.s_[..., top::stride, left::stride]

"""What is changed about the photographs before they are fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.stack import Stack

CHOICES = ("random", "spread")
SORTS = ("8-bit linear", "8-bit sRGB", "float16", "float32")


def everything(stack: Stack, seed: int) -> Stack:
    """The stack as it is."""
    del seed
    return stack


def fewer(stack: Stack, seed: int, *, count: int, choice: str) -> Stack:
    """Some photographs: at random, or spread as evenly as a greedy choice gets."""
    total = len(stack.rig)
    count = min(count, total)
    if choice == "random":
        picked = np.random.default_rng([seed, count]).permutation(total)[:count]
    else:
        picked = spread(np.hstack([stack.rig.directions, stack.rig.views]), count)
    return stack.take(np.sort(picked))


def spread(places: NDArray[Any], count: int) -> NDArray[np.intp]:
    """Begin at the middle of all; then always the place farthest from those already chosen."""
    apart = ((places - places.mean(axis=0)) ** 2).sum(axis=1)
    chosen = [int(apart.argmin())]
    nearest = np.full(len(places), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, ((places - places[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)


def recoded(stack: Stack, seed: int, *, sort: str) -> Stack:
    """The same light in other numbers; what is clipped stays clipped."""
    del seed
    # Clipped samples are +inf: full scale in whatever comes.
    light = np.array([stack.linear(i) for i in range(len(stack.rig))])
    white = float((np.asarray(stack.saturation) - stack.black).max() * stack.scale.max())
    if sort == "8-bit linear":
        codes = np.rint(np.clip(light / white, 0.0, 1.0) * 255.0).astype(np.uint8)
        return Stack(codes, lights=stack.rig, bands=stack.bands, scale=white / 255.0)
    if sort == "8-bit sRGB":
        curve = Encoding("srgb", 255.0)
        decoded = curve.decode(np.rint(curve.encode(light / white))) * np.float32(white)
        full = float(np.float32(white))
        return Stack(decoded, lights=stack.rig, bands=stack.bands, saturation=full)
    kind = np.float16 if sort == "float16" else np.float32
    return Stack(light.astype(kind), lights=stack.rig, bands=stack.bands)

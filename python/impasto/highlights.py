"""Overexposed highlights: reconstructed from the bands that are not clipped, or left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.stack import Stack, checked_stack

ENDLESS = float(np.finfo(np.float32).max)
"""Saturation level of a reconstructed stack: only infinite samples are clipped."""


def reconstruct_highlights(stack: Stack) -> Stack:
    """Replace clipped bands of overexposed samples by the heuristic of Snel et al. (section 4).

    Where some bands of a sample are clipped and others are not, the clipped ones are replaced by
    the colour of another photograph of the same pixel, the brightest in which no band is clipped.
    It is scaled to the bands that are not clipped. This assumes that a highlight has the colour of
    that photograph. The colour of the paint is part of it, so the error is largest where saturated
    paint shines. Fits to the photographs as they are, or to what :func:`leave_out_highlights`
    returns, predict highlights better unless paint and gloss have one colour.

    Parameters
    ----------
    stack
        At least two bands. Samples from ``saturation`` on, and infinite ones, are clipped.

    Returns
    -------
    Stack
        The same photographs as linear float32 samples. Samples that are clipped in all bands, or
        whose pixel has no photograph without a clipped band, remain clipped.

    Raises
    ------
    ArgumentError
        One band.
    """
    checked_stack(stack)
    count, bands = stack.shape[:2]
    if bands < 2:
        raise ArgumentError(
            "stack: highlights are reconstructed from the bands that are not clipped; found one "
            "band only"
        )
    colour = just_not_overexposed(stack)
    known = np.asarray(np.isfinite(colour).all(axis=0))
    samples = np.empty(stack.shape, np.float32)
    for index in range(count):
        samples[index] = _reconstructed(stack.linear(index), colour, known)
    return stack._replace(samples=samples, saturation=ENDLESS, scale=1.0, black=0.0)


def leave_out_highlights(stack: Stack) -> Stack:
    """Replace clipped samples by NaN: fits then know nothing of them, in no band that is clipped.

    A fit to the stack itself knows that the light was at least that of the clipping level. With few
    lamps that is worth more; with many, of which most show a highlight unclipped, less.

    Parameters
    ----------
    stack
        Samples from ``saturation`` on, and infinite ones, are clipped.

    Returns
    -------
    Stack
        The same photographs as linear float32 samples.
    """
    checked_stack(stack)
    samples = np.empty(stack.shape, np.float32)
    for index in range(len(stack.rig)):
        linear = stack.linear(index)
        samples[index] = np.where(linear == np.inf, np.float32(np.nan), linear)
    return stack._replace(samples=samples, saturation=ENDLESS, scale=1.0, black=0.0)


def just_not_overexposed(
    stack: Stack, less: Callable[[int], NDArray[np.float32]] | None = None
) -> NDArray[np.float32]:
    """``(band, y, x)``: the brightest photograph of each pixel in which no band is clipped.

    Brightness is the mean of the bands. NaN where there is none. ``less(photograph)`` is subtracted
    from what is taken of a photograph.
    """
    _, bands, height, width = stack.shape
    colour = np.full((bands, height, width), np.nan, np.float32)
    brightest = np.full((height, width), -np.inf, np.float32)
    for index in range(len(stack.rig)):
        linear = stack.linear(index)
        light = linear.mean(axis=0)
        # False for NaN and for infinity, which clipped samples have.
        better = np.isfinite(light) & (light > brightest)
        brightest = np.where(better, light, brightest)
        colour = np.where(better, linear if less is None else linear - less(index), colour)
    return colour


def _reconstructed(
    linear: NDArray[np.float32], colour: NDArray[np.float32], known: NDArray[np.bool_]
) -> NDArray[np.float32]:
    clipped = linear == np.inf
    seen = np.where(clipped, 0.0, linear).sum(axis=0, dtype=np.float64)
    expected = np.where(clipped, 0.0, colour).sum(axis=0, dtype=np.float64)
    # All bands clipped: nothing is seen.
    possible = known & ~clipped.all(axis=0) & (expected > 0.0) & (seen > 0.0)
    scale = np.divide(seen, expected, out=np.zeros_like(seen), where=possible)
    return np.where(clipped & possible, colour * scale, linear).astype(np.float32)

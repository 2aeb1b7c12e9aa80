"""The pixels of a data set that a setting is measured on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impasto.fit.sbrdf import fit_sbrdf
from impasto.fit.subsample import stride_index, subsampled
from study.data_sets import PaintingData, Paintings

WIDTH = 32
"""Width of the picture that holds the pixels of a class."""


class TooFewError(Exception):
    """A data set has fewer such pixels, or photographs, than a setting needs."""


def whole(paintings: Paintings) -> Paintings:
    """All pixels."""
    return paintings


def strided(paintings: Paintings, *, stride: int) -> Paintings:
    """Every ``stride``-th pixel along both axes."""
    return tuple(_strided(painting, stride) for painting in paintings)


def _strided(painting: PaintingData, stride: int) -> PaintingData:
    normal = painting.normal
    window = stride_index(painting.stack.shape[2:], stride)
    return replace(
        painting,
        stack=subsampled(painting.stack, stride),
        held=painting.held[window],
        normal=None if normal is None else normal[window],
        truth=None,
    )


def repeated(paintings: Paintings, *, times: int) -> Paintings:
    """The first painting repeated along both axes: a picture of realistic size."""
    painting = paintings[0]
    stack, normal = painting.stack, painting.normal
    part = replace(
        painting,
        stack=stack._replace(samples=np.tile(stack.samples, (1, 1, times, times))),
        held=np.tile(painting.held, (1, 1, times, times)),
        normal=None if normal is None else np.tile(normal, (1, times, times)),
        truth=None,
    )
    return (part,)


def alike(paintings: Paintings, *, lobes: int) -> Paintings:
    """Pixels to which the standard effort gives this number of lobes, repeated to a picture.

    The picture has as many pixels as the first painting, on which fits are timed, so that the
    fixed cost per painting has the same weight.

    Raises
    ------
    TooFewError
        There are fewer than one in a hundred.
    """
    painting = paintings[0]
    stack = painting.stack
    fitted = fit_sbrdf(stack, pooling="pixel")
    y, x = np.nonzero(fitted.lobes == lobes)
    count = stack.shape[2] * stack.shape[3]
    if len(y) < 0.01 * count:
        raise TooFewError(f"only {len(y)} of {count} pixels")
    order = np.resize(np.arange(len(y)), max(count // WIDTH, 1) * WIDTH).reshape(-1, WIDTH)
    place = np.s_[..., y[order], x[order]]
    normal = painting.normal
    part = replace(
        painting,
        stack=stack._replace(samples=np.ascontiguousarray(stack.samples[place])),
        held=painting.held[place],
        normal=None if normal is None else normal[place],
        truth=None,
        share=len(y) / count,
    )
    return (part,)

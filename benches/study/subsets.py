"""Which pixels of a data set a setting is measured on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impasto.fit.sbrdf import fit_sbrdf
from impasto.thinning import every, thinned
from study.data_sets import PaintingData, Paintings

WIDTH = 32
"""Pixels of a class stand in rows of so many."""


class TooFewError(Exception):
    """A data set has fewer such pixels, or photographs, than a setting takes."""


def whole(paintings: Paintings) -> Paintings:
    """All of them."""
    return paintings


def strided(paintings: Paintings, *, stride: int) -> Paintings:
    """Every so many along both axes."""
    return tuple(_strided(painting, stride) for painting in paintings)


def _strided(specimen: PaintingData, stride: int) -> PaintingData:
    normal = specimen.normal
    window = every(specimen.stack.shape[2:], stride)
    return replace(
        specimen,
        stack=thinned(specimen.stack, stride),
        held=specimen.held[window],
        normal=None if normal is None else normal[window],
        truth=None,
    )


def repeated(paintings: Paintings, *, times: int) -> Paintings:
    """The first painting side by side, so often along both axes: a picture as large as people's."""
    specimen = paintings[0]
    stack, normal = specimen.stack, specimen.normal
    part = replace(
        specimen,
        stack=stack._replace(samples=np.tile(stack.samples, (1, 1, times, times))),
        held=np.tile(specimen.held, (1, 1, times, times)),
        normal=None if normal is None else np.tile(normal, (1, times, times)),
        truth=None,
    )
    return (part,)


def alike(paintings: Paintings, *, lobes: int) -> Paintings:
    """Those that the standard effort gives so many lobes, over and over in a picture as large.

    Of the first painting, on which fits are timed: as many pixels as it has, so that what a fit
    asks of a painting at first weighs as much.

    Raises
    ------
    TooFewError
        There are fewer than one in a hundred.
    """
    specimen = paintings[0]
    stack = specimen.stack
    fitted = fit_sbrdf(stack, pooling="pixel")
    y, x = np.nonzero(fitted.lobes == lobes)
    count = stack.shape[2] * stack.shape[3]
    if len(y) < 0.01 * count:
        raise TooFewError(f"only {len(y)} of {count} pixels")
    turns = np.resize(np.arange(len(y)), max(count // WIDTH, 1) * WIDTH).reshape(-1, WIDTH)
    place = np.s_[..., y[turns], x[turns]]
    normal = specimen.normal
    part = replace(
        specimen,
        stack=stack._replace(samples=np.ascontiguousarray(stack.samples[place])),
        held=specimen.held[place],
        normal=None if normal is None else normal[place],
        truth=None,
        share=len(y) / count,
    )
    return (part,)

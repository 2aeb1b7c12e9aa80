"""Regular subsamples of the pixels of a stack: systematic sampling [@cochran1977sampling]."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.stack import Stack

SPARSE = 4
"""A subsample with more pixels outside the mask than this multiple of the wanted ones is packed
into a smaller picture: pixels outside the mask also take memory in every map of a fit."""

LEARNED_PIXELS = 1 << 21
"""Most pixels that a model of a painting is learned from: sixty thousand determine the width and
the strength of one lobe to a thousandth, other numbers come from some thousands at most."""
LEARNED_SAMPLES = 1 << 28
"""Most samples of theirs, half a gigabyte of 16-bit codes."""

Window: TypeAlias = tuple[slice, slice]
"""Rows and columns of a picture."""


@dataclass(frozen=True)
class Sample:
    """Every so many rows and columns of a painting, as many before as after them.

    Attributes
    ----------
    stride
        Of so many rows and columns one is taken, an odd number.
    size
        Rows and columns of the painting.
    """

    stride: int
    size: tuple[int, int]

    @classmethod
    def to_learn(
        cls, size: tuple[int, int], planes: int, inside: Callable[[Sample], int]
    ) -> Sample:
        """The finest sample that a model is learned from.

        Parameters
        ----------
        size
            Rows and columns.
        planes
            Samples of a pixel.
        inside
            How many pixels within the mask a sample has.
        """
        most = max(1, min(LEARNED_PIXELS, LEARNED_SAMPLES // planes))
        there = inside(cls(1, size))
        stride = 1
        while stride**2 * most < there:
            stride += 2
        # The holes of a patterned mask may coincide with the stride.
        while stride > 1 and 2 * stride**2 * inside(cls(stride, size)) < there:
            stride -= 2
        # Narrow pictures, and pixels outside the mask, which take memory too.
        most *= 1 if there == math.prod(size) else SPARSE
        while cls(stride, size).count(None) > most:
            stride += 2
        return cls(stride, size)

    @classmethod
    def of(cls, stack: Stack) -> Sample:
        """What a model of a stack is learned from."""
        planes = math.prod(stack.shape[:2])
        return cls.to_learn(stack.shape[2:], planes, lambda some: some.count(stack.mask))

    @property
    def window(self) -> Window:
        """Its rows and columns, as slices of the painting's."""
        rows, columns = (self._along(length) for length in self.size)
        return rows, columns

    @property
    def shape(self) -> tuple[int, int]:
        """How many rows and columns it has."""
        rows, columns = (len(range(n)[i]) for n, i in zip(self.size, self.window, strict=True))
        return rows, columns

    def count(self, mask: NDArray[np.bool_] | None) -> int:
        """How many of its pixels lie within the mask of the painting."""
        return math.prod(self.shape) if mask is None else int(np.count_nonzero(mask[self.window]))

    def rig(self, rig: Rig) -> Rig:
        """The painting's rig for it: pixels are wider, and near lamps keep their places."""
        right, up = rig.origin
        pitch = None if rig.pitch_mm is None else rig.pitch_mm * self.stride
        return Rig(rig, pitch_mm=pitch, origin=(right / self.stride, up / self.stride))

    def taken(self, stack: Stack) -> Stack:
        """Its pixels of the painting's stack."""
        return stack if self.stride == 1 else stack._at(*self.window, rig=self.rig(stack.rig))

    def _along(self, length: int) -> slice:
        first = (length - 1) * ((self.stride + 1) // 2) % self.stride
        return slice(first if first < length else (length - 1) // 2, length, self.stride)


def checked_stride(stride: Any) -> int:
    """Of every how many rows and columns a model is learned, as a caller gave it.

    Raises
    ------
    ArgumentError
        No odd whole number from 1 on.
    """
    if not is_whole(stride) or stride < 1 or stride % 2 == 0:
        raise ArgumentError(
            f"sample: expected an odd number from 1 on (every third pixel: 3), found {stride!r}"
        )
    return int(stride)


def subsampled(stack: Stack, stride: int) -> Stack:
    """Every ``stride``-th pixel along both axes; the width of a pixel grows by the same factor."""
    return _cut(stack, _strided(_whole(stack), stride))


def subsampled_to(stack: Stack, pixels: int) -> Stack:
    """About ``pixels`` pixels inside the mask of a stack, at a regular stride.

    Without a mask there are at most ``pixels``. The holes of a patterned mask may coincide with the
    stride; a shorter stride is then used. Only the bounding box of the mask is sampled. If its
    pixels are few and scattered, they are packed into a smaller picture, unless lamps or cameras
    are near: their directions depend on the position of a pixel.
    """
    box, there = _box(stack), pixel_count(stack)
    share = there / _size(box)
    stride = max(1, math.ceil(math.sqrt(there / pixels)))
    # A narrow picture keeps more pixels than one in stride².
    while share * _size(_strided(box, stride)) > pixels:
        stride += 1
    while stride > 1:
        window = _strided(box, stride)
        if 2 * _pixel_count(stack, window) > share * _size(window):
            break
        stride -= 1
    window = _strided(box, stride)
    left = _pixel_count(stack, window)
    if _size(window) > SPARSE * max(pixels, left) and left and not _near(stack.rig):
        return _packed(stack, window)
    return _cut(stack, window)


def _near(rig: Rig) -> bool:
    return bool(rig.near.any() or rig.near_views.any())


def pixel_count(stack: Stack) -> int:
    """Number of pixels inside the mask."""
    return _pixel_count(stack, _whole(stack))


def stride_index(shape: tuple[int, int], stride: int) -> Any:
    """Index of every ``stride``-th pixel of an image ``(..., y, x)``.

    The margins at opposite edges are equal, so that the centre stays in place for near lamps.
    """
    height, width = shape
    return (..., *_strided((slice(0, height, 1), slice(0, width, 1)), stride))


def _whole(stack: Stack) -> Window:
    height, width = stack.shape[2:]
    return slice(0, height, 1), slice(0, width, 1)


def _box(stack: Stack) -> Window:
    """Bounding box of the mask; everything if the mask is empty."""
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


def _pixel_count(stack: Stack, window: Window) -> int:
    return _size(window) if stack.mask is None else int(np.count_nonzero(stack.mask[window]))


def _cut(stack: Stack, window: Window) -> Stack:
    """A window of the stack; its centre becomes the origin of the rig."""
    if window == _whole(stack):
        return stack
    pitch = stack.rig.pitch_mm
    rig = stack.rig
    if pitch is not None:
        (up, right), stride = _middle(stack, window), window[0].step
        rig = Rig(rig.seen_from(right * pitch, up * pitch), pitch_mm=pitch * stride)
    return stack._at(*window, rig=rig)


def _middle(stack: Stack, window: Window) -> tuple[float, float]:
    """Offset in pixels, up and right, from the centre of the picture to that of a window."""
    height, width = stack.shape[2:]
    rows, columns = (range(along.start, along.stop, along.step) for along in window)
    return (height - 1 - rows[0] - rows[-1]) / 2, (columns[0] + columns[-1] - width + 1) / 2


def _packed(stack: Stack, window: Window) -> Stack:
    """The pixels of a window inside the mask, row by row in a smaller picture."""
    assert stack.mask is not None
    rows, columns = np.nonzero(stack.mask[window])
    rows, columns = (
        along.start + along.step * at for along, at in zip(window, (rows, columns), strict=True)
    )
    there = len(rows)
    width = math.isqrt(there - 1) + 1
    # Copies fill the last row; they are outside the mask.
    places = np.minimum(np.arange(-(-there // width) * width), there - 1).reshape(-1, width)
    mask = (np.arange(places.size) < there).reshape(places.shape)
    return stack._at(rows[places], columns[places], mask=mask)

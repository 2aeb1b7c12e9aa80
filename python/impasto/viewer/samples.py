"""What was photographed at one pixel, and what its fit shows under the same lights.

The page draws both over the angle between the normal and the half vector of light and view
[@rusinkiewicz1998change], on which gloss depends. Only the pixel is read: of photographs in memory
and of a result a view, of a store and of files the part where it lies.
"""

from __future__ import annotations

import json
import math
import threading
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, offset
from impasto.errors import ArgumentError
from impasto.fit.relief import Relief
from impasto.fit.result import Sbrdf
from impasto.fit.stored import StoredSbrdf
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.surface import Surface
from impasto.viewer.scales import cut

DIGITS = 6
"""Of the numbers that the page gets; a sample of 16 bits has five."""
SHADOWED = 0.5
"""Share of the light that reaches a pixel below which its sample counts as one in shadow."""


@runtime_checkable
class Windows(Protocol):
    """Photographs of which a window can be had; those of a job are such (:mod:`impasto.jobs`)."""

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Observations, bands, rows and columns."""

    def window(self, rows: slice, columns: slice) -> Stack:
        """The photographs of a window; the stack knows where it lies."""


class _OfStack:
    """Of photographs in memory."""

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        self.shape = stack.shape

    def window(self, rows: slice, columns: slice) -> Stack:
        return self._stack[rows, columns]


Photographed = Stack | Windows


def checked_size(stack: Photographed, shape: tuple[int, int]) -> None:
    """Refuse photographs of another size.

    Raises
    ------
    ArgumentError
        They are no photographs of this painting.
    """
    if (size := stack.shape[2:]) != shape:
        raise ArgumentError(
            f"stack: expected photographs of {shape[0]} x {shape[1]} pixels, as the result has, "
            f"found {size[0]} x {size[1]}"
        )


class Samples:
    """The samples of single pixels, beside what a result predicts for them.

    Parameters
    ----------
    result
        A fit, a store or a surface, in the bands of the photographs.
    stack
        The photographs, of the same size.
    """

    def __init__(self, result: Sbrdf | StoredSbrdf | Surface, stack: Photographed) -> None:
        self._result = result
        self._stack = _OfStack(stack) if isinstance(stack, Stack) else stack
        self._reading = threading.Lock()

    @classmethod
    def of(cls, result: Any, stack: Photographed | None) -> Samples | None:
        """None where there are no photographs, or where a result is not in their bands."""
        if stack is None:
            return None
        known: int | None = None
        if isinstance(result, Sbrdf | StoredSbrdf):
            known = len(result.bands)
        elif isinstance(result, Surface):
            known = len(result.diffuse)
        return cls(result, stack) if known == stack.shape[1] else None

    def data(self, row: int, column: int) -> bytes:
        """JSON of one pixel.

        ``bands``: their names. ``ceiling``: of each band, from what light on samples are clipped,
        or null. ``angle``: of each photograph, in degrees, between normal and half vector; null
        where nothing was fitted. ``measured`` and ``fitted``: of each photograph and band linear
        light, a white board 1; null for what was not taken, or not fitted. ``clipped``: of each of
        them. ``shadowed``: of each photograph, whether the lamp is behind the pixel's horizon or
        hidden by the painting's own relief. ``residual``: root mean square of the differences of
        samples that are neither, relative to the brightest of these; null without any.

        Raises
        ------
        IndexError
            There is no such pixel.
        """
        rows, columns = self._stack.shape[2:]
        if not (0 <= row < rows and 0 <= column < columns):
            raise IndexError(f"no pixel {row}, {column} of {rows} x {columns}")
        part = slice(row, row + 1), slice(column, column + 1)
        # Files are read by one request after the other.
        with self._reading:
            taken = self._stack.window(*part)
            pixel = _Pixel(*self._fitted(part, taken.rig))
        return json.dumps(_facts(taken, pixel), allow_nan=False, separators=(",", ":")).encode()

    def _fitted(self, part: Window, rig: Rig) -> tuple[Any, Rig, Relief | None]:
        """The result of one pixel, its lights, and the relief that shadows it."""
        result = self._result
        if isinstance(result, Surface):
            right, up = offset(part, result.shape)
            x, y = result.origin
            return replace(cut(result, part), origin=(x + right, y + up)), rig, None
        one = result[part]
        # The relief of the whole remembers the shadows that it has computed.
        relief = one.relief and self._relief
        one = replace(one, relief=relief, residuals=None)
        return one, one.lamps(rig), relief

    @cached_property
    def _relief(self) -> Relief | None:
        result = self._result
        assert isinstance(result, Sbrdf | StoredSbrdf)
        return (result if isinstance(result, Sbrdf) else result[:1, :1]).relief


class _Pixel:
    """What a result of one pixel shows under some lights.

    Attributes
    ----------
    fitted
        ``(obs, band)`` linear light; NaN where nothing was fitted.
    angle
        ``(obs,)`` degrees between normal and half vector.
    shadowed
        ``(obs,)``
    """

    def __init__(self, one: Any, lights: Rig, relief: Relief | None) -> None:
        self.fitted: NDArray[np.float32] = one.predict(lights, threads=1)[:, :, 0, 0]
        normal = np.asarray(one.normal[:, 0, 0], np.float64)
        here = lights.here
        half = here.directions + here.views
        length = np.linalg.norm(half, axis=1)
        with np.errstate(invalid="ignore"):  # a lamp behind an eye has no half vector
            cosine = half @ normal / length
        self.angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        self.shadowed = ~(here.directions @ normal > 0.0)
        if relief is not None:
            self.shadowed |= relief.seen((1, 1), lights)[:, 0, 0] < SHADOWED


def _facts(taken: Stack, pixel: _Pixel) -> dict[str, Any]:
    linear = np.stack([taken.linear(number)[:, 0, 0] for number in range(len(taken.rig))])
    clipped = linear == np.inf
    measured = np.where(clipped, taken.ceiling, linear)
    outside = taken.mask is not None and not taken.mask[0, 0]
    usable = np.isfinite(measured) & np.isfinite(pixel.fitted) & ~clipped
    usable &= ~pixel.shadowed[:, None] & (not outside)
    residual = math.nan
    if usable.any() and (brightest := float(measured[usable].max())) > 0.0:
        differences = (pixel.fitted - measured)[usable].astype(np.float64)
        residual = math.sqrt(float(np.mean(differences**2))) / brightest
    return {
        "bands": list(taken.bands),
        "ceiling": _plain(taken.ceiling),
        "angle": _plain(pixel.angle),
        "measured": [_plain(one) for one in measured],
        "fitted": [_plain(one) for one in pixel.fitted],
        "clipped": clipped.tolist(),
        "shadowed": pixel.shadowed.tolist(),
        "residual": _plain(np.array([residual]))[0],
    }


def _plain(values: NDArray[Any]) -> list[float | None]:
    """Numbers of JSON; null for what is none."""
    return [float(f"{one:.{DIGITS}g}") if math.isfinite(one) else None for one in values.tolist()]

"""A picture for every direction of the light: what an RTI file holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import one_of
from impasto._internal.viewing import Viewable
from impasto.encoding import Encoding
from impasto.errors import ArgumentError
from impasto.io.rti.bases import Basis, Floats, unit_directions
from impasto.stack import Stack

Colourspace = Literal["rgb", "lrgb", "mrgb"]
"""``rgb``: planes per channel; ``lrgb``: planes of the luminance, times a colour; ``mrgb``:
coordinates in principal components."""
Coding = Literal["srgb", "linear"]

_ROWS = 1 << 18
"""Pixels that are lit at a time."""


@dataclass(frozen=True, eq=False, repr=False)
class RelightableImage(Viewable):
    """Reflectance transformation imaging (RTI): the picture as a sum of functions of the light.

    It has no normals and no reflection model: it shows what was photographed from one view, in the
    colours of the photographs. :meth:`values` shows it under a light; :meth:`stack` makes
    photographs of it, of which :func:`impasto.fit_normals` and :func:`impasto.fit_sbrdf` estimate
    normals and colours as far as the file goes.

    Attributes
    ----------
    planes
        ``(plane, y, x)`` uint8 as stored, row 0 at the top.
    scale, bias
        ``(plane,)``: a coefficient is ``scale * code + bias``; 1 is full white.
    basis
        The functions, in the order of ``Basis.values``.
    colourspace
        What the planes hold.
    coding
        ``"srgb"``: values are display codes, as in ``.ptm`` and ``.rti``; ``"linear"``: linear
        light. Files do not say; relight writes linear light.
    format
        What the file is, in words.
    colour
        ``(3, y, x)`` uint8, for ``lrgb``.
    components
        ``(plane + 1, function, 3)`` of ``mrgb``: the mean, then the components.
    lights
        ``(light, 3)`` directions of the photographs, if the file has them.
    pitch_mm
        Width of a pixel, if the file has it.
    notes
        What is odd about the file.
    """

    planes: NDArray[np.uint8]
    scale: Floats
    bias: Floats
    basis: Basis
    colourspace: Colourspace = "rgb"
    coding: Coding = "srgb"
    format: str = "RTI"
    colour: NDArray[np.uint8] | None = None
    components: Floats | None = None
    lights: Floats | None = None
    pitch_mm: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        one_of(self.colourspace, get_args(Colourspace), "colourspace")
        one_of(self.coding, get_args(Coding), "coding")
        count = len(self.planes)
        if self.planes.ndim != 3 or self.planes.dtype != np.uint8:
            raise ArgumentError("planes: expected uint8 (plane, y, x)")
        for name in ("scale", "bias"):
            if getattr(self, name).shape != (count,):
                raise ArgumentError(f"{name}: expected one number for each of {count} planes")
        terms = self.basis.terms
        expected = {"rgb": 3 * terms, "lrgb": terms}
        if count != expected.get(self.colourspace, count):
            raise ArgumentError(
                f"planes: {self.basis.kind} of {terms} terms in {self.colourspace} has "
                f"{expected[self.colourspace]} planes, found {count}"
            )
        if (self.colourspace == "lrgb") != (self.colour is not None):
            raise ArgumentError("colour: lrgb has one, no other colourspace has")
        if self.colourspace == "mrgb":
            shape = (count + 1, terms, 3)
            if self.components is None or self.components.shape != shape:
                raise ArgumentError(f"components: expected shape {shape}")

    @property
    def shape(self) -> tuple[int, int]:
        """``(y, x)``."""
        _, rows, columns = self.planes.shape
        return rows, columns

    def pixels(self, at: NDArray[np.intp]) -> RelightableImage:
        """Some pixels by their flat numbers, as a picture of one column."""

        def some(planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
            return np.ascontiguousarray(planes.reshape(len(planes), -1)[:, at, None])

        colour = None if self.colour is None else some(self.colour)
        return replace(self, planes=some(self.planes), colour=colour)

    def values(self, lights: ArrayLike) -> NDArray[np.float32]:
        """The picture under each of some lights, in the coding of the file, 1 is white.

        Parameters
        ----------
        lights
            ``(light, 3)`` or ``(3,)`` directions towards the light.

        Returns
        -------
        ndarray
            ``(light, 3, y, x)`` float32, not clipped.

        Raises
        ------
        ArgumentError
            A light behind the picture.
        """
        weights, offset = self._weights(lights)
        count = len(weights)
        flat = self.planes.reshape(len(self.planes), -1)
        # A coefficient's scale and bias go into the few weights, not into the many pixels.
        operator = np.asarray(weights * self.scale[None, :, None], dtype=np.float32)
        offset = offset + np.einsum("lpk,p->lk", weights, self.bias)
        mixed = np.moveaxis(operator, 2, 1).reshape(count * 3, -1)
        shown = np.empty((count * 3, flat.shape[1]), np.float32)
        for first in range(0, flat.shape[1], _ROWS):
            part = flat[:, first : first + _ROWS].astype(np.float32)
            shown[:, first : first + _ROWS] = mixed @ part
        found = shown.reshape(count, 3, *self.shape)
        found += offset[..., None, None].astype(np.float32)
        if self.colour is not None:
            found *= self.colour.astype(np.float32) / np.float32(255.0)
        return found

    def linear(self, lights: ArrayLike) -> NDArray[np.float32]:
        """As :meth:`values`, clipped to 0..1, in linear light."""
        found = np.clip(self.values(lights), 0.0, 1.0)
        if self.coding == "linear":
            return found
        return np.asarray(Encoding("srgb").decode(found), dtype=np.float32)

    def display(self, light: ArrayLike) -> NDArray[np.uint8]:
        """``(y, x, 3)`` sRGB codes under one light."""
        found = np.clip(self.values(light)[0], 0.0, 1.0)
        if self.coding == "linear":
            found = np.asarray(Encoding("srgb").encode(found), dtype=np.float32)
        codes: NDArray[np.uint8] = np.rint(255.0 * found).astype(np.uint8)
        return np.moveaxis(codes, 0, -1)

    def _weights(self, lights: ArrayLike) -> tuple[Floats, Floats]:
        """``(light, plane, 3)`` weights of coefficients, and ``(light, 3)`` without any plane."""
        functions = self.basis.values(lights)
        count, planes = len(functions), len(self.planes)
        weights = np.zeros((count, planes, 3))
        offset = np.zeros((count, 3))
        if self.colourspace == "rgb":
            for channel in range(3):
                weights[:, channel::3, channel] = functions
        elif self.colourspace == "lrgb":
            weights[:] = functions[..., None]
        else:
            assert self.components is not None
            mixed = np.einsum("lf,pfk->lpk", functions, self.components)
            offset, weights = mixed[:, 0], mixed[:, 1:]
        return weights, offset

    def stack(self, lights: ArrayLike | None = None) -> Stack:
        """Photographs of it, for the fits: what it shows under lights, as linear light.

        Values are relative to the brightest that the file can hold, not to a white board, and
        shadows and highlights are as smooth as its functions.

        Parameters
        ----------
        lights
            ``(light, 3)``; default: its own lights, or 40 of a dome where the file has none.

        Raises
        ------
        ArgumentError
            Directions that cannot be used.
        """
        at = self.photographed if lights is None else unit_directions(lights)
        return Stack(self.linear(at), lights=at, bands=("red", "green", "blue"))

    @cached_property
    def photographed(self) -> Floats:
        """Its own lights, or 40 of a dome where the file has none: ``(light, 3)``."""
        return dome(40) if self.lights is None else unit_directions(self.lights)

    def luminance_maximum(self) -> NDArray[np.float32]:
        """Normals from the light in which a polynomial is brightest [@malzbender2001polynomial].

        Returns
        -------
        ndarray
            ``(3, y, x)`` unit vectors of the mean of the channels; NaN where the polynomial has no
            maximum over the hemisphere. Highlights pull it towards the light that they mirror;
            :meth:`stack` and a robust fit do better.

        Raises
        ------
        ArgumentError
            The functions are no polynomial.
        """
        if self.basis.kind != "ptm" or self.colourspace not in {"rgb", "lrgb"}:
            raise ArgumentError("luminance_maximum: only a polynomial texture map has one")
        channels = 1 if self.colourspace == "lrgb" else 3
        rows, columns = self.shape
        planes = self.planes.reshape(6, channels, rows, columns)
        scale, bias = (one.reshape(6, channels) for one in (self.scale, self.bias))
        _, x, y, xx, xy, yy = (
            np.einsum("cyx,c->yx", planes[term].astype(np.float64), scale[term]) + bias[term].sum()
            for term in range(6)
        )
        determinant = 4.0 * xx * yy - xy * xy
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (xy * y - 2.0 * yy * x) / determinant
            v = (xy * x - 2.0 * xx * y) / determinant
            rest = 1.0 - u * u - v * v
            known = (determinant > 0.0) & (xx < 0.0) & (rest > 0.0)
            found = np.stack([u, v, np.sqrt(np.where(known, rest, np.nan))])
        found[:, ~known] = np.nan
        return found.astype(np.float32)

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<RelightableImage {columns} x {rows} pixels, {self.format}>"

    def report(self) -> dict[str, object]:
        """What it is, for people."""
        rows, columns = self.shape
        names = {
            "ptm": "polynomial texture map",
            "hsh": "hemispherical harmonics",
            "sh": "spherical harmonics",
            "rbf": "radial functions",
        }
        values = "display codes" if self.coding == "srgb" else "linear light"
        facts: dict[str, object] = {
            "format": self.format,
            "size": f"{columns} x {rows} pixels",
            "basis": f"{names[self.basis.kind]}, {self.basis.terms} functions",
            "colours": f"{self.colourspace}, {values}",
            "planes": f"{len(self.planes)} of 8 bits",
        }
        if self.lights is not None:
            facts["lights"] = len(self.lights)
        if self.pitch_mm is not None:
            facts["pitch_mm"] = self.pitch_mm
        if self.notes:
            facts["notes"] = list(self.notes)
        return facts

    def _repr_html_(self) -> str:
        """HTML for notebooks: what it is, and pictures in two lights."""
        from impasto.notebook import relightable_view

        return relightable_view(self)


def dome(count: int) -> Floats:
    """Directions spread evenly over the hemisphere, 10 degrees and more above its edge.

    Points of the golden spiral: equal steps of z, azimuths that never repeat.
    """
    index = np.arange(count) + 0.5
    z = 1.0 - (1.0 - np.sin(np.radians(10.0))) * index / count
    azimuth = index * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)

"""Maps of a painting as textures: normals, colours and one lobe, in numbers that a format holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.encoding import Encoding
from impasto.export.lobes import Distribution, OneLobe, one_lobe
from impasto.export.loss import LIGHTS
from impasto.export.source import Map, Source

FLAT = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Textures:
    """A painting in the maps of a facet model.

    Attributes
    ----------
    normal
        ``(3, y, x)`` unit vectors: x right, y up, z towards the viewer (the OpenGL convention);
        straight ahead where unknown.
    diffuse
        ``(3, y, x)`` linear sRGB, 0 where unknown; with the ambient light that formats have no
        place for.
    lobe
        Width and strength of the highlight.
    """

    normal: Map
    diffuse: Map
    lobe: OneLobe

    @property
    def head_on(self) -> Map:
        """``(3, y, x)`` reflectance of the facets at normal incidence, at most 1."""
        return np.asarray(np.clip(self.lobe.specular * np.float32(self.lobe.head_on), 0.0, 1.0))


def textures(source: Source, distribution: Distribution) -> Textures:
    """The maps of a painting, its lobes replaced by the nearest one of a distribution."""
    return Textures(normals(source), colours(source), one_lobe(source.surface, distribution))


def normals(source: Source) -> Map:
    """``(3, y, x)`` unit vectors, straight ahead where unknown."""
    found = np.array(source.surface.normal, dtype=np.float32)
    found[:, ~source.known] = np.array(FLAT, np.float32)[:, None]
    return found


def colours(source: Source) -> Map:
    """``(3, y, x)`` linear sRGB with the ambient light, 0 where unknown."""
    lit = source.surface
    found = lit.diffuse
    if lit.ambient is not None:
        found = found + np.float32(_diffuse_of_ambient()) * lit.ambient
    return np.where(source.known, np.maximum(found, 0.0), 0.0).astype(np.float32)


def _diffuse_of_ambient() -> float:
    """How much diffuse colour is nearest to a constant light, by least squares.

    Of a flat panel under the lights from the front by which losses are measured.
    """
    cosine = np.sin(np.radians([elevation for _, elevation in LIGHTS]))
    return float(cosine.sum() / np.square(cosine).sum())


def coded_normals(normal: Map, bits: int = 8) -> NDArray[Any]:
    """``(3, y, x)`` codes ``(n + 1) / 2`` of normals."""
    full = (1 << bits) - 1
    codes = np.rint((np.clip(normal, -1.0, 1.0) + 1.0) / 2.0 * full)
    return np.asarray(codes, dtype=np.uint8 if bits == 8 else np.uint16)


def decoded_normals(codes: NDArray[Any]) -> Map:
    """Unit vectors of codes, as programs decode them."""
    full = np.iinfo(codes.dtype).max
    found = 2.0 * codes.astype(np.float32) / np.float32(full) - 1.0
    length = np.linalg.norm(found, axis=0, keepdims=True)
    return np.asarray(found / np.maximum(length, 1e-6), dtype=np.float32)


def coded_srgb(linear: Map) -> NDArray[np.uint8]:
    """8-bit sRGB codes of linear light, clipped to 0..1."""
    coded = Encoding("srgb").encode(np.clip(linear, 0.0, 1.0))
    return np.asarray(np.rint(255.0 * np.asarray(coded)), dtype=np.uint8)


def decoded_srgb(codes: NDArray[np.uint8]) -> Map:
    """Linear light of 8-bit sRGB codes."""
    table = np.asarray(Encoding("srgb").decode(np.arange(256) / 255.0), dtype=np.float32)
    return np.asarray(table[codes])


def coded_linear(values: Map) -> NDArray[np.uint8]:
    """8-bit codes of numbers from 0 to 1."""
    return np.asarray(np.rint(255.0 * np.clip(values, 0.0, 1.0)), dtype=np.uint8)

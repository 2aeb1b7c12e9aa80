"""What programs for a format compute from its maps: only to measure the loss of a written file.

These are the formulas of the formats' own specifications, for the pixels that are compared; the
painting itself is always lit by the core. All give light relative to a white board in full light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.export.rough_interface import fresnel, rough_interface, smith_beckmann
from impasto.export.source import Direction, Map

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Angles:
    """Cosines ``(n,)`` between normal, light, view and half vector; none negative."""

    nl: Floats
    nv: Floats
    nh: Floats
    vh: float

    @classmethod
    def of(cls, normal: Map, light: Direction, view: Direction | None) -> Angles:
        """Of normals ``(3, n)``; the view is the front by default."""
        to_light, to_eye = np.asarray(light), np.asarray(view or (0.0, 0.0, 1.0))
        half = to_light + to_eye
        half /= np.linalg.norm(half)
        unit = normal.astype(np.float64)
        nl, nv, nh = (np.clip(one @ unit, 0.0, 1.0) for one in (to_light, to_eye, half))
        return cls(nl, np.maximum(nv, 1e-6), nh, float(np.clip(half @ to_eye, 0.0, 1.0)))

    @property
    def tangent_squared(self) -> Floats:
        """Of the half vector's tilt."""
        cosine = np.maximum(self.nh, 1e-6) ** 2
        return np.asarray((1.0 - cosine) / cosine)


def ggx(base: Map, head_on: Map, alpha: Map, at: Angles, *, weight: float | Map = 1.0) -> Map:
    """The dielectric of glTF 2.0, appendix B, with KHR_materials_specular; also UsdPreviewSurface.

    Trowbridge-Reitz facets, the joint Smith shadowing of both directions, Schlick's Fresnel
    [@schlick1994inexpensive] from ``head_on (3, n)`` to ``weight``; the diffuse part gets what the
    brightest channel of the interface lets through.
    """
    squared = np.square(np.maximum(alpha, 1e-3).astype(np.float64))
    distribution = squared / (np.pi * np.square(np.square(at.nh) * (squared - 1.0) + 1.0))
    seen = at.nl * np.sqrt(np.square(at.nv) * (1.0 - squared) + squared)
    lit = at.nv * np.sqrt(np.square(at.nl) * (1.0 - squared) + squared)
    visible = 0.5 / np.maximum(seen + lit, 1e-12)
    fresnel = head_on + (weight - head_on) * (1.0 - at.vh) ** 5
    through = 1.0 - np.max(fresnel, axis=0)
    light = (base * through + np.pi * fresnel * distribution * visible) * at.nl
    return np.asarray(light, dtype=np.float32)


def ward(diffuse: Map, specular: Map, alpha: Map, front: Angles, ambient: float) -> Map:
    """OpenLIME's BRDF layer: Ward's lobe [@ward1992measuring], seen from the front.

    It divides ``kd`` by pi; here its light is multiplied by pi again.
    """
    width = np.square(alpha.astype(np.float64))
    product = front.nl * front.nv
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        lobe = np.exp(-front.tangent_squared / width) / (4.0 * np.pi * width * np.sqrt(product))
    lobe = np.where((product > 0.0) & (width * np.square(front.nh) >= 1e-5), lobe, 0.0)
    light = (diffuse / np.pi + specular * lobe) * front.nl + diffuse / np.pi * ambient
    return np.asarray(np.pi * light, dtype=np.float32)


def rough_plastic(diffuse: Map, specular: Map, alpha: float, index: float, at: Angles) -> Map:
    """Mitsuba's ``roughplastic`` with Beckmann facets [@walter2007microfacet].

    The diffuse part crosses the rough interface twice, and again and again from inside.
    """
    interface = rough_interface(alpha, index)
    crossed = interface.crossing(at.nl) * interface.crossing(at.nv) / index**2
    matte = diffuse / (1.0 - interface.inside)
    cosine = np.maximum(at.nh, 1e-6)
    with np.errstate(under="ignore"):
        lobe = np.exp(-at.tangent_squared / alpha**2) / (np.pi * alpha**2 * cosine**4)
    shadowed = smith_beckmann(at.nl, alpha) * smith_beckmann(at.nv, alpha)
    mirror = float(fresnel(np.asarray([at.vh]), index)[0])
    shine = np.pi * specular * mirror * lobe * shadowed / (4.0 * at.nv)
    return np.asarray(matte * crossed * at.nl + np.where(at.nl > 0.0, shine, 0.0), np.float32)

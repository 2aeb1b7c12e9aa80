"""The gloss of a simulated painting as Lafortune lobes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impasto.simulate.fields import Field
from impasto.simulate.paintings import Painting

INTERFACE = 0.0337
"""Fresnel reflectance of a dielectric of index 1.45 at normal incidence."""

PAINT = (0.3, -0.92, 5.0)
"""The directional lobe of paint: share of the diffuse colour, Cxy, exponent."""

HAZE = (0.2, 0.25, -0.97)
"""The halo of a gloss varnish: share of its lobe's strength and of its exponent, and Cxy."""


@dataclass(frozen=True, eq=False)
class Lobes:
    """The true lobes for :func:`impasto.fit_sbrdf` with ``model="lafortune"``, sharpest first.

    Attributes
    ----------
    specular
        ``(lobe, band, y, x)`` float32 strength; 0 where a pixel has fewer lobes.
    cxy, cz, exponent
        ``(lobe, y, x)`` float32, ``cxy**2 + cz**2 = 2``; the mirror lobe is (-1, 1).
    """

    specular: Field
    cxy: Field
    cz: Field
    exponent: Field


def lobes(painting: Painting, diffuse: Field) -> Lobes:
    """Lobes of a painting whose diffuse reflectance ``(band, y, x)`` is known.

    As the third paper describes them (section 4): a varnish reflects specularly, in the colour of
    the light; the paint itself has a directional diffuse lobe in its own colour. A gloss varnish
    also has a halo. One lobe without varnish, two under matte and satin, three under gloss.

    A coat's lobe has the width and the height of the Torrance-Sparrow lobe (beta, gamma) that the
    painting has otherwise: ``n = ln 2 / (-4 ln cos gamma)``, strength ``beta F(0)``. Only the top
    coat counts.
    """
    bands = len(diffuse)
    beta, gamma = painting.beta[0], painting.gamma[0]
    glossy = painting.masks["gloss"]
    varnished = beta > 0.0
    share, paint_cxy, paint_exponent = PAINT
    haze_share, haze_exponent, haze_cxy = HAZE
    sharp = -np.log(2.0) / (4.0 * np.log(np.cos(gamma)))
    interface = INTERFACE * beta
    strength = np.stack([interface, np.where(glossy, haze_share * interface, 0.0)])
    specular = np.empty((3, bands, *painting.size), np.float32)
    specular[:2] = strength[:, None]
    specular[2] = share * diffuse
    exponent = np.empty((3, *painting.size), np.float32)
    exponent[0], exponent[1], exponent[2] = sharp, haze_exponent * sharp, paint_exponent
    cxy = np.empty_like(exponent)
    cxy[0], cxy[1], cxy[2] = -1.0, haze_cxy, paint_cxy
    # The sharpest first, empty entries last, as in the result of a fit.
    there = np.stack([varnished, varnished & glossy, np.ones_like(varnished)])
    order = np.argsort(np.where(there, -exponent, 0.0), axis=0, kind="stable")
    cxy, exponent = (np.take_along_axis(map_, order, axis=0) for map_ in (cxy, exponent))
    specular = np.take_along_axis(specular, order[:, None], axis=0)
    return Lobes(specular, cxy, np.sqrt(np.float32(2.0) - cxy * cxy), exponent)

"""A yellowed painting under a glossy varnish that is taken off in a patch, and what is true of it.

Colours and normals of both states are those of the simulation; nothing of ``impasto.comparison`` is
used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto import simulate
from impasto.colour import delta_e, lab_from_xyz

CAMERA = simulate.camera("rgb")
LIGHTS = simulate.rig("tominaga-six-band-adaptation").directions
BETA, GAMMA = 3.0, 0.2
"""Wide enough a lobe for sixteen lamps, and strong enough to be seen."""
NOISE = 0.002
"""Standard deviation of a sample, white board 1: a camera at base sensitivity."""
XYZ_FROM_SRGB = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""IEC 61966-2-1, to four digits: a colour is off by less than 0.01 dE00."""


@dataclass(frozen=True, eq=False)
class CleanedPainting:
    """Both states.

    Attributes
    ----------
    before, after
        The surfaces.
    patch
        ``(y, x)``: where the varnish was taken off.
    angle
        ``(y, x)`` radians between the normals of both: varnish levels the relief.
    delta_e
        ``(y, x)`` dE00 between the diffuse colours.
    """

    before: impasto.Surface
    after: impasto.Surface
    patch: NDArray[np.bool_]
    angle: NDArray[np.float64]
    delta_e: NDArray[np.float64]


def cleaned_painting(
    size: tuple[int, int], patch: NDArray[np.bool_], seed: int = 3
) -> CleanedPainting:
    """The painting of a seed with its varnish, and without it in the patch."""
    old, bare = (
        simulate.painting(seed, size, varnish=kind, yellowing=yellow, relief=0.6, glazes=False)
        for kind, yellow in (("gloss", 1.0), (None, 0.0))
    )
    colours = [one.reflectance_in(CAMERA) for one in (old, bare)]
    normal = np.where(patch, bare.normal, old.normal)
    diffuse = np.where(patch, colours[1], colours[0])
    beta = np.where(patch, 0.0, BETA).astype(np.float32)
    labs = [
        lab_from_xyz((XYZ_FROM_SRGB @ one.reshape(3, -1)).reshape(one.shape))
        for one in (colours[0], diffuse)
    ]
    cosine = np.sum(old.normal * normal, axis=0, dtype=np.float64)
    return CleanedPainting(
        impasto.Surface.torrance_sparrow(old.normal, colours[0], BETA, GAMMA),
        impasto.Surface.torrance_sparrow(normal, diffuse, beta, GAMMA),
        patch,
        np.arccos(np.clip(cosine, -1.0, 1.0)),
        delta_e(*labs),
    )


def photographed(surface: impasto.Surface, seed: int) -> impasto.Stack:
    """Sixteen photographs with noise of their own."""
    rng = np.random.default_rng(seed)
    shown = surface.predict(LIGHTS)
    noise = rng.normal(scale=NOISE, size=shown.shape).astype(np.float32)
    return impasto.Stack(shown + noise, lights=LIGHTS, bands=CAMERA.bands)


def fitted(surface: impasto.Surface, seed: int) -> impasto.Sbrdf:
    """With a lobe of its own for every pixel."""
    return impasto.fit_sbrdf(photographed(surface, seed), pooling="pixel", lobes=1, ambient=False)

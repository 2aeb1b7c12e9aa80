"""Glazes, cracks and varnish of a simulated painting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.simulate.fields import Field, blur, fractal, noise, smoothstep
from impasto.simulate.pigments import WAVELENGTHS

NONE, MATTE, SATIN, GLOSS = range(4)
"""Classes of the varnish map."""

GAMMA: dict[int, float] = {MATTE: 0.30, SATIN: 0.12, GLOSS: 0.075}
"""Half-width of the facets' tilt in radians; 0.075 is from the RGB-camera paper."""

COAT_SHARE = (1.0, 0.35, 0.2)
"""Reflectance of the first, second and third coat from the top, relative to a full interface with
air: lower ones show where the upper is thin."""


def normals(height: Field, pitch_mm: float) -> Field:
    """Unit normals ``(3, y, x)`` of a height map in mm by central differences.

    World frame (x right, y up, z to the viewer; row 0 on top). With h(row, col) and pitch p::

        dh/dx = (h(row, col + 1) - h(row, col - 1)) / (2 p)
        dh/dy = (h(row - 1, col) - h(row + 1, col)) / (2 p)
        N = (-dh/dx, -dh/dy, 1) / |.|

    one-sided at the border, 0 along an axis of one pixel.
    """
    slopes = [
        np.gradient(height.astype(np.float64), pitch_mm, axis=axis)
        if height.shape[axis] > 1
        else np.zeros(height.shape)
        for axis in (1, 0)
    ]
    normal = np.stack([-slopes[0], slopes[1], np.ones(height.shape)])
    return np.asarray(normal / np.linalg.norm(normal, axis=0), dtype=np.float32)


def beta_of(gamma: float) -> float:
    """Strength of a smooth dielectric interface whose facets have half-width ``gamma`` (rad).

    The papers' D is not normalised, so beta carries the normalisation. A microfacet coat reflects
    pi D_n F G / (4 N.V) of what a white board does, with D_n = D ln 2 / (pi gamma^2) the density
    of facets (small angles): beta = ln 2 / (4 gamma^2). A gloss of 0.075 rad peaks at 1.04 times
    white, a satin of 0.12 rad at 0.41.
    """
    return float(np.log(2.0) / (4.0 * gamma * gamma))


def glaze_depth(rng: np.random.Generator, height: Field, dark: Field, pitch_mm: float) -> Field:
    """Optical depth ``(y, x)`` of a glaze: on dark paint, deeper in hollows."""
    patches = smoothstep(
        -0.2, 1.0, fractal(rng, height.shape, 0.22 * float(np.sqrt(height.size)), 3)
    )
    hollow = blur(height, 0.8 / pitch_mm) - height
    pooled = np.clip(1.0 + 14.0 * hollow, 0.2, 2.5)
    return np.asarray(dark * (0.25 + 0.75 * patches) * pooled, dtype=np.float32)


@dataclass(frozen=True)
class Varnish:
    """The varnish on a painting.

    Attributes
    ----------
    kind
        ``(y, x)`` uint8: NONE, MATTE, SATIN, GLOSS.
    beta, gamma
        ``(coat, y, x)``, the top coat first.
    thickness
        ``(y, x)`` relative thickness of all coats, for yellowing.
    """

    kind: NDArray[np.uint8]
    beta: Field
    gamma: Field
    thickness: Field


def varnish(
    rng: np.random.Generator, shape: tuple[int, int], kind: str | None, layers: int
) -> Varnish:
    """Varnish of one kind everywhere, or patches of all three."""
    classes = {None: NONE, "matte": MATTE, "satin": SATIN, "gloss": GLOSS}
    unit = float(np.sqrt(shape[0] * shape[1]))
    if kind == "patches":
        # Old varnish cleaned off, sunk in, or renewed.
        field = fractal(rng, shape, 0.34 * unit, 3)
        order = np.argsort(field, axis=None, kind="stable")
        label = np.empty(field.size, dtype=np.uint8)
        for band, part in zip((MATTE, SATIN, GLOSS), np.array_split(order, 3), strict=True):
            label[part] = band
        label = label.reshape(shape)
    else:
        label = np.full(shape, classes[kind], dtype=np.uint8)
    gamma = np.full((layers, *shape), 0.2, dtype=np.float32)
    beta = np.zeros((layers, *shape), dtype=np.float32)
    for coat in range(layers):
        for value, width in GAMMA.items():
            # An older, lower coat is rougher.
            rough = width * 1.5**coat
            gamma[coat][label == value] = rough
            beta[coat][label == value] = COAT_SHARE[coat] * beta_of(rough)
    uneven = 1.0 + 0.25 * noise(rng, shape, (0.04 * unit, 0.4 * unit))
    thickness = np.where(label == NONE, 0.0, layers * np.clip(uneven, 0.3, None))
    return Varnish(label, beta, gamma, thickness.astype(np.float32))


def levelled(height: Field, layers: int, pitch_mm: float) -> Field:
    """The relief under ``layers`` coats of varnish; each partly fills the finest hollows."""
    for _ in range(layers):
        soft = blur(height, 0.22 / pitch_mm)
        height = height + np.float32(0.15) * (soft - height)
    return np.asarray(height, dtype=np.float32)


def yellow(strength: float) -> NDArray[np.float64]:
    """Absorption ``(n,)`` of an aged resin at unit thickness, on the simulated wavelengths."""
    return np.asarray(strength * 0.30 * np.exp(-(WAVELENGTHS - 400.0) / 75.0))


def cracks(
    rng: np.random.Generator, shape: tuple[int, int], pitch_mm: float
) -> tuple[Field, Field]:
    """Craquelure: change of height in mm and darkness 0 .. 1, both ``(y, x)``.

    Two generations of Voronoi-like islands with wandering borders: wide old cracks, and hair
    cracks that come and go inside them. Islands cup: their rims stand up.
    """
    import cv2

    depth = np.zeros(shape, dtype=np.float32)
    darkness = np.zeros(shape, dtype=np.float32)
    for island_mm, width_mm, fall_mm, share in ((15.0, 0.13, 0.09, 0.80), (6.0, 0.08, 0.04, 0.28)):
        cell = max(island_mm / pitch_mm, 4.0)
        rows, columns = int(shape[0] / cell) + 3, int(shape[1] / cell) + 3
        shift = rng.random((2, rows, columns))
        seed_y = ((np.arange(rows)[:, None] - 1 + shift[0]) * cell).astype(np.float32)
        seed_x = ((np.arange(columns)[None, :] - 1 + shift[1]) * cell).astype(np.float32)
        margin = int(2 * cell)
        sites = np.full((shape[0] + 2 * margin, shape[1] + 2 * margin), 255, dtype=np.uint8)
        at_y = np.clip(seed_y + margin, 0, sites.shape[0] - 1).astype(int).ravel()
        at_x = np.clip(seed_x + margin, 0, sites.shape[1] - 1).astype(int).ravel()
        sites[at_y, at_x] = 0
        _, label = cv2.distanceTransformWithLabels(
            sites, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        wander = 0.10 * cell
        map_y, map_x = np.indices(shape, dtype=np.float32)
        map_y += margin + wander * fractal(rng, shape, 0.6 * cell, 4)
        map_x += margin + wander * fractal(rng, shape, 0.6 * cell, 4)
        island = cv2.remap(
            label.astype(np.float32),
            map_x,
            map_y,
            cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_REPLICATE,
        )
        border = np.zeros(shape, dtype=bool)
        border[:-1] |= island[:-1] != island[1:]
        border[:, :-1] |= island[:, :-1] != island[:, 1:]
        away = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 5) * pitch_mm
        # A picture inside one island has no border: cv2 then returns the largest float.
        away = np.minimum(away, 1e3)
        strength = smoothstep(-0.9, 0.2, fractal(rng, shape, 2.2 * cell, 2) + (share - 0.5) * 2.0)
        gap = np.exp(-((away / (0.5 * width_mm)) ** 2)) * strength
        rim = np.exp(-((away / (0.09 * island_mm)) ** 2)) * strength
        depth += (0.035 * island_mm / 15.0 * rim - fall_mm * gap).astype(np.float32)
        darkness = np.maximum(darkness, gap.astype(np.float32))
    return depth, darkness

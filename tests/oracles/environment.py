"""Environment light by brute force in plain float64 numpy.

A map over longitude and latitude is so many distant lights: one per texel in front of the painting,
from its middle, of irradiance radiance times solid angle. The reflection models are those of
``forward.py`` and ``lafortune_forward.py`` in the form of single facets: for one texel at a time an
integral over a map takes minutes.
"""

from __future__ import annotations

import numpy as np

from oracles.forward import INDEX, fresnel, transmittance


def texels(radiance, rotation=None):
    """Directions ``(m, 3)`` and light ``(m, 3)`` of a map ``(3, y, x)`` in front of z = 0."""
    radiance = np.asarray(radiance, np.float64)
    _, rows, columns = radiance.shape
    colatitude = np.linspace(0.0, np.pi, rows + 1)
    solid = (np.cos(colatitude[:-1]) - np.cos(colatitude[1:])) * 2.0 * np.pi / columns
    middle = 0.5 * (colatitude[:-1] + colatitude[1:])
    # From the middle column, in front, to the right as seen from the painting: to -x.
    azimuth = (np.arange(columns) + 0.5) * 2.0 * np.pi / columns - np.pi
    polar, around = np.meshgrid(middle, azimuth, indexing="ij")
    towards = np.stack(
        [-np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    )
    light = np.moveaxis(radiance, 0, -1) * solid[:, None, None]
    towards, light = towards.reshape(-1, 3), light.reshape(-1, 3)
    if rotation is not None:
        towards = towards @ np.asarray(rotation).T
    front = towards[:, 2] > 0.0
    return towards[front], light[front]


def irradiance(normals, sky, coated=False, view=(0.0, 0.0, 1.0)):
    """``(p, 3)`` of normals ``(p, 3)``."""
    towards, light = sky
    cosine = np.clip(normals @ towards.T, 0.0, 1.0)
    if not coated:
        return cosine @ light
    leaving = transmittance(np.arccos(np.clip(normals @ np.asarray(view), 0.0, 1.0)))
    return (cosine * transmittance(np.arccos(cosine))) @ light * leaving[:, None]


def lafortune(normals, view, cxy, cz, exponent, sky):
    """``(p, 3)`` of a lobe of unit strength; parameters are numbers or ``(p,)``."""
    towards, light = sky
    view = np.asarray(view, np.float64)
    n_l, n_v = normals @ towards.T, (normals @ view)[:, None]
    upright = n_l * n_v
    flat = (towards @ view)[None] - upright
    cxy, cz, exponent = (np.reshape(p, (-1, 1)) for p in (cxy, cz, exponent))
    base = np.maximum(cxy * flat + cz * upright, 0.0)
    return np.where(n_v > 0.0, base**exponent * np.maximum(n_l, 0.0), 0.0) @ light


def torrance_sparrow(normals, view, gamma, sky, index=INDEX):
    """``(p, 3)`` of a lobe of unit strength; gamma is a number or ``(p,)``."""
    towards, light = sky
    view = np.asarray(view, np.float64)
    half = towards + view
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    v_h = half @ view
    n_l, n_v, n_h = normals @ towards.T, (normals @ view)[:, None], normals @ half.T
    phi = np.arccos(np.clip(n_h, -1.0, 1.0))
    facets = np.exp(-np.log(2.0) * (phi / np.reshape(gamma, (-1, 1))) ** 2)
    masking = np.minimum(1.0, 2.0 * n_h * np.minimum(n_v, n_l) / v_h)
    value = facets * fresnel(np.arccos(np.clip(v_h, -1.0, 1.0)), index) * masking / n_v
    return np.where((n_l > 0.0) & (n_v > 0.0), value, 0.0) @ light

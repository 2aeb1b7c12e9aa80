"""An independent forward model in plain float64 numpy, written from the papers alone.

Equation numbers: Tominaga & Tanaka's six-band paper eq. 1 = RGB-camera paper eq. 9,

    Y = (N.L) S E + beta D(phi, gamma) F(theta, n) G / (N.V) E,
    D = exp(-ln 2 phi^2 / gamma^2),

phi the angle between N and the bisector H of L and V, G the attenuation of Torrance & Sparrow's
V-grooves, F Fresnel's reflectance of unpolarised light at a dielectric of index n, theta the
incidence on the facet. All angles by arccos and arcsin: this file is to be right, not fast.

``coated`` multiplies the first term by what a smooth dielectric interface transmits of the light on
its way in and, scattered, on its way out, relative to normal incidence (Wolff, Diffuse-reflectance
model for smooth dielectric surfaces, JOSA A 11, 1994).
"""

from __future__ import annotations

import numpy as np

INDEX = 1.45


def fresnel(theta, index=INDEX):
    """Unpolarised Fresnel reflectance at incidence ``theta`` (rad), from Snell's law."""
    cos_i = np.cos(theta)
    sin_t = np.sin(theta) / index
    cos_t = np.sqrt(1.0 - sin_t**2)
    perpendicular = (cos_i - index * cos_t) / (cos_i + index * cos_t)
    parallel = (index * cos_i - cos_t) / (index * cos_i + cos_t)
    return 0.5 * (perpendicular**2 + parallel**2)


def transmittance(theta, index=INDEX):
    """What the interface transmits at incidence ``theta`` (rad), 1 at normal incidence."""
    return (1.0 - fresnel(theta, index)) / (1.0 - fresnel(0.0, index))


def radiance(normal, diffuse, beta, gamma, light, view, index=INDEX, coated=False):
    """Radiance ``(band, y, x)`` under one light of unit irradiance, white board 1.0.

    ``normal`` (3, y, x); ``diffuse`` (band, y, x); ``beta``, ``gamma`` (y, x) or numbers;
    ``light`` and ``view`` unit vectors, (3,) or (3, y, x).
    """
    n = np.asarray(normal, np.float64)
    s = np.asarray(diffuse, np.float64)
    l = np.asarray(light, np.float64)  # noqa: E741
    v = np.asarray(view, np.float64)
    l = np.broadcast_to(l.reshape(3, *l.shape[1:], *([1] * (n.ndim - l.ndim))), n.shape)  # noqa: E741
    v = np.broadcast_to(v.reshape(3, *v.shape[1:], *([1] * (n.ndim - v.ndim))), n.shape)
    n_l, n_v = (n * l).sum(axis=0), (n * v).sum(axis=0)
    half = l + v
    half = half / np.linalg.norm(half, axis=0)
    n_h, v_h = (n * half).sum(axis=0), (v * half).sum(axis=0)
    phi = np.arccos(np.clip(n_h, -1.0, 1.0))
    distribution = np.exp(-np.log(2.0) * phi**2 / np.asarray(gamma, np.float64) ** 2)
    facet = np.arccos(np.clip(v_h, -1.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        attenuation = np.minimum(1.0, np.minimum(2.0 * n_h * n_v / v_h, 2.0 * n_h * n_l / v_h))
        specular = beta * distribution * fresnel(facet, index) * attenuation / n_v
    seen = (n_l > 0.0) & (n_v > 0.0)
    specular = np.where(seen, specular, 0.0)
    lit = np.maximum(n_l, 0.0)
    if coated:
        incidence, exitance = (np.arccos(np.clip(cosine, 0.0, 1.0)) for cosine in (n_l, n_v))
        lit = lit * transmittance(incidence, index) * transmittance(exitance, index)
    return s * lit[None] + specular[None]


def to_light(shape, pitch_mm, position):
    """Unit vectors ``(3, y, x)`` from each pixel to a point in mm, and squared distances."""
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2) * pitch_mm
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch_mm
    grid = np.stack([*np.meshgrid(x, y), np.zeros(shape)])
    reach = np.asarray(position, np.float64)[:, None, None] - grid
    squared = (reach**2).sum(axis=0)
    return reach / np.sqrt(squared), squared


def stack(normal, diffuse, beta, gamma, rig, pitch_mm=None, **options):
    """Radiance ``(obs, band, y, x)`` of a rig; ``beta``, ``gamma`` (coat, y, x) or (y, x)."""
    beta, gamma = (np.asarray(p, np.float64) for p in (beta, gamma))
    if beta.ndim < 3:
        beta, gamma = beta[None], gamma[None]
    images = []
    for light, view in zip(rig.lights, rig.views, strict=True):
        gain = light.intensity
        if hasattr(light, "position"):
            direction, squared = to_light(
                normal.shape[1:], pitch_mm or rig.pitch_mm, light.position
            )
            if light.falloff:
                # Irradiance 1 at the origin, then the inverse square law.
                gain = gain * np.sum(np.square(light.position)) / squared
        else:
            direction = np.asarray(light.direction)
        image = radiance(normal, diffuse, beta[0], gamma[0], direction, view, **options)
        for extra_beta, extra_gamma in zip(beta[1:], gamma[1:], strict=True):
            image = image + radiance(
                normal, np.zeros_like(diffuse), extra_beta, extra_gamma, direction, view
            )
        images.append(image * gain)
    return np.array(images)

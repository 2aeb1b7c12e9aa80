"""Photographs of a painting with relief through a lens: plain float64 numpy, known truth.

The ray of each square of a pixel (``flat_scene``) meets the height field by Newton's method from
the plane; the surface is matte or glossy under a distant lamp. Slopes must stay below the cotangent
of the tilt, so that no part hides another.
"""

from __future__ import annotations

import numpy as np

from oracles import flat_scene

NEAR = 12.0
"""Mm beside the painting from which rays may still meet the relief."""


def bumps(width, height, low, high, wave, border, seed=0):
    """A smooth relief between ``low`` and ``high`` mm: ``height(x, y) -> h, dh/dx, dh/dy``.

    A sum of eight cosines with wavelengths of ``wave`` mm and longer, times a window that falls to
    0 over the last ``border`` mm of the painting ``width x height``; flat outside.
    """
    rng = np.random.default_rng(seed)
    angles, phases = rng.uniform(0, 2 * np.pi, (2, 8))
    k = 2 * np.pi / (wave * rng.uniform(1.0, 2.5, 8))
    kx, ky = k * np.cos(angles), k * np.sin(angles)
    weights = k.min() / k

    def window(t, side):
        inside = np.clip((side / 2 - np.abs(t)) / border, 0.0, 1.0)
        value = inside**2 * (3 - 2 * inside)
        return value, -np.sign(t) * 6 * inside * (1 - inside) / border

    def raw(x, y):
        h, hx, hy = 0.0, 0.0, 0.0
        for a, b, phase, weight in zip(kx, ky, phases, weights, strict=True):
            argument = a * x + b * y + phase
            sine = np.sin(argument)
            h = h + weight * np.cos(argument)
            hx, hy = hx - weight * a * sine, hy - weight * b * sine
        wx, dx = window(x, width)
        wy, dy = window(y, height)
        return h * wx * wy, hx * wx * wy + h * dx * wy, hy * wx * wy + h * wx * dy

    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, 241),
                       np.linspace(-height / 2, height / 2, 241))  # fmt: skip
    own = raw(x, y)[0]
    # Two factors: the window keeps 0 at 0.
    up, down = high / own.max(), low / own.min()

    def relief(x, y):
        h, hx, hy = raw(x, y)
        # A smooth blend of both factors: 0.05 mm about 0.
        t = np.tanh(h / 0.2)
        factor = 0.5 * (up + down) + 0.5 * (up - down) * t
        slope = factor + h * 0.5 * (up - down) * (1 - t**2) / 0.2
        return h * factor, hx * slope, hy * slope

    relief.half = (width / 2, height / 2)
    return relief


def surface_points(camera, relief, n):
    """For each square of the pixels: x, y, z in mm, and the slopes there."""
    for u, v in flat_scene.rays_of_pixels(camera.size, camera.focal, tuple(camera.k),
                                          camera.centre, n):  # fmt: skip
        px, py, pz = camera.place
        ray = [u * a + v * b + c for a, b, c in camera.axes.T]
        reach = -pz / ray[2]
        x, y = px + reach * ray[0], py + reach * ray[1]
        # Beyond the painting all is flat; rays that are not steeper than 75 degrees come from near.
        near = (np.abs(x) < relief.half[0] + NEAR) & (np.abs(y) < relief.half[1] + NEAR)
        rx, ry, rz = (one[near] for one in ray)
        own = reach[near]
        for _ in range(20):
            h, hx, hy = relief(px + own * rx, py + own * ry)
            step = (h - pz - own * rz) / (rz - hx * rx - hy * ry)
            own = own + step
            if np.abs(step).max() < 1e-6:
                break
        x[near], y[near] = px + own * rx, py + own * ry
        z, hx, hy = np.zeros((3, *x.shape))
        z[near], hx[near], hy[near] = relief(x[near], y[near])
        yield x, y, z, hx, hy


def photograph(camera, relief, albedo, lamp, n=2, gloss=(0.0, 1.0)):
    """``(y, x)``: mean over the area of each pixel of ``albedo(x, y)`` times Lambert's cosine.

    ``gloss`` is strength and exponent of a lobe about the half vector (Blinn), which is added on
    the painting alone.
    """
    total = np.zeros(camera.size[::-1])
    for x, y, z, hx, hy in surface_points(camera, relief, n):
        size = np.sqrt(1 + hx**2 + hy**2)
        cosine = np.maximum((lamp[2] - hx * lamp[0] - hy * lamp[1]) / size, 0.0)
        total += albedo(x, y) * cosine
        if gloss[0] > 0.0:
            eye = [place - at for place, at in zip(camera.place, (x, y, z), strict=True)]
            far = np.sqrt(sum(one**2 for one in eye))
            half = [one / far + light for one, light in zip(eye, lamp, strict=True)]
            long = np.sqrt(sum(one**2 for one in half))
            facing = np.maximum((half[2] - hx * half[0] - hy * half[1]) / (size * long), 0.0)
            inside = (np.abs(x) < relief.half[0]) & (np.abs(y) < relief.half[1])
            total += gloss[0] * inside * facing ** gloss[1] * cosine
    return total / n**2


def pixel_of(camera, points):
    """Where points ``(n, 3)`` in mm are seen."""
    rays = (np.asarray(points, float) - camera.place) @ camera.axes.T
    u, v = flat_scene.distorted(rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2], camera.k)
    return np.column_stack([camera.focal * u + camera.centre[0],
                            camera.focal * v + camera.centre[1]])  # fmt: skip

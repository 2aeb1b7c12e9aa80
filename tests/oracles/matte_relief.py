"""A matte relief under lamps, in plain float64 numpy: Lambert's law and the inverse square law.

Written from the formulas alone: b (n . l) / (r / R)^2 with the direction and the distance of the
lamp for each pixel, Gaussian noise that grows with the root of the light, and where gloss is asked
for a lobe exp(-ln 2 (phi / width)^2) about the half vector.
"""

from __future__ import annotations

import numpy as np


def lamps(count: int, seed: int, lowest: float = 25.0, highest: float = 70.0) -> np.ndarray:
    """``(count, 3)`` unit vectors at random azimuths, even in the sine of the elevation."""
    random = np.random.default_rng(seed)
    azimuth = random.uniform(0.0, 2.0 * np.pi, count)
    low, high = np.sin(np.radians([lowest, highest]))
    z = random.permutation(np.linspace(low, high, count))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)


def relief(size: int, slope: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """``(3, y, x)`` normals of a random surface with that root mean square slope, and an albedo."""
    random = np.random.default_rng(seed)
    frequency = np.fft.fftfreq(size)
    radius = np.hypot(*np.meshgrid(frequency, frequency))
    radius[0, 0] = np.inf
    spectrum = radius**-1.2 * np.exp(-np.square(radius / 0.25))
    height = np.fft.ifft2(np.fft.fft2(random.normal(size=(size, size))) * spectrum).real
    along_x, along_y = np.gradient(height, axis=1), -np.gradient(height, axis=0)
    scale = slope / np.sqrt(np.mean(along_x**2 + along_y**2))
    normal = np.stack([-scale * along_x, -scale * along_y, np.ones_like(height)])
    paint = np.fft.ifft2(np.fft.fft2(random.normal(size=(size, size))) / radius).real
    return normal / np.linalg.norm(normal, axis=0), 0.4 + 0.25 * np.tanh(paint / paint.std())


def photographs(
    directions: np.ndarray,
    *,
    size: int = 160,
    slope: float = 0.1,
    inverse_distance: float = 0.0,
    strengths: np.ndarray | float = 1.0,
    noise: float = 0.003,
    gloss: float = 0.0,
    width: float = 0.12,
    seed: int = 0,
) -> np.ndarray:
    """``(lamp, y, x)``; inverse_distance of the lamps in 1 / width of the picture."""
    normal, albedo = relief(size, slope, seed)
    random = np.random.default_rng(seed + 1)
    along = (np.arange(size) - (size - 1) / 2) / size
    x, y = np.meshgrid(along, -along)
    plane = np.stack([x, y, np.zeros_like(x)])
    pictures = []
    for direction, strength in zip(
        directions, np.broadcast_to(strengths, len(directions)), strict=True
    ):
        towards = direction[:, None, None] - inverse_distance * plane
        far = np.linalg.norm(towards, axis=0)
        towards = towards / far
        light = albedo * np.maximum((normal * towards).sum(axis=0), 0.0)
        if gloss:
            half = towards + np.array([0.0, 0.0, 1.0])[:, None, None]
            half /= np.linalg.norm(half, axis=0)
            angle = 2.0 * np.arcsin(np.linalg.norm(normal - half, axis=0) / 2.0)
            light = light + gloss * np.exp(-np.log(2.0) * np.square(angle / width))
        light = strength * light / far**2
        pictures.append(light + noise * random.normal(size=light.shape) * np.sqrt(light + 0.01))
    return np.array(pictures)

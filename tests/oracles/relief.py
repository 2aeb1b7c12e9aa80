"""Textured relief under a distant lamp, and pictures shifted by parts of a pixel: plain numpy."""

from __future__ import annotations

import numpy as np


def smooth_noise(size, finest, seed):
    """``size x size``: noise of power 1/f^2 without waves shorter than ``finest`` pixels, rms 1."""
    rng = np.random.default_rng(seed)
    f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    power = np.where(f > 0, 1.0 / np.maximum(f, 1e-9), 0.0) * np.exp(-0.5 * (f * finest) ** 2)
    field = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(size, size))) * power, (size, size))
    return field / field.std()


def photograph(size, slope, azimuth, elevation, seed=0):
    """Lambert's cosine of a relief with slopes of ``slope`` degrees rms, times a texture."""
    height = smooth_noise(size, 4.0, seed + 1)
    dy, dx = np.gradient(height)
    scale = np.tan(np.radians(slope)) / np.sqrt((dx**2 + dy**2).mean())
    normal = np.stack([-scale * dx, scale * dy, np.ones_like(dx)])
    normal /= np.linalg.norm(normal, axis=0)
    a, e = np.radians([azimuth, elevation])
    lamp = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    albedo = np.exp(0.35 * smooth_noise(size, 3.0, seed + 2) - 1.0)
    return albedo * np.maximum(np.tensordot(lamp, normal, 1), 0.0)


def shifted(picture, x, y, margin=16):
    """The picture's content moved ``x`` to the right and ``y`` down, by the shift theorem.

    A mirrored border makes it continuous where it is taken for periodic; exact for what has no
    waves near two pixels.
    """
    padded = np.pad(picture, margin, mode="symmetric")
    double = np.concatenate([padded, padded[::-1]], axis=0)
    double = np.concatenate([double, double[:, ::-1]], axis=1)
    fy = np.fft.fftfreq(double.shape[0])[:, None]
    fx = np.fft.rfftfreq(double.shape[1])[None]
    spectrum = np.fft.rfft2(double) * np.exp(-2j * np.pi * (fx * x + fy * y))
    moved = np.fft.irfft2(spectrum, double.shape)
    return moved[margin : margin + picture.shape[0], margin : margin + picture.shape[1]]

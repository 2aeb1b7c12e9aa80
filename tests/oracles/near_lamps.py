"""A matte relief and a white board under lamps that stand near, in plain numpy.

Light of lamp i at place x: E_i (|p_i|^2 / |p_i - x|^2) times the cosine to the lamp there, times
the vignetting of the lens; a lamp of strength 1 reads 1 in the middle, if it is faced. Photographs
are codes of 16 bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile

FULL = 65535
EXPOSURE = 0.3
"""Share of full scale of a light of 1: the nearest lamp's corner stays below clipping."""


@dataclass(frozen=True)
class Scene:
    """Truth: normals (3, y, x), albedo (y, x), lamps (n, 3) in pixels, strengths, vignetting."""

    normal: np.ndarray
    albedo: np.ndarray
    lamps: np.ndarray
    strengths: np.ndarray
    vignetting: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def light(self, lamp: int, normal: np.ndarray | None = None) -> np.ndarray:
        """(y, x) on the relief, or on the plane of the board."""
        px, py, pz = self.lamps[lamp]
        there = np.stack([px - self.x, py - self.y, np.full(self.x.shape, pz)])
        far = np.sqrt((there**2).sum(axis=0))
        own = there[2] / far if normal is None else (normal * there / far).sum(axis=0)
        falloff = (px**2 + py**2 + pz**2) / far**2
        return self.strengths[lamp] * self.vignetting * falloff * np.maximum(own, 0.0)


def scene(size: int, distance: float, slope_degrees: float, seed: int = 0) -> Scene:
    """A square picture; nine lamps at 45 degrees, so many picture widths from its middle.

    Strengths differ by 10 %, and the lens darkens corners by 20 %.
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size].astype(float)
    x, y = x - (size - 1) / 2, (size - 1) / 2 - y
    slope = np.zeros((2, size, size))
    albedo = np.full((size, size), 0.5)
    for _ in range(12):
        wave = rng.uniform(2, 8) * 2 * np.pi / size
        angle, phase = rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
        across = np.array([np.cos(angle), np.sin(angle)])
        bend = np.cos(wave * (across[0] * x + across[1] * y) + phase)
        slope += across[:, None, None] * bend
        albedo += 0.03 * np.sin(1.7 * wave * (across[1] * x - across[0] * y) + phase)
    # The root mean square of the slope, both directions together.
    slope *= np.tan(np.radians(slope_degrees)) / np.sqrt((slope**2).sum(axis=0).mean())
    normal = np.stack([-slope[0], -slope[1], np.ones_like(x)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    angles = np.arange(9) * 2 * np.pi / 9
    around = np.stack([np.cos(angles), np.sin(angles), np.ones(9)], axis=1) / np.sqrt(2.0)
    strengths = 1.0 + 0.1 * np.cos(np.arange(9) * 2.3)
    vignetting = 1.0 - 0.4 * (x**2 + y**2) / size**2
    return Scene(normal, albedo, distance * size * around, strengths, vignetting, x, y)


def photographs(folder: Path, made: Scene, dark: float = 800.0) -> list[str]:
    """Photographs in ``painting``, boards in ``white``, and ``dark.tif``; their names."""
    names = [f"lamp{i}.tif" for i in range(len(made.lamps))]
    scale = EXPOSURE * (FULL - dark)
    for name, i in zip(names, range(len(names)), strict=True):
        painting = made.albedo * made.light(i, made.normal)
        for inner, light in (("painting", painting), ("white", made.light(i))):
            (folder / inner).mkdir(exist_ok=True, parents=True)
            codes = np.rint(scale * light + dark).astype(np.uint16)
            tifffile.imwrite(folder / inner / name, codes, photometric="minisblack")
    black = np.full(made.x.shape, round(dark), np.uint16)
    tifffile.imwrite(folder / "dark.tif", black, photometric="minisblack")
    return names


def errors(made: Scene, normal: np.ndarray, albedo: np.ndarray) -> tuple[float, float]:
    """Mean angle to the true normals in degrees, mean relative error of the albedo."""
    sine = np.linalg.norm(np.cross(normal, made.normal, axis=0), axis=0)
    angle = np.degrees(np.arctan2(sine, (normal * made.normal).sum(axis=0)))
    return float(angle.mean()), float(np.abs(albedo / made.albedo - 1.0).mean())

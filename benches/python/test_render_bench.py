"""Rendering against single-precision numpy, one thread.

    pytest benches/python/test_render_bench.py [--record]

A megapixel each, so 10 ms are 105 Mpx/s.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import impasto

SIZE = (1024, 1024)
WAVELENGTHS = np.arange(400.0, 701.0, 10.0)
BASIS = np.exp(-0.5 * ((WAVELENGTHS - np.linspace(410, 690, 6)[:, None]) / 35) ** 2)


@pytest.fixture(scope="module")
def painting() -> SimpleNamespace:
    rng = np.random.default_rng(0)
    normal = rng.normal(0.0, 0.1, (3, *SIZE)).astype(np.float32)
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    return SimpleNamespace(
        normal=normal,
        coefficients=rng.uniform(0.0, 0.5, (6, *SIZE)).astype(np.float32),
        basis=BASIS,
        wavelengths=WAVELENGTHS,
        beta=2.0,
        gamma=0.1,
    )


@pytest.fixture(scope="module")
def fold() -> impasto.colour.Fold:
    return impasto.colour.display_from_coefficients(BASIS, WAVELENGTHS, "A", d=0.56)


def test_bands_to_display(versus: Any, painting: SimpleNamespace, fold: Any) -> None:
    """Six bands to 8-bit codes; asked for: 100 Mpx/s."""
    matrix = fold.diffuse.astype(np.float32)

    def numpy() -> np.ndarray:
        light = np.clip(np.tensordot(matrix, painting.coefficients, 1), 0, 1)
        bright = np.float32(1.055) * light ** np.float32(1 / 2.4) - np.float32(0.055)
        code = np.where(light <= 0.0031308, np.float32(12.92) * light, bright)
        return np.moveaxis((code * 255 + np.float32(0.5)).astype(np.uint8), 0, 2)

    versus(
        lambda: impasto.display_from_bands(painting.coefficients, fold, threads=1),
        {"numpy": numpy},
        megapixels=SIZE[0] * SIZE[1] / 1e6,
    )


@pytest.mark.benchmark(group="whole pictures")
@pytest.mark.parametrize("effects", ["front", "shadows", "slanted"])
def test_render(benchmark: Any, painting: SimpleNamespace, effects: str) -> None:
    scene = impasto.Scene(
        [(0.0, 0.7, 0.7)],
        shadows=effects == "shadows",
        view=(0.5, 0.0, 0.8) if effects == "slanted" else (0.0, 0.0, 1.0),
    )
    height = np.zeros(SIZE, np.float32)
    surface = impasto.Surface.torrance_sparrow(
        painting.normal, painting.coefficients, painting.beta, painting.gamma
    )
    benchmark(impasto.render, surface, scene, reflectance=painting, height=height, threads=1)


@pytest.mark.benchmark(group="shadows and height")
@pytest.mark.parametrize("light", [(0.0, 0.9, 0.2), (0.9, 0.4, 0.2)])
def test_cast_shadows(benchmark: Any, light: tuple[float, float, float]) -> None:
    height = np.random.default_rng(0).uniform(0, 0.3, SIZE).astype(np.float32)
    benchmark(impasto.cast_shadows, height, 0.1, light, threads=1)


@pytest.mark.benchmark(group="shadows and height")
def test_integrate_normals(benchmark: Any, painting: SimpleNamespace) -> None:
    benchmark(impasto.integrate_normals, painting.normal, 0.1, threads=1)

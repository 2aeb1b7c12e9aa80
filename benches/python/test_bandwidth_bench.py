"""Calls that do little per sample, against plain numpy on the same work.

    pytest benches/python/test_bandwidth_bench.py [--record]

A megapixel each, on one thread. numpy is what somebody writes who wants the same numbers: single
precision, one matrix product where one will do. ``docs/bandwidth.md`` shows the record.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_normals_bench import SIDE, lstsq, pseudo_inverse, rank, rows, same, stack, unit

import impasto
from impasto import simulate

__all__ = ["stack"]

PIXELS = SIDE * SIDE
MEGAPIXELS = PIXELS / 1e6


@pytest.fixture(scope="module")
def colour() -> impasto.Stack:
    """48 photographs in three bands of 16 bits, nothing clipped."""
    rng = np.random.default_rng(0)
    angle = 2.399963 * np.arange(48)
    depth = np.linspace(0.95, 0.35, 48)
    radius = np.sqrt(1.0 - depth * depth)
    lights = np.stack([radius * np.cos(angle), radius * np.sin(angle), depth], axis=1)
    normal = rng.normal(0.0, 0.1, (3, SIDE, SIDE)).astype(np.float32)
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    albedo = rng.uniform(0.1, 0.8, (3, SIDE, SIDE)).astype(np.float32)
    codes = np.empty((48, 3, SIDE, SIDE), np.uint16)
    for light, photograph in zip(lights, codes, strict=True):
        shade = np.maximum(np.tensordot(light.astype(np.float32), normal, 1), 0)
        photograph[:] = np.rint(60000.0 * albedo * shade)
    return impasto.Stack(codes, lights=lights)


def all_maps(stack: impasto.Stack) -> list[np.ndarray]:
    """Normal, albedo, residual, condition, predicted error, counts and status of one band."""
    lights, samples = rows(stack)
    count = len(lights)
    scaled = np.linalg.pinv(lights) @ samples
    albedo = np.sqrt((scaled * scaled).sum(axis=0))
    normal = scaled / albedo
    rest = samples - lights @ scaled
    squares = np.einsum("ij,ij->j", rest, rest)
    covariance = np.linalg.inv(lights.T @ lights)
    adjugate = np.linalg.inv(covariance) * np.linalg.det(covariance)
    along = np.einsum("ij,ij->j", normal, covariance @ normal)
    half = (np.trace(covariance) - along) / 2
    product = np.einsum("ij,ij->j", normal, adjugate @ normal)
    worst = half + np.sqrt(np.maximum(half * half - product, 0))
    sigma = np.sqrt(squares / np.float32(count - 3) * worst) / albedo
    pixels = samples.shape[1]
    return [
        normal, albedo, np.sqrt(squares / np.float32(count)), sigma,
        np.full(pixels, np.linalg.cond(lights), np.float32),
        np.full(pixels, count, np.uint16), np.where(albedo > 0, 0, 16).astype(np.uint8),
    ]  # fmt: skip


def colour_normals(stack: impasto.Stack) -> np.ndarray:
    """Normals of the mean of the bands, photograph by photograph: no copy of the stack."""
    inverse = np.linalg.pinv(stack.rig.directions.astype(np.float32))
    grey = np.empty((len(inverse.T), PIXELS), np.float32)
    for photograph, out in zip(stack.samples, grey, strict=True):
        photograph.reshape(3, -1).mean(axis=0, dtype=np.float32, out=out)
    return unit(inverse @ grey)


def test_normals_alone(versus: Any, stack: impasto.Stack) -> None:
    found = versus(
        lambda: impasto.fit_normals(stack, method="least-squares", maps=("normal",), threads=1),
        {"pinv(L) @ I": lambda: pseudo_inverse(stack)},
        goal={"pinv(L) @ I": 4.0},
        megapixels=MEGAPIXELS,
    )
    same(found, pseudo_inverse(stack))


def test_into_given_memory(versus: Any, stack: impasto.Stack) -> None:
    """All maps of four megapixels under eight lights, into those of an earlier fit."""
    wide = impasto.Stack(np.tile(stack.samples[:8], (1, 1, 2, 2)), lights=stack.rig.take(range(8)))
    memory = impasto.fit_normals(wide, method="least-squares", threads=1)
    versus(
        lambda: impasto.fit_normals(wide, method="least-squares", out=memory, threads=1),
        {"ours, new memory": lambda: impasto.fit_normals(wide, method="least-squares", threads=1)},
        goal={"ours, new memory": 1.0},
        megapixels=4.0 * MEGAPIXELS,
    )


def test_all_maps(versus: Any, stack: impasto.Stack) -> None:
    found = versus(
        lambda: impasto.fit_normals(stack, method="least-squares", threads=1),
        {
            "pinv(L) @ I, normals only": lambda: pseudo_inverse(stack),
            "numpy, all maps": lambda: all_maps(stack),
            "lstsq, normals only": lambda: lstsq(stack),
        },
        goal={"pinv(L) @ I, normals only": 2.5, "lstsq, normals only": 50.0},
        megapixels=MEGAPIXELS,
    )
    normal, albedo, residual, sigma, condition, *_ = all_maps(stack)
    same(found, normal)
    unit_of_samples = float(stack.scale[0])
    for mine, theirs in [
        (found.albedo, unit_of_samples * albedo), (found.residual, unit_of_samples * residual),
        (found.condition, condition),
    ]:  # fmt: skip
        np.testing.assert_allclose(mine.ravel(), theirs, rtol=1e-3)
    # Ours is half the width of Student's interval: 1.042 deviations at 13 degrees of freedom.
    np.testing.assert_allclose(found.sigma.ravel(), 1.042 * sigma, rtol=5e-3)


@pytest.mark.parametrize("maps", [("normal",), None], ids=["normals_alone", "all_maps"])
def test_48_photographs_in_colour(versus: Any, colour: impasto.Stack, maps: Any) -> None:
    options: dict[str, Any] = {} if maps is None else {"maps": maps}
    versus(
        lambda: impasto.fit_normals(colour, method="least-squares", threads=1, **options),
        {"pinv(L) @ mean of the bands, normals only": lambda: colour_normals(colour)},
        goal={"pinv(L) @ mean of the bands, normals only": 1.0},
        megapixels=MEGAPIXELS,
        rounds=5,
    )


def test_default_rule(versus: Any, stack: impasto.Stack) -> None:
    versus(
        lambda: impasto.fit_normals(stack, threads=1),
        {"numpy, ranks once": lambda: rank(stack)},
        goal={"numpy, ranks once": 1.0},
        megapixels=MEGAPIXELS,
        rounds=5,
    )


@pytest.fixture(scope="module")
def painting() -> SimpleNamespace:
    """Normals of a rough surface, and six coefficients of spectra."""
    rng = np.random.default_rng(0)
    normal = rng.normal(0.0, 0.1, (3, SIDE, SIDE)).astype(np.float32)
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    wavelengths = np.arange(400.0, 701.0, 10.0)
    centres = np.linspace(410.0, 690.0, 6)[:, None]
    return SimpleNamespace(
        normal=normal,
        coefficients=rng.uniform(0.0, 0.5, (6, SIDE, SIDE)).astype(np.float32),
        basis=np.exp(-0.5 * ((wavelengths - centres) / 35.0) ** 2),
        wavelengths=wavelengths,
    )


@pytest.fixture(scope="module")
def camera() -> impasto.Camera:
    """Six bands and a flat light."""
    wavelengths = np.arange(400.0, 701.0, 5.0)
    centres = np.linspace(420.0, 680.0, 6)[:, None]
    sensitivities = np.exp(-0.5 * ((wavelengths - centres) / 25.0) ** 2)
    return impasto.Camera(wavelengths, sensitivities, "D65")


@pytest.mark.parametrize("estimator", ["wiener", "linear-model"])
def test_reflectance(
    versus: Any, painting: SimpleNamespace, camera: impasto.Camera, estimator: Any
) -> None:
    """Six bands to six coefficients; both sides have their estimator from before."""
    responses = painting.coefficients
    grid = np.arange(400.0, 701.0, 5.0)
    spectra = impasto.training.default_training().at(grid)
    seen = camera.operator(grid)
    if estimator == "wiener":
        correlation = spectra.T @ spectra / len(spectra)
        noise = 1e-6 * np.eye(len(seen))
        matrix = np.linalg.solve(seen @ correlation @ seen.T + noise, seen @ correlation).T
    else:
        basis = np.linalg.svd(spectra, full_matrices=False)[2][:6].T
        matrix = basis @ np.linalg.inv(seen @ basis)
    _, size, turn = np.linalg.svd(matrix, full_matrices=False)
    apply = (size[:, None] * turn).astype(np.float32)

    def numpy() -> np.ndarray:
        return apply @ responses.reshape(6, -1)

    found = versus(
        lambda: (
            impasto.fit_reflectance(
                None, responses, camera, estimator=estimator, threads=1
            ).coefficients
        ),
        {"numpy, one product": numpy},
        goal={"numpy, one product": 1.0},
        megapixels=MEGAPIXELS,
    )
    # Spectra of norms that agree: bases may differ by signs.
    mine, theirs = np.linalg.norm(found, axis=0).ravel(), np.linalg.norm(numpy(), axis=0)
    assert np.median(np.abs(mine / theirs - 1.0)) < 1e-3


def test_predict_matte(versus: Any, painting: SimpleNamespace) -> None:
    """Twelve photographs of a matte surface in three bands."""
    diffuse = painting.coefficients[:3]
    surface = impasto.Surface(painting.normal, diffuse)
    rig = simulate.rig("tominaga-six-band-adaptation").take(range(12))
    lights = rig.directions.astype(np.float32)

    def numpy() -> np.ndarray:
        shade = np.maximum(lights @ painting.normal.reshape(3, -1), 0)
        return shade[:, None] * diffuse.reshape(1, 3, -1)

    found = versus(
        lambda: surface.predict(rig, threads=1),
        {"numpy": numpy},
        goal={"numpy": 1.0},
        megapixels=MEGAPIXELS,
    )
    np.testing.assert_allclose(found.reshape(12, 3, -1), numpy(), rtol=1e-5, atol=1e-6)


def test_render_matte(versus: Any, painting: SimpleNamespace) -> None:
    """Six coefficients under one light to 8-bit codes."""
    surface = impasto.Surface(painting.normal, painting.coefficients)
    scene = impasto.Scene([(0.0, 0.7, 0.7)])
    fold = impasto.colour.display_from_coefficients(painting.basis, painting.wavelengths, "D65")
    matrix = fold.diffuse.astype(np.float32)
    light = np.float32([0.0, 0.5**0.5, 0.5**0.5])

    def numpy() -> np.ndarray:
        shade = np.maximum(np.tensordot(light, painting.normal, 1), 0)
        linear = np.clip(np.tensordot(matrix, painting.coefficients, 1) * shade, 0, 1)
        bright = np.float32(1.055) * linear ** np.float32(1 / 2.4) - np.float32(0.055)
        code = np.where(linear <= 0.0031308, np.float32(12.92) * linear, bright)
        return np.moveaxis((code * 255 + np.float32(0.5)).astype(np.uint8), 0, 2)

    found = versus(
        lambda: impasto.render(surface, scene, reflectance=painting, threads=1).display,
        {"numpy": numpy},
        goal={"numpy": 1.0},
        megapixels=MEGAPIXELS,
    )
    # A code may round the other way: single precision on both sides.
    assert np.abs(found.astype(int) - numpy()).max() <= 1

"""A tile of a painting gets, to the bit, the maps that it has in the whole painting."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate

SIZE = (30, 53)
"""Pixels: more than the numerics take up at once, and no multiple of their lanes."""
ROWS = (0, 13, 30)
COLUMNS = (0, 21, 53)
NORMALS = ("normal", "albedo", "used", "rejected", "residual", "condition", "sigma", "status")
LOBES = (
    *("normal", "diffuse", "specular", "cxy", "cz", "exponent", "lobes", "residual"),
    *("specular_sigma", "direction_sigma", "exponent_sigma", "sigma", "status"),
)


@cache
def photographs() -> tuple[np.ndarray, impasto.Rig]:
    """Linear samples ``(obs, band, y, x)`` from many views; some are clipped or missing."""
    painting = simulate.painting(seed=4, size=SIZE, varnish="gloss")
    stack = simulate.capture(painting, "snel-lafortune", "rgb").stack.take(range(0, 770, 24))
    samples = np.array([stack.linear(i) for i in range(len(stack.rig))], dtype=np.float32)
    samples[3, 1, 5:9, 18:25] = np.inf
    samples[::4, :, 12:15, 40] = np.nan
    return samples, stack.rig


def rig(near: bool) -> impasto.Rig:
    """Lights at their distances, or as far above the painting as it is wide four times."""
    rig = photographs()[1]
    if not near:
        return impasto.Rig(rig.directions, views=rig.views, pitch_mm=0.3)
    lights = [impasto.PointLight(tuple(60.0 * direction)) for direction in rig.directions]
    return impasto.Rig(lights, views=rig.views, pitch_mm=0.3)


def tiles(near: bool) -> Iterator[tuple[tuple[slice, slice], impasto.Stack]]:
    """The parts of the painting, each with its place."""
    samples, whole = photographs()[0], rig(near)
    height, width = SIZE
    for top, bottom in pairwise(ROWS):
        for left, right in pairwise(COLUMNS):
            place = np.s_[top:bottom, left:right]
            part = whole.part(0.5 * (left + right - width), 0.5 * (height - top - bottom))
            yield place, impasto.Stack(samples[..., *place].copy(), lights=part)


def assert_same(tile: Any, whole: Any, place: tuple[slice, slice], maps: tuple[str, ...]) -> None:
    for name in maps:
        expected = np.ascontiguousarray(getattr(whole, name)[..., *place])
        found = np.ascontiguousarray(getattr(tile, name))
        # Bits: NaN equals itself, and zeros have signs.
        assert found.tobytes() == expected.tobytes(), (name, place)


@pytest.mark.parametrize("near", [False, True], ids=["distant", "near"])
@pytest.mark.parametrize("method", ["least-squares", "threshold", "robust", "trimmed", "tukey"])
def test_normals_of_a_tile_are_those_of_the_whole(method: Any, near: bool) -> None:
    painting = impasto.Stack(photographs()[0], lights=rig(near))
    whole = impasto.fit_normals(painting, method=method)
    learned = impasto.learn_normals(painting)
    for place, stack in tiles(near):
        tile = impasto.fit_normals(stack, method=method, learned=learned)
        assert_same(tile, whole, place, NORMALS)


def test_the_scale_and_the_correlation_of_the_painting_matter() -> None:
    """Else the test above could not fail."""
    stack = impasto.Stack(photographs()[0], lights=rig(False))
    whole, learned = impasto.fit_normals(stack), impasto.learn_normals(stack)
    other = impasto.LearnedNormals(8.0 * learned.scale, learned.correlation)
    assert impasto.fit_normals(stack, learned=other).normal.tobytes() != whole.normal.tobytes()
    other = impasto.LearnedNormals(learned.scale, learned.correlation + 0.25)
    found = impasto.fit_normals(stack, learned=other)
    assert found.normal.tobytes() == whole.normal.tobytes()
    assert (found.sigma >= whole.sigma)[np.isfinite(whole.sigma)].all()
    assert found.sigma.tobytes() != whole.sigma.tobytes()


@pytest.mark.parametrize("near", [False, True], ids=["distant", "near"])
def test_lafortune_lobes_of_a_tile_are_those_of_the_whole(near: bool) -> None:
    options: dict[str, Any] = {"model": "lafortune", "lobes": 2}
    painting = impasto.Stack(photographs()[0], lights=rig(near))
    whole = impasto.fit_sbrdf(painting, **options)
    assert (whole.status == 0).mean() > 0.9
    learned = impasto.learn_sbrdf(painting, **options)
    for place, stack in tiles(near):
        assert_same(learned.apply(stack), whole, place, LOBES)


def test_a_tile_that_does_not_know_its_place_differs() -> None:
    """Under near lights: else the tests above could not fail."""
    whole = impasto.fit_normals(impasto.Stack(photographs()[0], lights=rig(True)))
    place, stack = next(tiles(True))
    lost = impasto.fit_normals(impasto.Stack(stack.samples, lights=rig(True)))
    assert np.nanmax(np.abs(lost.normal - whole.normal[:, *place])) > 1e-3

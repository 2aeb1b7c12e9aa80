"""Interreflections are taken off samples as they are read: the bits of a copy, and none is made."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from impasto import DistantLight, Rig, simulate
from impasto.fit import learning, sbrdf
from impasto.fit.normals import LEARNED_PIXELS, learn_normals
from impasto.fit.relief import Relief, finer
from impasto.fit.subsample import subsampled_to
from impasto.stack import Stack
from test_choice import dome

LIGHTS = 24
CELLS, STEP = 20, 5
ROWS, COLUMNS = 97, 91


def bowl(cells: int = CELLS, step: int = STEP) -> Relief:
    """A hollow with two bands, in cells of some pixels; it is not in the middle."""
    y, x = (np.mgrid[:cells, :cells] - 0.5 * cells) / (0.25 * cells)
    down = np.exp(-(x**2) - y**2)
    # Of -0.25 cells * down, per cell.
    normal = np.stack([-2.0 * x * down, 2.0 * y * down, np.ones_like(x)])
    normal /= np.linalg.norm(normal, axis=0)
    height = -0.25 * cells * step * down
    diffuse = np.stack([0.8 + 0.1 * np.sin(x), 0.5 + 0.2 * np.cos(y)])
    maps = (map_.astype(np.float32) for map_ in (height, normal, diffuse))
    return Relief(*maps, step, np.array([1.5, -2.0]), True, white=1.0)


def photographs(
    dtype: str, rows: int = ROWS, columns: int = COLUMNS, lights: int = LIGHTS, **options: Any
) -> Stack:
    """Of a painted panel, in codes or linear light."""
    painting = simulate.painting(5, (rows, columns), varnish="gloss", relief=1.5)
    rig = Rig([DistantLight(tuple(one), 0.6 + 0.02 * i) for i, one in enumerate(dome(lights))])
    linear = simulate.capture(painting, rig, "rgb", encoding="linear", bits=16).stack
    light = np.stack([linear.linear(index)[:2] for index in range(lights)])
    light[~np.isfinite(light)] = 1.0
    if dtype.startswith("uint"):
        full = np.iinfo(dtype).max
        return Stack(np.rint(light * 0.98 * full).astype(dtype), lights=rig, **options)
    return Stack(light.astype(dtype), lights=rig, **options)


def copied(relief: Relief, stack: Stack) -> Stack:
    """The photographs without interreflections as a float32 copy, by numpy."""
    albedo = np.maximum(np.nan_to_num(impasto.fit_normals(stack, method="rank").albedo), 0.0)
    samples = np.empty(stack.shape, np.float32)
    right, up = (np.array(stack.rig.origin) - relief.origin).tolist()
    for index in range(len(stack.rig)):
        one = stack.rig.take([index])
        cells = relief.irradiance(one, relief.visibility(one))[0]
        around = albedo * finer(cells, relief.step, albedo.shape[1:], (right, up))
        linear = stack.linear(index)
        samples[index] = np.maximum(linear - around, np.minimum(linear, 0.0))
    return Stack(samples, lights=stack.rig, bands=stack.bands, mask=stack.mask)


def same(one: Any, other: Any) -> None:
    """Two results, bit by bit."""
    for part in fields(one):
        values = getattr(one, part.name), getattr(other, part.name)
        if isinstance(values[0], np.ndarray):
            assert values[0].tobytes() == values[1].tobytes(), part.name


def holes(rows: int = ROWS, columns: int = COLUMNS) -> NDArray[np.bool_]:
    mask = np.ones((rows, columns), bool)
    mask[:7, :11] = False
    return mask


STACKS: dict[str, Callable[[], Stack]] = {
    "uint8": lambda: photographs("uint8", mask=holes(), black=3.0),
    "uint16": lambda: photographs("uint16", saturation=[6e4, 5e4], scale=[1.5e-5, 1.6e-5]),
    "float16": lambda: photographs("float16"),
    # In single precision 0.9 is less than 0.9.
    "float32": lambda: photographs("float32", saturation=0.9, black=[0.01, -0.002], scale=[1.0, 2]),
}
FITS: dict[str, dict[str, Any]] = {
    "none": {"pooling": "none"},
    "painting": {"pooling": "painting"},
    "pixel": {"pooling": "pixel"},
    "lafortune": {"model": "lafortune"},
}


@pytest.fixture(scope="module", params=STACKS)
def pair(request: pytest.FixtureRequest) -> tuple[Stack, Stack]:
    """Photographs whose samples are corrected as they are read, and a corrected copy."""
    stack = STACKS[request.param]()
    relief = bowl()
    direct = relief.removed(stack)
    assert np.shares_memory(direct.samples, stack.samples)
    return direct, copied(relief, stack)


@pytest.mark.parametrize("fit", FITS)
def test_fits_are_those_of_a_corrected_copy(pair: tuple[Stack, Stack], fit: str) -> None:
    direct, copy = pair
    options = {**FITS[fit], "refine": False, "residuals": False}
    wanted = impasto.fit_sbrdf(copy, **options, threads=1)
    for threads in (1, 2, 3):
        found = impasto.fit_sbrdf(direct, **options, threads=threads)
        same(found, wanted)
        same(found.normals, wanted.normals)


def test_parts_and_samples_are_those_of_a_corrected_copy(pair: tuple[Stack, Stack]) -> None:
    direct, copy = pair
    assert learn_normals(direct) == learn_normals(copy)
    made: list[Callable[[Stack], Stack]] = [
        lambda stack: stack[3:40, 5:60],
        lambda stack: stack.take([3, 1, 4]),
        lambda stack: stack.rotated(),
        lambda stack: stack._replace(mask=None),
        lambda stack: subsampled_to(stack, 300),
    ]
    for change in made:
        found, wanted = change(direct), change(copy)
        assert found.samples.tobytes() == wanted.samples.tobytes()
        assert found.rig.origin == wanted.rig.origin
    for index in (0, LIGHTS - 1):
        assert direct.linear(index).tobytes() == copy.samples[index].tobytes()


def test_scattered_pixels_are_those_of_a_corrected_copy() -> None:
    """They are packed into a smaller picture, of which cells know nothing."""
    few = np.zeros((ROWS, COLUMNS), bool)
    few[::13, ::11] = True
    stack = photographs("uint16", mask=few)
    found, wanted = (
        subsampled_to(one, 50) for one in (bowl().removed(stack), copied(bowl(), stack))
    )
    assert max(found.shape[2:]) < 13
    assert found.samples.tobytes() == wanted.samples.tobytes()
    assert found.samples[..., found.mask].any()


def test_a_tile_has_the_bits_of_the_whole() -> None:
    stack, relief = photographs("uint8"), bowl()
    options: dict[str, Any] = {"method": "least-squares", "threads": 2}
    whole = impasto.fit_normals(relief.removed(stack), **options)
    for tile in (np.s_[:40, 13:90], np.s_[33:34, 50:51], np.s_[60:97, :]):
        same(impasto.fit_normals(relief.removed(stack[tile]), **options), whole[tile])


def test_where_a_relief_has_no_surface_samples_stay() -> None:
    """As outside the mask under which it was learned."""
    stack, relief = photographs("uint8"), bowl()
    known, first = np.ones((CELLS, CELLS), bool), 12
    known[first:] = False
    part = replace(
        relief,
        height=np.where(known, relief.height, np.float32(np.nan)),
        diffuse=np.where(known, relief.diffuse, np.float32(0.0)),
    )
    # The first row of pixels beyond the middles of those cells.
    row = round((first - 0.5 * (CELLS - 1)) * STEP - relief.origin[1] + 0.5 * (ROWS - 1)) + 1
    direct = part.removed(stack)
    for index in range(LIGHTS):
        found, linear = direct.linear(index), stack.linear(index)
        assert found[:, row:].tobytes() == linear[:, row:].tobytes()
        assert (found < linear)[:, : row - 2 * STEP].any()


@pytest.mark.parametrize("way", ["fit", "learn", "apply"])
def test_memory_does_not_grow_with_photographs_times_pixels(
    monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    def found(*given: Any) -> Any:
        return bowl(step=12), given[3]

    monkeypatch.setattr(sbrdf, "learned_relief", found)
    monkeypatch.setattr(learning, "learned_relief", found)
    options: dict[str, Any] = {
        "pooling": "painting",
        "relief": True,
        "effort": "draft",
        "threads": 1,
    }

    def peak(stack: Stack) -> int:
        model = impasto.learn_sbrdf(stack, **options) if way == "apply" else None
        tracemalloc.start()
        try:
            if model is not None:
                model.apply(stack, threads=1)
            elif way == "learn":
                impasto.learn_sbrdf(stack, **options)
            else:
                impasto.fit_sbrdf(stack, **options)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    few, more = 16, 48
    small = photographs("uint8", 50, 55, more)
    stack = Stack(small.samples.repeat(4, axis=2).repeat(4, axis=3), lights=small.rig)
    _, bands, *size = stack.shape
    grown = peak(stack) - peak(stack.take(range(few)))
    # Of each photograph: cells that are remembered, copied to the numerics and worked on, with
    # their visibility, and twice the pixels from which the scale of residuals is learned.
    cells = 4 * (bands + 1) * CELLS**2
    each = 4 * cells + 2 * 4 * bands * LEARNED_PIXELS
    assert grown < (more - few) * each
    # A copy would be eight times that.
    assert 8 * each < 4 * bands * np.prod(size)

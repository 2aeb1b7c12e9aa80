"""Lobes of every pixel, learned once and applied to tiles: the maps of the whole, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit.lobes import (
    HALO,
    LearnedLobes,
    LobeMaps,
    LobeOptions,
    apply_lobes,
    fit_lobes,
    learn_lobes,
)
from oracles import forward
from oracles.rigs import spiral as lights
from test_sbrdf_lobes import SHAPE, same_bits, scene, small

__all__ = ["scene"]  # a fixture


def near_scene() -> impasto.Stack:
    """The surface under lamps, every third of which is near: pixels differ by their place."""
    lamps = [
        impasto.PointLight(tuple(90.0 * v)) if i % 3 == 0 else impasto.DistantLight(tuple(v))
        for i, v in enumerate(lights())
    ]
    _, values = small()
    noisy = values + np.random.default_rng(21).normal(0.0, 0.002, values.shape)
    noisy[:, :, 4, 8] = np.nan
    return impasto.Stack(noisy.astype(np.float32), lights=impasto.Rig(lamps, pitch_mm=1.0))


def part(stack: impasto.Stack, rows: slice, columns: slice) -> impasto.Stack:
    """A part of a stack, which knows where it lies."""
    height, width = stack.shape[2:]
    y, x = range(height)[rows], range(width)[columns]
    right = 0.5 * (x[0] + x[-1] - (width - 1))
    up = 0.5 * (height - 1 - y[0] - y[-1])
    return stack._replace(
        samples=np.ascontiguousarray(stack.samples[:, :, rows, columns]),
        rig=stack.rig.part(right, up),
    )


@pytest.mark.parametrize("start", ["neighbours", "neighbours-only", "multistart"])
def test_tiles_are_the_whole_bit_for_bit(start: Any, tmp_path: Path) -> None:
    stack = near_scene()
    effort = impasto.Effort(start=start, rounds=1)
    plain: dict[str, Any] = {"lobes": 2, "ambient": True, "index": 1.45}
    whole = fit_lobes(
        stack, impasto.fit_normals(stack), effort=effort, threads=2, progress=False, **plain
    )
    learned = learn_lobes(stack, impasto.fit_normals(stack), LobeOptions.of(effort, **plain))
    assert learned.options.start == start
    assert learned.prior is not None
    assert learned.prior.counts[0] > 0
    np.savez(tmp_path / "learned.npz", **learned.to_arrays())  # type: ignore[arg-type]
    with np.load(tmp_path / "learned.npz") as saved:
        learned = LearnedLobes.from_arrays(saved)
    halo = 0 if start == "multistart" else HALO
    height, width = SHAPE
    for tall, wide in ((13, 37), (5, 7), (4, 16), (1, 11)):
        found = LobeMaps.empty(3, 2, SHAPE)
        for y in range(0, height, tall):
            for x in range(0, width, wide):
                rows, columns = slice(y, min(y + tall, height)), slice(x, min(x + wide, width))
                top, left = max(y - halo, 0), max(x - halo, 0)
                with_halo = part(
                    stack, slice(top, rows.stop + halo), slice(left, columns.stop + halo)
                )
                inner = (
                    slice(y - top, rows.stop - top),
                    slice(x - left, columns.stop - left),
                )
                start = impasto.fit_normals(with_halo, learned=impasto.learn_normals(stack))
                tile = apply_lobes(learned, with_halo, start, inner=inner)
                for name in LobeMaps.__slots__:
                    getattr(found, name)[..., rows, columns] = getattr(tile, name)
        same_bits(whole, found.result(stack, whole.normals, 1.45))


def test_threads_change_nothing_without_rounds() -> None:
    """Lobes at the bound are widened with what this tile says, not what a worker's last one did."""
    rng = np.random.default_rng(4)
    shape = 30, 40
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, *shape)), np.ones((1, *shape))])
    normal /= np.linalg.norm(normal, axis=0)
    rig = impasto.Rig(lights())
    # The second is as wide as the bound.
    gamma = np.where(np.arange(shape[1]) < 20, 0.1, 0.25) * np.ones(shape)
    clean = forward.stack(normal, np.full((1, *shape), 0.3), np.full(shape, 3.0), gamma, rig)
    noisy = np.repeat(clean, 3, axis=1) + rng.normal(0.0, 0.01, (len(clean), 3, *shape))
    stack = impasto.Stack(noisy.astype(np.float32), lights=rig)
    plain: dict[str, Any] = {"lobes": 2, "ambient": False, "index": 1.45}
    effort = impasto.Effort(rounds=0, start="multistart")
    stereo = impasto.fit_normals(stack)
    # Only bounded lobes are widened.
    assert learn_lobes(stack, stereo, LobeOptions.of(effort, **plain)).options.bounded
    one, three = (
        fit_lobes(stack, stereo, effort=effort, threads=threads, progress=False, **plain)
        for threads in (1, 3)
    )
    assert (one.lobes > 0).mean() > 0.9
    same_bits(one, three)


def test_a_tile_is_written_into_memory_maps(scene: Any, tmp_path: Path) -> None:
    stack = scene[2]
    stereo = impasto.fit_normals(stack)
    options = LobeOptions.of(
        impasto.Effort(rounds=0, iterations=2), lobes=1, ambient=False, index=1.45
    )
    learned = learn_lobes(stack, stereo, options)
    expected = apply_lobes(learned, stack, stereo)
    mapped = LobeMaps(
        **{
            name: np.memmap(tmp_path / name, plane.dtype, mode="w+", shape=plane.shape)
            for name, plane in ((name, getattr(expected, name)) for name in LobeMaps.__slots__)
        }
    )
    assert apply_lobes(learned, stack, stereo, out=mapped) is mapped
    for name in LobeMaps.__slots__:
        assert getattr(mapped, name).tobytes() == getattr(expected, name).tobytes(), name


def test_tiles_and_saved_models_that_do_not_fit_are_refused(scene: Any) -> None:
    stack = scene[2]
    stereo = impasto.fit_normals(stack)
    options = LobeOptions.of(
        impasto.Effort(rounds=0, iterations=2), lobes=1, ambient=False, index=1.45
    )
    learned = learn_lobes(stack, stereo, options)
    bare = part(stack, slice(5, 9), slice(6, 20))
    with pytest.raises(impasto.GeometryError, match=f"{HALO} pixels farther"):
        apply_lobes(learned, bare, impasto.fit_normals(bare))
    elsewhere = bare._replace(rig=stack.rig.part(40.0, 0.0))
    with pytest.raises(impasto.GeometryError, match="lie beside the pixels"):
        apply_lobes(learned, elsewhere, impasto.fit_normals(bare))
    with pytest.raises(impasto.ArgumentError, match="inner"):
        apply_lobes(learned, stack, stereo, inner=(slice(3, 3), slice(None)))
    with pytest.raises(impasto.ArgumentError, match="normal: expected 3 planes of 481"):
        apply_lobes(learned, stack, stereo, out=LobeMaps.empty(3, 1, (13, 36)))
    arrays = learned.to_arrays()
    for name in ("start", "extent", "shapes"):
        rest = {key: value for key, value in arrays.items() if key != name}
        with pytest.raises(impasto.ArgumentError, match="no saved lobes"):
            LearnedLobes.from_arrays(rest)
    spoiled = LearnedLobes.from_arrays(arrays | {"counts": np.array([33, 0, 0], np.uint32)})
    with pytest.raises(impasto.ArgumentError, match="at most 32, found 33"):
        apply_lobes(spoiled, stack, stereo)

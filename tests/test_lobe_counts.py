"""Where a second lobe is searched for: beside pixels that have one, or all over the painting."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from oracles import forward as oracle
from oracles.rigs import spiral as lights

SHAPE = (32, 64)
SEEDS = np.s_[::4, ::4]


def painting(two: Any) -> impasto.Stack:
    """A varnish, with a broad sheen below it where ``two`` says, under noise of 0.002."""
    return lit(0.08, 6.0 * two, 0.24)


def lit(varnish: float, strength: Any, gamma: Any) -> impasto.Stack:
    """A varnish of one width, with a second lobe beside it."""
    rng = np.random.default_rng(5)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    rig = impasto.Rig(lights())
    flat = np.full((1, *SHAPE), 0.3)

    def gloss(diffuse: Any, strength: Any, gamma: Any) -> Any:
        return oracle.stack(normal, diffuse, strength, gamma, rig)

    first = gloss(flat, np.full(SHAPE, 3.0), np.full(SHAPE, varnish))
    clean = first + gloss(0.0 * flat, strength, np.full(SHAPE, gamma))
    noisy = np.repeat(clean, 3, axis=1) + rng.normal(0.0, 0.002, (len(clean), 3, *SHAPE))
    return impasto.Stack(noisy.astype(np.float32), lights=rig)


def lobes(stack: impasto.Stack, start: Any) -> Any:
    """How many lobes every pixel has."""
    effort = impasto.Effort(start=start)
    found = impasto.fit_sbrdf(stack, pooling="pixel", lobes=2, effort=effort, refine=False)
    assert isinstance(found, impasto.LobeSbrdf)
    return found.lobes


def test_noise_gives_few_pixels_a_second_lobe() -> None:
    stack = painting(np.zeros(SHAPE))
    thorough, found, only = (
        lobes(stack, start) for start in ("multistart", "neighbours", "neighbours-only")
    )
    chance = (thorough == 2).mean()
    assert 0.0 < chance < 0.05
    # One that a seed has by chance is searched for around it alone.
    assert (found == 2).mean() < 0.3 * chance
    np.testing.assert_array_equal(found, only)


@pytest.mark.parametrize("start", ["neighbours", "neighbours-only"])
def test_a_part_with_two_lobes_keeps_them(start: Any) -> None:
    two = np.broadcast_to(np.arange(SHAPE[1]) >= SHAPE[1] // 2, SHAPE)
    stack = painting(two)
    thorough, found = lobes(stack, "multistart"), lobes(stack, start)
    assert (thorough == 2)[two].mean() > 0.9
    assert (found == 2)[two].mean() > 0.95 * (thorough == 2)[two].mean()


@pytest.mark.parametrize(("top", "left"), [(10, 30), (18, 34)], ids=["on", "between"])
def test_a_small_part_with_two_lobes_keeps_them_around_seeds(top: int, left: int) -> None:
    """Too few pixels for a prior: what is searched for is what the seeds beside a pixel have.

    Row 16, column 32 is a seed of the coarse grid; the second part has none.
    """
    two = np.zeros(SHAPE, np.bool_)
    two[top : top + 9, left : left + 9] = True
    assert two[SEEDS].mean() < 0.05
    stack = painting(two)
    thorough, found = lobes(stack, "multistart"), lobes(stack, "neighbours")
    inside = np.zeros(SHAPE, np.bool_)
    inside[top + 2 : top + 7, left + 2 : left + 7] = True
    assert (thorough == 2)[inside].mean() > 0.9
    assert (found == 2)[inside].mean() > 0.9


def test_a_second_lobe_unlike_those_of_the_seeds_is_found() -> None:
    """Three pixels in ten have a narrow second lobe, the others a broad one.

    A search from the seeds' shapes alone finds fewer narrow ones than multistart does.
    """
    narrow = np.random.default_rng(0).random(SHAPE) < 0.3
    stack = lit(0.1, np.where(narrow, 3.0, 6.0), np.where(narrow, 0.03, 0.22))
    thorough, found = lobes(stack, "multistart"), lobes(stack, "neighbours")
    assert (thorough == 2)[~narrow].all()
    assert (found == 2)[~narrow].all()
    assert (found == 2)[narrow].sum() > (thorough == 2)[narrow].sum() > 100

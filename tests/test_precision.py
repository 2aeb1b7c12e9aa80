"""What searches for pixels' lobes compute in: ``Effort(precision=...)``.

Hard cases in double precision stand in test_hard_cases.py, threads and instruction sets in
test_calls.py.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, get_args

import numpy as np
import pytest

import impasto
from impasto.effort import Precision
from impasto.fit.lobes import fit_lobes
from oracles import forward, lobes
from oracles.rigs import spiral

SHAPE = (9, 12)
LIGHTS = spiral()
EVERY = get_args(Precision)


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """One band of a bumpy, varnished surface with noise of half a percent."""
    rng = np.random.default_rng(8)
    normal = np.concatenate([rng.normal(0.0, 0.12, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.2, 0.6, (1, *SHAPE))
    gamma = rng.uniform(0.12, 0.2, SHAPE)
    clean = forward.stack(normal, diffuse, np.full(SHAPE, 6.0), gamma, impasto.Rig(LIGHTS)) + 0.02
    noisy = clean + rng.normal(0.0, 0.003, clean.shape)
    return impasto.Stack(noisy.astype(np.float32), lights=LIGHTS)


def fitted(stack: impasto.Stack, *, threads: int = 2, **effort: Any) -> impasto.LobeSbrdf:
    """Every pixel by itself, from the table, searched to its end."""
    return fit_lobes(
        stack,
        impasto.fit_normals(stack),
        lobes=1,
        ambient=True,
        index=1.45,
        effort=impasto.Effort(iterations=30, start="multistart", **effort),
        threads=threads,
        progress=False,
        typical=False,
    )


def excess(stack: impasto.Stack, precision: Precision) -> Any:
    """Share of the least cost by which one round ends above it, per pixel with a lobe.

    The round weighs samples by what the search before it left: a fit without rounds ends there, and
    of one band its colours are those that weights are made with.
    """
    before, after = (fitted(stack, rounds=rounds, precision=precision) for rounds in (0, 1))
    shares = []
    for at in zip(*np.nonzero((before.lobes == 1) & (after.lobes == 1)), strict=True):
        pixel = np.asarray(stack.samples[(slice(None), 0, *at)], np.float64)
        (first, gamma), (normal, width) = (
            (np.asarray(fit.normal[(slice(None), *at)], np.float64), float(fit.gamma[(0, *at)]))
            for fit in (before, after)
        )
        first, normal = (n / np.linalg.norm(n) for n in (first, normal))
        colours = [before.diffuse[0], before.specular[0, 0], before.ambient[0]]
        weights = lobes.renewed(pixel, first, gamma, [c[at] for c in colours], LIGHTS)
        own, _ = lobes.weighted_cost(pixel, weights, normal, width, LIGHTS)
        shares.append(own / lobes.least(pixel, weights, normal, width, LIGHTS)[0] - 1.0)
    return np.array(shares)


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["polished", "double"])
def test_double_precision_ends_at_the_least_there_is(
    stack: impasto.Stack, precision: Precision
) -> None:
    shares = excess(stack, precision)
    assert len(shares) > 100
    # Normals are known to half a milliradian at best: rounded to single precision, by 6e-8, they
    # are 1.2e-4 standard deviations off, and the cost by the square of that in 54 degrees of
    # freedom. Single precision leaves out a step shorter than a tenth of a standard deviation.
    assert shares.max() < 1.2e-4**2 / 54
    single = excess(stack, "single")
    assert np.percentile(single, 90) > 100.0 * shares.max()
    assert single.max() < 0.1**2 / 54


def apart(one: impasto.LobeSbrdf, other: impasto.LobeSbrdf) -> Any:
    """How far two fits are from each other in standard deviations, per pixel with a lobe."""
    both = (one.lobes == 1) & (other.lobes == 1)
    assert both.mean() > 0.98
    width = np.abs(np.log(one.gamma[0] / other.gamma[0])) / other.gamma_sigma[0]
    normal = np.linalg.norm(one.normal - other.normal, axis=0) / other.sigma
    return np.maximum(width, normal)[both]


def test_polished_ends_where_double_does(stack: impasto.Stack) -> None:
    single, polished, double = (fitted(stack, rounds=2, precision=p) for p in EVERY)
    # What differs are the weights of the last round, by where the round before ended: in single
    # precision a tenth of a standard deviation from the minimum at most, of which weights pass on
    # less than a tenth.
    assert np.mean(apart(polished, double) < 0.1 * 0.1) > 0.98
    assert np.median(apart(polished, double)) < 0.5 * np.median(apart(single, double))


def same_bits(one: Any, other: Any, names: Any) -> None:
    for name in names:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize("precision", EVERY)
def test_threads_and_powers_of_two_change_no_bit(
    stack: impasto.Stack, precision: Precision
) -> None:
    found = fitted(stack, precision=precision, threads=1)
    planes = [f.name for f in fields(found) if isinstance(getattr(found, f.name), np.ndarray)]
    same_bits(found, fitted(stack, precision=precision, threads=3), planes)
    scaled = impasto.Stack(stack.samples * np.float32(2.0**-9), lights=LIGHTS)
    shapes = ("normal", "gamma", "gamma_sigma", "lobes", "sigma", "status", "converged")
    same_bits(found, fitted(scaled, precision=precision), shapes)


def test_without_rounds_there_is_nothing_to_polish(stack: impasto.Stack) -> None:
    single, polished = (fitted(stack, rounds=0, precision=p) for p in ("single", "polished"))
    same_bits(single, polished, ("normal", "gamma", "diffuse"))


def test_the_border_refuses_what_it_does_not_know(stack: impasto.Stack) -> None:
    effort = impasto.Effort()
    object.__setattr__(effort, "precision", "quadruple")
    with pytest.raises(impasto.ArgumentError, match=r"precision: expected .* found .quadruple"):
        impasto.fit_sbrdf(stack, pooling="pixel", effort=effort)

"""The mask of a stack rules, whatever normals, labels or arrays of numpy come with it."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status
from impasto.fit.subsample import pixel_count, subsampled_to
from oracles import forward

SHAPE = (9, 14)
FITS: dict[str, dict[str, Any]] = {
    "painting": {},
    "segment": {"pooling": "segment", "segments": np.arange(14) // 7 * np.ones(SHAPE, int)},
    "pixel": {"pooling": "pixel", "lobes": 1},
    "lafortune": {"model": "lafortune", "lobes": 1},
}

fit: Any = impasto.fit_sbrdf


def photographs() -> tuple[Any, Any]:
    """Samples of a varnished relief under 24 lights on a spiral, and the lights."""
    rng = np.random.default_rng(8)
    turn = np.arange(24) * np.pi * (3.0 - np.sqrt(5.0))
    z = np.linspace(0.95, 0.3, 24)
    side = np.sqrt(1.0 - z**2)
    lights = np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)
    normal = np.concatenate([rng.normal(0.0, 0.15, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    clean = forward.stack(normal, diffuse, 10.0, 0.15, impasto.Rig(lights))
    noisy = clean + 0.002 * rng.standard_normal(clean.shape)
    return noisy.astype(np.float32), lights


@pytest.fixture(scope="module")
def masked() -> tuple[impasto.Stack, impasto.Normals, Any]:
    """A stack with a mask, normals that know nothing of it, and the mask."""
    samples, lights = photographs()
    mask = np.ones(SHAPE, np.bool_)
    mask[:4] = mask[6, 7] = False
    stack = impasto.Stack(samples, lights=lights, mask=mask)
    learned = impasto.learn_normals(stack)
    stereo = impasto.fit_normals(impasto.Stack(samples, lights=lights), learned=learned)
    return stack, stereo, mask


def same(one: Any, other: Any) -> None:
    """Every number alike, NaN with NaN, in results and the results within them."""
    for field in fields(one):
        here, there = getattr(one, field.name), getattr(other, field.name)
        if is_dataclass(here):
            same(here, there)
        elif isinstance(here, np.ndarray):
            np.testing.assert_array_equal(here, there, field.name)


@pytest.mark.parametrize("name", FITS)
def test_normals_without_the_mask_bring_nothing_back(masked: Any, name: str) -> None:
    stack, stereo, mask = masked
    found = fit(stack, normals=stereo, **FITS[name])
    np.testing.assert_array_equal(found.status == Status.MASKED, ~mask)
    np.testing.assert_array_equal(np.isnan(found.normal).all(axis=0), found.status >= 16)
    assert np.isnan(found.predict()[..., ~mask]).all()
    same(found, fit(stack, **FITS[name]))


def test_normals_may_know_less_than_the_stack(masked: Any) -> None:
    stack, stereo, mask = masked
    whole = impasto.Stack(stack.samples, lights=stack.rig)
    found = fit(whole, normals=impasto.fit_normals(stack))
    np.testing.assert_array_equal(found.status == Status.MASKED, ~mask)
    everywhere = stereo.within(np.ones(SHAPE, np.bool_))
    same(everywhere, stereo)


def test_a_masked_label_is_of_no_segment(masked: Any) -> None:
    samples, lights = photographs()
    stack = impasto.Stack(samples, lights=lights)
    labels = np.zeros(SHAPE, int)
    labels[:, 10:] = 5
    held = np.ma.masked_array(labels, mask=labels == 5)
    found = fit(stack, pooling="segment", segments=held)
    np.testing.assert_array_equal(found.labels, np.where(labels == 5, -1, labels))
    assert [one.label for one in found.segments] == [0]
    # What stands behind the mask is nobody's business, not even as a number that is too large.
    held = np.ma.masked_array(np.where(labels == 5, 2**64 - 1, 0).astype(np.uint64), labels == 5)
    np.testing.assert_array_equal(fit(stack, pooling="segment", segments=held).labels, found.labels)


@pytest.mark.parametrize("which", ["phi", "samples"])
def test_a_masked_sample_of_a_lobe_does_not_count(which: str) -> None:
    phi = np.linspace(0.0, 0.5, 16)[:, None] * np.ones(3)
    arrays = {"phi": phi, "samples": 100.0 * np.exp(-np.log(2.0) * phi**2 / 0.2**2)}
    arrays[which][4, 1] = np.nan
    expected = impasto.fit_highlight(**arrays)
    arrays[which][4, 1] = 1e6
    hidden = np.zeros(phi.shape, np.bool_)
    hidden[4, 1] = True
    arrays[which] = np.ma.masked_array(arrays[which], mask=hidden)
    same(impasto.fit_highlight(**arrays), expected)
    # Integers have no NaN of their own.
    arrays[which] = np.ma.masked_array(np.ones(phi.shape, int), mask=True)
    assert (impasto.fit_highlight(**arrays).status == Status.INVALID_INPUT).all()


def test_a_mask_of_numpy_that_hides_nothing_changes_nothing() -> None:
    samples, lights = photographs()
    held = impasto.Stack(np.ma.masked_array(samples, mask=False), lights=lights)
    assert np.shares_memory(held.samples, samples)


def test_a_suggestion_is_for_what_the_mask_leaves() -> None:
    """As for the photographs cut down to it: what was black outside counted as a miss."""
    samples, lights = photographs()
    mask = np.zeros(SHAPE, np.bool_)
    mask[:, 4:] = True
    part = impasto.suggest_effort(impasto.Stack(samples, lights=lights, mask=mask), error=0.5)
    cropped = impasto.suggest_effort(impasto.Stack(samples[..., 4:], lights=lights), error=0.5)
    assert part.met
    options, others = ({repr(t.options): t.error for t in s.tried} for s in (part, cropped))
    assert options.keys() == others.keys()
    for name, error in options.items():
        # The same samples of the same pixels; sums over them are in another order.
        assert error == pytest.approx(others[name], rel=1e-3), name


@pytest.mark.parametrize("pattern", ["half", "corner", "lattice"])
def test_a_subsample_lies_inside_the_mask(pattern: str) -> None:
    mask = np.zeros((60, 80), np.bool_)
    if pattern == "half":
        mask[30:] = True
    elif pattern == "corner":
        mask[-8:, -8:] = True
    else:
        # Holes at every place of a stride of 2 (from 0 on: 59 and 79 are odd).
        mask[:] = True
        mask[::2, ::2] = False
    whole = impasto.Stack(np.ones((3, 60, 80), np.float32), lights=np.eye(3), mask=mask)
    few = pixel_count(subsampled_to(whole, 1000))
    assert min(250, pixel_count(whole)) <= few <= pixel_count(whole)
    if pattern == "half":
        assert few <= 1000
    dense = impasto.Stack(whole.samples, lights=np.eye(3))
    assert pixel_count(subsampled_to(dense, 1000)) <= 1000


def test_a_mask_of_other_bytes_is_one_of_0_and_1() -> None:
    samples, lights = photographs()
    # What a file of 0 and 255 is when it is called bool: True for numpy, no bool for Rust.
    codes = np.zeros(SHAPE, np.uint8)
    codes[2:5, 3:9] = 255
    for given in (codes.view(np.bool_), np.ascontiguousarray(codes.T).view(np.bool_).T):
        mask = impasto.Stack(samples, lights=lights, mask=given).mask
        assert mask is not None
        assert mask.flags.c_contiguous
        np.testing.assert_array_equal(mask.view(np.uint8), codes // 255)
    for wrong in (np.full(SHAPE, "x"), np.full(SHAPE, None)):
        with pytest.raises(impasto.ArgumentError, match="mask: expected bool, found dtype"):
            impasto.Stack(samples, lights=lights, mask=wrong)

"""The shape of lobes, learned from photographs whose facets are not those of the model."""

from __future__ import annotations

import numpy as np

import impasto
from impasto.fit.held_out import HeldOut
from impasto.surface import Surface

LAMPS, SIZE = 36, 24
ALPHA = 0.25


def leaf() -> tuple[impasto.Stack, impasto.Surface]:
    """A rough leaf of metal: Beckmann's facets, no diffuse part, in float64 by hand."""
    rng = np.random.default_rng(3)
    slope = rng.normal(0.0, 0.03, (2, SIZE, SIZE))
    normal = np.stack([-slope[0], -slope[1], np.ones((SIZE, SIZE))])
    normal /= np.linalg.norm(normal, axis=0)
    z = np.linspace(0.966, 0.3, LAMPS)
    turn = np.arange(LAMPS) * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    lights = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    cosine = np.einsum("kc,cyx->kyx", half, normal)
    tangent = (1.0 - cosine**2) / cosine**2
    facets = np.exp(-tangent / ALPHA**2) / cosine**4
    samples = np.repeat(0.6 * facets[:, None], 3, axis=1).astype(np.float32)
    stack = impasto.Stack(samples, lights=lights)
    return stack, Surface(normal.astype(np.float32), np.ones((3, SIZE, SIZE), np.float32))


def test_metal_is_told_by_its_light_and_its_shape_predicts_photographs() -> None:
    """Model's lobes miss these facets by several codes; their profile leaves a fifth or less.

    The profile follows the ratio of both lobes; what is left is its steps between 16 knots.
    """
    stack, _ = leaf()
    test = HeldOut(stack, 200, index=1.45, threads=1)
    metal = test.for_metal(stack.rig)
    assert metal.otherwise().surfaces == "shaped"
    plain, shaped = metal.errors(stack.rig, 2).trim, metal.otherwise().errors(stack.rig, 2).trim
    assert shaped < 0.2 * plain


def test_paint_has_a_varnish_as_the_other_kind() -> None:
    stack, ground = leaf()
    matte = stack._replace(samples=ground.predict(stack.rig, threads=1))
    test = HeldOut(matte, 200, index=1.45, threads=1)
    assert test.for_metal(stack.rig).otherwise().surfaces == "coated"

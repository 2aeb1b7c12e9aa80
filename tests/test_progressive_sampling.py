"""How many pixels the painting's lobe is searched with."""

from __future__ import annotations

import numpy as np
import pytest

import impasto
from impasto import Effort


@pytest.mark.parametrize("noisy", [False, True])
def test_more_pixels_are_searched_until_the_lobe_is_known(noisy: bool) -> None:
    """Of 25,600 pixels 6400 are enough under one varnish, and all are not with noise of 0.3.

    Twice the pixels a side: standard errors of half. Estimated ones scatter by a few per cent, and
    1600 pixels would have four times that of all. Without the noise both lobes are within five
    standard errors of the smaller sample of each other.
    """
    painting = impasto.simulate.painting(0, (160, 160), varnish="gloss")
    stack = impasto.simulate.capture(painting, camera="rgb", bits=None, seed=1).stack
    if noisy:
        light = np.array([stack.linear(one) for one in range(len(stack.rig))])
        noise = 0.3 * np.random.default_rng(3).standard_normal(light.shape)
        samples = (light * (1.0 + noise)).astype(np.float32)
        stack = impasto.Stack(samples, lights=stack.rig)
    usual, every = (
        impasto.fit_sbrdf(
            stack, pooling="painting", effort=effort, refine=False, relief=False, residuals=False
        )
        for effort in (Effort(), Effort(pixels=1 << 20))
    )
    errors, least = (np.sqrt(np.diag(one.covariance)) for one in (usual, every))
    if noisy:
        assert least.max() > 3e-3, "the lobe is not known well enough"
        assert (usual.beta, usual.gamma) == (every.beta, every.gamma)
        np.testing.assert_array_equal(usual.normal, every.normal)
    else:
        assert np.all((errors / least > 1.6) & (errors / least < 2.5)), errors / least
        assert abs(np.log(usual.beta / every.beta)) < 5.0 * errors[0]
        assert abs(np.log(usual.gamma / every.gamma)) < 5.0 * errors[1]

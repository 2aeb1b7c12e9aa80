"""What docs/models.md says that no model promises: a surface may reflect more than it receives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from oracles.rigs import spiral

SIDE = 24
"""Views along both axes of the hemisphere's equal projected areas."""


def hemisphere() -> Any:
    """Directions ``(view, 3)`` of equal cosine-weighted solid angle."""
    places = (np.arange(SIDE) + 0.5) / SIDE
    height, turn = np.meshgrid(np.sqrt(places), 2.0 * np.pi * places)
    z, side = height.ravel(), np.sqrt(1.0 - height.ravel() ** 2)
    return np.stack([side * np.cos(turn.ravel()), side * np.sin(turn.ravel()), z], axis=1)


@pytest.mark.parametrize("pooling", ["painting", "pixel"])
def test_six_per_cent_reflect_more_than_they_receive_from_the_side(pooling: Any) -> None:
    painting = simulate.painting(seed=7, size=(24, 24), varnish="patches")
    stack = simulate.capture(painting, impasto.Rig(spiral(24)), "rgb").stack
    fitted = impasto.fit_sbrdf(stack, pooling=pooling)
    views = hemisphere()
    angle = np.radians(64.0)
    light = np.tile([np.sin(angle), 0.0, np.cos(angle)], (len(views), 1))
    # A white board shows N.L from everywhere: what it sends in all is what it receives.
    albedo = fitted.predict(light, views).astype(np.float64).mean(axis=0) / np.cos(angle)
    known = albedo[:, fitted.status < 16]
    assert np.median(known) < 0.5
    assert 0.05 < (known > 1.0).any(axis=0).mean() < 0.075
    assert 1.3 < known.max() < 1.6

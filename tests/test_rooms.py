"""The rooms that impasto contains: light that can be computed otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

import impasto
from impasto.rooms import LABELS, ROOMS

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("name", ROOMS)
def test_a_white_board_in_a_room_has_y_of_1(name: str) -> None:
    """By a sum over the map here. Texels of 0.7 degrees move light by half of that: below 1 %."""
    radiance = ROOMS[name]()
    assert radiance.shape == (3, 256, 512)
    assert (radiance >= 0.0).all()
    assert np.isfinite(radiance).all()
    rows = (np.arange(256) + 0.5) / 256 * np.pi
    columns = (np.arange(512) + 0.5) / 512 * 2.0 * np.pi - np.pi
    cosine = np.sin(rows)[:, None] * np.cos(columns)[None, :]
    area = np.sin(rows)[:, None] * (np.pi / 256) ** 2
    board = (radiance * np.maximum(cosine, 0.0) * area).sum(axis=(1, 2))
    assert LUMINANCE @ board == pytest.approx(1.0, rel=1e-2)
    assert LUMINANCE @ impasto.Environment.named(name).irradiance() == pytest.approx(1.0, rel=1e-2)
    assert name in LABELS


def test_the_overcast_sky_is_that_of_cie() -> None:
    """A wall gets (1/2 + 4 / (3 pi)) 3/7 of the ground's light, 7 pi / 9 of the zenith's radiance.

    The ground, a fifth of white, fills the other half of what the wall sees, pi / 2. The highest
    rows of the map are within 1.4 degrees of the zenith, where the sky has lost 2e-4.
    """
    ground = 7.0 * math.pi / 9.0
    wall = (0.5 + 4.0 / (3.0 * math.pi)) * 3.0 / 7.0 * ground + 0.2 * ground / math.pi * math.pi / 2
    light = np.tensordot(LUMINANCE, ROOMS["overcast"]()[:, :, 200:312], axes=1)
    zenith, horizon = light[:2].mean(), light[126:128].mean()
    assert zenith == pytest.approx(1.0 / wall, rel=5e-3)
    assert zenith / horizon == pytest.approx(3.0, rel=0.03), "three times as much above"

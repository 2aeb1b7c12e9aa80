"""Photographs against their neighbours: pictures by plain numpy, and those of a gilded icon."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impasto.capture import hemisphere
from impasto.capture.frames import read_picture
from impasto.capture.neighbours import find_outliers, predictions
from impasto.io import read_lights

LAMPS = 200


def lambert_and_gloss(directions: np.ndarray, seed: int = 2) -> np.ndarray:
    """``(n, cells)``: cosine and a highlight of Blinn and Phong on tilted cells, with noise."""
    rng = np.random.default_rng(seed)
    normal = np.concatenate([rng.normal(0.0, 0.12, (2, 400)), np.ones((1, 400))])
    normal /= np.linalg.norm(normal, axis=0)
    albedo = rng.uniform(0.1, 0.7, 400)
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    light = albedo * np.maximum(directions @ normal, 0.0) + 0.3 * (half @ normal) ** 60
    return light + rng.normal(0.0, 5e-4, light.shape)


@pytest.fixture(scope="module")
def directions() -> np.ndarray:
    return hemisphere(LAMPS, np.radians(20.0))


@pytest.fixture(scope="module")
def light(directions: np.ndarray) -> np.ndarray:
    return lambert_and_gloss(directions)


def outliers(light: np.ndarray, directions: np.ndarray) -> dict[int, str]:
    count = len(light)
    names = [f"shot_{n + 1}" for n in range(count)]
    found = find_outliers(light, directions, names, list(range(1, count + 1)))
    return {own: f"{misfire.code}: {misfire.why}" for own, misfire in found.misfires.items()}


def nearest(directions: np.ndarray, own: int) -> int:
    cosine = directions @ directions[own]
    cosine[own] = -2.0
    return int(cosine.argmax())


def test_right_photographs_do_not_stand_out(light: np.ndarray, directions: np.ndarray) -> None:
    assert outliers(light, directions) == {}
    # Lamps of unequal strength, 10 % (standard deviation), are no misfire either.
    strength = np.exp(np.random.default_rng(4).normal(0.0, 0.1, LAMPS))
    assert outliers(light * strength[:, None], directions) == {}


def test_the_direction_of_the_light_is_that_of_the_lamp(
    light: np.ndarray, directions: np.ndarray
) -> None:
    """And of a photograph under the neighbouring lamp it is as far off as that lamp.

    Lamps stand 8 degrees apart. A quadratic misses a highlight 10 degrees wide by a few percent of
    its light, which moves the estimate by a quarter of the distance; at the next lamp the slope has
    changed by as much again. The limit of a wrong lamp is half of the distance.
    """
    inner = directions[:, 2] > 0.5
    found = predictions(light, directions)
    assert np.quantile((found.offset / found.spacing)[inner], 0.95) < 0.25
    own = int(np.flatnonzero(inner)[40])
    wrong = light.copy()
    wrong[own] = light[nearest(directions, own)]
    found = predictions(wrong, directions)
    assert found.offset[own] == pytest.approx(found.spacing[own], rel=0.5)


def test_what_is_wrong_is_named(light: np.ndarray, directions: np.ndarray) -> None:
    own = 90
    other = (own + 77) % LAMPS
    near = nearest(directions, own)
    cases = {
        f"wrong-lamp: the light comes from lamp {other + 1}, not from lamp {own + 1}": light[other],
        f"wrong-lamp: the light comes from lamp {near + 1}, not from lamp {own + 1}": light[near],
        f"double-light: two lamps are on: lamp {own + 1} and lamp {other + 1}": (
            light[own] + light[other]
        ),
        "no-light: no light came from the lamp": 0.01 * light[own],
        "strength: the light is 6 % weaker than under the neighbouring lamps": 0.94 * light[own],
        "unlike: the photograph does not look like those under neighbouring lamps": np.where(
            np.arange(400) < 80, 0.1 * light[own], light[own]
        ),
    }
    for words, photograph in cases.items():
        changed = light.copy()
        changed[own] = photograph
        found = outliers(changed, directions)
        assert list(found) == [own], words
        # Shading of a fifth of the picture also takes light.
        same = found[own] == words or (words.startswith("unlike") and "weaker" in found[own])
        assert same, (words, found[own])


def test_exchanged_photographs_are_named_together(
    light: np.ndarray, directions: np.ndarray
) -> None:
    changed = light.copy()
    changed[[30, 120]] = light[[120, 30]]
    found = outliers(changed, directions)
    assert found[30] == (
        "swapped: the light comes from lamp 121, not from lamp 31: exchanged with shot_121"
    )
    assert found.keys() == {30, 120}


def test_few_lamps_are_not_judged(light: np.ndarray, directions: np.ndarray) -> None:
    changed = light[:29].copy()
    changed[4] = light[20]
    assert outliers(changed, directions[:29]) == {}


def test_a_gilded_icon(data: Path) -> None:
    """72 real photographs: none stands out; of five exchanged pairs most are seen.

    Gilding mirrors the lamp, and lamps stand far apart: a few exchanges make no difference that
    neighbours foretell. What stands out is one of both, or a neighbour.
    """
    lights = read_lights(data / "icon_rti" / "dirs.lp")
    assert lights.names is not None
    pictures = [read_picture(data / "icon_rti" / name).thumbnail() for name in lights.names]
    light = np.array(pictures)
    assert outliers(light, lights.directions) == {}
    rng = np.random.default_rng(0)
    seen = 0
    for _ in range(5):
        one, other = rng.choice(72, 2, replace=False)
        changed = light.copy()
        changed[[one, other]] = light[[other, one]]
        seen += bool({int(one), int(other)} & outliers(changed, lights.directions).keys())
    assert seen >= 3

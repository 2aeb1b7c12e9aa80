"""Pictures against those of another renderer, Mitsuba 3: frames, fall-off, cameras and models.

``oracles/mitsuba_pictures.npz`` has Mitsuba's pictures, ``oracles/mitsuba_pictures.py`` the
painting and its lamps, ``oracles/mitsuba_models.py`` how Mitsuba shows them. The tests do without
Mitsuba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, Environment, PointLight, PointView, Rig, Scene, Surface
from oracles import mitsuba_pictures as oracle

MAPS = oracle.painting()
RGB_FROM_XYZ = np.linalg.inv(impasto.colour.Display.named("srgb").xyz_from_linear)


@pytest.fixture(scope="module")
def theirs() -> dict[str, np.ndarray]:
    with np.load(oracle.FILE) as file:
        return dict(file)


def surface(model: str) -> Surface:
    normal, diffuse = MAPS["normal"], MAPS["diffuse"]
    placed: dict[str, Any] = {"pitch_mm": oracle.PITCH_MM}
    coats = {"torrance-sparrow": 1, "two coats": 2}
    if model == "diffuse":
        return Surface(normal, diffuse, **placed)
    if model in coats:
        beta, gamma = (MAPS[name][: coats[model]] for name in ("beta", "gamma"))
        return Surface.torrance_sparrow(normal, diffuse, beta, gamma, **placed)
    lobes = (MAPS[name] for name in ("specular", "cxy", "cz", "exponent"))
    return Surface.lafortune(normal, diffuse, *lobes, **placed)


def lamp(name: str) -> DistantLight | PointLight:
    kind, where, intensity = oracle.LAMPS[name]
    return (DistantLight if kind == "distant" else PointLight)(where, intensity)


def eye(name: str) -> Any:
    where, near = oracle.VIEWS[name]
    return PointView(where) if near else where


def agree(ours: np.ndarray, expected: np.ndarray, model: str) -> None:
    """Within the roundings of single precision on both sides.

    An angle, cosine or distance carries some ten roundings of 6e-8 on either side, and Mitsuba's
    normals another from their code (1 + N) / 2: 1e-6 of the brightest that the light could show,
    1. A facet's exponent k phi^2 changes by 2 k phi d phi; with k phi^2 up to 5, where the lobe is
    still seen, and gamma from 0.06, that is 60 d phi, times the lobe's own exp(-5): 1e-6 again. A
    Lafortune base carries four roundings and is raised to a power of up to 80: 2e-5 of a lobe.
    """
    assert expected.max() > 0.3
    lobes = model == "lafortune"
    np.testing.assert_allclose(ours, expected, rtol=2e-5 if lobes else 3e-6, atol=2e-6)


@pytest.mark.parametrize("view", oracle.VIEWS)
@pytest.mark.parametrize("light", oracle.LAMPS)
@pytest.mark.parametrize("model", oracle.MODELS)
def test_pixels_show_what_mitsuba_shows(
    model: str, light: str, view: str, theirs: dict[str, np.ndarray]
) -> None:
    expected = theirs[f"{model} / {light} / {view}"]
    painting = surface(model)
    # As samples of a stack, from any side.
    rig = Rig([lamp(light)], views=[eye(view)], pitch_mm=oracle.PITCH_MM)
    agree(painting.predict(rig)[0], expected, model)
    if view == "slanted":
        return  # whose picture is foreshortened
    # As a picture; XYZ and back is some ten roundings more, of sums that are up to 5 times a band.
    scene = Scene([lamp(light)], view=eye(view))
    image = impasto.render(painting, scene)
    linear = np.tensordot(RGB_FROM_XYZ, image.xyz.astype(np.float64), 1)
    np.testing.assert_allclose(linear, expected, rtol=2e-5, atol=5e-6)


def test_the_oracle_tells_models_lamps_and_views_apart(theirs: dict[str, np.ndarray]) -> None:
    """No two pictures are the same, and each has what it is there for."""
    pictures = {name: shown for name, shown in theirs.items() if name != "mitsuba"}
    assert len(pictures) == len(oracle.MODELS) * (
        len(oracle.LAMPS) * len(oracle.VIEWS) + len(oracle.TURNS)
    )
    for model in oracle.MODELS:
        of_model = [shown for name, shown in pictures.items() if name.startswith(f"{model} /")]
        matte = model == "diffuse"
        for i, one in enumerate(of_model):
            for other in of_model[:i]:
                same_lamp = np.abs(one - other).max() < 1e-5
                assert matte or not same_lamp
    raking = pictures["diffuse / raking / straight"]
    assert 0.05 < np.mean(raking == 0.0) < 0.5  # facets that turn away from the lamp
    for model in oracle.MODELS[1:]:
        lit = "distant / straight"
        assert np.abs(pictures[f"{model} / {lit}"] - pictures[f"diffuse / {lit}"]).max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("turn", oracle.TURNS)
@pytest.mark.parametrize("model", oracle.MODELS)
def test_a_room_shows_what_mitsuba_shows(
    model: str, turn: str, theirs: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The map's orientation, its rotation, the plane that clips it, and the three kinds of tables.

    Mitsuba interpolates its map of 512 columns between texels, impasto's texels are patches: 2e-4
    of a lamp as narrow as the room's. Turned by no whole number of texels, the wall cuts through
    two columns of the map. Half a column, 0.006 rad, seen by steep facets (45 degrees) at a cosine
    of at most 0.7, would be 0.003 of the light of a room as bright at the wall as elsewhere: cut
    texels count by their share, of which a tenth may be wrong. Lobes have what documentation
    allows them, half a percent.
    """
    monkeypatch.setenv("IMPASTO_CACHE", "off")
    expected = theirs[f"{model} / {turn}"]
    room = Environment(oracle.room(), rotation=oracle.TURNS[turn])
    image = impasto.render(surface(model), Scene(environment=room))
    linear = np.tensordot(RGB_FROM_XYZ, image.xyz.astype(np.float64), 1)
    error = np.abs(linear / expected - 1.0)
    if model == "diffuse":
        assert error.max() < 3e-4
    else:
        assert np.percentile(error, 99) < 0.005

"""The page in the light of an environment: rotation, colours and gloss are the renderer's."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
from impasto.cli import main
from impasto.rooms import LABELS, ROOMS
from impasto.viewer import Contents, write_site
from impasto.viewer.environments import cube_of
from test_viewer import normals, numbers, surfaces
from viewer_page import shown

TURN = 130
"""Degrees by which a room is turned."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    folder = tmp_path_factory.mktemp("profile")
    with chromium.Chromium(folder, size=(800, 420)) as started:
        yield started


def lit(browser: chromium.Chromium, room: str, changes: dict[str, Any]) -> NDArray[Any]:
    """Codes ``(y, x, 3)`` of the page in an environment."""
    browser.value(
        "(async () => { const { viewer } = window.impasto;"
        f"viewer.set({{ environment: {json.dumps(room)} }}); await viewer.environment(); }})()"
    )
    return shown(browser, {"environment": room, **changes})[..., :3].astype(int)


def test_a_board_in_a_room_is_white() -> None:
    """All are scaled so: irradiance on a wall has Y = 1, by the sum over the map itself."""
    for name in ROOMS:
        radiance = impasto.Environment.named(name).radiance.astype(float)
        rows, columns = radiance.shape[1:]
        latitude = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
        longitude = 2.0 * np.pi * ((np.arange(columns) + 0.5) / columns - 0.5)
        front = np.cos(latitude)[:, None] * np.cos(longitude)
        area = np.cos(latitude)[:, None] * (np.pi / rows) * (2.0 * np.pi / columns)
        board = (radiance * np.maximum(front, 0.0) * area).sum(axis=(1, 2))
        # Cosines are taken in the middles of texels of 0.7 degrees.
        assert np.array([0.2126, 0.7152, 0.0722]) @ board == pytest.approx(1.0, rel=1e-3), name
        assert name in LABELS


def test_a_cube_has_the_light_of_its_map() -> None:
    """The irradiance of a board from all sides: sums over both parts of the sphere agree.

    Texels of a face are means of nine rays, each the texel of the map that it meets: an edge of a
    lamp is off by less than a ray, a percent of a candle's width at most.
    """
    radiance = impasto.Environment.named("window").radiance
    cube = cube_of(radiance)
    side = cube.shape[-1]
    places = 2.0 * (np.arange(side) + 0.5) / side - 1.0
    weight = (1.0 + places[:, None] ** 2 + places**2) ** -1.5
    rows, columns = radiance.shape[1:]
    latitude = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
    area = np.broadcast_to(np.cos(latitude)[:, None], (rows, columns))
    of_map = (radiance * area).sum(axis=(1, 2)) / area.sum()
    of_cube = (cube * weight).sum(axis=(0, 2, 3)) / (6.0 * weight.sum())
    assert of_cube == pytest.approx(of_map, rel=0.02)


@pytest.mark.parametrize(
    ("name", "degrees"), [("matte", 5), ("pixels", 5), ("lafortune", 5), ("gilded spectra", 15)]
)
def test_a_painting_in_a_room_looks_as_rendered(
    browser: chromium.Chromium, tmp_path: Path, name: str, degrees: int
) -> None:
    """Matte paint to a code; gloss nearer than a room that is turned by a few degrees more.

    Tables of prefiltered lobes are an approximation, whose error is measured
    (``docs/viewer.md``). A wrong axis, sense, factor or colour would be an error of convention, and
    larger than that of five degrees, a tenth of the width of the window. Of gold, which shows
    little else than the room, approximations count for more: 15 degrees.
    """
    surface, spectra = surfaces()[name]
    write_site(surface, tmp_path / "site", reflectance=spectra)
    browser.open((tmp_path / "site" / "index.html").as_uri())
    light = {"illuminant": "A", "adaptation": 0.56} if spectra is not None else {}
    codes = lit(browser, "window", {"rotation": TURN, **light})

    def rendered(angle: float) -> impasto.Image:
        room = impasto.Environment.named("window", rotation=np.radians(angle))
        scene = impasto.Scene(environment=room, **light)
        return impasto.render(surface, scene, reflectance=spectra)

    image = rendered(TURN)
    known = image.coverage > 0
    assert image.display[known].std() > 5, "a picture that shows something"
    off = np.abs(codes - image.display)[known]
    further = np.abs(rendered(TURN + degrees).display.astype(int) - image.display)[known]
    assert off.mean() < further.mean(), (off.mean(), further.mean())
    if name == "matte":
        assert off.max() <= 1


def test_an_environment_of_the_caller_is_shown(browser: chromium.Chromium, tmp_path: Path) -> None:
    """A room that is red at the left and blue at the right lights what faces each side so."""
    radiance = np.zeros((3, 32, 64), np.float32)
    radiance[0, :, 32:] = radiance[2, :, :32] = 1.0  # of a viewer who looks at the painting
    path = tmp_path / "halves.exr"
    impasto.io.write_exr(path, dict(zip("RGB", radiance, strict=True)))
    random = np.random.default_rng(2)
    surface = impasto.Surface(normals(random), numbers(random, 0.5, 0.9, 3))
    own = impasto.Environment.read(path)
    write_site(surface, tmp_path / "site", environments=[own])
    browser.open((tmp_path / "site" / "index.html").as_uri())
    name = browser.value("window.impasto.viewer.doc.environments.at(-1).name")
    codes = lit(browser, name, {})
    image = impasto.render(surface, impasto.Scene(environment=own))
    assert np.abs(image.display[..., 0].astype(int) - image.display[..., 2]).max() > 30
    # The map has few texels, which a cube's means of nine rays smooth by a texel: 6 degrees.
    assert np.abs(codes - image.display).mean() < 2.0


def test_wrong_environments_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(4)
    surface = impasto.Surface(normals(random), numbers(random, 0.5, 0.9, 3))
    with pytest.raises(impasto.ArgumentError, match="environments: expected a sequence of"):
        Contents(surface, environments=["gallery"])  # type: ignore[list-item]
    room = impasto.Environment.named("gallery")
    with pytest.raises(impasto.ArgumentError, match="at most 11, found 12"):
        Contents(surface, environments=[room] * 12)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    stack = impasto.Stack(surface.predict(lights), lights=lights)
    impasto.fit_sbrdf(stack, pooling="none", check=False).save(tmp_path / "fit.npz")
    place = ["export", "web", str(tmp_path / "fit.npz"), "--out", str(tmp_path / "site")]
    assert main([*place, "--environment", "galery"]) == 1
    assert "did you mean 'gallery'?" in " ".join(capsys.readouterr().err.split())

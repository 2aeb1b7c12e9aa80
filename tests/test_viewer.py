"""The page that shows a painting in any light: its pixels are those of the renderer."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
from impasto.surface import Lobe, Surface
from impasto.viewer import write_site

SHAPE = (24, 40)
WAVELENGTHS = np.arange(400.0, 701.0, 10.0)


def normals(random: np.random.Generator, shape: tuple[int, int] = SHAPE) -> NDArray[np.float32]:
    lean = random.normal(0.0, 0.25, (2, *shape))
    planes = np.concatenate([lean, np.ones((1, *shape))])
    return (planes / np.linalg.norm(planes, axis=0)).astype(np.float32)


class Spectra:
    """Reflectances on smooth basis spectra that are no orthonormal ones."""

    def __init__(self, random: np.random.Generator) -> None:
        centres = np.array([420.0, 500.0, 560.0, 620.0, 690.0])
        self.wavelengths = WAVELENGTHS
        self.basis = np.exp(-(((WAVELENGTHS - centres[:, None]) / 50.0) ** 2))
        self.coefficients = random.uniform(0.0, 0.6, (5, *SHAPE)).astype(np.float32)


def numbers(random: np.random.Generator, low: float, high: float, *sizes: int) -> NDArray[Any]:
    return random.uniform(low, high, (*sizes, *SHAPE)).astype(np.float32)


def surfaces() -> dict[str, tuple[Surface, Any]]:
    """Every kind of map that a surface may have."""
    random = np.random.default_rng(0)
    normal, diffuse = normals(random), numbers(random, 0.05, 0.9, 3)
    found: dict[str, tuple[Surface, Any]] = {
        "matte": (Surface(normal, diffuse), None),
        "one pair": (Surface.torrance_sparrow(normal, diffuse, 2.0, 0.12, pitch_mm=0.5), None),
        "grey": (Surface.torrance_sparrow(normal, diffuse[:1], 1.0, 0.3), None),
        "coated": (
            Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2, coated=True, index=1.6), None
        ),
    }  # fmt: skip
    beta, gamma = numbers(random, 0.0, 3.0, 2, 3), numbers(random, 0.04, 0.5, 2)
    beta[1, :, :6] = 0.0
    gamma[1, :6] = np.nan  # a lobe that is not there has no shape
    ambient = numbers(random, 0.0, 0.1, 3)
    broken = normal.copy()
    broken[:, 10:14, 3:9] = np.nan
    found["pixels"] = (
        Surface.torrance_sparrow(broken, diffuse, beta, gamma, ambient=ambient), None
    )  # fmt: skip
    found["lafortune"] = (
        Surface.lafortune(
            normal, diffuse,
            numbers(random, 0.0, 0.4, 3, 3), -numbers(random, 0.8, 1.1, 3),
            numbers(random, 0.8, 1.1, 3), numbers(random, 1.0, 150.0, 3),
        ), None,
    )  # fmt: skip
    spectra = Spectra(random)
    # Leaf of metal at the left, which a varnish leaves as it is; paint at the right.
    leaf = np.where(np.arange(SHAPE[1]) < 12, 300.0, 4.0) * np.ones(SHAPE, np.float32)
    found["spectra"] = (Surface.torrance_sparrow(normal, diffuse, leaf, 0.1), spectra)
    neutral = Lobe(numbers(random, 0.0, 0.3), (-0.98, 1.01, 60.0))
    found["phong spectra"] = (Surface(normal, diffuse, (neutral,), "lafortune"), spectra)
    return found


LAMP = impasto.DistantLight.from_angles
RAKING = {"azimuth": 200, "elevation": 8}
SCENES: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("matte", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("matte", RAKING, {"lights": [LAMP(np.radians(200), np.radians(8))]}),
    ("one pair", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("one pair", {"azimuth": 0, "elevation": 90}, {"lights": [LAMP(0.0, np.pi / 2)]}),
    ("one pair", {"exposure": 1}, {"lights": [LAMP(np.pi / 2, np.pi / 4)], "exposure": 2.0}),
    ("one pair", {"near": 15}, {"lights": [impasto.PointLight((0, 15 * 0.5**0.5, 15 * 0.5**0.5))]}),
    ("grey", RAKING, {"lights": [LAMP(np.radians(200), np.radians(8))]}),
    ("coated", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("coated", RAKING, {"lights": [LAMP(np.radians(200), np.radians(8))]}),
    ("pixels", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("pixels", RAKING, {"lights": [LAMP(np.radians(200), np.radians(8))]}),
    ("lafortune", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("lafortune", {"elevation": 80}, {"lights": [LAMP(np.pi / 2, np.radians(80))]}),
    ("spectra", {}, {"lights": [LAMP(np.pi / 2, np.pi / 4)]}),
    ("spectra", {"illuminant": "A"}, {"illuminant": "A"}),
    ("spectra", {"illuminant": "A", "adaptation": 0.56}, {"illuminant": "A", "adaptation": 0.56}),
    ("spectra", {"illuminant": "A", "adaptation": 1}, {"illuminant": "A", "adaptation": 1.0}),
    ("spectra", {"illuminant": "A", "adaptation": 0}, {"illuminant": "A", "adaptation": 0.0}),
    ("spectra", {"illuminant": "LED-B3", "adaptation": 0.3},
     {"illuminant": "LED-B3", "adaptation": 0.3}),
    ("spectra", {"illuminant": "D50"}, {"illuminant": "D50"}),
    ("spectra", {"varnish": "clear"}, {"varnish": impasto.Varnish()}),
    ("spectra", {"varnish": "yellowed", "illuminant": "A", "adaptation": 0.56},
     {"varnish": impasto.Varnish(yellowness=10.0), "illuminant": "A", "adaptation": 0.56}),
    ("spectra", {"varnish": "brown", **RAKING},
     {"varnish": impasto.Varnish(yellowness=30.0),
      "lights": [LAMP(np.radians(200), np.radians(8))]}),
    ("phong spectra", {"varnish": "yellowed"}, {"varnish": impasto.Varnish(yellowness=10.0)}),
]  # fmt: skip
"""A surface, what the page is asked for, and the same as a scene of the renderer."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    folder = tmp_path_factory.mktemp("profile")
    with chromium.Chromium(folder, size=(900, 600)) as started:
        yield started


def shown(browser: chromium.Chromium, changes: dict[str, Any], scale: int = 0) -> NDArray[Any]:
    """What the page makes of a state, ``(y, x, 4)`` codes."""
    data = browser.value(
        "(async () => { const { viewer } = window.impasto;"
        f"viewer.set({{ ...viewer.first, ...{json.dumps(changes)} }});"
        f"const {{ width, height, data }} = await viewer.picture({scale});"
        "let text = ''; for (const code of data) text += String.fromCharCode(code);"
        "return [height, width, btoa(text)]; })()"
    )
    height, width, text = data
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)


def test_the_page_has_the_pixels_of_the_renderer(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """Within one code: normals are kept in 16 bits, and each side rounds for itself.

    A normal is off by 2^-16, so the narrowest lobe here, of 0.04 rad, by 2 ln 2 / 0.04 * 2^-16 =
    5e-4 of itself, 0.06 codes; half precision of a colour is 0.03 codes. All is far from 1.
    """
    off = []
    for name, (surface, spectra) in surfaces().items():
        folder = tmp_path / name
        write_site(surface, folder, reflectance=spectra)
        browser.open((folder / "index.html").as_uri())
        for page, options in [scene[1:] for scene in SCENES if scene[0] == name]:
            scene = impasto.Scene(**{"lights": [LAMP(np.pi / 2, np.pi / 4)], **options})
            image = impasto.render(surface, scene, reflectance=spectra)
            codes = shown(browser, page)
            known = image.coverage > 0
            worst = np.abs(codes[..., :3].astype(int) - image.display)[known].max()
            off.append(worst)
            assert (codes[..., 3] > 0).tolist() == known.tolist(), (name, page)
            assert image.display[known].std() > 5, "a picture that shows something"
            assert worst <= 1, (name, page, worst)
    assert len(off) == len(SCENES) >= 20

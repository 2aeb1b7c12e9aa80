"""Relightable images of other programs in the page, and two paintings side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
from impasto.cli import main
from impasto.io import read_relightable
from impasto.io.rti import Basis, RelightableImage
from impasto.surface import Surface
from impasto.viewer import Contents, write_site
from viewer_page import on_canvas, shown

SHAPE = (24, 40)
LIGHTS = [(90.0, 45.0), (200.0, 8.0), (0.0, 90.0), (317.0, 55.0)]
"""Azimuths and elevations in degrees."""


def direction(azimuth: float, elevation: float) -> tuple[float, float, float]:
    a, e = np.radians(azimuth), np.radians(elevation)
    return float(np.cos(e) * np.cos(a)), float(np.cos(e) * np.sin(a)), float(np.sin(e))


def images() -> dict[str, RelightableImage]:
    """Every kind of functions, colours and coding, of random planes."""
    random = np.random.default_rng(7)

    def codes(count: int) -> NDArray[np.uint8]:
        return random.integers(0, 256, (count, *SHAPE), np.uint8)

    def numbers(count: int, size: float) -> dict[str, Any]:
        scale = random.uniform(0.2, 1.0, count) * size / 255.0
        return {"scale": scale, "bias": -random.uniform(0.2, 0.5, count) * size}

    found = {
        "ptm": RelightableImage(
            codes(18), **numbers(18, 0.8), basis=Basis("ptm", 6), coding="srgb"
        ),
        "ptm, luminance": RelightableImage(
            codes(6), np.full(6, 1 / 255), np.full(6, -0.2), Basis("ptm", 6), "lrgb", "srgb",
            colour=codes(3),
        ),
        "hsh, four": RelightableImage(
            codes(12), **numbers(12, 1.5), basis=Basis("hsh", 4), coding="linear"
        ),
        "hsh": RelightableImage(
            codes(27), **numbers(27, 0.8), basis=Basis("hsh", 9), coding="linear"
        ),
        "sh": RelightableImage(codes(27), **numbers(27, 1.0), basis=Basis("sh", 9), coding="srgb"),
    }  # fmt: skip
    at = np.array([direction(*one) for one in random.uniform((0, 5), (360, 88), (30, 2))])
    components = random.normal(0.0, 0.3, (10, 30, 3))
    components[0] = random.uniform(0.2, 0.6, (30, 3))
    found["rbf"] = RelightableImage(
        codes(9), **numbers(9, 2.0), basis=Basis("rbf", 30, at, 0.3), colourspace="mrgb",
        coding="linear", components=components, lights=at,
    )  # fmt: skip
    return found


def test_a_relightable_image_is_shown_as_its_functions_say(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """Within one code of :meth:`RelightableImage.display`: both sum in single precision.

    A sum of 28 numbers below 2 is off by 28 * 2^-24 * 2 = 3e-6, 0.001 codes, before each rounds.
    """
    for number, (name, image) in enumerate(images().items()):
        folder = tmp_path / str(number)
        write_site(image, folder)
        browser.open((folder / "index.html").as_uri())
        for azimuth, elevation in LIGHTS:
            expected = image.display(direction(azimuth, elevation)).astype(int)
            state = {"azimuth": azimuth, "elevation": elevation}
            codes = shown(browser, state)[..., :3].astype(int)
            assert expected.std() > 10, "a picture that shows something"
            assert np.abs(codes - expected).max() <= 1, (name, azimuth, elevation)


def test_exposure_is_that_of_linear_light(browser: chromium.Chromium, tmp_path: Path) -> None:
    """One stop is twice the light, also where a file holds display codes.

    The decoded code is doubled and coded again: the slope of that is 2^(1/2.4) above the linear
    part and 2 in it, so that what rounds differently stays within one code.
    """
    image = images()["ptm"]
    write_site(image, tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    light = np.clip(2.0 * image.linear(direction(90, 45))[0].astype(float), 0.0, 1.0)
    expected = 255.0 * np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )
    codes = shown(browser, {"exposure": 1})[..., :3].astype(float)
    # What is above white without exposure is white with it.
    assert np.abs(np.moveaxis(codes, -1, 0) - expected).max() <= 1.0


@pytest.mark.parametrize("name", ["ptm18", "hsh27", "rbf27"])
def test_relight_s_own_folder_is_shown(
    name: str, browser: chromium.Chromium, tmp_path: Path, data: Path
) -> None:
    """Of 402 x 395 pixels, in four tiles; a smaller scale is the mean of 2 x 2.

    Planes of means are kept in half precision, off by 1/16 of a code at most. Of the 27 planes
    that add to a channel none weighs more than 4 per 255 codes here: 27 * 4 / 16 / 255 is 0.03
    of the range only if all err together; 2 codes are allowed where the curve is steep.
    """
    image = read_relightable(data / "peer_relight" / name)
    site = tmp_path / "site"
    assert main(["export", "web", str(data / "peer_relight" / name), "--out", str(site),
                 "--quiet"]) == 0  # fmt: skip
    browser.open((site / "index.html").as_uri())
    assert browser.value("document.querySelector('h1').textContent") == name
    at = direction(317, 55)
    state = {"azimuth": 317, "elevation": 55}
    codes = shown(browser, state)[..., :3].astype(int)
    assert np.abs(codes - image.display(at)).max() <= 1
    whole = image.values(at)[0].astype(float)
    rows, columns = (size // 2 for size in whole.shape[1:])
    means = whole[:, : 2 * rows, : 2 * columns].reshape(3, rows, 2, columns, 2).mean(axis=(2, 4))
    light = np.clip(means, 0.0, 1.0)
    expected = 255.0 * np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )
    smaller = np.moveaxis(shown(browser, state, 1)[..., :3].astype(float), -1, 0)
    assert np.abs(smaller - expected).max() <= 2.0


def painting(seed: int) -> Surface:
    random = np.random.default_rng(seed)
    normal = np.zeros((3, *SHAPE), np.float32)
    normal[:2] = random.normal(0.0, 0.2, (2, *SHAPE))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.8, (3, *SHAPE)).astype(np.float32)
    return Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2)


@pytest.mark.parametrize("other", ["rbf", "ptm, luminance", "a surface"])
def test_two_paintings_are_shown_in_the_same_lamp(
    other: str, browser: chromium.Chromium, tmp_path: Path
) -> None:
    """Pixel for pixel: left of the line one, right of it the other, and their CIEDE2000.

    The difference is compared with colour-science's on the codes of the two renderers. A step of
    the ramp is 20 / 255 = 0.08; codes off by one change a dark colour by up to 1 (13 steps), and
    by 0.4 in the mean of bright ones.
    """
    beside: Any = painting(2) if other == "a surface" else images()[other]
    write_site(painting(1), tmp_path / "site", against=beside, against_title="The other")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    at = direction(200, 30)
    scene = impasto.Scene([impasto.DistantLight(at)])
    left = impasto.render(painting(1), scene).display.astype(int)
    right = (
        impasto.render(painting(2), scene).display if other == "a surface" else beside.display(at)
    ).astype(int)
    state = {"azimuth": 200, "elevation": 30, "split": 0.5, "view": [20, 12, 8]}
    # The canvas is 480 wide: its middle column is the painting's, eight columns to a pixel.
    codes = on_canvas(browser, state)[..., :3].astype(int)
    rows, columns = codes.shape[:2]
    top, start = rows / 2 - 12 * 8 + 4, columns / 2 - 20 * 8 + 4
    picked = codes[
        np.ix_((top + 8 * np.arange(24)).astype(int), (start + 8 * np.arange(40)).astype(int))
    ]
    assert np.abs(picked[:, :20] - left[:, :20]).max() <= 1
    assert np.abs(picked[:, 20:] - right[:, 20:]).max() <= 1
    assert np.abs(left - right).max() > 50, "the two differ"
    ramp = np.array(browser.value("window.impasto.viewer.doc.ramp"))
    codes = on_canvas(browser, state | {"compare": "difference", "split": 0})[..., :3].astype(int)
    picked = codes[
        np.ix_((top + 8 * np.arange(24)).astype(int), (start + 8 * np.arange(40)).astype(int))
    ]
    step = np.abs(picked[..., None, :] - ramp).sum(axis=-1).argmin(axis=-1)
    with colour.utilities.suppress_warnings(colour_usage_warnings=True):
        lab = [
            colour.XYZ_to_Lab(colour.sRGB_to_XYZ(one / 255.0), [0.3127, 0.3290])
            for one in (left, right)
        ]
        expected = np.clip(colour.delta_E(*lab, method="CIE 2000") / 20.0 * 255.0, 0, 255)
    assert np.median(np.abs(step - expected)) <= 2.0
    assert np.abs(step - expected).max() <= 26.0


def test_the_other_painting_can_be_put_away(browser: chromium.Chromium, tmp_path: Path) -> None:
    beside = images()["hsh"]
    write_site(painting(1), tmp_path / "site", against=beside, against_title="relight <i>hsh</i>")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    assert browser.value("window.impasto.viewer.state.against") is True
    label = "[...document.querySelectorAll('label')].find(one => one.textContent === %s)"
    name = json.dumps("relight <i>hsh</i>")
    assert browser.value(f"{label % name} !== undefined")
    browser.value(f"{label % json.dumps('None')}.click()")
    assert browser.value("window.impasto.viewer.state.against") is False
    browser.until("document.querySelector('.divider').hidden")
    link = browser.value("window.impasto.viewer.link()")
    assert "against=none" in link
    # It has one layer: beside normals there is nothing, and the page says so.
    browser.value(f"{label % name}.click()")
    browser.value("window.impasto.viewer.set({ layer: 'normals' }); window.impasto.viewer.draw(0)")
    assert browser.value("document.querySelector('.divider').hidden") is True
    assert "has no such layer" in browser.value("document.querySelector('aside').textContent")
    # A link from one's own hand shows something.
    for text in ("against=difference,0.2", "against=x,y", "against=", "against=difference,9"):
        browser.value(f"location.hash = {json.dumps(text)}")
        browser.value("new Promise(done => setTimeout(done, 0))")
        assert browser.value("window.impasto.viewer.state.against") is True
        assert 0.0 <= browser.value("window.impasto.viewer.state.split") <= 1.0


def test_what_cannot_stand_beside_is_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    small = RelightableImage(
        random.integers(0, 256, (18, 24, 39), np.uint8), np.ones(18), np.zeros(18), Basis("ptm", 6)
    )
    with pytest.raises(impasto.ArgumentError, match=r"40 x 24 pixels.*found 39 x 24"):
        Contents(painting(1), against=small)
    with pytest.raises(impasto.ArgumentError, match="relightable image has no spectra"):
        Contents(images()["ptm"], reflectance=object())
    with pytest.raises(impasto.ArgumentError, match="that of a relightable image cannot"):
        Contents(images()["ptm"], height=np.zeros(SHAPE))


def test_a_file_of_another_program_says_what_is_odd(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """relight's ``.ptm`` has scales of 0: it is black, and command and page say why."""
    out = tmp_path / "site"
    assert main(["export", "web", str(data / "peer_relight" / "icon.ptm"), "--out", str(out)]) == 0
    assert "scales are 0" in " ".join(capsys.readouterr().err.split())
    assert b"scales are 0" in (out / "document.js").read_bytes()

"""Light from an environment on the page: its pixels against the renderer, and how it is turned."""

from __future__ import annotations

import base64
import gzip
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
from impasto.rooms import ROOMS
from impasto.viewer import Contents, write_site
from impasto.viewer.environments import Environments
from test_viewer import surfaces


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    with chromium.Chromium(tmp_path_factory.mktemp("profile"), size=(1000, 600)) as started:
        yield started


def shown(browser: chromium.Chromium, changes: dict[str, Any], quality: str) -> NDArray[Any]:
    """What the page makes of a state, ``(y, x, 4)`` codes."""
    height, width, text = browser.value(
        "(async () => { const { viewer } = window.impasto;"
        f"viewer.set({{ ...viewer.first, ...{json.dumps(changes)} }});"
        f"const {{ width, height, data }} = await viewer.picture(0, {{}}, {json.dumps(quality)});"
        "let text = ''; for (const code of data) text += String.fromCharCode(code);"
        "return [height, width, btoa(text)]; })()"
    )
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)


TURNED = impasto.Environment.named("gallery", rotation=np.pi / 3)
YELLOWED = impasto.Varnish(yellowness=10.0)
SCENES: list[tuple[str, str, float, str, dict[str, Any], dict[str, Any], float, float]] = [
    ("matte", "gallery", 0, "saved", {}, {}, 1, 0.1),
    ("matte", "overcast", 30, "saved", {}, {}, 1, 0.1),
    ("matte", "candles", 200, "saved", {}, {}, 2, 0.2),
    ("coated", "window", 20, "resting", {}, {}, 4, 0.5),
    ("one pair", "gallery", 60, "resting", {"exposure": -1},
     {"exposure": 0.5 / TURNED.irradiance().max()},
     2, 0.3),
    ("pixels", "candles", 0, "resting", {}, {}, 3, 0.5),
    ("spectra", "gallery", 60, "saved",
     {"varnish": "yellowed", "illuminant": "A", "adaptation": 0.56},
     {"varnish": YELLOWED, "illuminant": "A", "adaptation": 0.56}, 6, 0.4),
    ("lafortune", "gallery", 0, "resting", {}, {}, 18, 0.8),
]  # fmt: skip
"""A surface, a room, degrees, quality of the tables, what the page and a scene are asked for, and
the largest and the mean difference in codes."""


def test_pixels_in_an_environment_are_those_of_the_renderer(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """Matte surfaces to one code: their light is that of the renderer's, in 768 lamps or more.

    Candles are smaller than their texels, which the renderer's map of other texels shifts by half
    of 0.7 degrees: 0.6 % of the light of a facet at 60 degrees, a code. Tables of lobes are sums
    over 32 directions at rest and 256 in a picture that is saved, whose error falls with their
    number and grows with the strength of the gloss, to 300 in "spectra". The bounds are little
    more than what was found. Of surfaces that are quickly rendered, a room that is turned by half a
    radian more is off by five times the bound on average: turning is a rotation, in this sense.
    """
    for name in dict.fromkeys(scene[0] for scene in SCENES):
        surface, spectra = surfaces()[name]
        write_site(surface, tmp_path / name, reflectance=spectra)
        browser.open((tmp_path / name / "index.html").as_uri())
        for _, room, degrees, quality, page, options, most, mean in (
            scene for scene in SCENES if scene[0] == name
        ):
            light = impasto.Environment.named(room, rotation=np.radians(degrees))
            scene = impasto.Scene(environment=light, **options)
            image = impasto.render(surface, scene, reflectance=spectra)
            codes = shown(browser, {"environment": room, "rotation": degrees, **page}, quality)
            known = image.coverage > 0
            off = np.abs(codes[..., :3].astype(int) - image.display)[known]
            assert (codes[..., 3] > 0).tolist() == known.tolist(), (name, room)
            assert image.display[known].std() > 20, "a picture that shows something"
            assert off.max() <= most, (name, room, off.max())
            assert off.mean() <= mean, (name, room, off.mean())
            if name in {"matte", "one pair"}:
                further = impasto.Scene(environment=light.rotated(0.5), **options)
                turned = impasto.render(surface, further, reflectance=spectra).display
                moved = np.abs(codes[..., :3].astype(int) - turned)[known]
                assert moved.mean() >= 5.0 * mean, (name, room, moved.mean())


def test_a_room_by_name_and_a_missing_map_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page has the rooms; the option adds files. Nothing is read or written before."""
    for word, said in (("candles", "every page has Candles"), ("none.exr", "none.exr: cannot be")):
        words = ["export", "web", "none", "--out", str(tmp_path / "site"), "--environment", word]
        assert main(words) == 1
        assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "site").exists()


def test_dragging_and_keys_turn_the_room(browser: chromium.Chromium, tmp_path: Path) -> None:
    """By half of a circle over the width of the canvas, by 5 and 1 degrees; a lamp ends it."""
    write_site(surfaces()["matte"][0], tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri() + "#environment=window,350")
    state = "window.impasto.viewer.state"
    browser.until("window.impasto.viewer.renderer.environments.has('window')")
    assert browser.value(f"[{state}.environment, {state}.rotation]") == ["window", 350]
    width = browser.value("window.impasto.viewer.canvas.clientWidth")
    browser.drag((width / 4, 300), (width / 2, 300))
    assert browser.value(f"{state}.rotation") == pytest.approx(35, abs=1)
    before = browser.value(f"{state}.rotation")
    browser.key("ArrowRight")
    browser.key("ArrowLeft", shift=True)
    assert browser.value(f"{state}.rotation") == pytest.approx(before + 4)
    assert browser.until("document.querySelector('.readout').textContent.includes('North window')")
    text = browser.value("window.impasto.viewer.link()")
    assert f"environment=window,{round(before + 4, 2):g}" in text
    browser.key("r")
    assert browser.value(f"{state}.environment") == "none"


def test_an_environment_of_ones_own_is_shown(browser: chromium.Chromium, tmp_path: Path) -> None:
    """A cube with one bright face beyond half precision, to be seen and behind the wall."""
    faces = np.full((6, 3, 8, 8), 0.02, np.float32)
    faces[0, :, 2:6, 2:6] = np.array([3e5, 2e5, 1e5])[:, None, None]
    lit, behind = (
        impasto.Environment(faces, rotation=angle, intensity=0.5, name="One <lamp>")
        for angle in (0.9, -0.9)
    )
    surface, _ = surfaces()["matte"]
    write_site(surface, tmp_path / "site", environments=[lit, behind])
    browser.open((tmp_path / "site" / "index.html").as_uri())
    for name, turned in (("own-1", lit), ("own-2", behind)):
        codes = shown(browser, {"environment": name}, "saved")[..., :3].astype(int)
        image = impasto.render(surface, impasto.Scene(environment=turned))
        assert np.abs(codes - image.display).max() <= 2, name
    assert browser.value("document.body.textContent.includes('One <lamp>')")


def test_cubes_hold_the_light_of_the_maps() -> None:
    """Irradiance of four facets by a sum over the faces, with directions from the text of OpenGL.

    Texels are 0.7 degrees wide; the renderer's own table is exact to 1e-4.
    """
    rooms = Environments()
    for number, name in enumerate(ROOMS):
        record = rooms.records[number]
        side = record["side"]
        data = np.frombuffer(gzip.decompress(rooms.data(number)), np.float16)
        faces = data.astype(np.float64).reshape(6, side, side, 3) * record["scale"]
        t, s = np.meshgrid(*[2.0 * (np.arange(side) + 0.5) / side - 1.0] * 2, indexing="ij")
        one = np.ones_like(s)
        major = [
            (one, -t, -s),
            (-one, -t, s),
            (s, one, t),
            (s, -one, -t),
            (s, -t, one),
            (-s, -t, -one),
        ]
        towards = np.stack([np.stack(face, axis=-1) for face in major])
        length = np.linalg.norm(towards, axis=-1, keepdims=True)
        light = faces * 4.0 / side**2 / length**3 * (towards[..., 2:] > 0.0)
        for normal in ((0, 0, 1), (0.6, 0, 0.8), (0, 0.6, 0.8), (-0.3, -0.4, np.sqrt(0.75))):
            cosine = np.maximum(towards / length @ np.array(normal), 0.0)
            found = (light * cosine[..., None]).sum(axis=(0, 1, 2))
            expected = impasto.Environment.named(name).irradiance(normal)
            np.testing.assert_allclose(found, expected, rtol=0.015, err_msg=name)


def test_what_is_no_environment_is_refused() -> None:
    surface = surfaces()["matte"][0]
    even = impasto.Environment(np.ones((3, 4, 8)))
    with pytest.raises(impasto.ArgumentError, match="environments"):
        Contents(surface, environments=["gallery"])  # type: ignore[list-item]
    with pytest.raises(impasto.ArgumentError, match="at most 11"):
        Contents(surface, environments=[even] * 12)
    made = Contents(surface).file("environments/5.js")
    assert made is not None
    with pytest.raises(IndexError):
        made()


def test_the_page_is_ready_when_the_tables_of_a_room_are(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """However long the room takes to load."""
    write_site(surfaces()["one pair"][0], tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    seen = browser.value(
        "(async () => { const { viewer } = window.impasto, kept = viewer.source.environment;"
        " const wait = ms => new Promise(done => setTimeout(done, ms));"
        " viewer.source.environment = number => wait(400).then(() => kept(number));"
        " viewer.set({ environment: 'gallery' }); await wait(200);"
        " const early = document.documentElement.dataset.ready ?? null;"
        " while (!document.documentElement.dataset.ready) await wait(5);"
        " const { prefilter } = viewer.renderer;"
        " return [early, prefilter?.shown?.quality ?? null, prefilter?.busy ?? null]; })()"
    )
    assert seen == [None, "resting", False]

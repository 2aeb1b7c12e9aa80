"""The page that shows a painting in any light: its pixels are those of the renderer."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
from impasto.cli import main
from impasto.surface import Lobe, Surface
from impasto.viewer import Contents, ViewServer, write_site
from loopback import serving
from viewer_page import shown

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
        self.interface = random.uniform(0.0, 0.5, (5, 3))


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
    gilded = Surface.torrance_sparrow(
        normal, diffuse, 40.0 * beta, np.nan_to_num(gamma, nan=0.2), ambient=ambient
    )
    found["gilded spectra"] = (gilded, spectra)
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
    ("gilded spectra", {"illuminant": "A", "adaptation": 0.56},
     {"illuminant": "A", "adaptation": 0.56}),
    ("gilded spectra", {"varnish": "yellowed", "elevation": 20},
     {"varnish": impasto.Varnish(yellowness=10.0), "lights": [LAMP(np.pi / 2, np.radians(20))]}),
    ("phong spectra", {"varnish": "yellowed"}, {"varnish": impasto.Varnish(yellowness=10.0)}),
]  # fmt: skip
"""A surface, what the page is asked for, and the same as a scene of the renderer."""


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


def encoded(linear: NDArray[Any]) -> NDArray[Any]:
    """8-bit codes of IEC 61966-2-1, before rounding."""
    light = np.clip(linear.astype(float), 0.0, 1.0)
    return 255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def test_what_the_display_clips_is_marked(browser: chromium.Chromium, tmp_path: Path) -> None:
    """Where the renderer's linear light is above 1, or below 0: half of the pixels, in stripes.

    Linear light of both sides agrees to 1e-3; pixels that are nearer to a limit are left out.
    """
    surface, spectra = surfaces()["gilded spectra"]
    spectra.coefficients[[0, 2, 3, 4], :, 15:] *= 0.01  # a green that no display has
    write_site(surface, tmp_path / "site", reflectance=spectra)
    browser.open((tmp_path / "site" / "index.html").as_uri())
    scene = impasto.Scene([LAMP(np.pi / 2, np.pi / 4)])
    linear = impasto.render(surface, scene, reflectance=spectra).linear
    codes = shown(browser, {"clipped": True})[..., :3].astype(int)
    plain = shown(browser, {})[..., :3].astype(int)
    marked = (codes != plain).any(axis=-1)
    bright, outside = linear.max(axis=0) > 1.0, linear.min(axis=0) < -1e-3
    sure = (np.abs(linear - 1.0) > 2e-3).all(axis=0) & (np.abs(linear + 1e-3) > 2e-3).all(axis=0)
    assert min((bright & sure).sum(), (outside & ~bright & sure).sum()) > 20, "both are there"
    rows, columns = np.indices(SHAPE)
    stripes = (rows + columns) % 4 < 2
    assert (marked[sure] == ((bright | outside) & stripes)[sure]).all()
    red = codes[bright & sure & stripes]
    blue = codes[outside & ~bright & sure & stripes]
    assert (red[:, 0] == 255).all()
    assert (blue[:, 2] == 255).all()
    # The saved picture has none.
    browser.value("window.impasto.viewer.set({ clipped: true })")
    found = browser.value(
        "(async () => { const { data } = await window.impasto.viewer.picture(0,"
        " { clipped: false }); return [...data]; })()"
    )
    saved = np.array(found).reshape(*SHAPE, 4)[..., :3]
    assert (saved == plain).all()


def test_layers_show_how_far_a_fit_can_be_trusted(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """On ramps of the logarithm, 0.1 to 10 degrees and 0.1 to 10 % of white.

    A step of the ramp is 2.7 %, and half precision is off by 0.05 %: the neighbouring step at most.
    """
    random = np.random.default_rng(5)
    lights = np.array([[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8],
                       [0.0, 0.0, 1.0]])  # fmt: skip
    true = Surface(normals(random), numbers(random, 0.2, 0.7, 3))
    noise = 0.01 * random.normal(size=(5, 3, *SHAPE)) * random.uniform(0, 1, SHAPE)
    mask = np.ones(SHAPE, bool)
    mask[3:6, 4:9] = False
    samples = np.maximum(true.predict(lights) + noise, 1e-3)
    stack = impasto.Stack(samples, lights=lights, mask=mask)
    result = impasto.fit_sbrdf(stack, pooling="none", check=False)
    write_site(result, tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    ramp = np.array(browser.value("window.impasto.viewer.doc.ramp"))
    for name, (low, high) in {"sigma": np.radians([0.1, 10.0]), "residual": (1e-3, 0.1)}.items():
        codes = shown(browser, {"layer": name})[..., :3].astype(int)
        values = getattr(result, name)
        known = np.isfinite(values)
        steps = 255 * np.log(values[known] / low) / np.log(high / low)
        expected = np.clip(np.rint(steps), 0, 255).astype(int)
        assert np.unique(expected).size > 50, "the map is no constant"
        near = np.stack([ramp[np.clip(expected + step, 0, 255)] for step in (-1, 0, 1)])
        assert (near == codes[known]).all(axis=-1).any(axis=0).all()
        grey = codes[~known]
        assert len(grey) >= 15
        assert (grey == grey[:, :1]).all(), "unknown is grey"
        legend = browser.value("document.querySelector('.legend').textContent")
        assert legend == {"sigma": "0.1°10°", "residual": "0.1 % of white10 %"}[name]
    browser.value("window.impasto.viewer.inspect(7, 12)")
    browser.until("document.querySelector('dl.values') !== null")
    rows = browser.value("document.querySelector('dl.values').textContent")
    said = re.search(r"Uncertainty of the normal([\d.]+)°", rows)
    assert said is not None
    # Two digits are shown.
    assert float(said[1]) == pytest.approx(np.degrees(result.sigma[12, 7]), rel=0.06)


@pytest.mark.parametrize("name", ["pixels", "lafortune"])
def test_from_the_side_it_has_the_light_of_the_model(
    browser: chromium.Chromium, tmp_path: Path, name: str
) -> None:
    """Each pixel as :meth:`Surface.predict` has it for this view; one code, as in front."""
    surface, _ = surfaces()[name]
    write_site(surface, tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    azimuth, tilt, light = np.radians(250.0), np.radians(50.0), (0.0, 0.5**0.5, 0.5**0.5)
    view = (np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt))
    expected = encoded(surface.predict([light], view)[0])
    codes = shown(browser, {"towards": 250, "tilt": 50})
    known = np.isfinite(expected).all(axis=0)
    found = np.moveaxis(codes[..., :3].astype(float), -1, 0)
    front = encoded(surface.predict([light])[0])
    assert np.abs(front - expected)[:, known].max() > 20, "the view counts"
    assert np.abs(found - expected)[:, known].max() <= 1.0


def test_relief_moves_what_is_seen_from_the_side(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """A bright square 2 mm above a dark ground, seen from the right: it moves left by h sin(tilt).

    Its left edge is measured, in pixels of the canvas: the wall below it is hidden. A cell of the
    grid, a third of a pixel of the painting, is 2 columns wide there, and pixels are whole.
    """
    height = np.zeros(SHAPE, np.float32)
    height[8:16, 16:24] = 2.0
    diffuse = np.where(height > 0, 0.9, 0.02) * np.ones((3, 1, 1), np.float32)
    normal = np.zeros((3, *SHAPE), np.float32)
    normal[2] = 1.0
    flat = Surface(normal, diffuse.astype(np.float32), height=height, pitch_mm=0.5)
    write_site(flat, tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    edge = (
        "(relief => { const { viewer } = window.impasto, { gl, canvas } = viewer.renderer;"
        "viewer.set({ ...viewer.first, tilt: 40, towards: 0, relief, view: [20, 12, 9] });"
        "viewer.draw(0); const data = new Uint8Array(4 * canvas.width * canvas.height);"
        "gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, data);"
        "let left = Infinity, count = 0;"
        "for (let i = 0; i < canvas.width * canvas.height; i++)"
        "  if (data[4 * i] > 150) { left = Math.min(left, i % canvas.width); count++; }"
        "return [left, count]; })"
    )
    (before, area), (after, _) = (browser.value(f"{edge}({times})") for times in (0, 1))
    # Foreshortened: 8 columns of 9 pixels times cos(40 degrees), 8 rows.
    assert area == pytest.approx(8 * 9 * np.cos(np.radians(40.0)) * 8 * 9, rel=0.1)
    assert after - before == pytest.approx(-2.0 / 0.5 * 9 * np.sin(np.radians(40.0)), abs=3.0)


def test_a_store_is_shown_at_all_its_scales(browser: chromium.Chromium, tmp_path: Path) -> None:
    """Tiles are cut anew of the store's own, which are smaller here; each scale is as rendered."""
    random = np.random.default_rng(3)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    true = Surface(normals(random, (270, 300)), random.uniform(0.2, 0.7, (3, 270, 300)))
    stack = impasto.Stack(true.predict(lights), lights=impasto.Rig(lights, pitch_mm=0.1))
    out = impasto.run(stack, tmp_path / "a.zarr", tile=128, pooling="none")
    stored = impasto.open_sbrdf(out)
    assert stored.factors[:2] == (2, 4)
    scene = impasto.Scene([LAMP(np.pi / 2, np.pi / 4)])
    with serving(ViewServer(Contents(stored))) as server:
        browser.open(server.url)
        for scale, painting in enumerate((impasto.load_sbrdf(out), stored.level(2))):
            expected = impasto.render(painting, scene, fidelity="model").display
            codes = shown(browser, {}, scale)[..., :3].astype(int)
            assert codes.shape == expected.shape
            assert np.abs(codes - expected).max() <= 1
        # A view of single pixels loads no tile that is not seen.
        browser.open(f"{server.url}#view=10,10,40")
        names = browser.value("[...window.impasto.viewer.renderer.textures.keys()].sort().join()")
        assert names == f"0/0-0,{len(stored.factors)}/0-0"
        browser.value("window.impasto.viewer.inspect(12, 11)")
        status = browser.value("document.querySelector('dl.values').textContent")
    assert "column 12, row 11" in status
    assert re.search(r"1\.[23] mm from the left, 1\.[12] mm from the top", status)
    code = int(stored.map("status", slice(11, 12), slice(12, 13))[0, 0])
    assert impasto.Status(code).reason in status


def test_the_command_writes_a_page_of_any_result(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """A result folder, an .npz and a .zarr, opened from the disk: each as it is rendered."""
    random = np.random.default_rng(4)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    true = Surface(normals(random), numbers(random, 0.2, 0.7, 3))
    stack = impasto.Stack(true.predict(lights), lights=impasto.Rig(lights, pitch_mm=0.5))
    photographs = tmp_path / "stack.npz"
    impasto.io.write_stack(photographs, stack)
    folder = tmp_path / "folder"
    words = [str(photographs), "--out", str(folder), "--pooling", "none", "--quiet"]
    assert main(["fit", *words]) == 0
    result = impasto.load_sbrdf(folder / "sbrdf.npz")
    result.save(tmp_path / "a.impasto.zarr")
    expected = impasto.render(result, impasto.Scene([LAMP(np.pi / 2, np.pi / 4)]), fidelity="model")
    assert expected.display.std() > 5
    for number, name in enumerate(("folder", "folder/sbrdf.npz", "a.impasto.zarr")):
        site = tmp_path / f"site{number}"
        words = [str(tmp_path / name), "--out", str(site), "--title", name, "--quiet"]
        words += ["--photographs", str(photographs)] if number == 0 else []
        assert main(["export", "web", *words]) == 0
        browser.open((site / "index.html").as_uri())
        assert browser.value("document.querySelector('h1').textContent") == name
        codes = shown(browser, {})[..., :3].astype(int)
        assert np.abs(codes - expected.display).max() <= 1
        photographed = browser.value("window.impasto.viewer.doc.photographs.length")
        assert photographed == (4 if number == 0 else 0)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The address of a page on a disk, with all that a result can have."""
    surface, _ = surfaces()["pixels"]
    lights = [[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]]
    stack = impasto.Stack(np.nan_to_num(surface.predict(lights)), lights=lights)
    folder = tmp_path_factory.mktemp("pages") / "site"
    write_site(surface, folder, stack=stack, title="Icon <i>1</i>", pitch_mm=0.5)
    return (folder / "index.html").as_uri()


@pytest.fixture
def opened(browser: chromium.Chromium, site: str) -> chromium.Chromium:
    """The page as it is when it opens; loaded anew only where another one is shown."""
    if browser.address != site:
        browser.open(site)
    browser.value(
        "(() => { const { viewer } = window.impasto; viewer.notes = []; viewer.choose('light');"
        " viewer.set({ ...viewer.first }); viewer.canvas.focus(); })()"
    )
    return browser


def state(browser: chromium.Chromium) -> dict[str, Any]:
    return dict(browser.value("window.impasto.viewer.state"))


def test_the_light_follows_pointer_and_keys(opened: chromium.Chromium) -> None:
    box = opened.value(
        "(() => { const b = document.querySelector('canvas').getBoundingClientRect();"
        " return [b.x, b.y, b.width, b.height]; })()"
    )
    middle = box[0] + box[2] / 2, box[1] + box[3] / 2
    reach = 0.48 * min(box[2:])
    # Half way from the middle to the edge, to the right: cos(elevation) is 1/2.
    opened.drag(middle, (middle[0] + reach / 2, middle[1]))
    found = state(opened)
    assert found["elevation"] == pytest.approx(60.0, abs=0.5)
    assert min(found["azimuth"], 360 - found["azimuth"]) < 0.5
    assert opened.value("document.querySelector('.readout').textContent") == (
        "Light from the right, 60° high"
    )
    for _ in range(40):  # never below the horizon
        opened.key("ArrowRight")
    assert state(opened)["elevation"] == pytest.approx(2.0)
    opened.key("r")
    assert (state(opened)["azimuth"], state(opened)["elevation"]) == (45.0, 10)
    opened.key("i")
    assert opened.value("document.querySelector('[aria-pressed=true]').textContent") == "Inspect"
    opened.drag(middle, middle)
    opened.until("document.querySelector('dl.values') !== null")
    column, row = state(opened)["pixel"]
    assert (abs(column - SHAPE[1] // 2) <= 1, abs(row - SHAPE[0] // 2) <= 2) == (True, True)
    assert opened.value("document.querySelectorAll('aside svg.plot').length") == 1


def test_a_picture_is_turned_with_its_light(opened: chromium.Chromium) -> None:
    """A quarter turn counterclockwise: what was right is above, and so is what the pointer says."""
    before = opened.value("window.impasto.viewer.toCanvas([40, 12])")
    middle = opened.value("window.impasto.viewer.toCanvas([20, 12])")
    assert before[0] > middle[0]
    assert before[1] == pytest.approx(middle[1])
    opened.key("t")
    opened.until("window.impasto.viewer.state.turns === 1")
    after = opened.value("window.impasto.viewer.toCanvas([40, 12])")
    centre = opened.value("window.impasto.viewer.toCanvas([20, 12])")
    assert centre == pytest.approx(middle, abs=1e-6)
    assert after[0] == pytest.approx(centre[0])
    assert after[1] < centre[1]
    back = opened.value(f"window.impasto.viewer.place({json.dumps(after)})")
    assert back == pytest.approx([40, 12])
    opened.value("window.impasto.viewer.lightAt(0, 0.5)")  # from above on the page
    assert state(opened)["azimuth"] == pytest.approx(0.0, abs=1e-6)
    assert opened.value("document.querySelector('.readout').textContent") == (
        "Light from above, 60° high"
    )
    # The file has the picture as it stands on the page.
    opened.value("HTMLAnchorElement.prototype.click = function () { window.saved = this.href; }")
    opened.value("window.impasto.viewer.savePicture()")
    opened.until("window.saved !== undefined")
    size = opened.value(
        "new Promise(done => { const image = new Image(); image.onload = () =>"
        " done([image.width, image.height]); image.src = window.saved; })"
    )
    assert size == [SHAPE[0], SHAPE[1]]


def test_a_link_shows_the_same_again(opened: chromium.Chromium) -> None:
    changes = {
        "azimuth": 200.0, "elevation": 15.0, "near": 120.0, "exposure": 1.5, "layer": "width",
        "gloss": False, "tilt": 30, "towards": 45, "turns": 3, "view": [10.0, 12.0, 8.0],
        "pixel": [3, 4],
    }  # fmt: skip
    before = opened.value(
        f"(() => {{ const {{ viewer }} = window.impasto; viewer.set({json.dumps(changes)});"
        " viewer.link(); return viewer.state; })()"
    )
    address = opened.value("location.href")
    opened.open(address)
    assert state(opened) == before == before | changes
    opened.value("location.hash = 'light=30,40'")
    opened.until("window.impasto.viewer.state.azimuth === 30")
    # Whatever stands behind #, the page shows something.
    for text in (
        "light=NaN,1e999", "view=0,0,0&pixel=-1,99999", "d=7&illuminant=%00&layer=x", "&&=",
        "photograph=99", "light=1&near=-5&eye=5,500&off=x,,gloss",
    ):  # fmt: skip
        opened.value(f"location.hash = {json.dumps(text)}")
        opened.value("new Promise(done => setTimeout(done, 0))")  # the page is told later
        found = state(opened)
        assert 2 <= found["elevation"] <= 90
        assert found["layer"] == "picture"
        assert found["photograph"] == -1


def test_a_photograph_is_compared_in_its_own_light(opened: chromium.Chromium) -> None:
    """It is what the model predicts: the page's difference is that of two roundings."""
    opened.value("window.impasto.viewer.compareWith(1)")
    opened.until("window.impasto.viewer.renderer.photographs.has(1)")
    opened.value("window.impasto.viewer.set({ compare: 'difference', split: 0 })")
    bright = (
        "new Promise(done => requestAnimationFrame(() => { const { renderer, doc } = "
        "window.impasto.viewer; window.impasto.viewer.draw(0); const { gl, canvas } = renderer;"
        "const data = new Uint8Array(4 * canvas.width * canvas.height);"
        "gl.bindFramebuffer(gl.FRAMEBUFFER, null);"
        "gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, data);"
        "const steps = [];"
        "for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255) steps.push("
        "  doc.ramp.findIndex(c => c[0] === data[i] && c[1] === data[i+1] && c[2] === data[i+2]));"
        "done([steps.length, Math.min(...new Set(steps)), Math.max(...new Set(steps)),"
        "  steps.filter(s => s > 13).length]); }))"
    )
    # The controls say which lamp it is and what the colours mean, also where a link shows it.
    assert opened.value(
        "[...document.querySelectorAll('input[type=number]')].slice(0, 2).map(one => +one.value)"
    ) == [0, round(np.degrees(np.arctan2(0.8, 0.6)))]
    assert opened.value(
        "[...document.querySelectorAll('.ends')].some(one => one.checkVisibility()"
        " && one.textContent.includes('CIEDE2000'))"
    )
    count, least, most, large = opened.value(bright)
    assert count > 1000
    assert least == 0
    # 255 steps are 20 CIEDE2000; a code of 8 bits is up to 1 of it in the dark (13 steps).
    assert large < 0.002 * count, most
    # In another light it is not: the map is no constant.
    opened.value(
        "window.impasto.viewer.doc.photographs[1].direction = [-0.6, 0, 0.8];"
        "window.impasto.viewer.changed()"
    )
    assert opened.value(bright)[3] > 0.5 * count
    opened.value("window.impasto.viewer.doc.photographs[1].direction = [0.6, 0, 0.8]")


def test_nothing_is_asked_of_another_host(opened: chromium.Chromium) -> None:
    names = opened.value("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert all(name.startswith(("file:", "blob:", "data:")) for name in names)
    blocked = opened.value(
        "new Promise(done => { document.addEventListener('securitypolicyviolation',"
        " event => done(event.effectiveDirective));"
        " new Image().src = 'http://127.0.0.1:9/x.png'; })"
    )
    assert blocked == "img-src"
    refused = opened.value("fetch('http://127.0.0.1:9/').then(() => 'sent', () => 'refused')")
    assert refused == "refused"


def test_notes_are_web_annotations(opened: chromium.Chromium) -> None:
    opened.key("n")
    opened.value("window.impasto.viewer.askNote([2, 3, 10, 5])")
    opened.value("document.querySelector('textarea').value = 'a <b>loss</b>'")
    opened.click("dialog .main")
    opened.until("window.impasto.viewer.notes.length === 1")
    (found,) = opened.value("window.impasto.viewer.notes")
    assert found["@context"] == "http://www.w3.org/ns/anno.jsonld"
    assert (found["type"], found["body"]["type"]) == ("Annotation", "TextualBody")
    assert found["body"]["value"] == "a <b>loss</b>"
    assert found["target"]["selector"] == {
        "type": "FragmentSelector", "conformsTo": "http://www.w3.org/TR/media-frags/",
        "value": "xywh=pixel:2,3,10,5",
    }  # fmt: skip
    assert "<b>" in opened.value("document.querySelector('.notes').textContent")
    page = json.dumps({"type": "AnnotationPage", "items": [found | {"id": "urn:x"}, {"bad": 1}]})
    opened.value(f"window.impasto.viewer.openNotes(new File([{json.dumps(page)}], 'n.json'))")
    assert opened.value("window.impasto.viewer.notes.length") == 2


def test_controls_have_names(opened: chromium.Chromium) -> None:
    """Every control that a screen reader meets says what it is."""
    opened.value("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    nodes = opened.call("Accessibility.getFullAXTree")["nodes"]
    roles = {"button", "slider", "checkbox", "radio", "spinbutton", "application", "textbox"}
    controls = [node for node in nodes if node.get("role", {}).get("value") in roles]
    assert len(controls) > 25
    nameless = [node["role"]["value"] for node in controls if not node.get("name", {}).get("value")]
    assert nameless == []


def test_notes_that_are_handed_on_hold_no_token(browser: chromium.Chromium, tmp_path: Path) -> None:
    surface, _ = surfaces()["matte"]
    with serving(ViewServer(Contents(surface))) as server:
        browser.open(server.url)
        browser.value("window.impasto.viewer.askNote([2, 3, 10, 5])")
        browser.value("document.querySelector('textarea').value = 'a loss'")
        browser.click("dialog .main")
        browser.until("window.impasto.viewer.notes.length === 1")
        (found,) = browser.value("window.impasto.viewer.notes")
    assert found["target"]["source"] == "urn:impasto:view"
    assert server.token not in json.dumps(found)

"""Stores of any size in the page: what is read, what is shown of it, and when."""

from __future__ import annotations

import gzip
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
import impasto.fit.stored.maps as stored_maps
import impasto.fit.stored.result as stored_result
from impasto.cli import main
from impasto.surface import Surface
from impasto.viewer import Contents, write_site
from impasto.viewer.layout import SHOWN
from viewer_page import shown

ROWS, COLUMNS = 630, 610
LIGHTS = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8], [0.0, 0.0, 1.0]]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Noise that grows to the right, a hole, and one smaller scale."""
    random = np.random.default_rng(2)
    normal = np.zeros((3, ROWS, COLUMNS), np.float32)
    normal[:2] = random.normal(0.0, 0.1, (2, ROWS, COLUMNS))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.3, 0.6, (3, ROWS, COLUMNS)).astype(np.float32)
    samples = Surface(normal, diffuse).predict(LIGHTS)
    samples += 0.02 * random.normal(size=samples.shape) * np.linspace(0.05, 1.0, COLUMNS)
    mask = np.ones((ROWS, COLUMNS), bool)
    mask[300:420, 260:400] = False
    stack = impasto.Stack(
        np.maximum(samples, 1e-3).astype(np.float32),
        lights=impasto.Rig(LIGHTS, pitch_mm=0.1), mask=mask,
    )  # fmt: skip
    out = tmp_path_factory.mktemp("store") / "painting.impasto.zarr"
    impasto.run(stack, out, tile=320, pooling="none")
    return out


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    with chromium.Chromium(tmp_path_factory.mktemp("profile"), size=(800, 500)) as started:
        yield started


def planes_of(contents: Contents, number: int, row: int, column: int) -> dict[str, NDArray[Any]]:
    """The numbers of a tile by the document alone."""
    scale, side = contents.document["scales"][number], contents.document["side"]
    shape = (min(side, scale["height"] - row * side), min(side, scale["width"] - column * side))
    make = contents.data(f"tiles/{number}/{row}-{column}")
    assert make is not None
    data, found = gzip.decompress(make()), {}
    for group in contents.document["groups"]:
        kind = np.dtype({"int16": "<i2", "half": "<f2", "single": "<f4"}[group["number"]])
        count = group["layers"] * shape[0] * shape[1] * 4
        texels = np.frombuffer(data, kind, count).reshape(group["layers"], *shape, 4)
        data = data[count * kind.itemsize :]
        for index, name in enumerate(group["planes"]):
            found[name] = texels[index // 4, ..., index % 4]
    return found


def test_how_far_a_stored_fit_can_be_trusted_is_shown(store: Path) -> None:
    """Of the pixel itself, and from afar of the pixel in the middle of those that are one."""
    contents = Contents(impasto.open_sbrdf(store))
    whole = impasto.load_sbrdf(store)
    assert contents.document["quality"] == ["sigma", "residual"]
    for number, factor in ((0, 1), (1, 2)):
        assert contents.document["scales"][number]["factor"] == factor
        planes = planes_of(contents, number, 0, 0)
        shape = planes["flags"].shape
        for name in ("sigma", "residual", "status"):
            values = getattr(whole, name)[factor // 2 :: factor, factor // 2 :: factor]
            values = values[: shape[0], : shape[1]]
            if name == "status":
                assert (planes["flags"] % SHOWN == values).all()
                continue
            known = np.isfinite(values) & (planes["flags"] >= SHOWN)
            # Half precision has 11 bits.
            assert np.allclose(planes[name][known], values[known], rtol=2.0**-11, atol=1e-7)
            assert known.mean() > 0.5
    assert np.unique(planes_of(contents, 0, 1, 1)["flags"]).size > 1, "the hole is in this tile"


def test_a_stored_layer_is_shown_in_the_page(
    browser: chromium.Chromium, store: Path, tmp_path: Path
) -> None:
    write_site(impasto.open_sbrdf(store), tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    codes = shown(browser, {"layer": "residual"}, 1)[..., :3].astype(int)
    ramp = np.array(browser.value("window.impasto.viewer.doc.ramp"))
    values = impasto.load_sbrdf(store).residual[1::2, 1::2][: codes.shape[0], : codes.shape[1]]
    known = np.isfinite(values) & (codes.min(axis=-1) != codes.max(axis=-1))
    expected = (
        np.clip(255 * np.log(values[known] / 1e-3) / np.log(100.0), 0, 255).round().astype(int)
    )
    near = np.stack([ramp[np.clip(expected + step, 0, 255)] for step in (-1, 0, 1)])
    assert (near == codes[known]).all(axis=-1).any(axis=0).mean() > 0.999
    assert np.unique(expected).size > 30


def test_a_tile_reads_its_own_window_alone(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing else of any map, and no statistics before somebody asks for effects."""
    windows: list[tuple[str, int]] = []

    def watched(read: Any) -> Any:
        def reading(path: Path, array: Any, rows: slice, columns: slice) -> Any:
            windows.append((array.name, (rows.stop - rows.start) * (columns.stop - columns.start)))
            return read(path, array, rows, columns)

        return reading

    for module in (stored_maps, stored_result):
        monkeypatch.setattr(module, "read_window", watched(module.read_window))
    whole: list[str] = []
    for module in (stored_maps, stored_result):
        read = module.read_array

        def reading(path: Path, array: Any, read: Any = read) -> Any:
            whole.append(array.name)
            return read(path, array)

        monkeypatch.setattr(module, "read_array", reading)
    contents = Contents(impasto.open_sbrdf(store))
    assert max((size for _, size in windows), default=0) <= 1, "before a tile is asked for"
    assert "statistics" not in whole
    windows.clear()
    planes_of(contents, 0, 0, 0)
    small = -(-ROWS // 2) * -(-COLUMNS // 2)
    assert ("levels/2/normal", small) in windows, "for the relief, once"
    windows.clear()
    planes_of(contents, 0, 1, 1)
    assert {size for _, size in windows} == {256 * 256}
    assert {"normal", "diffuse", "status", "sigma", "residual"} <= {name for name, _ in windows}
    windows.clear()
    planes_of(contents, 1, 0, 0)
    sizes = dict(windows)
    assert sizes["levels/2/normal"] == 256 * 256
    assert sizes["sigma"] == 512 * 512, "the pixels of which one is shown"
    effects = contents.data("effects")
    assert effects is not None
    assert {one["name"] for one in json.loads(effects())} >= {"diffuse", "ambient"}
    assert "statistics" in whole


@pytest.mark.parametrize("threads", [1, 3])
def test_a_page_reads_each_pixel_once_and_has_the_tiles_that_are_served(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: int
) -> None:
    """A window is read for all tiles in it; a tile alone, as the server makes it, is the oracle."""
    read, sizes = stored_maps.read_window, []

    def reading(path: Path, array: Any, rows: slice, columns: slice) -> Any:
        if array.name == "normal":
            sizes.append((rows.stop - rows.start) * (columns.stop - columns.start))
        return read(path, array, rows, columns)

    monkeypatch.setattr(stored_maps, "read_window", reading)
    folder = tmp_path / "site"
    done: list[int] = []
    site = write_site(
        impasto.open_sbrdf(store), folder, threads=threads, progress=lambda at, _: done.append(at)
    )
    # One pixel more is read before, for what is no map.
    assert sum(size for size in sizes if size > 1) == ROWS * COLUMNS
    contents = Contents(impasto.open_sbrdf(store))
    names = list(contents.names())
    assert site.files == len(names) == done[-1]
    assert sum("tiles/0/" in name for name in names) == 9
    for name in names:
        make = contents.file(name)
        assert make is not None
        assert (folder / name).read_bytes() == make(), name


def test_a_page_of_a_damaged_store_is_not_written(store: Path, tmp_path: Path) -> None:
    """A fault in one of several threads ends the others and leaves nothing."""
    damaged = tmp_path / "a.impasto.zarr"
    shutil.copytree(store, damaged)
    chunk = next(one for one in (damaged / "diffuse" / "c").rglob("*") if one.is_file())
    data = bytearray(chunk.read_bytes())
    data[len(data) // 3] ^= 0xFF
    chunk.write_bytes(data)
    with pytest.raises(impasto.CorruptInputError, match="diffuse"):
        write_site(impasto.open_sbrdf(damaged), tmp_path / "site", threads=3)
    assert [one.name for one in tmp_path.iterdir()] == ["a.impasto.zarr"]


def test_one_tile_holds_the_whole_of_any_store(store: Path) -> None:
    """Scales below the smallest of the store are made of that, as the store's own are."""
    stored = impasto.open_sbrdf(store)
    contents = Contents(stored)
    scales = contents.document["scales"]
    assert [one["factor"] for one in scales] == [1, 2, 4]
    assert max(scales[-1]["height"], scales[-1]["width"]) <= 256
    assert stored.factors == (2,)
    planes = planes_of(contents, 2, 0, 0)
    above = stored.level(2).normal
    means = above[:, : 2 * (above.shape[1] // 2), : 2 * (above.shape[2] // 2)]
    means = means.reshape(3, means.shape[1] // 2, 2, means.shape[2] // 2, 2)
    mean = means.mean(axis=(2, 4))
    mean /= np.linalg.norm(mean, axis=0)
    found = np.stack([planes[name] for name in "xyz"]) / 32767.0
    whole = np.isfinite(means).all(axis=(0, 2, 4)) & (planes["flags"] >= SHOWN)
    assert whole.mean() > 0.9
    # Normals are rounded to 1 / 32767; the mean is one of unit vectors whose lengths are kept.
    assert np.abs(found - mean)[:, whole].max() < 1e-3
    # The status of the pixel in the middle of two by two, twice.
    status = impasto.load_sbrdf(store).status[3::4, 3::4]
    rows, columns = planes["flags"].shape
    assert (planes["flags"] % SHOWN == status[:rows, :columns]).all()


def test_a_saved_result_without_scales_has_them_in_the_page(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    surface_normals = np.zeros((3, 300, 280), np.float32)
    surface_normals[2] = 1.0
    diffuse = random.uniform(0.3, 0.6, (3, 300, 280)).astype(np.float32)
    samples = Surface(surface_normals, diffuse).predict(LIGHTS)
    saved = impasto.fit_sbrdf(impasto.Stack(samples, lights=LIGHTS), pooling="none", check=False)
    saved.save(tmp_path / "a.impasto.zarr")
    contents = Contents(impasto.open_sbrdf(tmp_path / "a.impasto.zarr"))
    assert [one["factor"] for one in contents.document["scales"]] == [1, 2]
    planes = planes_of(contents, 1, 0, 0)
    mean = saved.diffuse.reshape(3, 150, 2, 140, 2).mean(axis=(2, 4))
    assert np.allclose(planes["diffuse1"], mean[1], rtol=2e-3)
    assert (planes["flags"] % SHOWN == saved.status[1::2, 1::2]).all()


@pytest.mark.parametrize("kind", ["surface", "store"])
def test_a_painting_without_an_estimate_says_so(
    kind: str, browser: chromium.Chromium, tmp_path: Path
) -> None:
    normal = np.full((3, 20, 30), np.nan, np.float32)
    diffuse = np.full((3, 20, 30), np.nan, np.float32)
    empty: Any = Surface(normal, diffuse)
    if kind == "store":
        stack = impasto.Stack(np.full((5, 3, 20, 30), 0.5), lights=LIGHTS)
        fitted = impasto.fit_sbrdf(stack, pooling="none", check=False)
        fitted.normal[:] = np.nan
        fitted.diffuse[:] = np.nan
        fitted.status[:] = int(impasto.Status.MASKED)
        fitted.save(tmp_path / "a.impasto.zarr")
        empty = impasto.open_sbrdf(tmp_path / "a.impasto.zarr")
    assert Contents(empty).empty
    write_site(empty, tmp_path / "site")
    browser.open((tmp_path / "site" / "index.html").as_uri())
    said = browser.value("document.querySelector('.wait').textContent")
    assert said.startswith("No pixel of this painting has an estimate")
    assert browser.value("document.querySelector('.wait').hidden") is False
    if kind == "store":
        assert impasto.Status.MASKED.reason in said
        browser.value("window.impasto.viewer.set({ layer: 'status' })")
        browser.until("document.querySelector('.wait').hidden")
        words = tmp_path / "a.impasto.zarr", "--out", tmp_path / "page"
        assert main(["export", "web", *map(str, words)]) == 0


def test_a_painting_with_one_estimate_is_not_empty() -> None:
    normal = np.full((3, 20, 30), np.nan, np.float32)
    diffuse = np.full((3, 20, 30), np.nan, np.float32)
    normal[:, 7, 9], diffuse[:, 7, 9] = (0.0, 0.0, 1.0), 0.5
    assert not Contents(Surface(normal, diffuse)).empty


def test_a_store_has_the_spectra_of_its_camera(browser: chromium.Chromium, tmp_path: Path) -> None:
    """Each tile as :func:`impasto.fit_reflectance` has it of the whole, lit as the renderer does.

    Codes within one, as of a result in memory.
    """
    random = np.random.default_rng(5)
    normal = np.zeros((3, 300, 270), np.float32)
    normal[:2] = random.normal(0.0, 0.15, (2, 300, 270))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.7, (3, 300, 270)).astype(np.float32)
    samples = Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2).predict(LIGHTS)
    stack = impasto.Stack(samples, lights=LIGHTS, bands=("red", "green", "blue"))
    out = impasto.run(stack, tmp_path / "a.zarr", tile=160, pooling="painting", effort="draft")
    camera = impasto.Camera.srgb()
    whole = impasto.load_sbrdf(out)
    spectra = impasto.fit_reflectance(None, whole, camera)
    page = tmp_path / "page"
    words = [str(out), "--out", str(page), "--camera", "srgb", "--quiet"]
    assert main(["export", "web", *words]) == 0
    browser.open((page / "index.html").as_uri())
    lamp = impasto.DistantLight((0.0, 0.5**0.5, 0.5**0.5))
    for state, options in (
        ({"illuminant": "A", "adaptation": 0.56}, {"illuminant": "A", "adaptation": 0.56}),
        ({"varnish": "yellowed"}, {"varnish": impasto.Varnish(yellowness=10.0)}),
    ):
        scene = impasto.Scene([lamp], **options)  # type: ignore[arg-type]
        image = impasto.render(whole, scene, reflectance=spectra, fidelity="model")
        codes = shown(browser, state)[..., :3].astype(int)
        known = image.coverage > 0
        assert image.display[known].std() > 5
        assert np.abs(codes - image.display)[known].max() <= 1
    assert browser.value("window.impasto.viewer.doc.colours.basis.length") == len(spectra.basis)


def test_a_camera_must_be_that_of_the_store(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grid = np.arange(400.0, 701.0, 10.0)
    six = impasto.Camera(grid, np.ones((6, len(grid))), "D65")
    with pytest.raises(impasto.ArgumentError, match="3 bands of the photographs"):
        Contents(impasto.open_sbrdf(store), camera=six)
    with pytest.raises(impasto.ArgumentError, match="give the camera"):
        Contents(impasto.open_sbrdf(store), reflectance=object())
    assert main(["view", str(store), "--no-browser", "--illuminant", "A"]) == 2
    assert "it needs --camera" in capsys.readouterr().err


def test_what_is_no_result_is_named_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    normal = np.zeros((3, 20, 30), np.float32)
    normal[2] = 1.0
    write_site(Surface(normal, np.full((3, 20, 30), 0.5, np.float32)), tmp_path / "page")
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    (photographs / "lights.LP").write_text("0\n")
    for folder, said in (
        (tmp_path / "page", "is a page already: open"),
        (photographs, "holds photographs: impasto fit"),
        (tmp_path, "has no sbrdf.npz"),
    ):
        assert main(["view", str(folder), "--no-browser"]) == 1
        assert said in " ".join(capsys.readouterr().err.split())


def test_a_store_has_the_relief_of_a_small_scale(tmp_path: Path) -> None:
    """A dome of known height on 600 x 640 pixels, integrated at half the scale.

    h = 2 mm cos^2 of the distance, down to 0 at 25 mm: curvature at most h pi^2 / (2 * 25^2) =
    0.016 / mm. Linear interpolation over pixels of 0.2 mm misses 0.2^2 / 8 of it, 8e-5 mm; slopes
    of single-precision normals and the level leave more. One hundredth of the height is asked for.
    """
    rows, columns, pitch = 600, 640, 0.1
    y, x = np.mgrid[:rows, :columns].astype(float)
    x, y = (x - 319.5) * pitch, (299.5 - y) * pitch
    r = np.maximum(np.hypot(x, y), 1e-9)
    height = np.where(r < 25.0, 2.0 * np.cos(np.pi * r / 50.0) ** 2, 0.0)
    slope = np.where(r < 25.0, -2.0 * np.sin(np.pi * r / 25.0) * np.pi / 50.0, 0.0)
    normal = np.stack([-slope * x / r, -slope * y / r, np.ones_like(r)])
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    surface = Surface(normal, np.full((3, rows, columns), 0.5, np.float32))
    stack = impasto.Stack(surface.predict(LIGHTS), lights=impasto.Rig(LIGHTS, pitch_mm=pitch))
    out = impasto.run(stack, tmp_path / "a.zarr", tile=320, pooling="none")
    contents = Contents(impasto.open_sbrdf(out))
    assert contents.document["relief"] is True
    for number, row, column in ((0, 1, 1), (0, 0, 2), (1, 0, 0), (2, 0, 0)):
        factor, side = contents.document["scales"][number]["factor"], 256
        found = planes_of(contents, number, row, column)["height"].astype(float)
        top, left = row * side * factor, column * side * factor
        part = height[top : top + factor * found.shape[0], left : left + factor * found.shape[1]]
        sizes = found.shape[0], factor, found.shape[1], factor
        expected = part.reshape(sizes).mean(axis=(1, 3)) - height.mean()
        # Half precision of 2 mm is 1e-3.
        assert np.abs(found - expected).max() < 0.02, (number, row, column)

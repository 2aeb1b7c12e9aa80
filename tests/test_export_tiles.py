"""Exports of paintings that are not loaded: what is written tile by tile is what the whole has.

The store is small; the limit from which on a painting is written by tiles is lowered.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

import impasto
from command_line import complaint
from impasto import export
from impasto.cli import main, scale
from impasto.errors import ArgumentError, CorruptInputError
from impasto.export import formats, iiif
from impasto.io import read_image
from killed_jobs import stack

ROWS, COLUMNS = 277, 601
"""Odd and prime: no scale fills its groups."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("store") / "ä b.impasto.zarr"
    impasto.run(stack((ROWS, COLUMNS)), path, pooling="painting", effort="draft", tile=128)
    return path


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 40000 pixels on a painting is too large to be loaded."""
    for module in (formats, iiif):
        monkeypatch.setattr(module, "LOADED", 40_000)
    monkeypatch.setattr(scale, "WHOLE", 40_000)


def deep_zoom(folder: Path, name: str, level: int) -> NDArray[Any]:
    """A level of a pyramid, by the rules of the format alone."""
    image = ET.parse(folder / f"{name}.dzi").getroot()
    space = "{http://schemas.microsoft.com/deepzoom/2008}"
    assert image.tag == f"{space}Image"
    size = image.find(f"{space}Size")
    assert size is not None
    width, height = int(size.attrib["Width"]), int(size.attrib["Height"])
    side, overlap = int(image.attrib["TileSize"]), int(image.attrib["Overlap"])
    assert overlap == 0
    top = int(np.ceil(np.log2(max(width, height))))
    wide, tall = (-(-one // 2 ** (top - level)) for one in (width, height))
    files = folder / f"{name}_files" / str(level)
    rows = []
    for row in range(-(-tall // side)):
        tiles = [read_image(files / f"{column}_{row}.{image.attrib['Format']}")
                 for column in range(-(-wide // side))]  # fmt: skip
        rows.append(np.concatenate(tiles, axis=2))
    found = np.concatenate(rows, axis=1)
    assert found.shape[1:] == (tall, wide)
    assert len(list(files.iterdir())) == -(-tall // side) * -(-wide // side)
    return found


@pytest.mark.usefixtures("large")
def test_openlime_pyramids_have_the_maps_of_the_whole(store: Path, tmp_path: Path) -> None:
    stored = impasto.open_sbrdf(store)
    report = export.to("openlime", stored, tmp_path / "tiles")
    content = json.loads((tmp_path / "tiles" / "layers.json").read_text())
    layer = content["layers"]["brdf"]
    assert layer["layout"] == "deepzoom1px"
    assert set(layer["channels"]) == {"kd", "ks", "normals", "gloss"}
    # The same painting in memory, exported whole; both are as bright as they fit.
    whole = export.to("openlime", impasto.load_sbrdf(store), tmp_path / "whole")
    other = json.loads((tmp_path / "whole" / "layers.json").read_text())
    # From a smaller scale, whose brightest colours are means.
    assert content["brightness"] == pytest.approx(other["brightness"], rel=0.05)
    for name, file in layer["channels"].items():
        top = deep_zoom(tmp_path / "tiles", file.removesuffix(".dzi"), 10)
        expected = read_image(tmp_path / "whole" / f"{name}.png")
        if name in {"normals", "gloss"}:
            np.testing.assert_array_equal(top, expected)
        else:  # as the brightness differs
            assert top.shape == expected.shape
    # The next scales show the same from afar: normals of a mean slope, within two steps of a code.
    smaller = deep_zoom(tmp_path / "tiles", "normals", 9)
    normal = impasto.load_sbrdf(store).normal[:, : ROWS // 2 * 2, : COLUMNS // 2 * 2]
    mean = normal.reshape(3, ROWS // 2, 2, COLUMNS // 2, 2).mean(axis=(2, 4))
    mean /= np.linalg.norm(mean, axis=0)
    codes = np.rint(127.5 * (mean + 1.0))
    assert np.abs(smaller[:, : ROWS // 2, : COLUMNS // 2].astype(int) - codes).max() <= 2
    np.testing.assert_array_equal(smaller[:, -1], smaller[:, -2])
    # 256 pixels: the level from which OpenLIME starts; none beyond.
    assert deep_zoom(tmp_path / "tiles", "kd", 8).shape[2] == -(-COLUMNS // 4)
    assert report.p50 is not None
    assert whole.p50 is not None
    assert report.p50 == pytest.approx(whole.p50, rel=0.3)
    assert not (tmp_path / "tiles" / "rti").exists()
    assert any("RTI" in words for words in report.lost)


@pytest.mark.usefixtures("large")
def test_iiif_tiles_of_a_store_are_those_of_the_whole(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every file that both have is the same; whole pictures are those that can be held."""
    monkeypatch.setattr(iiif, "TILE", 128)
    monkeypatch.setattr(iiif, "WIDE", 256)
    report = export.to("iiif", impasto.open_sbrdf(store), tmp_path / "tiles")
    loss = export.to("iiif", impasto.load_sbrdf(store), tmp_path / "whole")
    files = {path.relative_to(tmp_path / "tiles") for path in (tmp_path / "tiles").rglob("*.jpg")}
    assert len([path for path in files if path.parts[0] != "full"]) == 15 + 6 + 2
    for path in files:
        if path.parts[:2] != ("full", "max"):
            one, other = ((tmp_path / name / path).read_bytes() for name in ("tiles", "whole"))
            assert one == other, path
    info = json.loads((tmp_path / "tiles" / "info.json").read_text())
    assert (info["width"], info["height"]) == (COLUMNS, ROWS)
    assert info["tiles"][0]["scaleFactors"] == [1, 2, 4, 8]
    # 601 x 277 and 301 x 139 are more than 40000 pixels.
    assert (info["maxWidth"], info["maxHeight"]) == (151, 70)
    assert info["sizes"] == [{"width": 76, "height": 35}, {"width": 151, "height": 70}]
    largest = read_image(tmp_path / "tiles" / "full" / "max" / "0" / "default.jpg")
    assert largest.shape == (3, 70, 151)
    assert report.p50 == pytest.approx(loss.p50, rel=0.5)


@pytest.mark.usefixtures("large")
def test_heights_and_normals_of_a_store(store: Path, tmp_path: Path) -> None:
    stored, loaded = impasto.open_sbrdf(store), impasto.load_sbrdf(store)
    report = export.to("height", stored, tmp_path / "a.tif", pitch_mm=0.2)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].is_tiled
        facts = json.loads(file.pages[0].description)
        codes = file.asarray()
    assert codes.dtype == np.uint16
    assert (codes.min(), codes.max()) == (0, 65535)
    found = codes * facts["mm_per_code"] + facts["mm_at_code_0"]
    assert facts["pixelSizeInMM"] == 0.2
    # Half a code of 16 bits, and the rounding of float32.
    assert report.measured["height_error_mm"] < 0.51 * facts["mm_per_code"]
    # By tiles on a coarse grid: the difference is a part of what no surface explains.
    exact = loaded.height(0.2)
    off = found - exact - (found - exact).mean()
    assert np.sqrt(np.mean(off**2)) < 0.02 * (exact.max() - exact.min())
    turned = impasto.find_level(loaded.normal)
    report = export.to("height", stored, tmp_path / "a.tif", pitch_mm=0.2, level=True)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        facts = json.loads(file.pages[0].description)
        found = file.asarray() * facts["mm_per_code"] + facts["mm_at_code_0"]
    assert f"the lean ({turned}): heights are about its plane" in report.lost
    off = found - loaded.height(0.2, level=turned)
    assert np.sqrt(np.mean((off - off.mean()) ** 2)) < 0.02 * (exact.max() - exact.min())
    export.to("normal-map", stored, tmp_path / "b.tif")
    export.to("normal-map", loaded, tmp_path / "b.png")
    np.testing.assert_array_equal(read_image(tmp_path / "b.tif"), read_image(tmp_path / "b.png"))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a.tif", "a.tif.loss.json", "b.png", "b.png.loss.json", "b.tif", "b.tif.loss.json",
    ]  # fmt: skip


@pytest.mark.usefixtures("large")
def test_what_is_not_tiled_says_what_to_do(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = impasto.open_sbrdf(store)
    for name, kind in export.FORMATS.items():
        out = tmp_path / f"a{kind.suffix}"
        if kind.tiled is None:
            with pytest.raises(ArgumentError, match=rf"too large for {name}.*smaller scale"):
                export.to(name, stored, out)
        elif kind.suffix:  # other suffixes are
            with pytest.raises(ArgumentError, match=r"601 x 277 pixels.*Name it so"):
                export.to(name, stored, out)
    with pytest.raises(ArgumentError, match="reflectance: a store"):
        export.to("iiif", stored, tmp_path / "a", reflectance=object())
    light = impasto.DistantLight((0.0, 0.6, 0.8))
    for scene, words in (
        (impasto.Scene([light], shadows=True), "shadows"),
        (impasto.Scene([light], exposure="maximum"), "exposure"),
    ):
        with pytest.raises(ArgumentError, match=words):
            export.to("iiif", stored, tmp_path / "a", scene=scene)
    words = ["export", "gltf", str(store), "--out", str(tmp_path / "a.glb")]
    assert "--region for a detail" in complaint(words, 1, capsys)
    assert list(tmp_path.iterdir()) == []
    assert main(["export", "normal-map", str(store), "--out", str(tmp_path / "n.tif")]) == 0
    assert "n.tif" in capsys.readouterr().err
    assert read_image(tmp_path / "n.tif").shape == (3, ROWS, COLUMNS)


@pytest.mark.usefixtures("large")
def test_a_store_without_scales_is_refused_where_they_are_needed(
    store: Path, tmp_path: Path
) -> None:
    impasto.load_sbrdf(store).save(tmp_path / "bare.zarr")
    with pytest.raises(ArgumentError, match="no smaller scales"):
        export.to("openlime", impasto.open_sbrdf(tmp_path / "bare.zarr"), tmp_path / "a")
    assert not (tmp_path / "a").exists()
    # Others need none.
    export.to("normal-map", impasto.open_sbrdf(tmp_path / "bare.zarr"), tmp_path / "b.tif")
    assert read_image(tmp_path / "b.tif").shape == (3, ROWS, COLUMNS)


def test_a_small_store_is_loaded(store: Path, tmp_path: Path) -> None:
    export.to("normal-map", impasto.open_sbrdf(store), tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").shape == (3, ROWS, COLUMNS)


def masked(shape: tuple[int, int]) -> impasto.Stack:
    """The lower half is no painting."""
    whole = stack(shape)
    mask = np.ones(shape, np.bool_)
    mask[shape[0] // 2 :] = False
    return impasto.Stack(
        whole.samples, lights=whole.rig, saturation=whole.saturation, scale=whole.scale, mask=mask
    )


@pytest.fixture(scope="module")
def odd_stores(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A line, a painting half of which is unknown, lobes of Lafortune."""
    folder = tmp_path_factory.mktemp("stores")
    none: dict[str, Any] = {"pooling": "none", "tile": 64}
    wanted: dict[str, tuple[impasto.Stack, dict[str, Any]]] = {
        "line": (stack((3, 300)), none),
        "half": (masked((130, 70)), none),
        "lafortune": (stack((65, 66)), {"model": "lafortune", "lobes": 1, "tile": 32}),
    }
    found = {}
    for name, (photographs, options) in wanted.items():
        found[name] = folder / f"{name}.zarr"
        impasto.run(photographs, found[name], **options)
    return found


@pytest.mark.parametrize("name", ["line", "half", "lafortune"])
def test_odd_paintings_are_tiled(
    name: str, odd_stores: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (formats, iiif):
        monkeypatch.setattr(module, "LOADED", 100)
    stored = impasto.open_sbrdf(odd_stores[name])
    for kind, out in (
        ("openlime", "a"),
        ("iiif", "b"),
        ("height", "c.tif"),
        ("normal-map", "d.tif"),
    ):
        report = export.to(kind, stored, tmp_path / out)  # type: ignore[arg-type]
        numbers = [report.p50, report.p99, *report.measured.values()]
        assert np.isfinite([one for one in numbers if one is not None]).all()
        if report.p50 is not None:
            assert report.p50 < 3.0
    assert read_image(tmp_path / "d.tif").shape == (3, *stored.shape)
    kd = deep_zoom(tmp_path / "a", "kd", int(np.ceil(np.log2(max(stored.shape)))))
    if name == "half":
        assert not kd[:, 65:].any()
        assert kd[:, :65].any()


@pytest.mark.usefixtures("large")
def test_a_damaged_store_leaves_nothing(store: Path, tmp_path: Path) -> None:
    """The last chunk of the normals is cut off; tiles before it were written already."""
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    chunks = sorted(path for path in (copy / "normal").rglob("*") if path.is_file())
    last = max((path for path in chunks if path.name != "zarr.json"), key=lambda path: path.parts)
    last.write_bytes(last.read_bytes()[:40])
    for kind, out in (
        ("openlime", "a"),
        ("iiif", "b"),
        ("height", "c.tif"),
        ("normal-map", "d.tif"),
    ):
        with pytest.raises(CorruptInputError, match=r"copy\.zarr"):
            export.to(kind, impasto.open_sbrdf(copy), tmp_path / out)  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["copy.zarr"]


@pytest.mark.skipif(sys.platform == "win32", reason="limits the size of files")
@pytest.mark.parametrize(
    ("kind", "out"),
    [("openlime", "a"), ("iiif", "b"), ("height", "c.tif"), ("normal-map", "d.tif")],
)
@pytest.mark.usefixtures("large")
def test_a_full_disk_leaves_nothing_and_names_the_file(
    kind: Any, out: str, store: Path, tmp_path: Path
) -> None:
    """No file may have more than 3000 bytes, as on a disk that is full after as many."""

    def work() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
        try:
            export.to(kind, impasto.open_sbrdf(store), tmp_path / out)
        except OSError as error:
            os._exit(17 if str(tmp_path / out) in str(error) else 18)

    assert os.waitstatus_to_exitcode(waited(work)) == 17
    assert list(tmp_path.iterdir()) == []


def waited(work: Callable[[], None]) -> int:
    """The status of a child that does some work."""
    if (child := os.fork()) == 0:
        work()
        os._exit(0)
    return os.waitpid(child, 0)[1]

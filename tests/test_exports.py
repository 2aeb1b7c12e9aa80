"""Exports: the files are what their formats say, and their losses are what the files show."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import impasto
from impasto import export, simulate
from impasto.errors import ArgumentError
from impasto.io import read_header, read_image
from oracles import exports as opened
from rti_decoders import OpenLime, Ptm, Relight

ROWS, COLUMNS = 24, 32
PITCH_MM = 0.5


@pytest.fixture(scope="module")
def painting() -> Any:
    """With spectra, satin varnish and a height of its own."""
    return simulate.painting(3, (ROWS, COLUMNS), pitch_mm=PITCH_MM)


def lab(linear: np.ndarray) -> np.ndarray:
    """CIELAB of linear sRGB by OpenCV, which knows nothing of ours."""
    pixels = np.moveaxis(np.clip(linear, 0.0, 1.0), 0, -1).astype(np.float32)
    coded = np.where(pixels <= 0.0031308, 12.92 * pixels, 1.055 * pixels ** (1 / 2.4) - 0.055)
    return np.moveaxis(cv2.cvtColor(coded.astype(np.float32), cv2.COLOR_RGB2LAB), -1, 0)


def test_a_loss_is_what_a_decoder_of_its_own_finds(painting: Any, tmp_path: Path) -> None:
    """The picture of each light from the written bytes, by a decoder without our code, against
    ``impasto.render``. CIE76 of the two ends of a scene's percentiles is no CIEDE2000, but where
    neither sees a difference both are small, and the order of the scenes is the same."""
    path = tmp_path / "a.ptm"
    report = export.to("ptm", painting, path)
    decoder = Ptm(path)
    found = []
    for scene in report.scenes:
        azimuth, elevation = np.radians(scene.light)
        x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
        light = (float(x), float(y), float(np.sin(elevation)))
        codes = [[decoder.shown(r, c, light) for c in range(COLUMNS)] for r in range(ROWS)]
        coded = np.clip(np.moveaxis(np.array(codes), -1, 0) / 255, 0.0, 1.0)
        low = coded / 12.92
        linear = np.where(coded <= 0.04045, low, ((coded + 0.055) / 1.055) ** 2.4)
        drawn = impasto.render(painting, impasto.Scene([light], exposure=1.0)).linear
        found.append(np.percentile(np.linalg.norm(lab(linear) - lab(drawn), axis=0), (50, 95)))
    ours = np.array([(scene.p50, scene.p95) for scene in report.scenes])
    theirs = np.array(found)
    assert len(theirs) == 8
    # CIEDE2000 divides chroma and hue by 1 + 0.045 C, 1 to 5 here, and lightness by 1 to 1.75.
    assert (ours <= 1.1 * theirs).all()
    assert (ours >= theirs / 5.0).all()
    assert np.corrcoef(ours[:, 1], theirs[:, 1])[0, 1] > 0.9


FOLDERS = ("openlime", "relight", "materialx", "usd", "mitsuba", "iiif")
PICTURED = [name for name in export.FORMATS if name not in {"height", "normal-map"}]
MOST = {
    "openlime": 1.0, "relight": 3.5, "ptm": 3.5, "hsh": 3.0, "gltf": 1.5, "materialx": 1.5,
    "usd": 1.5, "mitsuba": 0.5, "iiif": 2.0,
}  # fmt: skip
"""Median dE00 from the front: a facet model with the painting's lobe is within a just noticeable
difference; smooth functions of the light lose the highlights; JPEG blurs brush strokes."""


@pytest.mark.parametrize("name", PICTURED)
def test_every_format_says_what_it_loses(name: Any, painting: Any, tmp_path: Path) -> None:
    out = tmp_path / f"a{export.FORMATS[name].suffix}"
    report = export.to(name, painting, out)
    assert report.p50 is not None
    assert 0.0 < report.p50 <= MOST[name]
    assert report.p50 <= report.p95 <= report.p99  # type: ignore[operator]
    assert report.kept
    assert report.lost
    stored = out / "loss.json" if name in FOLDERS else tmp_path / f"{out.name}.loss.json"
    content = json.loads(stored.read_text())
    assert content["p95"] == report.p95
    folder = out if name in FOLDERS else tmp_path
    assert report.files
    for file, _ in report.files:
        assert (folder / file).is_file()
    assert str(report.summary) in str(report)
    # Only the formats that can be seen from the side say how they look from there.
    views = {scene.view for scene in report.scenes}
    turns = name in {"gltf", "materialx", "usd", "mitsuba"}
    assert (len(views) > 1) == turns == (report.oblique_p95 is not None)


def test_a_worse_file_has_a_greater_loss(painting: Any, tmp_path: Path) -> None:
    """Matte shading is smooth but for its end at the horizon; gloss is not smooth."""
    lit = painting.surface()
    matte = impasto.Surface(lit.normal, np.full((3, ROWS, COLUMNS), 0.4))
    shiny = impasto.Surface.torrance_sparrow(lit.normal, matte.diffuse, 12.0, 0.12)
    losses = [export.to("hsh", one, tmp_path / "a.rti").p99 for one in (matte, shiny)]
    assert losses[0] is not None
    assert losses[1] is not None
    assert losses[0] < 3.0 < 6.0 < losses[1]


# glTF


def glb(path: Path) -> tuple[dict[str, Any], bytes]:
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    binary, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    assert 28 + size + binary == length
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def accessor(document: dict[str, Any], binary: bytes, number: int) -> np.ndarray:
    one = document["accessors"][number]
    view = document["bufferViews"][one["bufferView"]]
    part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[one["type"]]
    kind = {5126: "<f4", 5125: "<u4"}[one["componentType"]]
    return np.frombuffer(part, kind).reshape(one["count"], width)


def test_gltf_has_the_true_size_and_the_normals_of_opengl(painting: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    report = export.to("gltf", painting, path, name="panel")
    document, binary = glb(path)
    primitive = document["meshes"][0]["primitives"][0]
    points = accessor(document, binary, primitive["attributes"]["POSITION"])
    size = points.max(axis=0) - points.min(axis=0)
    np.testing.assert_allclose(size, [COLUMNS * PITCH_MM * 1e-3, ROWS * PITCH_MM * 1e-3, 0.0])
    triangles = accessor(document, binary, primitive["indices"]).reshape(-1, 3)
    edges = points[triangles]
    facing = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    assert (facing[:, 2] > 0.0).all()
    # The upper left corner of the picture is the upper left corner of the panel.
    places = accessor(document, binary, primitive["attributes"]["TEXCOORD_0"])
    corner = np.argmin(places.sum(axis=1))
    assert points[corner, 0] < 0.0 < points[corner, 1]
    material = document["materials"][0]
    source = document["textures"][material["normalTexture"]["index"]]["source"]
    view = document["bufferViews"][document["images"][source]["bufferView"]]
    png = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    codes = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    normal = np.moveaxis(codes / 127.5 - 1.0, -1, 0)
    # Half a code of 1/127.5 in each component.
    np.testing.assert_allclose(normal, painting.surface().normal, atol=0.5 / 127.5 + 1e-6)
    assert document["nodes"][0]["name"] == "panel"
    assert document["asset"]["extras"]["loss"]["p95"] == report.p95


def test_a_displaced_mesh_has_the_height_of_the_painting(painting: Any, tmp_path: Path) -> None:
    export.to("gltf", painting, tmp_path / "a.glb", displaced=True)
    document, binary = glb(tmp_path / "a.glb")
    points = accessor(document, binary, 0)
    assert len(points) == ROWS * COLUMNS
    height = 1e3 * points[:, 2].reshape(ROWS, COLUMNS)
    expected = painting.height - painting.height.mean(dtype=np.float64)
    np.testing.assert_allclose(height, expected, atol=1e-6)
    step = 1e3 * np.diff(points.reshape(ROWS, COLUMNS, 3)[0, :, 0])
    np.testing.assert_allclose(step, PITCH_MM, rtol=1e-5)


def test_without_the_width_of_a_pixel_a_size_is_said_to_be_made_up(tmp_path: Path) -> None:
    surface = impasto.Surface(np.eye(3)[2][:, None, None] * np.ones((3, 4, 5)), np.ones((3, 4, 5)))
    report = export.to("gltf", surface, tmp_path / "a.glb")
    assert any("1 mm per pixel" in one for one in report.lost)
    again = export.to("gltf", surface, tmp_path / "a.glb", pitch_mm=0.1)
    assert not any("1 mm per pixel" in one for one in again.lost)


def test_the_gltf_validator_finds_nothing(painting: Any, tmp_path: Path) -> None:
    """Where node and the npm package gltf-validator are; else the recorded run is what there is."""
    script = "console.log(require.resolve('gltf-validator'))"
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    found = subprocess.run([node, "-e", script], capture_output=True, text=True, check=False)
    if found.returncode:
        if os.environ.get("IMPASTO_EXPECT_GLTF_VALIDATOR") == "1":
            pytest.fail("gltf-validator is not in NODE_PATH")
        pytest.skip("gltf-validator is not in NODE_PATH (npm install gltf-validator)")
    for name, options in (("panel", {}), ("relief", {"displaced": True})):
        path = tmp_path / f"{name}.glb"
        export.to("gltf", painting, path, **options)
        command = [node, "-e", opened.VALIDATE, str(path)]
        issues = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


# Geometry


def test_heights_come_back_in_mm(painting: Any, tmp_path: Path) -> None:
    """Floats exactly; 16-bit codes within half of one, from the scale in the file alone."""
    expected = painting.height - painting.height.mean(dtype=np.float64)
    export.to("height", painting, tmp_path / "a.exr")
    np.testing.assert_allclose(read_image(tmp_path / "a.exr")[0], expected, atol=1e-6)
    report = export.to("height", painting, tmp_path / "a.tif")
    import tifffile

    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        facts, codes = json.loads(file.pages[0].description), file.asarray()
    assert codes.dtype == np.uint16
    assert facts["pixelSizeInMM"] == PITCH_MM
    found = codes * facts["mm_per_code"] + facts["mm_at_code_0"]
    np.testing.assert_allclose(found, expected, atol=0.51 * facts["mm_per_code"])
    assert report.measured["height_error_mm"] <= 0.51 * facts["mm_per_code"]


def test_stl_and_ply_are_meshes_at_true_scale(painting: Any, tmp_path: Path) -> None:
    expected = painting.height - painting.height.mean(dtype=np.float64)
    wide, tall = (COLUMNS - 1) * PITCH_MM, (ROWS - 1) * PITCH_MM
    faces = 2 * (ROWS - 1) * (COLUMNS - 1)
    export.to("height", painting, tmp_path / "a.stl")
    data = (tmp_path / "a.stl").read_bytes()
    assert not data.startswith(b"solid")  # which would say that it is text
    (count,) = struct.unpack_from("<I", data, 80)
    assert count == faces
    assert len(data) == 84 + 50 * count
    facets = np.frombuffer(data[84:], [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    low, high = (extreme(facets["v"].reshape(-1, 3), axis=0) for extreme in (np.min, np.max))
    np.testing.assert_allclose(high - low, [wide, tall, np.ptp(expected)], rtol=1e-5)
    assert (facets["n"][:, 2] > 0.0).all()
    edges = facets["v"][:, 1:] - facets["v"][:, :1]
    turned = np.cross(edges[:, 0], edges[:, 1])
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(turned, facets["n"], atol=1e-4)
    export.to("height", painting, tmp_path / "a.ply")
    head, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n", 1)
    assert f"element vertex {ROWS * COLUMNS}\n".encode() in head
    assert f"element face {faces}\n".encode() in head
    assert len(body) == ROWS * COLUMNS * 15 + faces * 13
    vertices = np.frombuffer(body, [("p", "<f4", 3), ("c", "u1", 3)], ROWS * COLUMNS)
    np.testing.assert_allclose(vertices["p"][:, 2], expected.ravel(), atol=1e-6)


def test_a_normal_map_has_green_up(tmp_path: Path) -> None:
    """A surface that leans up: its green is above the middle, its red at it."""
    normal = np.zeros((3, 4, 6))
    normal[1], normal[2] = 0.6, 0.8
    export.to("normal-map", impasto.Surface(normal, np.ones((3, 4, 6))), tmp_path / "a.png")
    codes = read_image(tmp_path / "a.png")
    assert codes.dtype == np.uint16
    expected = np.rint((np.array([0.0, 0.6, 0.8]) + 1.0) / 2.0 * 65535)
    np.testing.assert_allclose(codes[:, 0, 0], expected, atol=1)


# Folders


def test_iiif_tiles_are_where_the_api_says(tmp_path: Path) -> None:
    """Image API 3.0, level 0: every tile of every scale factor has the file that a viewer asks for,
    and its pixels are those of the whole."""
    rng = np.random.default_rng(0)
    rows, columns = 700, 1100
    smooth = cv2.resize(rng.uniform(0.1, 0.9, (7, 11, 3)), (columns, rows))
    normal = np.zeros((3, rows, columns))
    normal[2] = 1.0
    surface = impasto.Surface(normal, np.moveaxis(smooth, -1, 0))
    export.to("iiif", surface, tmp_path / "a", url="https://museum.example/a")
    info = json.loads((tmp_path / "a" / "info.json").read_text())
    assert info["id"] == "https://museum.example/a"
    assert (info["width"], info["height"]) == (columns, rows)
    (tiles,) = info["tiles"]
    assert tiles["scaleFactors"] == [1, 2, 4]
    whole = read_image(tmp_path / "a" / "full" / "max" / "0" / "default.jpg").astype(int)
    seen = 0
    for factor in tiles["scaleFactors"]:
        span = tiles["width"] * factor
        for top in range(0, rows, span):
            for left in range(0, columns, span):
                height, width = min(span, rows - top), min(span, columns - left)
                size = f"{-(-width // factor)},{-(-height // factor)}"
                region = f"{left},{top},{width},{height}"
                region = "full" if (height, width) == (rows, columns) else region
                file = tmp_path / "a" / region / size / "0" / "default.jpg"
                tile = read_image(file).astype(int)
                assert f"{tile.shape[2]},{tile.shape[1]}" == size
                part = whole[:, top : top + height : factor, left : left + width : factor]
                # A smooth picture: neighbours, and two JPEGs, are a few codes apart.
                assert np.abs(tile - part).max() <= 8
                seen += 1
    assert seen == 3 * 2 + 2 + 1
    for size in info["sizes"]:
        file = tmp_path / "a" / "full" / f"{size['width']},{size['height']}" / "0" / "default.jpg"
        header = read_header(file)
        assert (header.width, header.height) == (size["width"], size["height"])


def test_openlime_has_spectra_and_weights_for_illuminants(painting: Any, tmp_path: Path) -> None:
    export.to("openlime", painting, tmp_path / "a")
    index = json.loads((tmp_path / "a" / "layers.json").read_text())
    layers = index["layers"]
    assert set(layers) == {"brdf", "rti", "multispectral"}
    assert layers["brdf"]["colorspaces"]
    info = json.loads((tmp_path / "a" / layers["multispectral"]["url"]).read_text())
    presets = json.loads((tmp_path / "a" / layers["multispectral"]["presets"]).read_text())
    count = info["nplanes"]
    assert count == len(info["wavelength"]) <= 33
    files = sorted((tmp_path / "a" / "spectra").glob("band_*.jpg"))
    assert len(files) == -(-count // 3)
    bands = np.concatenate([read_image(file) for file in files])[:count] / 255.0
    for name, scene in (
        ("D65", {}),
        ("Illuminant A, adapted d = 0.56", {"illuminant": "A", "adaptation": 0.56}),
    ):
        weights = np.array([presets[name][channel] for channel in ("red", "green", "blue")])
        shown = np.tensordot(weights, bands, axes=1)
        flat = np.zeros((3, ROWS, COLUMNS))
        flat[2] = 1.0
        matte = impasto.Surface(flat, painting.coefficients)
        front = impasto.Scene([(0.0, 0.0, 1.0)], **scene)
        expected = impasto.render(matte, front, reflectance=painting).linear
        # JPEG moves single bands by a few codes of 255, of which 31 are averaged.
        assert np.median(np.abs(shown - expected)) < 0.01


@pytest.mark.parametrize("light", [(0.0, 0.6, 0.8), (-0.8, 0.0, 0.6), (0.0, 0.0, 1.0)])
def test_openlime_s_layer_shows_the_painting(
    light: tuple[float, float, float], painting: Any, tmp_path: Path
) -> None:
    """A decoder of its own, times what ``brightness`` says, is the picture of impasto: gloss has
    255 steps of the fourth root of the width, 2 % each, and colours codes of sRGB, 1 %; Fresnel's
    reflectance, which the layer lacks, grows by less than 1 % from 0 to 25 degrees."""
    export.to("openlime", painting, tmp_path / "a")
    decoder = OpenLime(tmp_path / "a")
    found = [[decoder.shown(y, x, light) for x in range(COLUMNS)] for y in range(ROWS)]
    scale = decoder.brightness
    shown = np.moveaxis(np.array(found), -1, 0) / scale
    expected = impasto.render(painting, impasto.Scene([light], exposure=1.0)).linear
    # The layer's own ambient light, 2 % of the colour; normals of 8 bits move N.L by 0.004.
    np.testing.assert_allclose(np.median(np.abs(shown - expected)), 0.0, atol=0.01)
    assert np.percentile(np.abs(shown - expected), 99) < 0.06
    assert set(Relight(tmp_path / "a" / "rti").info) >= {"width", "type", "materials"}


def test_usd_is_text_of_the_true_size(painting: Any, tmp_path: Path) -> None:
    export.to("usd", painting, tmp_path / "a", name="2 panels")
    text = (tmp_path / "a" / "painting.usda").read_text()
    assert text.startswith("#usda 1.0")
    assert 'defaultPrim = "_2_panels"' in text
    assert "metersPerUnit = 0.001" in text
    assert f"extent = [({-COLUMNS * PITCH_MM / 2:g}, {-ROWS * PITCH_MM / 2:g}, 0)" in text
    assert text.count("{") == text.count("}")
    assert "dE00" in text


def test_materialx_and_mitsuba_name_files_that_are_there(painting: Any, tmp_path: Path) -> None:
    export.to("materialx", painting, tmp_path / "m")
    root = ET.parse(tmp_path / "m" / "painting.mtlx").getroot()
    named = [one.get("value") for one in root.iter("input") if one.get("type") == "filename"]
    assert len(named) == 4
    assert all((tmp_path / "m" / str(file)).is_file() for file in named)
    export.to("mitsuba", painting, tmp_path / "s")
    scene = ET.parse(tmp_path / "s" / "scene.xml").getroot()
    files = [one.get("value") for one in scene.iter("string") if one.get("name") == "filename"]
    assert sorted(map(str, files)) == ["diffuse.exr", "normal.exr", "specular.exr"]
    assert all((tmp_path / "s" / str(file)).is_file() for file in files)
    assert not (tmp_path / "s" / "lafortune.py").exists()
    export.to("mitsuba", opened.lobed(), tmp_path / "l")
    compile((tmp_path / "l" / "lafortune.py").read_text(), "lafortune.py", "exec")


def test_the_programs_that_the_formats_are_for_opened_them() -> None:
    """The record of ``oracles/exports.py``; all of them are named there."""
    found = json.loads(opened.FILE.read_text())
    assert found["usd"]["findings"] == []
    assert found["usd"]["shader"] == "UsdPreviewSurface"
    # Points in the middle of pixels of 0.5 mm.
    assert found["usd"]["size"][:2] == [(opened.COLUMNS - 1) * 0.5, (opened.ROWS - 1) * 0.5]
    assert found["materialx"]["valid"]
    assert found["materialx"]["missing"] == []
    assert found["materialx"]["undeclared"] == []
    assert found["materialx"]["surfaces"] == ["standard_surface", "open_pbr_surface"]
    assert min(found["materialx"]["shader_lines"].values()) > 1000
    # The side of a dome that leans towards the lamp is the bright one: right is right, up is up.
    # Where shading is not softened as it is on bright slopes, Blender shows what we do.
    for side in ("left", "right", "above", "below"):
        shown = found["blender_normals"][side]
        assert shown["towards_the_lamp"] > 1.3 * shown["away_from_it"]
        assert shown["difference_p50"] < 0.01
    for one in found["gltf_validator"].values():
        assert (one["numErrors"], one["numWarnings"]) == (0, 0)
    # Blender's panel stands upright: its height is along z. A just noticeable difference is 1.
    size = [opened.COLUMNS * 5e-4, 0.0, opened.ROWS * 5e-4]
    np.testing.assert_allclose(found["blender"]["size_m"], size, atol=1e-8)
    assert found["blender"]["model_dE_p95"] < 1.0
    assert found["blender"]["render_dE_p95"] < 1.5 * found["blender"]["reported_p95"]
    # Mitsuba's own tables have 64 entries; a quadrature of ours must not be told from them.
    assert found["mitsuba"]["plastic_model_difference_most"] < 0.01
    assert found["mitsuba"]["plastic_dE_p95"] < found["mitsuba"]["plastic_reported_p95"]
    assert found["mitsuba"]["lafortune_difference_most"] < 0.01


def test_the_recorded_numbers_are_those_of_what_is_written_now(tmp_path: Path) -> None:
    """The loss that the record states for Mitsuba is that of today's file."""
    report = export.to("mitsuba", opened.varnished(), tmp_path / "a")
    expected = json.loads(opened.FILE.read_text())["mitsuba"]["plastic_reported_p95"]
    assert report.p95 == pytest.approx(expected, rel=1e-3)


# Lobes


def test_one_lobe_of_the_same_kind_is_found_again() -> None:
    """Facets exp(-ln 2 phi^2 / gamma^2) are Beckmann's of alpha = gamma / sqrt(ln 2) for small
    angles: 3 % is the step between widths, and tan phi is phi to 1 % up to 10 degrees."""
    from impasto.export.lobes import one_lobe

    normal = np.zeros((3, 1, 4))
    normal[2] = 1.0
    gamma = np.array([[0.02, 0.05, 0.08, 0.1]])
    surface = impasto.Surface.torrance_sparrow(normal, np.ones((3, 1, 4)), 5.0, gamma)
    found = one_lobe(surface, "beckmann")
    np.testing.assert_allclose(found.alpha, gamma / np.sqrt(np.log(2.0)), rtol=0.05)
    np.testing.assert_allclose(found.peak, 5.0, rtol=0.03)


@pytest.mark.parametrize("exponent", [20.0, 100.0, 400.0])
def test_a_lafortune_lobe_in_the_mirror_direction_has_a_width(exponent: float) -> None:
    """``cos^n(2 phi)`` is ``exp(-2 n phi^2)`` for small tilts: Beckmann's of ``1 / (2 n)`` squared.
    The widths that are compared are 3 % apart; head-on the lobe shows its strength, 0.5."""
    from impasto.export.lobes import one_lobe

    normal = np.zeros((3, 1, 1))
    normal[2] = 1.0
    flat = np.ones((1, 1, 1))
    specular = np.full((1, 3, 1, 1), 0.5)
    surface = impasto.Surface.lafortune(
        normal, np.zeros((3, 1, 1)), specular, -flat, flat, exponent * flat
    )
    found = one_lobe(surface, "beckmann")
    np.testing.assert_allclose(found.alpha, np.sqrt(0.5 / exponent), rtol=0.03)
    np.testing.assert_allclose(found.peak * found.head_on, 0.5, rtol=0.03)
    behind = impasto.Surface.lafortune(
        normal, np.zeros((3, 1, 1)), specular, flat, flat, exponent * flat
    )
    assert not one_lobe(behind, "beckmann").peak.any()  # retro-reflective: no facet does that


def test_unknown_and_matte_pixels_have_no_lobe(tmp_path: Path) -> None:
    normal = np.zeros((3, 2, 3))
    normal[2] = 1.0
    normal[:, 0, 0] = np.nan
    beta, gamma = np.full((2, 3), 4.0), np.full((2, 3), 0.1)
    beta[1, 1] = 0.0
    gamma[1, 2] = np.nan
    surface = impasto.Surface.torrance_sparrow(normal, np.full((3, 2, 3), 0.5), beta, gamma)
    for name, suffix in (("gltf", ".glb"), ("ptm", ".ptm"), ("height", ".exr")):
        export.to(name, surface, tmp_path / f"a{suffix}")  # type: ignore[arg-type]
    export.to("openlime", surface, tmp_path / "o")
    shine = read_image(tmp_path / "o" / "ks.png")
    assert shine[:, 0, 1].all()
    assert not shine[:, 1, 1:].any()
    assert not read_image(tmp_path / "o" / "kd.png")[:, 0, 0].any()
    assert np.isnan(read_image(tmp_path / "a.exr")[0, 0, 0])


# Wrong calls


def test_wrong_calls_are_refused_and_write_nothing(painting: Any, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "letter.txt").write_text("dear")
    cases: tuple[tuple[Any, Any, str, str], ...] = (
        ("gtlf", painting, "a.glb", "did you mean 'gltf'"),
        ("gltf", painting, "a.gltf", r"ending in \.glb"),
        ("ptm", painting, "a.rti", r"ending in \.ptm"),
        ("height", painting, "a.obj", r"ending in \.exr"),
        ("openlime", painting, "own", "no export of impasto wrote"),
        ("gltf", painting.height, "a.glb", "result: expected"),
    )
    for name, result, out, problem in cases:
        with pytest.raises((ArgumentError, TypeError), match=problem):
            export.to(name, result, tmp_path / out)
    assert [path.name for path in tmp_path.rglob("*")] == ["own", "letter.txt"]


def test_an_export_is_replaced_and_a_failed_one_leaves_it(painting: Any, tmp_path: Path) -> None:
    out = tmp_path / "a"
    export.to("relight", painting, out, functions="hsh")
    assert len(list(out.glob("plane_*"))) == 9
    with pytest.raises(ArgumentError, match="functions"):
        export.to("relight", painting, out, functions="sh")
    assert len(list(out.glob("plane_*"))) == 9
    export.to("relight", painting, out, functions="ptm")
    assert len(list(out.glob("plane_*"))) == 6
    assert [path.name for path in tmp_path.iterdir()] == ["a"]

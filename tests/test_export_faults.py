"""Exports of paintings that nobody planned for, and exports that fail or are killed on the way."""

from __future__ import annotations

import json
import shutil
import signal
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import export
from impasto.errors import ArgumentError
from impasto.export.gltf import unpacked
from impasto.io import read_relightable
from killed_jobs import count_steps, in_child, kill

FORMATS = [(name, kind.suffix) for name, kind in export.FORMATS.items()]


def surface(rows: int = 5, columns: int = 6, bands: int = 3, shine: float = 2.0) -> impasto.Surface:
    """Slopes and colours by chance, one lobe."""
    random = np.random.default_rng(rows + columns + bands)
    normal = np.concatenate(
        [random.normal(0.0, 0.1, (2, rows, columns)), np.ones((1, rows, columns))]
    )
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.8, (bands, rows, columns))
    flat = np.ones((rows, columns))
    return impasto.Surface.torrance_sparrow(
        normal, diffuse, shine * flat, 0.15 * flat, pitch_mm=0.1
    )


def unknown() -> impasto.Surface:
    """Not one pixel was estimated."""
    nothing = np.full((3, 4, 5), np.nan)
    return impasto.Surface.torrance_sparrow(nothing, nothing, nothing[0], nothing[0])


@pytest.mark.parametrize("size", [(1, 1), (1, 7)])
@pytest.mark.parametrize(("name", "suffix"), FORMATS)
def test_a_row_or_a_pixel_is_exported(
    name: Any, suffix: str, size: tuple[int, int], tmp_path: Path
) -> None:
    """All but meshes of the relief, which have no triangle there."""
    report = export.to(name, surface(*size), tmp_path / f"a{suffix}")
    found = [report.p50, report.p95, report.oblique_p95, *report.measured.values()]
    assert np.isfinite([one for one in found if one is not None]).all()
    if name in {"ptm", "hsh", "relight"}:
        assert read_relightable(tmp_path / f"a{suffix}").shape == size
    with pytest.raises(ArgumentError, match="at least 2 x 2"):
        export.to("height", surface(*size), tmp_path / "a.stl")
    assert not (tmp_path / "a.stl").exists()


def test_three_of_six_bands_stand_in_for_colours(tmp_path: Path) -> None:
    """The last, the middle and the first: sRGB codes by the formula of IEC 61966-2-1."""
    painting = surface(bands=6)
    export.to("height", painting, tmp_path / "a.ply")
    body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")[1]
    vertices = np.frombuffer(body, [("place", "<f4", 3), ("colour", "u1", 3)], 30)
    linear = np.asarray(painting.diffuse[[5, 3, 0]], dtype=np.float64)
    coded = 255.0 * np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
    )
    # Half a code of rounding, and what single precision adds.
    assert np.abs(vertices["colour"].T - coded.reshape(3, -1)).max() < 0.501
    with pytest.raises(ArgumentError, match="from 0 to 5"):
        painting.with_bands([6])


@pytest.mark.parametrize(("name", "suffix"), FORMATS)
def test_a_painting_without_any_estimate_is_refused(name: Any, suffix: str, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="no pixel has a normal and colours"):
        export.to(name, unknown(), tmp_path / f"a{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_any_name_is_one_of_the_format(tmp_path: Path) -> None:
    name = '1 ä <b>"</b>\n'
    export.to("usd", surface(), tmp_path / "usd", name=name)
    text = (tmp_path / "usd" / "painting.usda").read_text("utf-8")
    assert 'defaultPrim = "_1_ä__b____b__"' in text
    assert "</_1_ä__b____b__/Paint>" in text
    for kind, document in (("materialx", "painting.mtlx"), ("mitsuba", "scene.xml")):
        export.to(kind, surface(), tmp_path / kind, name=name)  # type: ignore[arg-type]
        ET.parse(tmp_path / kind / document)
    export.to("gltf", surface(), tmp_path / "a.glb", name=name)
    document, _ = unpacked((tmp_path / "a.glb").read_bytes(), tmp_path / "a.glb")
    assert document["nodes"][0]["name"] == name


@pytest.mark.parametrize(
    "url",
    [
        "",
        "museum",
        "javascript:alert(1)",
        "http://",
        "https://a.example/x y",
        "http://[",
        "ftp://a.example",
    ],
)
def test_what_is_no_address_of_iiif_is_refused(url: str, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="url: expected where the folder will be served"):
        export.to("iiif", surface(), tmp_path / "a", url=url)
    assert list(tmp_path.iterdir()) == []


def test_an_address_of_iiif_is_one(tmp_path: Path) -> None:
    """Without a slash at the end, and with the characters of a URI (RFC 3986) alone."""
    for out, url, expected in (
        ("a", "https://museum.example/icon/", "https://museum.example/icon"),
        ("ä b", None, "https://example.org/iiif/%C3%A4%20b"),
    ):
        export.to("iiif", surface(), tmp_path / out, url=url)
        assert json.loads((tmp_path / out / "info.json").read_text())["id"] == expected


@pytest.mark.parametrize("quality", [0, 101, 97.5, True, "97"])
def test_a_quality_that_is_none_is_refused(quality: Any, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="quality: expected a whole number from 1 to 100"):
        export.to("iiif", surface(), tmp_path / "a", quality=quality)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "out"), [("usd", "a"), ("gltf", "a.glb")])
def test_a_place_below_a_file_is_none(name: Any, out: str, tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(ArgumentError, match=r"out: .* lie in .*letter\.txt, which is a file"):
        export.to(name, surface(), tmp_path / "letter.txt" / out)
    with pytest.raises(ArgumentError, match=r"out: .* lie in .*letter\.txt.* is a file"):
        export.to(name, surface(), tmp_path / "letter.txt" / "more" / out)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.parametrize(
    ("name", "out"), [("gltf", "a.glb"), ("ptm", "a.ptm"), ("height", "a.tif")]
)
def test_an_export_that_fails_leaves_the_earlier_one(
    name: Any, out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fails when its file is written, but not yet measured or reported."""
    export.to(name, surface(), tmp_path / out)
    earlier = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def fails(*_: Any, **__: Any) -> None:
        raise MemoryError("none left")

    monkeypatch.setattr(export.LossReport, "save", fails)
    with pytest.raises(MemoryError):
        export.to(name, surface(shine=3.0), tmp_path / out)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == earlier


@pytest.mark.skipif(sys.platform == "win32", reason="kills processes")
def test_a_killed_export_leaves_a_whole_file_or_the_earlier_one(tmp_path: Path) -> None:
    """Killed before each of its flushes and renames; no file stands beside another's report."""
    out, beside = tmp_path / "a.ptm", tmp_path / "a.ptm.loss.json"
    export.to("ptm", surface(), out)
    earlier, report = out.read_bytes(), beside.read_bytes()
    export.to("ptm", surface(9, 8), out)
    later = out.read_bytes()
    kills = 0
    for step in range(1, 100):
        out.write_bytes(earlier)
        beside.write_bytes(report)

        def work(step: int = step) -> None:
            count_steps(step, kill)
            export.to("ptm", surface(9, 8), out)

        if in_child(work) == 0:
            break
        kills += 1
        assert out.read_bytes() in {earlier, later}
        if beside.exists():
            assert dict(json.loads(beside.read_text())["files"]) == {"a.ptm": out.stat().st_size}
    else:
        pytest.fail("it never ended")
    # Two files are flushed and renamed, then get their names; then the folder is flushed.
    assert kills >= 7
    assert out.read_bytes() == later
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ptm", "a.ptm.loss.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="kills processes")
def test_a_killed_folder_is_whole_or_the_earlier_one(tmp_path: Path) -> None:
    """All of its files are as large as its report says."""
    out, earlier = tmp_path / "a", tmp_path / "b"
    export.to("relight", surface(), earlier, functions="ptm")
    kills = 0
    for step in range(1, 400, 9):
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(earlier, out)

        def work(step: int = step) -> None:
            count_steps(step, kill)
            export.to("relight", surface(9, 8), out)

        ended = in_child(work)
        if ended == 0:
            break
        assert ended == signal.SIGKILL
        kills += 1
        if out.exists():
            info = json.loads((out / "info.json").read_text())
            assert len(list(out.glob("plane_*.jpg"))) == info["nplanes"] // 3
            assert read_relightable(out).shape == (info["height"], info["width"])
    else:
        pytest.fail("it never ended")
    assert kills > 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]

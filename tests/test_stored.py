"""Stores that are read by windows: parts, pictures and smaller scales are those of the whole."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
import zarr

import impasto
from impasto import ArgumentError, CorruptInputError, DistantLight, PointLight, Scene, jobs
from impasto.cli import main
from impasto.colour import delta_e, lab_from_xyz
from impasto.fit.relief import Relief
from impasto.io.results.zarr_arrays import ZarrArray
from killed_jobs import stack, tree

pytest.importorskip("fcntl", reason="jobs need POSIX")

SIZE = (150, 205)
OPTIONS: dict[str, Any] = {"tile": 64, "pooling": "none"}
FITS: dict[str, dict[str, Any]] = {
    "painting": {"pooling": "painting", "residuals": True, "effort": "draft"},
    "pixel": {"pooling": "pixel", "effort": "draft", "lobes": 1},
    "segment": {"pooling": "segment", "segments": np.arange(2000).reshape(40, 50) // 1000},
    "lafortune": {"model": "lafortune", "lobes": 1, "effort": "draft"},
}
PART = np.s_[30:101, 55:140]
FAR = Scene([DistantLight((0.3, 0.2, 0.9)), DistantLight((-0.4, 0.1, 0.6), 0.5)])
ROOM = Scene(environment=impasto.Environment(np.linspace(0.1, 2.0, 384).reshape(3, 8, 16)))
NEAR = Scene([PointLight((30.0, 20.0, 90.0))])


def with_pitch() -> impasto.Stack:
    taken = stack(SIZE)
    mask = np.ones(SIZE, bool)
    mask[:5, :9] = mask[70:90, 100:] = False
    return taken._replace(mask=mask, rig=impasto.Rig(taken.rig, pitch_mm=0.5))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    return impasto.run(with_pitch(), folder / "painting.zarr", **OPTIONS)


@pytest.fixture(scope="module")
def whole(store: Path) -> impasto.Sbrdf:
    return impasto.load_sbrdf(store)


@pytest.fixture(scope="module")
def stored(store: Path) -> impasto.StoredSbrdf:
    return impasto.open_sbrdf(store)


def bits(result: impasto.Sbrdf) -> dict[str, tuple[Any, ...]]:
    return {n: (a.dtype, a.shape, a.tobytes()) for n, a in result.arrays().items()}


@pytest.mark.parametrize("fit", FITS)
def test_a_part_is_that_of_the_whole(fit: str, tmp_path: Path) -> None:
    """Every kind of result: also arrays that happen to be as large as the picture stay whole."""
    result = impasto.fit_sbrdf(stack((40, 50)), **FITS[fit])
    result.save(tmp_path / "a.zarr")
    opened = impasto.open_sbrdf(tmp_path / "a.zarr")
    part = np.s_[10:36, 20:49]
    assert type(opened[part]) is type(result) is opened.kind
    assert bits(opened[part]) == bits(result[part])
    if fit == "painting":
        assert result.residuals is not None
    for scene in (ROOM, FAR):
        shown = impasto.render(opened[part], scene, output="light").xyz
        expected = impasto.render(result, scene, output="light").xyz[:, *part]
        assert shown.tobytes() == np.ascontiguousarray(expected).tobytes()
    # What pictures do not show is not read for them.
    shown = impasto.render(opened.visible(*part), FAR, output="light").xyz
    assert shown.tobytes() == np.ascontiguousarray(expected).tobytes()
    assert not opened.visible(*part).normals.normal.any()
    assert bits(opened.every(7)) == bits(impasto.load_sbrdf(tmp_path / "a.zarr")) | {
        name: (array.dtype, picked.shape, picked.tobytes())
        for name, array in result.arrays().items()
        if array.shape[-2:] == result.shape
        for picked in [np.ascontiguousarray(array[..., ::7, ::7])]
    }


def test_what_is_no_map_is_not_cut(tmp_path: Path) -> None:
    """Covariances (2, 2) and a relief in cells of one pixel, in a picture of that size."""
    result = impasto.fit_sbrdf(stack()[:2, :2], pooling="painting", check=False)
    relief = Relief(
        np.zeros((2, 2), np.float32), result.normal, result.diffuse, 1, np.zeros(2), False
    )
    result = replace(result, relief=relief)
    result.save(tmp_path / "a.zarr")
    part = impasto.open_sbrdf(tmp_path / "a.zarr")[1:, :1]
    assert bits(part) == bits(result[1:, :1])
    assert part.relief is not None
    assert part.relief.height.shape == (2, 2)


def test_a_handle_knows_what_is_no_map(stored: impasto.StoredSbrdf, whole: impasto.Sbrdf) -> None:
    assert stored.shape == whole.shape == SIZE
    assert stored.bands == whole.bands
    assert stored.pitch_mm == 0.5
    assert stored.chosen is whole.chosen is None
    assert stored.rig.origin == (0.0, 0.0)
    assert stored.rig.vectors.tobytes() == whole.rig.vectors.tobytes()
    assert stored.find_level() == impasto.find_level(whole.normal)
    assert "205 x 150" in repr(stored)
    np.testing.assert_array_equal(stored.map("status", *PART), whole.status[PART])
    with pytest.raises(ArgumentError, match=r"name: expected one of .*normal"):
        stored.map("nothing", *PART)
    with pytest.raises(ArgumentError, match="step"):
        stored.every(0)


@pytest.mark.parametrize(
    ("scene", "level"),
    [(FAR, False), (FAR.changed(exposure="maximum"), True), (NEAR, False)],
    ids=["far", "maximum", "near"],
)
def test_a_picture_part_by_part_is_that_of_the_whole(
    scene: Scene, level: bool, stored: impasto.StoredSbrdf, whole: impasto.Sbrdf, tmp_path: Path
) -> None:
    image = whole.render(scene, level=level)
    image.save(tmp_path / "whole.tif")
    seen: list[tuple[int, int]] = []
    found = stored.render(
        scene, tmp_path / "parts.tif", level=level, progress=lambda *done: seen.append(done)
    )
    expected = tifffile.imread(tmp_path / "whole.tif")
    shown = tifffile.imread(tmp_path / "parts.tif")
    np.testing.assert_array_equal(shown, expected)
    assert seen[-1][0] == seen[-1][1] >= SIZE[0] * SIZE[1]
    assert found.exposure == image.exposure
    assert found.clipped == pytest.approx(image.clipped, abs=1e-12)
    assert found.covered == pytest.approx(float(image.coverage.mean()), abs=1e-6)
    with tifffile.TiffFile(tmp_path / "parts.tif") as file:
        page = file.pages.first
        assert page.is_tiled
        assert page.iccprofile == impasto.colour.icc_profile(scene.display)


def test_a_detail_has_the_pixels_of_the_whole(
    stored: impasto.StoredSbrdf, whole: impasto.Sbrdf, tmp_path: Path
) -> None:
    expected = whole.render(FAR, output="light").xyz[:, *PART]
    assert impasto.render(stored[PART], FAR, output="light").xyz.tobytes() == (
        np.ascontiguousarray(expected).tobytes()
    )
    whole.render(FAR).save(tmp_path / "whole.tif")
    stored.render(FAR, tmp_path / "part.tif", region=PART, tolerance=0)
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "part.tif"), tifffile.imread(tmp_path / "whole.tif")[PART]
    )
    near = impasto.render(stored[PART], NEAR, output="light").xyz
    assert near.tobytes() == whole.render(NEAR, output="light").xyz[:, *PART].tobytes()


def test_shadows_of_a_relief_are_those_of_the_whole(whole: impasto.Sbrdf, tmp_path: Path) -> None:
    """Cells of 5 pixels, which a part does not begin with."""
    tops = np.random.default_rng(2).uniform(0.0, 4.0, (30, 41)).astype(np.float32)
    upright = np.zeros((3, 30, 41), np.float32)
    upright[2] = 1.0
    relief = Relief(tops, upright, upright + 0.3, 5, np.zeros(2), True)
    rough = replace(whole, relief=relief)
    rough.save(tmp_path / "rough.zarr")
    scene = Scene([DistantLight((0.8, 0.1, 0.2))])
    expected = rough.render(scene, output="light").xyz
    assert np.nanmax(abs(expected - whole.render(scene, output="light").xyz)) > 0.01
    opened = impasto.open_sbrdf(tmp_path / "rough.zarr")
    for part in (PART, np.s_[:64, :64]):
        shown = impasto.render(opened[part], scene, output="light").xyz
        assert shown.tobytes() == np.ascontiguousarray(expected[:, *part]).tobytes()


def test_only_the_chunks_of_a_part_are_read(store: Path, tmp_path: Path) -> None:
    """Damage elsewhere is not noticed; damage in the part is, and names the array."""
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    expected = bits(impasto.open_sbrdf(store)[:64, :64])
    shard = copy / "normal" / "c" / "0" / "0" / "1"
    data = bytearray(shard.read_bytes())
    data[100] ^= 1
    shard.write_bytes(data)
    (copy / "diffuse" / "c" / "0" / "1" / "1").unlink()
    damaged = impasto.open_sbrdf(copy)
    assert bits(damaged[:64, :64]) == expected
    with pytest.raises(CorruptInputError, match="normal"):
        damaged[:64, 60:70]
    with pytest.raises(CorruptInputError, match=r"1: is missing"):
        damaged.map("diffuse", slice(64, 70), slice(64, 70))
    with pytest.raises(CorruptInputError, match=r"normal|diffuse"):
        damaged.render(FAR, tmp_path / "none.tif")
    assert not list(tmp_path.glob("*none*"))


def test_chunks_that_a_shard_lacks_count_where_a_window_touches_them(tmp_path: Path) -> None:
    array = ZarrArray("a", (17, 256, 256), np.dtype(np.float32), 256)
    assert array.inner == 128
    plane = np.ones((17, 256, 256), np.float32)
    data = bytearray(array.encoded(plane))
    # The index: four chunks of place and length, before its checksum. The last one is lost.
    data[-4 - 16 : -4] = b"\xff" * 16
    (tmp_path / "shard").write_bytes(data)
    lost = [
        array.missing_chunks(tmp_path / "shard", 0, 0, window)
        for window in (
            None,
            np.s_[0:128, 0:256],
            np.s_[127:129, 127:129],
            np.s_[130:256, 0:127],
        )
    ]
    assert lost == [1, 0, 1, 0]


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (Scene([DistantLight((0, 1, 1))], shadows=True), "shadows: .*--region"),
        (Scene([DistantLight((0, 1, 1))], view=(0.5, 0.0, 0.8)), "view: "),
        (
            Scene([DistantLight((0, 1, 1))], view=impasto.PointView((9, 9, 90)), perspective=True),
            "perspective: ",
        ),
    ],
)
def test_what_needs_the_whole_painting_is_refused(
    scene: Scene, words: str, stored: impasto.StoredSbrdf, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words):
        stored.render(scene, tmp_path / "a.tif")
    with pytest.raises(ArgumentError, match=r"path: expected a name ending in \.tif"):
        stored.render(FAR, tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_store_is_refused(whole: impasto.Sbrdf, tmp_path: Path) -> None:
    whole.save(tmp_path / "a.npz")
    with pytest.raises(ArgumentError, match="load_sbrdf"):
        impasto.open_sbrdf(tmp_path / "a.npz")
    with pytest.raises(FileNotFoundError):
        impasto.open_sbrdf(tmp_path / "none.zarr")


def test_a_handle_is_no_surface(stored: impasto.StoredSbrdf) -> None:
    whole: Any = stored
    with pytest.raises(ArgumentError, match=r"surface: .*a part of what impasto\.open_sbrdf"):
        impasto.render(whole, FAR)


def test_smaller_scales_look_like_reduced_pictures(
    stored: impasto.StoredSbrdf, whole: impasto.Sbrdf
) -> None:
    assert stored.factors == (2, 4)
    for factor in stored.factors:
        level = stored.level(factor)
        assert level.shape == (SIZE[0] // factor, SIZE[1] // factor)
        for scene in (FAR, NEAR):
            small = impasto.render(level, scene, output="light")
            expected = whole.render(scene, reduce=factor, output="light")
            white = np.linalg.solve(small.exposure * scene.display.linear_from_xyz, np.ones(3))
            colours = [lab_from_xyz(image.xyz, white) for image in (small, expected)]
            # The first step is the same. The next takes normals of unit length for those of four
            # pixels: of a scatter s within them, terms of s^4 are lost. Normals of these waves
            # lean by up to 0.3 and change by 0.05 from pixel to pixel. At the edge of a gap, four
            # pixels count alike of which some have fewer pixels of the painting.
            known = np.isfinite(
                whole.normal[2, : SIZE[0] // factor * factor, : SIZE[1] // factor * factor]
            )
            complete = known.reshape(level.shape[0], factor, level.shape[1], factor).all(
                axis=(1, 3)
            )
            assert complete.mean() > 0.8
            assert delta_e(*colours)[complete].max() < 0.05
            if factor == 2:
                np.testing.assert_array_equal(small.xyz, expected.xyz)
            np.testing.assert_array_equal(small.coverage, expected.coverage)
    with pytest.raises(ArgumentError, match="factor: the store has 2, 4"):
        stored.level(3)


def test_scales_of_coloured_lobes_and_more_bands(tmp_path: Path) -> None:
    """Maps per lobe and band; bands are chosen as of a whole result."""
    from impasto.overview import visible

    out = impasto.run(stack(), tmp_path / "a.zarr", tile=32, **FITS["pixel"])
    opened, loaded = impasto.open_sbrdf(out), impasto.load_sbrdf(out)
    assert opened.factors == (2, 4)
    level = opened.level(2)
    two = level.with_bands([2, 0, 1])
    expected = impasto.render(loaded.with_bands([2, 0, 1]), FAR, reduce=2, output="light")
    assert impasto.render(two, FAR, output="light").xyz.tobytes() == expected.xyz.tobytes()
    assert visible(level) is level


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Writing the levels fails after so many shards, once."""
    from impasto.jobs import levels

    left, written = [3], levels._written

    def fails(folder: Path, files: dict[str, bytes]) -> dict[str, str]:
        left[0] -= 1
        if left[0] == 0:
            raise OSError(28, "No space left on device", str(folder))
        return written(folder, files)

    monkeypatch.setattr(levels, "_written", fails)
    return left


def test_scales_are_the_same_after_an_interruption(
    store: Path, interrupted: list[int], tmp_path: Path
) -> None:
    out = tmp_path / "painting.zarr"
    with pytest.raises(OSError, match="No space"):
        impasto.run(with_pitch(), out, threads=2, **OPTIONS)
    assert not out.exists()
    assert interrupted == [0]
    impasto.run(with_pitch(), out, threads=1, **OPTIONS)
    assert tree(out) == tree(store)


def test_a_changed_scale_is_found(store: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    shard = copy / "levels" / "2" / "normal" / "c" / "0" / "0" / "1"
    data = bytearray(shard.read_bytes())
    data[100] ^= 1
    shard.write_bytes(data)
    (copy / "levels" / "4" / "diffuse" / "zarr.json").unlink()
    found = [str(one) for one in jobs.verify(copy)]
    assert len(found) == 2
    assert "levels/2/normal/c/0/0/1: has changed" in found[0]
    assert "levels/4/diffuse/zarr.json: is missing" in found[1]
    with pytest.raises(CorruptInputError, match="normal"):
        impasto.open_sbrdf(copy).level(2)


def test_viewers_find_the_scales(store: Path, whole: impasto.Sbrdf) -> None:
    """What OME-NGFF 0.5 demands of an image, and that its places are those of its pixels."""
    group = zarr.open_group(store, mode="r")
    ome: Any = group.attrs["ome"]
    assert ome["version"] == "0.5"
    assert [one["name"] for one in ome["multiscales"]] == ["diffuse", "normal"]
    for image in ome["multiscales"]:
        names = [axis["name"] for axis in image["axes"]]
        assert [axis["type"] for axis in image["axes"]] == ["channel", "space", "space"]
        assert [axis.get("unit") for axis in image["axes"]] == [None, "millimeter", "millimeter"]
        sizes = []
        for entry in image["datasets"]:
            array: Any = group[entry["path"]]
            assert list(array.metadata.dimension_names) == names
            scale, move = entry["coordinateTransformations"]
            assert (scale["type"], move["type"]) == ("scale", "translation")
            assert len(scale["scale"]) == len(move["translation"]) == array.ndim
            sizes.append(array.shape)
            # The middle of the first pixel is that of those that it stands for.
            side = round(scale["scale"][1] / 0.5)
            assert array.shape[1] == SIZE[0] // side
            assert move["translation"][1] == 0.5 * np.arange(side).mean()
        assert sizes == sorted(sizes, reverse=True)
    two: Any = group["levels/2/diffuse"]
    small = np.asarray(two[...])
    # Means of the four, each times the cosine of its normal's angle to the mean normal: never more.
    mean = whole.diffuse[:, :150, :204].reshape(3, 75, 2, 102, 2).mean(axis=(2, 4))
    known = np.isfinite(mean)
    assert (small[known] <= mean[known] * (1 + 1e-6)).all()
    np.testing.assert_allclose(small[known], mean[known], rtol=0.01)
    json.dumps(ome)


def test_the_command_shows_details_and_overviews(
    store: Path,
    whole: impasto.Sbrdf,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same pictures whether a store is small enough to be loaded or not."""

    def command(words: str) -> Any:
        assert main(["render", str(store), *words.split(), "--out", str(tmp_path / "a.tif")]) == 0
        return tifffile.imread(tmp_path / "a.tif")

    light = "--light 30,60 --quiet"
    everything = command(light)
    overview = command(f"{light} --width 50")
    assert overview.shape == (37, 50, 3)

    # The scale of 1/2 has 102 columns, of which 50 are made: light is a mean over areas. Within
    # the picture it is that of the whole; normals that scatter within four pixels, and the odd
    # column, which the scale has not, change the light by less than a hundredth.
    def green(codes: Any) -> np.ndarray:
        decoded = impasto.colour.as_display("srgb").decode(np.moveaxis(codes, -1, 0) / 65535.0)
        return decoded[1].astype(np.float32)

    linear = green(everything)
    mean = cv2.resize(linear[:, :204], (50, 37), interpolation=cv2.INTER_AREA)
    assert np.abs(green(overview) - mean).mean() < 0.01
    assert np.abs(green(overview)[:, ::-1] - mean).mean() > 0.03
    assert command(f"{light} --width 30").shape == (22, 30, 3)
    assert command(f"{light} --width 200").shape == (146, 200, 3)
    assert command(f"{light} --width 999").shape == everything.shape
    monkeypatch.setattr("impasto.cli.scale.WHOLE", 3000)
    np.testing.assert_array_equal(command(light), everything)
    # Of 205 x 150 pixels no more than 3000 are loaded: the scale of 1/4 has 51 x 37.
    assert command(f"{light} --width 50").shape == (36, 50, 3)
    assert command(f"{light} --width 60").shape == (37, 51, 3)
    detail = command(f"{light} --region 20 30 50 60")
    np.testing.assert_array_equal(detail, everything[20:70, 30:90])
    assert command(f"{light} --region 20 30 90 100 --level").shape == (90, 100, 3)
    capsys.readouterr()
    command(f"{light} --explain")
    explained = capsys.readouterr().out.splitlines()
    scene = Scene([DistantLight.from_angles(np.radians(30), np.radians(60))])
    assert explained == impasto.open_sbrdf(store).plan(scene).explain().splitlines()
    assert main(["info", str(store)]) == 0
    told = capsys.readouterr().out
    assert "205 x 150 pixels" in told
    assert "1/2, 1/4" in told
    for status, count in zip(*np.unique(whole.status, return_counts=True), strict=True):
        name = impasto.Status(int(status)).name.lower().replace("_", " ")
        assert f"{name} {100 * count / whole.status.size:.2f} % ({count})" in told
    assert main(["doctor", str(store)]) == 0
    told = capsys.readouterr().out
    assert "12 photographs, 3 bands, 205 x 150 pixels" in told
    assert "no seam at 11 borders of tiles" in told


@pytest.mark.parametrize(
    ("words", "code", "complaint"),
    [
        ("--out {out}.png", 1, "--out: a picture of 205 x 150 pixels is written part by part"),
        ("--out {out}.tif --shadows", 1, "shadows: "),
        ("--out {out}.tif --reduce 2", 1, "--reduce: "),
        ("--out {out}.tif --region 0 0 9 999", 1, "--region: expected TOP LEFT HEIGHT WIDTH"),
        ("--out {out}.tif --width 0", 1, "--width: "),
        ("--out {out}.tif --width 9 --region 0 0 9 9", 2, "--region is a detail"),
    ],
)
def test_the_command_says_what_to_do_instead(
    words: str,
    code: int,
    complaint: str,
    store: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("impasto.cli.scale.WHOLE", 3000)
    found = main(["render", str(store), *words.format(out=tmp_path / "a").split(), "--quiet"])
    assert found == code
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_a_picture_of_one_tile_has_one_scale(tmp_path: Path) -> None:
    out = impasto.run(stack((40, 60)), tmp_path / "a.zarr", tile=64, pooling="none")
    assert impasto.open_sbrdf(out).factors == ()
    assert not (out / "levels").exists()
    assert "ome" not in zarr.open_group(out, mode="r").attrs

"""Heights that are integrated tile by tile are those of the whole, but for what no surface has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.fft
import tifffile

import impasto
from impasto import ArgumentError, CorruptInputError
from impasto.cli import main
from impasto.fit.stored.height import Blocks, _cosines, _from_cosines, height_rows
from impasto.io.images.bands_of_rows import write_tiff_rows
from killed_jobs import stack

SIZE = (407, 530)


@pytest.fixture(autouse=True)
def fine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of 4 pixels and 48 around tiles of 64, so that a small picture has many."""
    monkeypatch.setattr("impasto.fit.stored.height.FINEST", 4)
    monkeypatch.setattr("impasto.fit.stored.height.TILE", 64)
    monkeypatch.setattr("impasto.fit.stored.height.TILE_BLOCKS", 1)


def relief(size: tuple[int, int] = SIZE) -> np.ndarray:
    """Strokes, a bulge, waves longer than a tile and a panel that bends: pixels high."""
    y, x = np.mgrid[: size[0], : size[1]]
    strokes = 0.3 * np.sin(x / 3.3) * np.cos(y / 4.1)
    bulge = 6.0 * np.exp(-((x - 160.0) ** 2 + (y - 240.0) ** 2) / 45.0**2)
    return strokes + bulge + 8.0 * np.sin(x / 150.0 + y / 250.0) + 12.0 * (x / 530.0 - 0.5) ** 2


def normals(height: np.ndarray, degrees: float = 0.0) -> np.ndarray:
    down, right = np.gradient(height)
    found = np.stack([-right, down, np.ones_like(right)])
    found /= np.linalg.norm(found, axis=0)
    noise = np.random.default_rng(3).normal(0.0, np.radians(degrees), found.shape)
    return np.asarray(found + noise, np.float32)


def by_tiles(normal: np.ndarray, pitch: float = 1.0, **options: Any) -> np.ndarray:
    """With the sizes of all bands checked."""
    size = normal.shape[1], normal.shape[2]
    bands = list(
        height_rows(lambda rows, columns: normal[:, rows, columns], size, pitch, **options)
    )
    assert {len(band[0]) for band in bands[:-1]} <= {options.get("rows", 256)}
    return np.concatenate([band[0] for band in bands])


@pytest.mark.parametrize(("tile", "rows"), [(64, 256), (100, 16), (4096, 100)])
def test_slopes_of_a_surface_give_the_surface(tile: int, rows: int) -> None:
    """Steps of central differences along each axis are those of a surface, but for its borders."""
    # Edge slopes are means of two central differences: those of the surface filtered along one
    # axis by (1 2 1) / 4, which is another for x and y. So let the relief be the sum of a function
    # of x and one of y, whose slopes are integrable whatever filters them.
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    height = 5.0 * np.sin(x / 40.0) + 0.3 * np.sin(x / 3.0) + 4.0 * np.cos(y / 170.0) + y / 50.0
    normal = normals(height)
    expected = impasto.integrate_normals(normal)
    found = by_tiles(normal, tile=tile, rows=rows)
    # Heights of +-15 are rounded to 1e-6, normals in single precision to 6e-8: over some hundred
    # edges in a row, random roundings of slopes of up to 0.2 add up to some 1e-6.
    np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(by_tiles(normal, 0.25, tile=tile), 0.25 * expected, atol=1e-5)


@pytest.mark.parametrize("degrees", [1.0, 5.0])
def test_noise_makes_less_of_a_difference_than_it_does_to_the_whole(degrees: float) -> None:
    """What no surface explains is the noise: the whole's height has its error, too."""
    truth = relief()
    normal = normals(truth, degrees)
    expected = impasto.integrate_normals(normal)
    found = by_tiles(normal, tile=64)
    without = impasto.integrate_normals(normals(truth))
    error = float((expected - without).std())
    assert 0.005 < error < 1.0
    # The coarse grid's least squares over blocks of pixels weigh the same slopes otherwise. Both
    # solutions have nearly the same error (a tenth of it apart here).
    assert float((found - expected).std()) < 0.2 * error
    assert float((found - without).std()) < 1.05 * error
    # No seam: the difference is smooth; noise tilts neighbours much more.
    slopes = [abs(np.diff(found - expected, axis=axis)).max() for axis in (0, 1)]
    assert max(slopes) < 0.03 * np.radians(degrees)


def test_gaps_are_bridged_as_in_the_whole() -> None:
    normal = normals(relief())
    normal[:, 100:180, 90:200] = np.nan
    normal[:, np.random.default_rng(1).random(SIZE) < 0.02] = np.nan
    normal[2, 300:310, 300:310] = -0.2
    expected = impasto.integrate_normals(normal)
    found = by_tiles(normal, tile=64)
    assert np.isfinite(found).all()
    # Holes make slopes that no surface has: the whole's heights, which span 20, are off by 0.13
    # (root mean square) and up to 0.75 for them. Coarse grid and whole weigh all of such slopes
    # alike but waves of a few blocks, which tiles have from their own pixels (below: to 0.3 %).
    error = expected - impasto.integrate_normals(normals(relief()))
    error -= error.mean()
    assert float((found - expected).std()) < 0.003 * float(error.std())
    assert abs(found - expected).max() < 0.003 * abs(error).max()


def test_slopes_that_no_surface_has_do_not_matter_much() -> None:
    """Waves of 13 pixels whose slopes along x and y do not belong together."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] / 2.0
    normal = np.stack([0.3 * np.sin(x), 0.3 * np.cos(x + y), np.ones(SIZE)]).astype(np.float32)
    expected = impasto.integrate_normals(normal)
    found = by_tiles(normal, tile=64)
    # They are as short as three blocks, which the coarse grid alone would take wrongly by a tenth:
    # tiles have them from their own pixels.
    assert float((found - expected).std()) < 3e-3 * float(expected.std())


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (5, 7), (16, 16), (33, 17), (2, 300)])
def test_small_pictures_are_integrated_too(size: tuple[int, int]) -> None:
    y, x = np.mgrid[: size[0], : size[1]]
    normal = np.stack([-0.1 * np.cos(x / 5.0), 0.2 * np.sin(y / 9.0), np.ones(size)])
    found = by_tiles(normal.astype(np.float32), tile=16)
    expected = impasto.integrate_normals(normal)
    np.testing.assert_allclose(found - found.mean(), expected, atol=1e-5)


def test_the_cosine_transform_is_scipy_s() -> None:
    for size in (1, 2, 5, 12):
        values = np.random.default_rng(size).normal(size=(size, 7))
        expected = scipy.fft.dct(values, type=2, axis=0)
        np.testing.assert_allclose(_cosines(values, 0), expected, atol=1e-12)
        np.testing.assert_allclose(_from_cosines(_cosines(values, 1), 1), values, atol=1e-13)


def test_blocks_grow_with_the_picture() -> None:
    for size in ((300, 400), (32768, 32768), (20000, 60000)):
        down, across = Blocks.of(size).grid
        assert down * across <= 2 * 2**20
    assert Blocks.of((300, 400)).side == 4
    uneven = Blocks((5, 3), 2).means(np.arange(5.0), 0)
    np.testing.assert_array_equal(uneven, [0.5, 2.5, 4.0])


def test_a_store_s_height_is_a_tiled_file(tmp_path: Path) -> None:
    taken = stack((150, 205))._replace(rig=impasto.Rig(stack().rig, pitch_mm=0.5))
    out = impasto.run(taken, tmp_path / "a.zarr", tile=64, pooling="none")
    stored, whole = impasto.open_sbrdf(out), impasto.load_sbrdf(out)
    seen: list[tuple[int, int]] = []
    file = stored.height(tmp_path / "a.tif", progress=lambda *done: seen.append(done))
    assert seen[-1] == (150 * 205, 150 * 205)
    expected = impasto.integrate_normals(whole.normal, 0.5)
    difference = tifffile.imread(file) - expected
    # The waves of above, of 11 blocks: coarse grid and whole weigh what no surface has alike.
    assert 0.0 < float(difference.std()) < 0.02 * float(expected.std())
    plane = impasto.find_level(whole.normal)
    level = tifffile.imread(stored.height(tmp_path / "b.tif", level=True, pitch_mm=1.0))
    lying = impasto.integrate_normals(whole.normal, 1.0, level=plane)
    assert float((level - lying).std()) < 0.02 * float(lying.std())
    bent = impasto.find_level(whole.normal, bend=True)
    with pytest.raises(ArgumentError, match="level: the bending"):
        stored.height(tmp_path / "c.tif", level=bent)
    (out / "normal" / "c" / "0" / "1" / "1").unlink()
    with pytest.raises(CorruptInputError, match="is missing"):
        stored.height(tmp_path / "c.tif")
    assert not list(tmp_path.glob("*c*.tif"))


def test_the_command_writes_a_height(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = impasto.run(stack((80, 90)), tmp_path / "a.zarr", tile=64, pooling="none")
    words = ["height", str(out), "--pitch", "0.5", "--no-level", "--quiet", "--out"]
    assert main([*words, str(tmp_path / "whole.tif")]) == 0
    expected = impasto.integrate_normals(impasto.load_sbrdf(out).normal, 0.5)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "whole.tif"), expected)
    monkeypatch.setattr("impasto.cli.scale.WHOLE", 3000)
    assert main([*words, str(tmp_path / "tiles.tif")]) == 0
    # These waves are no surface, and 11 blocks long: as long as what the coarse grid decides. Its
    # slopes are means over blocks, which take 1 - sin(pi / 11) / (pi / 11) = 1.4 % of such waves.
    difference = tifffile.imread(tmp_path / "tiles.tif") - expected
    assert 0.0 < float(difference.std()) < 0.02 * float(expected.std())
    assert main([*words, str(tmp_path / "a.png")]) == 1
    assert "--out: expected a name ending in .tif" in capsys.readouterr().err


def test_a_large_file_is_a_bigtiff(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 65536, (3, 300, 520)).astype(np.uint16)
    rows = [picture[:, top : top + 256] for top in (0, 256)]
    for limit, big in ((2**32, False), (1000, True)):
        monkeypatch.setattr("impasto.io.images.bands_of_rows.CLASSIC", limit)
        path = tmp_path / f"{big}.tif"
        write_tiff_rows(path, rows, (300, 520), planes=3, dtype=np.uint16)
        with tifffile.TiffFile(path) as file:
            assert file.is_bigtiff is big
            np.testing.assert_array_equal(file.asarray(), np.moveaxis(picture, 0, -1))
    with pytest.raises(ArgumentError, match=r"expected a name ending in \.tif"):
        write_tiff_rows(tmp_path / "a.png", rows, (300, 520), planes=3, dtype=np.uint16)

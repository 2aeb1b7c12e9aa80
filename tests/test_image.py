"""Pictures: only what is asked for is computed, and files say for which display they are."""

from __future__ import annotations

import gc
import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageCms

import impasto
from impasto import DistantLight, Scene, _core
from impasto.colour import Display
from impasto.image import _CURVES, tone_curve
from impasto.io import read_image

LIGHT = DistantLight((0.3, 0.4, 0.8))


@pytest.fixture(scope="module")
def surface() -> impasto.Surface:
    """A glossy surface with a highlight and a pixel without a normal."""
    rng = np.random.default_rng(5)
    normal = rng.normal(0.0, 0.2, (3, 37, 300))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    normal[:, 3, 4] = np.nan
    diffuse = rng.uniform(-0.05, 0.9, (3, 37, 300))
    return impasto.Surface.torrance_sparrow(normal, diffuse, 20.0, 0.1)


SCENES: dict[str, dict[str, Any]] = {
    "front": {},
    "display": {"display": "display-p3", "exposure": 1.7, "background": (0.2, 0.5, 0.7)},
    "slanted": {"view": (0.5, 0.1, 0.8), "background": (0.2, 0.5, 0.7)},
    "maximum": {"exposure": "maximum", "background": (1.0, 0.0, 0.5)},
    "shadows": {"shadows": True},
}


@pytest.mark.parametrize("options", SCENES.values(), ids=SCENES)
def test_a_picture_does_not_depend_on_what_is_computed_first(
    surface: impasto.Surface, options: dict[str, Any]
) -> None:
    scene = Scene([LIGHT], **options)
    codes, light = (impasto.render(surface, scene, output=one) for one in ("display", "light"))
    # The same operations on the same numbers: the same bits.
    for name in ("display", "xyz", "linear", "coverage"):
        np.testing.assert_array_equal(getattr(codes, name), getattr(light, name), err_msg=name)
    assert codes.report() == light.report()
    assert repr(codes) == repr(light)


@pytest.mark.parametrize("options", SCENES.values(), ids=SCENES)
def test_codes_and_shares_are_those_of_the_linear_light(
    surface: impasto.Surface, options: dict[str, Any]
) -> None:
    image = impasto.render(surface, Scene([LIGHT], **options))
    matrix = image.exposure * image.screen.linear_from_xyz
    linear = np.tensordot(matrix, image.xyz.astype(np.float64), 1)
    # Three products of at most 10 in single precision, each rounded once.
    np.testing.assert_allclose(image.linear, linear, atol=3 * 10 * 2.0**-24 * 4)
    exact = image.screen.encode(np.clip(linear, 0.0, 1.0))
    # Half a code of rounding, and the table of the tone curve (crates/impasto, curve.rs).
    assert np.abs(image.display - 255.0 * np.moveaxis(exact, 0, -1)).max() < 0.502
    above = (image.linear > 1.0).mean(axis=(1, 2))
    below = (image.linear < 0.0).mean(axis=(1, 2))
    np.testing.assert_allclose(list(image.clipped.values()), above, rtol=1e-12)
    np.testing.assert_allclose(list(image.outside.values()), below, rtol=1e-12)


def test_a_tone_curve_is_made_once_for_each_display() -> None:
    srgb = Display.named("srgb")
    assert Display.named("sRGB") is srgb
    assert tone_curve(srgb) is tone_curve(srgb)
    with pytest.raises(ValueError, match="read-only"):
        srgb.xyz_from_linear[0, 0] = 1.0
    other = Display(srgb.name, srgb.xyz_from_linear.copy(), srgb.curve)
    assert tone_curve(other) is tone_curve(other) is not tone_curve(srgb)
    # A display that is gone leaves nothing behind for another in its place.
    there = len(_CURVES)
    del other
    gc.collect()
    assert len(_CURVES) == there - 1


def test_only_what_is_asked_for_is_computed(
    surface: impasto.Surface, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def counted(name: str) -> None:
        original: Callable[..., Any] = getattr(_core, name)

        def count(*arguments: Any) -> Any:
            calls.append(name)
            return original(*arguments)

        monkeypatch.setattr(_core, name, count)

    for name in ("paint", "render", "linear_from_bands", "display_from_bands"):
        counted(name)
    image = impasto.render(surface, Scene([LIGHT]))
    assert image.display.shape == (37, 300, 3)
    assert image.report()["covered"] > 0.99
    assert calls == ["paint"]
    assert image.linear is image.linear
    assert image.xyz is image.xyz
    assert calls == ["paint", "render", "linear_from_bands"]
    calls.clear()
    assert impasto.render(surface, Scene([LIGHT]), output="light").xyz.shape == (3, 37, 300)
    assert calls == ["render"]


def test_a_picture_is_pickled_without_its_painting(surface: impasto.Surface) -> None:
    image = impasto.render(surface, Scene([LIGHT]))
    same = pickle.loads(pickle.dumps(image))
    for name in ("display", "xyz", "linear", "coverage"):
        np.testing.assert_array_equal(getattr(same, name), getattr(image, name))


def test_an_unknown_output_is_refused(surface: impasto.Surface) -> None:
    with pytest.raises(impasto.ArgumentError, match="output: expected 'display' or 'light'"):
        impasto.render(surface, Scene([LIGHT]), output="linear")  # type: ignore[arg-type]


def in_srgb(codes: NDArray[Any], profile: bytes) -> NDArray[np.int64]:
    """sRGB codes by Little CMS for codes with a profile."""
    source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    transform = ImageCms.buildTransform(
        source, ImageCms.createProfile("sRGB"), "RGB", "RGB", renderingIntent=1
    )
    converted = ImageCms.applyTransform(Pillow.fromarray(codes), transform)
    return np.asarray(converted).astype(np.int64)


@pytest.mark.parametrize("suffix", ["png", "jpg", "tif"])
@pytest.mark.parametrize("display", ["srgb", "display-p3"])
def test_every_file_says_for_which_display_it_is(
    surface: impasto.Surface, tmp_path: Path, suffix: str, display: str
) -> None:
    path = tmp_path / f"picture.{suffix}"
    image = impasto.render(surface, Scene([LIGHT], display=display))
    image.save(path)
    if suffix == "tif":
        with tifffile.TiffFile(path) as file:
            profile = bytes(file.pages[0].tags["InterColorProfile"].value)
            codes = np.rint(file.asarray() / 257.0).astype(np.uint8)
    else:
        with Pillow.open(path) as file:
            profile, codes = file.info["icc_profile"], np.asarray(file)
    assert display.replace("-", "") in description(profile).replace("-", "").lower()
    found = in_srgb(codes, profile)
    if display == "srgb":
        # Little CMS rounds once.
        assert np.abs(found - codes).max() <= 1
        return
    screen, srgb = image.screen, impasto.colour.Display.named("srgb")
    linear = screen.decode(np.moveaxis(codes, -1, 0) / 255.0)
    expected = np.tensordot(srgb.linear_from_xyz @ screen.xyz_from_linear, linear, 1)
    # Inside sRGB, where both agree about what is shown.
    inside = ((expected > 0.002) & (expected < 0.998)).all(axis=0)
    assert inside.sum() > 1000
    exact = 255.0 * np.moveaxis(srgb.encode(expected.clip(0.0, 1.0)), 0, -1)
    # One code, of rounding and of the engine's 16-bit tables.
    assert np.abs(found - exact)[inside].max() <= 1.0


def description(profile: bytes) -> str:
    return ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile)))


def test_a_long_profile_fills_several_segments_of_a_jpeg(tmp_path: Path) -> None:
    # Pillow puts the segments together by their numbers (ICC.1:2022, annex B.4).
    profile = np.random.default_rng(0).integers(0, 256, 150_001, dtype=np.uint8).tobytes()
    path = tmp_path / "long.jpg"
    impasto.io.write_jpeg(path, np.zeros((8, 8, 3), np.uint8), icc=profile)
    with Pillow.open(path) as file:
        assert file.info["icc_profile"] == profile
        assert file.info["jfif"]
        assert np.asarray(file).max() == 0


@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_a_picture_of_one_or_three_rows_is_saved_as_it_is(
    rows: int, name: str, tmp_path: Path
) -> None:
    """Its rows are not taken for its channels."""
    shades = np.linspace(0.1, 0.9, 40)[None, None] * np.array([0.2, 0.5, 0.9])[:, None, None]
    flat = np.zeros((3, rows, 40))
    flat[2] = 1.0
    surface = impasto.Surface(flat, shades * np.ones((3, rows, 40)))
    scene = impasto.Scene([impasto.DistantLight((0.0, 0.0, 1.0))], exposure=1.0)
    image = impasto.render(surface, scene)
    image.save(tmp_path / name)
    found = read_image(tmp_path / name)
    full = float(np.iinfo(found.dtype).max)
    shown = np.moveaxis(image.display, -1, 0)
    assert found.shape == shown.shape
    # Codes of 8 bits, of 16 bits rounded otherwise, or of a JPEG of a smooth ramp.
    assert np.abs(255.0 * found / full - shown).max() <= 4.0

"""ICC profiles, read by another colour engine (Little CMS, through Pillow)."""

from __future__ import annotations

import io

import colour
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from impasto.colour import Display, icc_profile
from impasto.io import read_image, write_png8, write_png16, write_tiff16
from oracles import monitor


@pytest.fixture(scope="module")
def codes() -> np.ndarray:
    """Random 8-bit pixels ``(64, 64, 3)`` and all greys."""
    pixels = np.random.default_rng(8).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    pixels[:4] = np.arange(256, dtype=np.uint8).reshape(4, 64, 1)
    return pixels


def engine(display: Display) -> object:
    return ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(display)))


def converted(codes, source, target):
    """Codes of ``target`` for codes of ``source``: relative colorimetric, Little CMS."""
    transform = ImageCms.buildTransform(source, target, "RGB", "RGB", renderingIntent=1)
    return np.asarray(ImageCms.applyTransform(Image.fromarray(codes), transform))


def test_srgb_is_what_the_engine_calls_srgb(codes):
    theirs = ImageCms.createProfile("sRGB")
    found = converted(codes, engine(Display.named("srgb")), theirs)
    # Colorants are rounded to 1/65536 and the engine to 8 bits: one code.
    assert np.abs(found.astype(int) - codes).max() <= 1


def test_display_p3_reaches_srgb_as_colour_science_says(codes):
    found = converted(codes, engine(Display.named("display-p3")), ImageCms.createProfile("sRGB"))
    expected = colour.RGB_to_RGB(
        codes / 255.0,
        "Display P3",
        "sRGB",
        chromatic_adaptation_transform=None,
        apply_cctf_decoding=True,
        apply_cctf_encoding=True,
    )
    # Inside the gamut; at its edge the engine clips and the formula does not. One code of rounding
    # on each side.
    inside = ((expected > 0.02) & (expected < 0.98)).all(axis=-1)
    assert inside.sum() > 500
    assert np.abs(found - 255.0 * expected)[inside].max() <= 2.0


def test_a_calibrated_display_shows_the_same_colours_through_its_profile(codes):
    display = Display.calibrated(**{**monitor.session(), "black": None, "ramp": None}, curve=2.2)
    planes = np.moveaxis(codes / 255.0, -1, 0)
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        display.white.xyz, colour.xy_to_XYZ([0.3127, 0.3290]), transform="Bradford"
    )
    xyz = np.tensordot(adapt, display.xyz_of(planes), axes=1)
    linear = Display.named("srgb").linear_of(xyz)
    inside = ((linear > 0.02) & (linear < 0.98)).all(axis=0)
    expected = np.moveaxis(255.0 * Display.named("srgb").encode(linear), 0, -1)
    found = converted(codes, engine(display), ImageCms.createProfile("sRGB"))
    assert inside.sum() > 500
    assert np.abs(found - expected)[inside].max() <= 2.0


def test_measured_curves_are_tabulated():
    display = Display.calibrated(**monitor.session())
    profile = engine(display)
    assert profile.profile.profile_description == "impasto calibrated"
    assert len(icc_profile(display)) > 3 * 2 * 4096
    # The engine's own reading of the white: full drive is the connection space's white.
    assert profile.profile.media_white_point[0] == pytest.approx((0.9642, 1.0, 0.8249), abs=1e-4)


def test_the_same_display_gives_the_same_bytes():
    assert icc_profile(Display.named("srgb")) == icc_profile(Display.named("sRGB"))
    assert len(icc_profile(Display.named("srgb"))) < 1000


def test_files_carry_the_profile_and_the_same_pixels(tmp_path, codes):
    profile = icc_profile(Display.named("display-p3"))
    for name, write in (("8.png", write_png8), ("16.png", write_png16), ("16.tif", write_tiff16)):
        picture = codes if name == "8.png" else codes.astype(np.uint16) * 257
        write(tmp_path / name, picture, icc=profile)
        np.testing.assert_array_equal(
            read_image(tmp_path / name), np.moveaxis(picture, -1, 0), err_msg=name
        )
    for name in ("8.png", "16.png"):
        with Image.open(tmp_path / name) as image:
            image.verify()
            assert image.info["icc_profile"] == profile
    with tifffile.TiffFile(tmp_path / "16.tif") as file:
        assert file.pages[0].iccprofile == profile

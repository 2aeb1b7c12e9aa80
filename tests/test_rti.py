"""RTI files: those of another program, read; and ours, read by decoders that share no code."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io import read_image, read_relightable, read_stack
from impasto.io.rti import (
    Basis,
    RelightableImage,
    quantised,
    write_ptm,
    write_relight,
    write_rti,
)
from impasto.io.rti.image import dome
from rti_decoders import Ptm, Relight, Rti, harmonics
from rti_files import COLUMNS, ROWS, compressed, relightable

LIGHT = (0.3, -0.4, 0.75**0.5)


def every(decoder: Ptm | Rti | Relight, light: tuple[float, float, float]) -> np.ndarray:
    found = [[decoder.shown(y, x, light) for x in range(COLUMNS)] for y in range(ROWS)]
    return np.moveaxis(np.array(found), -1, 0)


# What another program wrote


@pytest.fixture(scope="module")
def peer(data: Path) -> Path:
    return data / "peer_relight"


@pytest.fixture(scope="module")
def lights(data: Path) -> np.ndarray:
    return impasto.io.read_lights(data / "icon_rti" / "dirs.lp").directions


@pytest.mark.parametrize("name", ["ptm18", "hsh27", "rbf27"])
def test_a_folder_of_relight_shows_what_relight_itself_shows(
    name: str, peer: Path, lights: np.ndarray
) -> None:
    """Its own picture has the codes below ours: relight cuts the fraction off, and a light in its
    file has three decimals, which moves no code by more than the rounding of one."""
    image = read_relightable(peer / name)
    theirs = read_image(peer / name / "lit_12.png").astype(int)
    ours = 255.0 * np.clip(image.values(lights[12])[0], 0.0, 1.0)
    assert image.coding == "linear"
    np.testing.assert_array_less(theirs, ours + 0.05)
    np.testing.assert_array_less(ours, theirs + 1.05)


def test_files_of_relight_hold_the_planes_of_its_folders(peer: Path) -> None:
    """Bit for bit, with rows from below in ``.ptm`` and from above in ``.rti``."""
    for file, folder in (("icon.ptm", "ptm18"), ("icon.rti", "hsh27")):
        found, expected = read_relightable(peer / file), read_relightable(peer / folder)
        np.testing.assert_array_equal(found.planes, expected.planes)


def test_a_file_without_scales_says_so(peer: Path) -> None:
    """relight's ``.ptm`` has six zeros where its scales belong."""
    image = read_relightable(peer / "icon.ptm")
    assert "scales are 0" in image.notes[0]
    assert not image.values(LIGHT).any()


@pytest.mark.parametrize(("name", "expected"), [("ptm18", 19.0), ("hsh27", 20.1), ("rbf27", 29.5)])
def test_held_out_photographs_score_what_relight_says(
    name: str, expected: float, peer: Path, data: Path
) -> None:
    """Its figures are those of its own pictures of 8 bits, whose fractions are cut off: half a code
    of linear light is up to 6 codes of a dark pixel in sRGB, here worth up to 0.3 dB."""
    stack = read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb").take(range(0, 72, 6))
    at = np.array([light.direction for light in stack.rig.lights])
    shown = read_relightable(peer / name).linear(at)
    srgb = impasto.Encoding("srgb", 255.0)
    error = np.square(srgb.encode(shown) - srgb.encode(stack.samples)).mean(axis=(1, 2, 3))
    assert np.mean(10.0 * np.log10(255.0**2 / error)) == pytest.approx(expected, abs=0.3)


# What we write


@pytest.mark.parametrize("light", [LIGHT, (0.0, 0.0, 1.0), (-0.8, 0.59, 0.1)])
def test_a_decoder_from_the_description_reads_what_we_write(
    light: tuple[float, float, float], tmp_path: Path
) -> None:
    """The files' numbers have nine digits, or 24 bits: 1e-6 of values around 1 and 255."""
    ptm, hsh = relightable("ptm"), relightable("hsh")
    write_ptm(tmp_path / "a.ptm", ptm)
    write_rti(tmp_path / "a.rti", hsh)
    unit = tuple(np.array(light) / np.linalg.norm(light))
    ours = ptm.values(unit)[0]
    np.testing.assert_allclose(every(Ptm(tmp_path / "a.ptm"), unit) / 255, ours, atol=3e-6)
    np.testing.assert_allclose(every(Rti(tmp_path / "a.rti"), unit), hsh.values(unit)[0], atol=3e-6)
    for kind in ("ptm", "hsh"):
        folder = tmp_path / f"{kind}{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        image = relightable(kind, file=False)
        write_relight(folder, image, suffix="png")
        shown = every(Relight(folder), unit)
        np.testing.assert_allclose(shown, image.values(unit)[0], atol=3e-6)


def test_what_we_write_comes_back_bit_for_bit(tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    writers: tuple[tuple[str, RelightableImage, Callable[..., None]], ...] = (
        ("a.ptm", relightable("ptm"), write_ptm),
        ("b.rti", relightable("hsh"), write_rti),
        ("c", relightable("hsh", file=False), lambda p, i: write_relight(p, i, suffix="png")),
    )
    for name, image, write in writers:
        write(tmp_path / name, image)
        again = read_relightable(tmp_path / name)
        np.testing.assert_array_equal(again.planes, image.planes)
        np.testing.assert_allclose(again.scale, image.scale, rtol=1e-7)
        np.testing.assert_allclose(again.bias, image.bias, rtol=1e-7, atol=1e-9)
        assert again.basis == image.basis
    assert read_relightable(tmp_path / "c").pitch_mm == 0.25
    assert read_relightable(tmp_path / "c").coding == "srgb"


def test_luminance_and_colour_are_read_and_written(tmp_path: Path) -> None:
    rgb = relightable("ptm")
    rng = np.random.default_rng(1)
    image = RelightableImage(
        planes=rgb.planes[::3],
        scale=rgb.scale[::3],
        bias=rgb.bias[::3],
        basis=rgb.basis,
        colourspace="lrgb",
        colour=rng.integers(0, 256, (3, ROWS, COLUMNS), dtype=np.uint8),
    )
    write_ptm(tmp_path / "a.ptm", image)
    again = read_relightable(tmp_path / "a.ptm")
    np.testing.assert_array_equal(again.planes, image.planes)
    np.testing.assert_array_equal(again.colour, image.colour)
    shown = every(Ptm(tmp_path / "a.ptm"), LIGHT) / 255
    np.testing.assert_allclose(shown, image.values(LIGHT)[0], atol=3e-6)


def test_compressed_planes_differences_and_corrections_are_read(tmp_path: Path) -> None:
    """Pixel 17 of 16 columns: the second place of the second row of the file."""
    path = tmp_path / "a.ptm"
    planes = compressed(path, corrections=struct.pack(">IB", 17, 201), reference=0)
    planes[2].reshape(-1)[17] = 201
    image = read_relightable(path)
    assert image.shape == (8, 16)
    np.testing.assert_array_equal(image.colour, planes[6:, ::-1])
    # In memory 1, u, v, u^2, u v, v^2; in the file u^2, v^2, u v, u, v, 1.
    np.testing.assert_array_equal(image.planes[[3, 5, 4, 1, 2, 0]], planes[:6, ::-1])


def test_a_correction_outside_of_the_picture_is_refused(tmp_path: Path) -> None:
    compressed(tmp_path / "a.ptm", corrections=struct.pack(">IB", 16 * 8, 1))
    with pytest.raises(CorruptInputError, match="outside"):
        read_relightable(tmp_path / "a.ptm")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"PTM_1.2", b"JPG_1.2", "does not begin with PTM_"),
        (b"PTM_FORMAT_RGB", b"PTM_FORMAT_LUM", "is not read"),
        (b"\n7\n5\n", b"\n7\n6\n", "truncated"),
        (b"\n7\n5\n", b"\n0\n5\n", "claims a size"),
        (b"\n7\n5\n", b"\n900000\n900000\n", "more than"),
        (b"\n7\n5\n", b"\nx\n5\n", "cannot be read"),
    ],
)
def test_a_damaged_ptm_is_refused(old: bytes, new: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ptm"
    write_ptm(path, relightable("ptm"))
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    with pytest.raises((CorruptInputError, ArgumentError), match=problem) as error:
        read_relightable(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"#HSH1.2", b"HSH1.2", "is no RTI file"),
        (b"\n3\n", b"\n4\n", "RTI type 4"),
        (b"7 5 3", b"7 9 3", "truncated"),
        (b"9 2 1", b"16 2 1", "holds 16 hemispherical"),
        (b"9 2 1", b"9 1 1", "colour type 1"),
    ],
)
def test_a_damaged_rti_is_refused(old: bytes, new: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "a.rti"
    write_rti(path, relightable("hsh"))
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    with pytest.raises((CorruptInputError, ArgumentError), match=problem) as error:
        read_relightable(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("type", "dmd", "is not read"),
        ("colorspace", "mycc", "is not read"),
        ("nplanes", 10**9, "planes"),
        ("width", 9, "expected 3"),
        ("materials", [], "cannot be read"),
        ("format", "../x", "are not read"),
        ("type", "ptm", "ptm has 6, found 9"),
    ],
)
def test_a_damaged_folder_is_refused(key: str, value: Any, problem: str, tmp_path: Path) -> None:
    write_relight(tmp_path, relightable("hsh", file=False))
    info = tmp_path / "info.json"
    info.write_text(json.dumps(json.loads(info.read_text()) | {key: value}))
    with pytest.raises((CorruptInputError, ArgumentError), match=problem) as error:
        read_relightable(tmp_path)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize("pitch", [0, -1.0, True, 1e300, float("inf"), "0.1"])
def test_what_is_no_width_of_a_pixel_is_left_out(pitch: Any, tmp_path: Path) -> None:
    write_relight(tmp_path, relightable("hsh", file=False))
    info = tmp_path / "info.json"
    for value, expected in ((pitch, None), (0.25, 0.25)):
        content = json.loads(info.read_text()) | {"pixelSizeInMM": value}
        info.write_text(json.dumps(content))
        assert read_relightable(tmp_path).pitch_mm == expected


def test_any_cut_ends_in_an_error_that_names_the_file(tmp_path: Path) -> None:
    for name, image, write in (
        ("a.ptm", relightable("ptm"), write_ptm),
        ("a.rti", relightable("hsh"), write_rti),
    ):
        path = tmp_path / name
        write(path, image)
        whole = path.read_bytes()
        for length in range(0, len(whole) - 1, 37):
            path.write_bytes(whole[:length])
            with pytest.raises((CorruptInputError, ArgumentError)) as error:
                read_relightable(path)
            assert name in str(error.value)


# Functions


def test_hemispherical_harmonics_are_orthonormal() -> None:
    """By the midpoint rule over cosines and azimuths. The last 0.01 radians above the horizon hold
    1 % of the cosines, over which the functions stay as they are: errors of some 0.01 at most."""
    cosine = (np.arange(400) + 0.5) / 400
    azimuth = (np.arange(64) + 0.5) / 64 * 2 * np.pi
    c, phi = (one.ravel() for one in np.meshgrid(cosine, azimuth))
    sine = np.sqrt(1.0 - c * c)
    found = Basis("hsh", 9).values(np.stack([sine * np.cos(phi), sine * np.sin(phi), c], axis=1))
    products = found.T @ found * (2 * np.pi / len(c))
    np.testing.assert_allclose(products, np.eye(9), atol=0.02)


def test_functions_are_those_of_the_description() -> None:
    at = dome(12)
    expected = [harmonics(tuple(one)) for one in at]
    np.testing.assert_allclose(Basis("hsh", 9).values(at), expected, atol=1e-12)
    np.testing.assert_allclose(Basis("hsh", 4).values(at), np.array(expected)[:, :4], atol=1e-12)
    z = at[:, 2]
    squares = np.square(Basis("sh", 9).values(at)[:, 1:4]).sum(axis=1)
    np.testing.assert_allclose(squares, 3 / (4 * np.pi), rtol=1e-12)  # Unsold's theorem
    assert np.all(z > 0.0)


def test_radial_functions_are_one_at_their_own_light() -> None:
    """Neighbours of a dome of 40 are 0.35 apart: exp(-(0.35 / 0.05)^2) is 1e-21."""
    at = dome(40)
    np.testing.assert_allclose(Basis("rbf", 40, at, 0.05).values(at), np.eye(40), atol=1e-9)
    everywhere = Basis("rbf", 40, at, 0.2).values(dome(97))
    np.testing.assert_allclose(everywhere.sum(axis=1), 1.0, rtol=1e-12)


def test_the_brightest_light_of_a_polynomial_is_its_normal() -> None:
    """``1 - |l - n|^2 / 2`` in (u, v) is brightest at the normal's own; codes of 254 steps over a
    range of 2 move u and v by some 1/127 of the curvature 1: 0.02."""
    n = np.array([0.2, -0.3])
    coefficients = np.zeros((6, 3, 1, 1), np.float32)
    coefficients[:, :, 0, 0] = np.array([0.5, n[0], n[1], -0.5, 0.0, -0.5])[:, None]
    image = quantised(coefficients, Basis("ptm", 6), shared=True, whole=True)
    found = image.luminance_maximum()[:, 0, 0]
    np.testing.assert_allclose(found[:2], n, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-6)
    flat = quantised(np.zeros((6, 3, 1, 1), np.float32), Basis("ptm", 6))
    assert np.isnan(flat.luminance_maximum()).all()


def test_normals_come_out_of_an_rti(tmp_path: Path) -> None:
    """A matte surface survives nine harmonics: its shading is nearly of second order in the light.
    Least squares of shading that is cut off at the horizon leans by 2 degrees at most."""
    rng = np.random.default_rng(2)
    slopes = 0.2 * rng.uniform(-1.0, 1.0, (2, ROWS, COLUMNS))
    normal = np.stack([*slopes, np.ones((ROWS, COLUMNS))])
    normal /= np.linalg.norm(normal, axis=0)
    surface = impasto.Surface(normal, np.full((3, ROWS, COLUMNS), 0.6))
    impasto.export.to("hsh", surface, tmp_path / "a.rti")
    stack = read_relightable(tmp_path / "a.rti").stack()
    found = impasto.fit_normals(stack, method="robust").normal
    angle = np.degrees(np.arccos(np.clip((found * normal).sum(axis=0), -1.0, 1.0)))
    assert angle.max() < 2.0


@pytest.mark.parametrize("light", [(0, 0, 0), (0, 0, -1), (np.nan, 0, 1), (1, 2)])
def test_a_light_that_is_none_is_refused(light: Any) -> None:
    with pytest.raises(ArgumentError, match="lights"):
        relightable().values(light)


def test_scales_that_differ_by_channel_do_not_fit_a_file(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="quantise"):
        write_ptm(tmp_path / "a.ptm", relightable("ptm", file=False))
    with pytest.raises(ArgumentError, match="quantise"):
        write_rti(tmp_path / "a.rti", relightable("hsh", file=False))
    with pytest.raises(ArgumentError, match="kind"):
        write_rti(tmp_path / "a.rti", relightable("ptm"))
    assert list(tmp_path.iterdir()) == []

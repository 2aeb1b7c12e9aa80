"""How photographs are decoded where nobody says: alike in Python and on the command line."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import ImageCms

import impasto
from impasto import ImpastoError, read_stack, simulate
from impasto.cli.photographs import Reading
from impasto.colour import Display, icc_profile
from impasto.io import read_header, write_jpeg, write_lights, write_png8, write_stack
from impasto.io.images.profile import profile_curve
from impasto.io.session.tone import sure_tone
from test_io_stack import CODES8, CODES16, COUNT, HEIGHT, LIGHTS, NAMES, WIDTH, save, session

SHARE = CODES8 / 255.0
SRGB = np.where(SHARE <= 0.04045, SHARE / 12.92, ((SHARE + 0.055) / 1.055) ** 2.4)
"""IEC 61966-2-1, in float64."""


def note(stack: impasto.Stack) -> str:
    """The one sentence on the tone curve."""
    (found,) = [str(entry) for entry in stack.notes if entry.kind == "encoding"]
    return found


def light(stack: impasto.Stack) -> np.ndarray:
    return np.stack([stack.linear(index) for index in range(len(stack.rig))])


def pictures(folder: Path, suffix: str) -> Path:
    """Eight-bit files of one kind; JPEGs have other pixels, but the same for every reader."""
    names = [f"{name}{suffix}" for name in NAMES]
    folder.mkdir(exist_ok=True)
    for name, planes in zip(names, CODES8, strict=True):
        if suffix == ".jpg":
            write_jpeg(folder / name, np.moveaxis(planes, 0, -1))
        else:
            save(folder / name, planes)
    write_lights(folder / "dirs.lp", LIGHTS, names)
    return folder / "dirs.lp"


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_eight_bits_are_srgb_in_python_and_on_the_command_line(tmp_path: Path, suffix: str) -> None:
    path = pictures(tmp_path, suffix)
    stack, command_line = read_stack(path), Reading().read(path)
    np.testing.assert_array_equal(stack.samples, command_line.samples)
    assert stack.encoding == command_line.encoding == impasto.Encoding("srgb", 255.0)
    assert note(stack) == note(command_line)
    assert "8-bit files without a profile, read as srgb" in note(stack)
    assert stack.encoding_source == "assumed"
    assert "float32, srgb (assumed)>" in repr(stack)
    if suffix != ".jpg":
        # A power in float32: a few units in the last place.
        np.testing.assert_allclose(stack.samples[CODES8 < 255], SRGB[CODES8 < 255], rtol=2e-6)


@pytest.mark.parametrize(
    ("suffix", "codes"), [(".png", CODES16), (".tif", (CODES16 / 65535).astype(np.float32))]
)
def test_deeper_files_are_linear_and_say_so(tmp_path: Path, suffix: str, codes: np.ndarray) -> None:
    path = session(tmp_path, codes, suffix)
    for stack in (read_stack(path), Reading().read(path)):
        np.testing.assert_array_equal(stack.samples, codes)
        assert "more than 8 bits, read as linear light" in note(stack)
        assert "linear (assumed)>" in repr(stack)


def test_what_is_given_is_not_assumed(tmp_path: Path) -> None:
    stack = read_stack(session(tmp_path), encoding="srgb")
    assert (stack.notes, stack.encoding_source) == ((), "given")
    assert repr(stack).endswith("float32, srgb>")
    write_stack(tmp_path / "s.npz", stack)
    assert read_stack(tmp_path / "s.npz").encoding_source == "given"


# Profiles.


def tag(curve: str) -> bytes:
    """A tone curve as ICC.1:2022 writes it, sections 10.6 and 10.18."""
    codes = np.linspace(0.0, 1.0, 1024)
    if curve == "linear":
        return b"curv" + bytes(4) + struct.pack(">I", 0)
    if curve == "2.2":
        return b"curv" + bytes(4) + struct.pack(">IH", 1, round(2.2 * 256))
    if curve == "1.8":
        return b"para" + bytes(4) + struct.pack(">HHi", 0, 0, round(1.8 * 65536))
    # A table, as in the sRGB profile of 1998 ...
    table = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    if curve == "lightness":
        # ... or of CIE L*, as in eciRGB v2: no gamma has this curve.
        table = np.where(codes <= 0.08, codes / 9.033, ((codes + 0.16) / 1.16) ** 3)
    return b"curv" + bytes(4) + struct.pack(">I1024H", 1024, *np.rint(65535 * table).astype(int))


def profile(curve: str) -> bytes:
    """The least profile that has a curve for each channel."""
    content = tag(curve)
    start = 128 + 4 + 3 * 12
    table = b"".join(
        struct.pack(">4sII", name, start, len(content)) for name in (b"rTRC", b"gTRC", b"bTRC")
    )
    head = bytes(16) + b"RGB XYZ " + bytes(12) + b"acsp" + bytes(88)
    return head + struct.pack(">I", 3) + table + content


def with_profile(path: Path, planes: np.ndarray, icc: bytes) -> None:
    if path.suffix == ".png":
        write_png8(path, np.moveaxis(planes, 0, -1), icc=icc)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, np.moveaxis(planes, 0, -1), photometric="rgb", iccprofile=icc)
    else:
        _, coded = cv2.imencode(".jpg", np.moveaxis(planes[::-1], 0, -1))
        data, half = coded.tobytes(), len(icc) // 2
        # In two segments, as long profiles are.
        parts = b"".join(
            b"\xff\xe2"
            + struct.pack(">H", len(part) + 16)
            + b"ICC_PROFILE\0"
            + bytes([n, 2])
            + part
            for n, part in ((1, icc[:half]), (2, icc[half:]))
        )
        path.write_bytes(data[:2] + parts + data[2:])


def profiled(folder: Path, suffix: str, icc: bytes) -> Path:
    names = [f"{name}{suffix}" for name in NAMES]
    for name, planes in zip(names, CODES8, strict=True):
        with_profile(folder / name, planes, icc)
    write_lights(folder / "dirs.lp", LIGHTS, names)
    return folder / "dirs.lp"


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("curve", ["linear", "1.8", "2.2", "srgb"])
def test_a_profile_says_the_curve(tmp_path: Path, suffix: str, curve: str) -> None:
    path = profiled(tmp_path, suffix, profile(curve))
    stack = read_stack(path)
    assert stack.encoding == impasto.Encoding(curve, 255.0)
    assert stack.encoding_source == "profile"
    assert f"read as {curve}, as their profile states" in note(stack)
    # What is given wins.
    assert read_stack(path, encoding="2.4").encoding.curve == "2.4"


def test_profiles_of_other_programs() -> None:
    """LittleCMS's sRGB; our own of a display with the curve of sRGB, and of one with a gamma."""
    written = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert profile_curve(written) == "srgb"
    assert profile_curve(icc_profile(Display.named("display-p3"))) == "srgb"
    for damaged in (b"", bytes(200), profile("srgb")[:150], profile("srgb")[:300]):
        assert profile_curve(damaged) == "other"


def test_an_unusual_curve_is_told(tmp_path: Path) -> None:
    stack = read_stack(profiled(tmp_path, ".png", profile("lightness")))
    assert stack.encoding.curve == "srgb"
    assert "unusual tone curve" in note(stack)


def test_profiles_that_differ_are_ignored(tmp_path: Path) -> None:
    path = profiled(tmp_path, ".png", profile("1.8"))
    with_profile(tmp_path / f"{NAMES[3]}.png", CODES8[3], profile("linear"))
    stack = read_stack(path)
    assert stack.encoding.curve == "srgb"
    (told,) = [str(entry) for entry in stack.notes if entry.kind == "profile"]
    assert NAMES[3] in told
    assert "1.8" in told


def test_deep_files_with_a_curve_are_told(tmp_path: Path) -> None:
    """They stay linear: raw developers write their output profile into linear files as well."""
    for name, planes in zip(NAMES, CODES16, strict=True):
        rgb = np.moveaxis(planes, 0, -1)
        tifffile.imwrite(
            tmp_path / f"{name}.tif", rgb, photometric="rgb", iccprofile=profile("1.8")
        )
    stack = read_stack(tmp_path, lights=LIGHTS)
    assert stack.encoding.curve == "linear"
    assert "their profile has another curve, 1.8; give encoding=" in note(stack)


@pytest.mark.parametrize(
    ("kind", "body", "curve"),
    [
        (b"sRGB", b"\0", "srgb"),
        (b"gAMA", struct.pack(">I", 45455), "srgb"),
        (b"gAMA", struct.pack(">I", 100_000), "linear"),
        (b"gAMA", struct.pack(">I", 55556), "1.8"),
    ],
)
def test_chunks_of_png_say_the_curve(tmp_path: Path, kind: bytes, body: bytes, curve: str) -> None:
    path = tmp_path / "a.png"
    save(path, CODES8[0])
    data = path.read_bytes()
    chunk = struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    path.write_bytes(data[:33] + chunk + data[33:])
    assert read_header(path).curve == curve


# Estimates that overrule the rule.


def coded(curve: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    rig = "tominaga-six-band-adaptation"
    painting = simulate.painting(5, (72, 72), varnish="satin")
    stack = simulate.capture(painting, rig, encoding=curve, bits=8).stack.take(range(count))
    if curve == "linear":
        return stack.samples - stack.black[0].astype(np.uint8), stack.rig.directions
    return np.rint(stack.encode(stack.samples)).astype(np.uint8), stack.rig.directions


@pytest.mark.parametrize(
    ("curve", "count", "read"),
    [("linear", 16, "linear"), ("linear", 11, "srgb"), ("srgb", 16, "srgb"), ("2.2", 16, "srgb")],
)
def test_only_photographs_that_are_sure_overrule_srgb(
    tmp_path: Path, curve: str, count: int, read: str
) -> None:
    """Six bands as three and three: two files per light."""
    codes, lights = coded(curve, count)
    for index, planes in enumerate(codes):
        save(tmp_path / f"s{index}_a.png", planes[:3])
        save(tmp_path / f"s{index}_b.png", planes[3:])
    stack = read_stack(tmp_path, lights=lights, pattern=["{name}_a.png", "{name}_b.png"])
    assert stack.encoding.curve == read
    assert stack.encoding_source == ("estimated" if read == "linear" else "assumed")


def test_the_icon_is_srgb_by_any_selection(data: Path) -> None:
    """Gloss and few lights mislead the estimate of an icon; they never make it sure."""
    stack = read_stack(data / "icon_rti" / "dirs.lp", encoding="linear")
    rng = np.random.default_rng(1)
    for count in (12, 16, 24):
        some = stack.take(np.sort(rng.choice(72, count, replace=False)))
        assert sure_tone(some.samples, some.rig.directions, white=255.0) is None


def test_a_board_takes_out_strengths_whether_one_per_light_or_one_per_band(tmp_path: Path) -> None:
    """Photographs and boards see the same lamps: what is said of these changes no bit."""
    path = session(tmp_path)
    boards = np.full((COUNT, 3, HEIGHT, WIDTH), 200, np.uint8)
    known: dict[str, object] = {"encoding": "linear", "white": boards}
    plain = read_stack(path, **known)
    per_light = np.linspace(0.5, 1.5, COUNT)
    for strengths in (per_light, per_light[:, None] * [1.0, 2.0, 4.0]):
        told = read_stack(path, intensities=strengths, **known)
        np.testing.assert_array_equal(told.samples, plain.samples)
        np.testing.assert_array_equal(told.rig.intensities, plain.rig.intensities)


# A black level.


@pytest.mark.parametrize("level", [100, 100.0, [100, 120, 90]])
def test_a_black_level_keeps_integers(tmp_path: Path, level: object) -> None:
    path = session(tmp_path, CODES16)
    stack = read_stack(path, dark=level, saturation=60000)
    assert stack.samples.dtype == np.uint16
    np.testing.assert_array_equal(stack.samples, CODES16)
    black = np.broadcast_to(np.asarray(level, dtype=float), 3)
    np.testing.assert_array_equal(stack.black, black)
    expected = (CODES16 - black[:, None, None]) / 65535.0
    usable = CODES16 < 60000
    # Two roundings to float32 of numbers below 1.
    np.testing.assert_allclose(light(stack)[usable], expected[usable], rtol=0, atol=1.2e-7)
    assert np.isposinf(light(stack)[~usable]).all()


def test_a_black_level_beside_a_frame_or_a_curve_is_applied_at_once(tmp_path: Path) -> None:
    """Strengths per band, a board and a curve are not linear functions of the code."""
    path = session(tmp_path)
    with_curve = read_stack(path, dark=5)
    assert with_curve.samples.dtype == np.float32
    usable = CODES8 < 255
    np.testing.assert_allclose(
        with_curve.samples[usable], SRGB[usable] - 5 / 255 / 12.92, rtol=0, atol=1.2e-7
    )
    per_band = np.ones((COUNT, 3)) * [1.0, 2.0, 4.0]
    gains = read_stack(path, encoding="linear", dark=5, intensities=per_band)
    assert gains.samples.dtype == np.float32
    frame = np.full((3, HEIGHT, WIDTH), 5)
    assert read_stack(path, encoding="linear", dark=frame).samples.dtype == np.float32
    with pytest.raises(ImpastoError, match="dark"):
        read_stack(path, encoding="linear", dark=300)

"""Tone curves from grey patches and exposures: known curves, refused series, the file in use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import impasto
from impasto import ArgumentError, CorruptInputError, Encoding
from impasto.calibrate import tone_from_exposures, tone_from_patches
from impasto.calibrate.tone_response import fit_response
from impasto.cli import main
from impasto.encoding import curve_of_points
from impasto.io import (
    Session,
    read_tone_curve,
    write_lights,
    write_png8,
    write_session,
    write_tiff16,
    write_tone_curve,
)

GREYS = np.array([0.90, 0.59, 0.36, 0.20, 0.09, 0.03])
GAINS = np.array([1.0, 0.8, 0.6])


def srgb(light: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, written from the standard."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def unusual(light: np.ndarray) -> np.ndarray:
    """A curve with a shoulder, which no gamma has: the inverse of x (0.2 + 0.5 x + 0.3 x^3)."""
    code = np.linspace(0.0, 1.0, 4001)
    return np.interp(light, code * (0.2 + 0.5 * code + 0.3 * code**3), code)


CURVES = {"linear": lambda light: light, "srgb": srgb, "unusual": unusual}


def patches(folder: Path, curve: Any, *, greys: np.ndarray = GREYS, bits: int = 16) -> list[str]:
    """A photograph of six squares under even light, with noise of 0.3 %; its arguments."""
    rng = np.random.default_rng(2)
    light = np.full((3, 60, 20 + 50 * len(greys)), 0.5)
    rows = ["column,row,size,reflectance"]
    for i, (grey, truth) in enumerate(zip(greys, GREYS, strict=False)):
        light[:, 10:50, 20 + 50 * i : 60 + 50 * i] = grey
        rows.append(f"{40 + 50 * i},30,30,{truth}")
    light = np.clip(light * GAINS[:, None, None] * rng.normal(1, 0.003, light.shape), 0, 1)
    if bits == 16:
        path = folder / "patches.tif"
        write_tiff16(path, np.rint(65535 * curve(light)).astype(np.uint16))
    else:
        path = folder / "patches.png"
        write_png8(path, np.moveaxis(np.rint(255 * curve(light)), 0, -1).astype(np.uint8))
    table = folder / "patches.csv"
    table.write_text("\n".join(rows))
    return [str(path), str(table)]


def exposures(
    folder: Path, curve: Any, stops: tuple[float, ...] = (-4, -3, -2, -1, 0), **extra: Any
) -> Path:
    """A smooth scene of 12 stops by several times, 8 bits, with noise of 0.3 %."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:96, :144] / 144.0
    scene = 2.0 ** (3.5 * np.sin(5 * x) * np.cos(4 * y) - 0.5)
    for i, stop in enumerate(stops):
        light = scene * 2.0**stop * rng.normal(1, 0.003, scene.shape)
        light *= extra.get("light", {}).get(i, 1.0)
        codes = np.rint(255 * curve(np.clip(light, 0, 1))).astype(np.uint8)
        write_png8(folder / f"e{i}.png", codes)
    return folder


def off(found: Any, curve: Any) -> float:
    """Largest error within the measured codes, after the best factor, over the light at the end."""
    low, high = found.measured
    light = np.linspace(0.0, 1.0, 4001)
    codes = curve(light)
    inside = (codes >= low) & (codes <= high)
    own, truth = found.response(codes[inside]), light[inside]
    factor = (own @ truth) / (truth @ truth)
    return float(np.abs(own / factor - truth).max() / truth[-1])


@pytest.mark.parametrize("name", CURVES)
def test_six_patches_tell_the_curve(name: str, tmp_path: Path) -> None:
    """Medians of 900 pixels have 0.013 % of noise; the rest is what smoothness cannot know.

    The stated errors, of 95 %, must hold at the worst code: 3 standard deviations.
    """
    found = tone_from_patches(*patches(tmp_path, CURVES[name]))
    assert len(found.samples.codes) == 18
    assert off(found, CURVES[name]) < max(3.0 * found.sigma, 0.003)
    assert off(found, CURVES[name]) < 0.01
    if name != "unusual":
        assert found.nearest == name
        assert found.deviation < 0.01
    assert (found.nonlinearity < 0.01) == (name == "linear")


@pytest.mark.parametrize("name", CURVES)
def test_exposures_tell_the_curve(name: str, tmp_path: Path) -> None:
    """8 bits: half a code is 0.2 % of full scale."""
    folder = exposures(tmp_path / "series", CURVES[name])
    found = tone_from_exposures(folder, times=[1, 2, 4, 8, 16])
    assert off(found, CURVES[name]) < 0.01
    assert found.measured[1] > 0.9
    assert (found.nearest == name) == (name != "unusual")


def test_the_stated_errors_are_those_of_the_curve() -> None:
    """20 series of six patches with errors of 0.3 % in reflectance, sRGB, by plain numpy.

    Errors at neighbouring codes are alike; 20 series tell the standard deviation to 16 %, and a
    curve has three numbers or more: twice that is allowed.
    """
    scores = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        light = GAINS[:, None] * GREYS
        codes = srgb(light * (1 + rng.normal(0, 0.003, light.shape)))
        codes = codes + rng.normal(0, 0.0005, codes.shape)
        group = np.repeat(np.arange(3), 6)
        found = fit_response(codes.ravel(), np.tile(GREYS, 3), group)
        at = np.linspace(codes.min(), 0.95 * codes.max(), 20)
        truth = ((at + 0.055) / 1.055) ** 2.4
        end = codes.max()
        factor = np.interp(end, found.codes, found.light) / ((end + 0.055) / 1.055) ** 2.4
        sigma = np.interp(at, found.codes, found.sigma)
        scores.append((found(at) / factor - truth) / (sigma / factor))
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_black_is_no_light(tmp_path: Path) -> None:
    """A pedestal of 4096 codes; without it the darkest patch, 0.018, would read as 0.08."""

    def raised(light: np.ndarray) -> np.ndarray:
        return (4096 + (65535 - 4096) * light) / 65535

    found = tone_from_patches(*patches(tmp_path, raised), dark=4096)
    low, high = (found.response(raised(np.array([v]))) - found.response.black for v in (0.09, 0.9))
    assert float(low[0] / high[0]) == pytest.approx(0.1, abs=0.001)
    assert found.nonlinearity < 0.005


def test_the_file_is_what_read_stack_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Light of photographs with an unusual curve, by argument, command and session."""
    series = exposures(tmp_path / "series", unusual)
    out = tmp_path / "tone.json"
    words = ["calibrate", "linearity", str(series), "--times", "1", "2", "4", "8", "16",
             "--out", str(out)]  # fmt: skip
    assert main(words) == 0
    assert "nearest known curve" in capsys.readouterr().err
    content = json.loads(out.read_text())
    assert content["series"] == "exposures"
    assert out.with_suffix(".png").is_file()
    light = np.linspace(0.05, 0.9, 40 * 30).reshape(30, 40)
    names = [f"p{i}.png" for i in range(3)]
    for i, name in enumerate(names):
        codes = np.rint(255 * unusual(light * (1 - 0.2 * i))).astype(np.uint8)
        write_png8(tmp_path / name, codes)
    lamps = tmp_path / "lamps.lp"
    write_lights(lamps, np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]]), names)
    stack = impasto.read_stack(lamps, encoding=str(out), images=tmp_path)
    ratio = stack.linear(1) / stack.linear(0)
    # Half a code is 0.4 % of the darkest light, twice.
    assert np.abs(ratio - 0.8).max() < 0.03
    assert abs(float(np.median(ratio)) - 0.8) < 0.003
    assert "measured" in repr(stack)
    write_session(tmp_path / "session.toml", Session(lights="lamps.lp", encoding="tone.json"))
    same = impasto.read_stack(tmp_path / "session.toml")
    np.testing.assert_array_equal(same.samples, stack.samples)
    impasto.io.write_stack(tmp_path / "stack.npz", stack)
    assert impasto.read_stack(tmp_path / "stack.npz").encoding == stack.encoding
    assert main(words) == 1  # nothing is overwritten


def test_rounded_exposure_times_are_those_of_the_shutter(tmp_path: Path) -> None:
    """EXIF says 1/15, 1/30, 1/60, 1/125 of 1/16, 1/32, 1/64, 1/128, where 4 % would bend a line.

    The brightest places are few: the stated error is 0.5 %, twice that and a half are allowed.
    """
    folder = tmp_path / "series"
    folder.mkdir()
    y, x = np.mgrid[:64, :96] / 96.0
    scene, rng = 0.3 + 0.65 * x * (1 - 0.3 * y), np.random.default_rng(1)
    for i, name in enumerate((15, 30, 60, 125)):
        codes = np.rint(255 * scene / 2**i + rng.normal(0, 1, x.shape)).astype(np.uint8)
        image = Image.fromarray(codes).convert("RGB")
        exif = image.getexif()
        exif.get_ifd(0x8769)[33434] = 1.0 / name
        image.save(folder / f"e{i}.jpg", exif=exif.tobytes(), quality=98)
    found = tone_from_exposures(folder)
    assert found.nearest == "linear"
    assert found.nonlinearity < 2.5 * found.sigma < 0.015
    nominal = tone_from_exposures(folder, times=[1 / 15, 1 / 30, 1 / 60, 1 / 125])
    assert nominal.nonlinearity > found.nonlinearity


# --- the file


def test_points_are_joined_and_back() -> None:
    """Straight lines have an exact inverse; beyond full scale the last one goes on."""
    codes, light = np.array([0, 0.25, 0.5, 1.0]), np.array([0, 0.1, 0.3, 1.0])
    curve = Encoding(curve_of_points(codes, light), 255.0)
    at = np.array([0.0, 60.0, 127.5, 200.0, 255.0, 300.0, -60.0])
    expected = np.interp(np.abs(at) / 255, codes, light)
    expected[5] = 1 + (300 / 255 - 1) * 0.7 / 0.5
    np.testing.assert_allclose(curve.decode(at), np.copysign(expected, at), rtol=1e-6)
    np.testing.assert_allclose(curve.encode(curve.decode(at[:5])), at[:5], atol=1e-4)
    assert curve.name == "measured"
    falling = ("0,0", "0,0 1", "0,0 0.5,0.6 0.4,0.7 1,1", "0,0 0.5,0.6 0.7,0.5 1,1", "0,0 1,2")
    endless = ("0,0 0.3,inf 0.7,inf 1,1", "0,0 inf,0.3 inf,0.7 1,1", "0,0 0.5,nan 1,1")
    for points in (*falling, *endless):
        with pytest.raises(ArgumentError, match="points"):
            Encoding(f"points:{points}")


def test_files_that_hold_no_curve(tmp_path: Path) -> None:
    path = tmp_path / "tone.json"
    write_tone_curve(path, [0, 0.5, 1], [0, 0.2, 1])
    assert read_tone_curve(path) == "points:0,0 0.5,0.2 1,1"
    good = json.loads(path.read_text())
    for change, said in (
        ({"kind": "lens"}, "is not the file of a tone curve"),
        ({"version": 3}, "version 3"),
        ({"light": [0, 1]}, "tone curve"),
        ({"light": [0, "a", 1]}, "tone curve"),
        ({"light": [0, 0.2, 0.9]}, "rise from 0,0 to 1,1"),
    ):
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(CorruptInputError, match=said):
            read_tone_curve(path)
    path.write_text("{")
    with pytest.raises(CorruptInputError, match="not valid JSON"):
        read_tone_curve(path)
    with pytest.raises(ArgumentError, match=r"\.json"):
        write_tone_curve(tmp_path / "tone.txt", [0, 1], [0, 1])


# --- series that tell nothing


def test_patches_that_are_clipped_or_contradict_each_other(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="samples are neither clipped nor black"):
        tone_from_patches(*patches(tmp_path, lambda light: np.minimum(40 * light, 1.0)))
    with pytest.raises(ArgumentError, match="say little of the curve"):
        tone_from_patches(*patches(tmp_path, lambda light: 0.2 * light))
    swapped = GREYS[[0, 2, 1, 3, 4, 5]]
    with pytest.raises(ArgumentError, match=r"patch 2 .*line 3\) reflects more than patch 3"):
        tone_from_patches(*patches(tmp_path, srgb, greys=swapped))
    uneven = GREYS * np.array([1, 1, 1.25, 0.8, 1.2, 1])
    with pytest.raises(ArgumentError, match="no tone curve explains the series"):
        tone_from_patches(*patches(tmp_path, CURVES["linear"], greys=uneven))
    picture, table = patches(tmp_path, srgb)
    for text, said in (
        ("x,y\n", "line 1: expected column,row,size,reflectance"),
        ("column,row,size,reflectance\n1,2,3\n", "line 2: expected four numbers"),
        ("column,row,size,reflectance\n1,2,3,-1\n", "reflectance above 0"),
        ("column,row,size,reflectance\n", "names no patch"),
        ("column,row,size,reflectance\n5,5,30,0.5\n", "leaves the photograph"),
    ):
        Path(table).write_text(text)
        with pytest.raises((ArgumentError, CorruptInputError), match=said):
            tone_from_patches(picture, table)


def test_a_code_of_clipped_samples_is_one(tmp_path: Path) -> None:
    series = patches(tmp_path, srgb)
    for saturation in (np.nan, 0.0, -3.0):
        with pytest.raises(ArgumentError, match="saturation: expected the code from which"):
            tone_from_patches(*series, saturation=saturation)
    with pytest.raises(ArgumentError, match=r"at most 65535, .*found 65536"):
        tone_from_patches(*series, saturation=65536)


def test_exposures_that_are_clipped_or_contradict_each_other(tmp_path: Path) -> None:
    times = [1, 2, 4, 8, 16]
    over = exposures(tmp_path / "over", CURVES["linear"], (6, 7, 8, 9, 10))
    with pytest.raises(ArgumentError, match="clipped or black where it could be read"):
        tone_from_exposures(over, times=times)
    series = exposures(tmp_path / "series", srgb)
    with pytest.raises(ArgumentError, match=r"e\d\.png was exposed for longer than e\d\.png"):
        tone_from_exposures(series, times=times[::-1])
    with pytest.raises(ArgumentError, match="does not say its exposure time"):
        tone_from_exposures(series)
    with pytest.raises(ArgumentError, match="3 for the 5 photographs"):
        tone_from_exposures(series, times=[1, 2, 4])
    with pytest.raises(ArgumentError, match="2 different exposure times"):
        tone_from_exposures(series, times=[1, 1, 1, 2, 2])
    with pytest.raises(ArgumentError, match="positive"):
        tone_from_exposures(series, times=[1, 2, 4, 8, -1])
    lamp = exposures(tmp_path / "lamp", CURVES["linear"], light={2: 1.5})
    with pytest.raises(ArgumentError, match="no tone curve explains the series"):
        tone_from_exposures(lamp, times=times)
    weak = exposures(tmp_path / "weak", CURVES["linear"], light={2: 1.06})
    assert any("e2.png" in text for text in tone_from_exposures(weak, times=times).findings)


def test_the_command_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, table = patches(tmp_path, srgb, bits=8)
    assert main(["calibrate", "linearity", picture, "--out", str(tmp_path / "a.json")]) == 1
    assert "--patches" in capsys.readouterr().err
    assert main(["calibrate", "linearity", picture, "--out", str(tmp_path / "a.txt")]) == 1
    words = ["calibrate", "linearity", picture, "--patches", table, "--quiet"]
    assert main([*words, "--out", str(tmp_path / "a.json")]) == 0
    # The picture of the curve would be a photograph beside that of the patches.
    assert (tmp_path / "calibration" / "a.png").is_file()

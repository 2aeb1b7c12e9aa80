"""A white board: strengths of lamps, noise, and boards that are no good."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.calibrate import board_strengths, photon_transfer
from impasto.calibrate.board import mean_strengths
from impasto.calibrate.photon_transfer import pair_blocks
from impasto.calibrate.smooth_field import smooth_field
from impasto.cli import main
from impasto.errors import ArgumentError, GeometryError, ImpastoError
from impasto.io import LightFile, read_image, write_lights, write_tiff16

HEIGHT, WIDTH = 240, 320
WELL, READ, BLACK = 20000.0, 6.0, 900.0
STRENGTHS = np.array([0.55, 0.6, 0.5, 0.65, 0.58])
COLOURS = np.array([0.7, 1.0, 0.5])
ANGLES = np.arange(5) * 1.25
LIGHTS = np.stack([0.6 * np.cos(ANGLES), 0.6 * np.sin(ANGLES), np.full(5, 0.8)], axis=1)
NAMES = [f"lamp{i}.tif" for i in range(5)]
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(float)
ACROSS, DOWN = X / (WIDTH - 1) - 0.5, Y / (HEIGHT - 1) - 0.5
VIGNETTING = 1.0 - 0.3 * (ACROSS**2 + DOWN**2)


def codes(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Photons and read noise on a pedestal, rounded: the EMVA model of a camera, in numpy."""
    electrons = rng.poisson(WELL * light) + rng.normal(0.0, READ, light.shape)
    return np.clip(np.rint((65535 - BLACK) * electrons / WELL + BLACK), 0, 65535).astype(np.uint16)


def board_light(lamp: int) -> np.ndarray:
    """``(band, y, x)`` of a board with reflectance 0.9."""
    plane = 0.9 * STRENGTHS[lamp] * LIGHTS[lamp, 2] * VIGNETTING
    return COLOURS[:, None, None] * plane


def photograph(folder: Path, seed: int, change: Any = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for i, name in enumerate(NAMES):
        light = board_light(i)
        if change is not None:
            light = change(i, light)
        write_tiff16(folder / name, codes(light, rng))
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("boards")
    photograph(home / "board", 1)
    photograph(home / "again", 2)
    write_lights(home / "lamps.lp", LIGHTS, NAMES)
    return home


def measured(home: Path, folder: Path | None = None, **options: Any) -> Any:
    usual = {"dark": BLACK, "reflectance": 0.9}
    return board_strengths(folder or home / "board", home / "lamps.lp", **{**usual, **options})


def refused(
    home: Path, folder: Path, kind: type[ImpastoError] = ArgumentError, **options: Any
) -> str:
    with pytest.raises(kind) as caught:
        measured(home, folder, **options)
    return str(caught.value)


# --- numbers


def test_strengths_are_those_of_the_lamps(made: Path) -> None:
    """A block of 178 pixels at 0.3 of full scale has 0.1 % of photon noise; the fit averages them.

    Full scale of light is that of codes above black: WELL electrons are 65535 - BLACK codes.
    """
    found = measured(made)
    scale = (65535 - BLACK) / 65535
    truth = STRENGTHS[:, None] * COLOURS * scale
    off = found.strengths / truth - 1.0
    assert found.sigma.max() < 1e-3
    assert np.abs(off).max() < 4.0 * found.sigma.max()
    assert found.findings == ()
    # The corner has 1 - 0.3 / 2 of the light; its blocks end half a block before it.
    assert found.evenness == pytest.approx(0.85, abs=0.02)


def test_the_stated_errors_are_those_of_the_middle() -> None:
    """100 fields with noise: the standard deviation of 100 normal numbers has 7 % itself."""
    rows, columns = 18, 24
    y, x = np.mgrid[:rows, :columns].astype(float)
    truth = np.exp(0.3 * (x - 11.5) / 24 - 0.4 * ((y - 8.5) / 18) ** 2)
    scores = []
    for seed in range(100):
        noisy = truth * np.exp(np.random.default_rng(seed).normal(0, 0.01, truth.shape))
        field = smooth_field(noisy, (180, 240))
        scores.append(np.log(field.middle) / field.sigma)
    assert 0.75 < np.std(scores) < 1.25
    assert abs(np.mean(scores)) < 0.35


def test_a_shadow_is_not_followed_by_the_field() -> None:
    """5 % of the blocks lose half their light: the fit of a mean would lose 2.5 %."""
    truth = np.full((18, 24), 0.5)
    noisy = truth * np.exp(np.random.default_rng(0).normal(0, 0.002, truth.shape))
    noisy[2:6, 10:16] *= 0.5
    assert smooth_field(noisy, (180, 240)).middle == pytest.approx(0.5, rel=1e-3)


def test_pairs_tell_the_noise_of_the_camera(made: Path) -> None:
    """Four of the stated standard deviations, which are a few per cent of the read noise.

    Rounding of 16 bits is 0.1 electrons here.
    """
    found = measured(made, again=made / "again")
    assert len(found.noise) == 3
    for one in found.noise:
        (well, well_sigma), (read, read_sigma) = one.full_well, one.read
        # Full scale of light is 65535 codes, those above black are WELL electrons.
        assert abs(well - WELL * 65535 / (65535 - BLACK)) < 4 * well_sigma
        assert well_sigma < 0.04 * well
        assert abs(read - READ) < 4 * max(read_sigma, 0.1)
    assert found.repeatability is not None
    # Both folders have the same lamps: photon noise of the middle is all.
    assert found.repeatability < 1e-3


def test_dark_frames_tell_the_read_noise_better(made: Path, tmp_path: Path) -> None:
    """130 blocks of 576 pixels: the variance has 0.5 %, read noise 0.3 %; four of them."""
    rng, paths = np.random.default_rng(9), []
    for i in range(2):
        paths.append(tmp_path / f"dark{i}.tif")
        write_tiff16(paths[-1], codes(np.zeros((3, HEIGHT, WIDTH)), rng))
    for one in measured(made, again=made / "again", dark=paths).noise:
        assert abs(one.read[0] / READ - 1.0) < 4 * 0.003 + abs(one.full_well[0] / WELL - 1.0)
        assert one.read[1] < 0.1


def test_read_noise_is_found_with_dark_parts_in_the_picture() -> None:
    """Light from 0 to 0.8 of full scale, so that read noise of 20 electrons is most of the dark."""
    rng = np.random.default_rng(4)
    light = np.repeat(np.linspace(0.0, 0.8, 20), 24)[:, None] * np.ones((1, 960))
    first, second = (
        (rng.poisson(WELL * light) + rng.normal(0, 20.0, light.shape)) / WELL for _ in range(2)
    )
    found = photon_transfer(*pair_blocks(first, second))
    assert abs(found.read[0] - 20.0) < 4 * found.read[1]
    assert found.read[1] < 1.0
    assert abs(found.full_well[0] - WELL) < 4 * found.full_well[1]
    # The second frame brighter by 1 %: only variations within blocks count.
    brighter = photon_transfer(*pair_blocks(first, 1.01 * second))
    assert brighter.full_well[0] == pytest.approx(found.full_well[0], rel=0.03)


def test_the_file_is_what_read_stack_takes(made: Path, tmp_path: Path) -> None:
    """A flat grey of reflectance 0.4 under all lamps; without strengths the lamps differ by 30 %.

    Photon noise of a pixel is 2.5 % in the darkest band, of the mean of 400 pixels 0.13 %.
    """
    home = tmp_path / "painting"
    home.mkdir()
    rng = np.random.default_rng(7)
    for i, name in enumerate(NAMES):
        write_tiff16(home / name, codes(board_light(i) / 0.9 * 0.4, rng))
    write_lights(home / "lamps.lp", LIGHTS, NAMES)
    words = ["calibrate", "board", str(made / "board"), "--lights", str(made / "lamps.lp"),
             "--out", str(home / "light_intensities.txt"), "--dark", "900",
             "--again", str(made / "again"), "--reflectance", "0.9", "--quiet"]  # fmt: skip
    assert main(words) == 0
    stack = impasto.read_stack(home / "lamps.lp", dark=BLACK)
    for i in range(5):
        seen = stack.linear(i)[:, 110:130, 150:170].mean(axis=(1, 2))
        assert seen / LIGHTS[i, 2] == pytest.approx(0.4, rel=5 * 1.3e-3)
    content = json.loads((home / "light_intensities.json").read_text())
    assert content["photographs"] == NAMES
    well, sigma = content["noise"][1]["full_well"]
    assert abs(well - WELL) < 5 * sigma
    # Beside photographs a picture would be taken for one.
    assert read_image(home / "calibration" / "light_intensities.png").shape[0] == 3
    assert main(words) == 1  # nothing is overwritten


def test_near_lamps_lose_their_falloff(tmp_path: Path) -> None:
    """1.5 widths away, light differs by a factor of 2; its middle is known all the same.

    Half a block of the middle is 3 mm of 480: the smooth fit of what is left has 1e-3.
    """
    pitch = 1.0
    places = 1.5 * WIDTH * LIGHTS
    x, y = (X - (WIDTH - 1) / 2) * pitch, ((HEIGHT - 1) / 2 - Y) * pitch
    for i, (px, py, pz) in enumerate(places):
        square = (px - x) ** 2 + (py - y) ** 2 + pz**2
        light = STRENGTHS[i] * (places[i] @ places[i]) * pz / square**1.5
        write_tiff16(tmp_path / NAMES[i], np.rint(65535 * light).astype(np.uint16)[None])
    lengths = np.linalg.norm(places, axis=1)
    file = LightFile(
        tmp_path / "lamps.dome", "dome", None, LIGHTS, lengths, positions=places,
        width_mm=WIDTH * pitch,
    )  # fmt: skip
    write_lights(tmp_path / "lamps.dome", file)
    found = board_strengths(tmp_path, tmp_path / "lamps.dome")
    assert np.abs(found.strengths[:, 0] / STRENGTHS - 1.0).max() < 2e-3
    assert found.evenness.max() < 0.6


# --- boards that are no good


def test_a_shadow_and_a_spot_are_found_where_they_are(made: Path, tmp_path: Path) -> None:
    def change(lamp: int, light: np.ndarray) -> np.ndarray:
        light = light.copy()
        light[:, 40:70, 60:90] *= 0.97  # a spot of the board
        if lamp == 3:
            light[:, 150:200, 200:280] *= 0.8
        return light

    found = measured(made, photograph(tmp_path / "spots", 3, change))
    assert len(found.findings) == 2
    common, own = found.findings
    assert common.startswith("all photographs: the board is 3")
    assert "% darker" in common
    column, row = (int(number) for number in re.findall(r"(?:column|row) (\d+)", common))
    assert 60 <= column <= 90
    assert 40 <= row <= 70
    assert own.startswith("lamp3.tif: 2")
    assert "a shadow of something?" in own
    clean = measured(made)
    assert np.abs(found.strengths / clean.strengths - 1).max() < 2e-3


def test_overexposed_dark_unlit_and_missing_boards_are_named(made: Path, tmp_path: Path) -> None:
    def over(lamp: int, light: np.ndarray) -> np.ndarray:
        return light * (3.0 if lamp == 2 else 1.0)

    text = refused(made, photograph(tmp_path / "over", 3, over))
    assert "lamp2.tif is overexposed: " in text
    assert "band 1 is clipped" in text

    def dark(lamp: int, light: np.ndarray) -> np.ndarray:
        return light * (0.01 if lamp == 4 else 1.0)

    assert "lamp4.tif is dark" in refused(made, photograph(tmp_path / "dark", 3, dark))

    def weak(lamp: int, light: np.ndarray) -> np.ndarray:
        return light * (0.09 if lamp == 1 else 1.0)

    text = refused(made, photograph(tmp_path / "weak", 3, weak))
    assert "lamp1.tif has 9." in text
    assert "did the lamp not light?" in text

    # Paint of a relief in place of the board: light and dark by 20 %, at random.
    paint = np.exp(0.2 * np.random.default_rng(2).normal(size=(6, 6)))

    def painting(lamp: int, light: np.ndarray) -> np.ndarray:
        rows, columns = light.shape[-2:]
        coarse = np.kron(paint, np.ones((rows // 6 + 1, columns // 6 + 1)))[:rows, :columns]
        return light * coarse

    text = refused(made, photograph(tmp_path / "painting", 3, painting))
    assert "is it a photograph of the painting?" in text
    folder = photograph(tmp_path / "less", 3)
    (folder / "lamp3.tif").unlink()
    assert "no photograph of the board for lamp3.tif" in refused(made, folder)
    write_tiff16(folder / "lamp3.tif", np.full((3, 50, 60), 30000, np.uint16))
    assert "lamp3.tif has 60 x 50 pixels" in refused(made, folder)


def test_options_that_do_not_fit(made: Path, tmp_path: Path) -> None:
    assert "reflectance" in refused(made, made / "board", reflectance=[0.9, 0.8])
    assert "reflectance" in refused(made, made / "board", reflectance=0.0)
    assert "no brighter than the dark frame" in refused(made, made / "board", dark=14000.0)
    assert "is not a folder" in refused(made, tmp_path / "none")
    # The code as it was given, whatever the tone curve makes of it.
    for encoding in ("linear", "srgb"):
        text = refused(made, made / "board", dark=1e9, encoding=encoding)
        assert "dark: expected finite codes below full scale (65535)" in text
        assert "(such as 1e+09)" in text
    for saturation in (np.nan, 0.0, -3.0):
        text = refused(made, made / "board", saturation=saturation)
        assert "saturation: expected the code from which" in text
    behind = LIGHTS * np.array([1.0, 1.0, -1.0])
    write_lights(tmp_path / "behind.lp", behind, NAMES)
    with pytest.raises(GeometryError, match="stands behind the board"):
        board_strengths(made / "board", tmp_path / "behind.lp")


def test_two_copies_tell_no_noise(made: Path) -> None:
    """The strengths are found all the same, and a sentence says what is missing."""
    found = measured(made, again=made / "board")
    assert found.noise == ()
    assert "copy of the first" in found.findings[0]
    assert mean_strengths(found).mean() == pytest.approx(1.0, abs=1e-12)

"""A white card beside the painting, and the places of near lamps, through ``impasto align``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto.align import Card, align, layout_from_markers
from impasto.cli import main
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io import LightFile, read_lights, write_lights, write_tiff16
from impasto.session import find_session
from test_align import EXACT, LENS, PAINTING, camera, scene

POSITIONS = np.array([[-300.0, 200.0, 500.0], [50.0, -350.0, 450.0]])
STRENGTHS = np.array([[0.9, 0.5], [0.6, 0.35]])
"""Of two lamps in two bands."""
REFLECTANCE, BLACK, NOISE = 0.8, 0.03, 0.004
MIDDLE, SIDES = (120.0, 0.0), (30.0, 50.0)
CARD = "120,0,30,50"
TILTS = (0.0, 30.0)
Plane = np.ndarray
Light = Callable[[Plane, Plane], Plane]


def irradiance(position: np.ndarray, x: Plane, y: Plane) -> Plane:
    """Of a lamp that gives 1 on a board at the middle that faces it: inverse square and cosine.

    Written as the light of a point: I z / r^3, with I the square of its distance.
    """
    square = (x - position[0]) ** 2 + (y - position[1]) ** 2 + position[2] ** 2
    return float(position @ position) * position[2] / square**1.5


@cache
def seen(number: int, shade: float = 1.0) -> np.ndarray:
    """``(band, y, x)`` light: the painting, its marks, and the card, half of it shaded."""

    def lit(x: Plane, y: Plane) -> Plane:
        across, up = np.abs(x - MIDDLE[0]), np.abs(y - MIDDLE[1])
        card = (across <= SIDES[0] / 2) & (up <= SIDES[1] / 2)
        white = REFLECTANCE * np.where(y > MIDDLE[1], 1.0, shade)
        return irradiance(POSITIONS[number], x, y) * np.where(card, white, scene()(x, y))

    one = camera(TILTS[number]).photograph(lit, 2)
    return STRENGTHS[number][:, None, None] * one


def codes(light: np.ndarray, seed: int) -> np.ndarray:
    noisy = light + BLACK + np.random.default_rng(seed).normal(0, NOISE, light.shape)
    return np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "photos").mkdir()
    (tmp_path / "dark").mkdir()
    for number in range(2):
        write_tiff16(tmp_path / "photos" / f"p{number}.tif", codes(seen(number), number))
        write_tiff16(tmp_path / "dark" / f"d{number}.tif", codes(0.0 * seen(0), 5 + number))
    far = np.linalg.norm(POSITIONS, axis=1)
    lamps = LightFile(
        Path("lamps.dome"), "dome", None, POSITIONS / far[:, None], far, POSITIONS,
        width_mm=PAINTING[0],
    )  # fmt: skip
    write_lights(tmp_path / "lamps.dome", lamps)
    LENS.save(tmp_path / "lens.json")
    return tmp_path


def words(home: Path, *more: str) -> list[str]:
    photos, out, lamps = (str(home / name) for name in ("photos", "aligned", "lamps.dome"))
    return ["align", photos, "--out", out, "--markers", EXACT, "--size", "200x150",
            "--lights", lamps, "--quiet", *more]  # fmt: skip


def test_the_card_says_how_strong_the_lamp_was(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In each photograph and band, from two views, with the dark frames taken off.

    Noise of 0.004 in 700 pixels of the card is 1.5e-4, that of the dark frames as much again: 0.1 %
    of the least light, 0.2; five of these. Errors of a tenth of a pixel move the card by 0.1 mm,
    over which the light changes by 0.05 %.
    """
    more = ("--card", CARD, "--card-reflectance", "0.8", "--dark", str(home / "dark"),
            "--lens", str(home / "lens.json"))  # fmt: skip
    assert main(words(home, *more)) == 0
    found = np.loadtxt(home / "aligned" / "light_intensities.txt")
    np.testing.assert_allclose(found, STRENGTHS, rtol=0.006)
    none = [*words(home)[:3], str(home / "b"), *words(home, "--card", "120;0")[4:]]
    assert main(none) == 1
    assert "--card: expected x,y,width,height in mm such as" in capsys.readouterr().err
    # The session of the photographs as the camera wrote them reads the same strengths.
    (home / "lamps.dome").rename(home / "photos.dome")
    session = find_session(home).session
    assert session.intensities == "aligned/light_intensities.txt"
    assert "aligned/light_intensities.txt" in session.sha256


def test_positions_of_near_lamps_are_written(home: Path) -> None:
    """With the cameras of a lens as a table, without a lens as a dome; to rounding errors."""
    layout = layout_from_markers(EXACT, PAINTING)
    for lens, name in ((LENS, "lights.csv"), (None, "lights.dome")):
        out = home / f"{name}-aligned"
        found = align(home / "photos", out, layout, lens=lens, lights=home / "lamps.dome",
                      pixel_mm=2.0)  # fmt: skip
        assert found.lights == name
        np.testing.assert_allclose(read_lights(out / name).positions, POSITIONS, rtol=1e-14)
        rig = impasto.read_stack(out).rig
        np.testing.assert_allclose(rig.vectors, POSITIONS, rtol=1e-14)
        assert rig.pitch_mm == pytest.approx(2.0, rel=1e-12)
        assert np.isfinite(rig.view_positions).all() == (lens is not None)


def test_a_table_holds_lamps_that_are_near_before_a_camera_that_is_not(tmp_path: Path) -> None:
    far = np.linalg.norm(POSITIONS, axis=1)
    views = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    file = LightFile(
        tmp_path / "a.csv", "csv", ("a", "b"), POSITIONS / far[:, None], far, POSITIONS,
        views=views, pitch_mm=0.5,
    )  # fmt: skip
    write_lights(tmp_path / "a.csv", file)
    again = read_lights(tmp_path / "a.csv", strict=True)
    np.testing.assert_allclose(again.positions, POSITIONS, rtol=1e-15)
    assert again.view_positions is None
    assert (again.pitch_mm, again.names) == (0.5, ("a", "b"))
    assert np.array_equal(again.views, views)
    text = (tmp_path / "a.csv").read_text()
    assert text.splitlines()[0].endswith("camera_mm,pixel_mm,light_mm")
    (tmp_path / "a.csv").write_text(text.replace(repr(far[0].item()), "-1"))
    with pytest.raises(CorruptInputError, match="light_mm: expected distances of the lamps"):
        read_lights(tmp_path / "a.csv")
    with pytest.raises(ArgumentError, match="places of cameras and lamps need the width"):
        write_lights(tmp_path / "b.csv", replace(file, pitch_mm=None))


@pytest.mark.parametrize(
    ("middle", "sides", "said"),
    [
        ((220.0, 0.0), SIDES, "does not show all of the card"),
        ((0.0, 0.0), (120.0, 90.0), r"its light varies by \d\d %"),
        ((120.0, 0.0), (-1.0, 50.0), "card: expected a positive width"),
    ],
)
def test_a_card_that_is_none(
    home: Path, middle: tuple[float, float], sides: tuple[float, float], said: str
) -> None:
    """Outside of the photograph; the chessboard of the painting; a size that is none."""
    layout = layout_from_markers(EXACT, PAINTING)
    with pytest.raises(ArgumentError, match=said):
        align(home / "photos", home / "out", layout, lights=home / "lamps.dome", pixel_mm=2.0,
              card=Card(middle, sides))  # fmt: skip
    assert not (home / "out").exists()


def test_light_on_a_card_that_is_of_no_use(home: Path) -> None:
    """Half in the shade, clipped, no light at all; and no lamp whose place is known."""
    layout, card = layout_from_markers(EXACT, PAINTING), Card(MIDDLE, SIDES, REFLECTANCE)
    options = {"lights": home / "lamps.dome", "pixel_mm": 2.0, "card": card}

    def refused(said: str, **changes: object) -> None:
        with pytest.raises(ArgumentError, match=said):
            align(home / "photos", home / "out", layout, **{**options, **changes})

    refused("card: needs a light file", lights=None)
    refused(r"card: is dark in p0\.tif; see whether the lamp was on", dark=60000.0)
    refused(r"card: is clipped in p0\.tif; expose less", saturation=20000)
    write_tiff16(home / "photos" / "p0.tif", codes(seen(0, 0.6), 0))
    refused(r"card: its light varies by 2\d % in p0\.tif")

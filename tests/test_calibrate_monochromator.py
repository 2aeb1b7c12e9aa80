"""Bands from a monochromator: simulated series against their truth, and what is refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

import impasto
from impasto.calibrate import camera_from_monochromator
from impasto.cli import main
from impasto.errors import ArgumentError
from impasto.io import read_camera

NM = np.arange(400.0, 701.0, 10.0)
WIDTH = 12.0
"""Full width at half maximum of the bandpass, nm."""
CENTRES, SPREADS = np.array([610.0, 540.0, 455.0]), np.array([30.0, 34.0, 26.0])
LEAK = 0.02
"""A second maximum of the blue band, relative to its first."""
ELECTRONS, READ, BLACK, FULL = 20000.0, 8.0, 256, 4095
ROWS, COLUMNS = 28, 36


def truth(nm: np.ndarray) -> np.ndarray:
    curves = np.exp(-0.5 * np.square((nm - CENTRES[:, None]) / SPREADS[:, None]))
    curves[2] += LEAK * np.exp(-0.5 * np.square((nm - 650.0) / 20.0))
    return np.asarray(curves)


def power(nm: np.ndarray) -> np.ndarray:
    """A lamp that is six times brighter at the red end."""
    return np.asarray(2.0 + 10.0 * ((nm - 400.0) / 300.0) ** 1.5)


def seen(nm: float) -> np.ndarray:
    """What the bands see through a triangle, by the sum over 0.05 nm."""
    off = np.arange(-WIDTH, WIDTH + 0.025, 0.05)
    weight = 1.0 - np.abs(off) / WIDTH
    return np.asarray(truth(nm + off) @ (weight / weight.sum()))


def shape() -> np.ndarray:
    """The light on a patch, which is not even; 0 around it."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    light = 1.0 - 0.002 * np.square(x - 15) - 0.001 * np.square(y - 12)
    light[(y < 5) | (y >= 23) | (x < 6) | (x >= 30)] = 0.0
    return np.asarray(light)


def photograph(light: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """12 bits with photons and read noise over a black level; light (band, y, x), full scale 1."""
    electrons = random.poisson(ELECTRONS * light) + random.normal(0.0, READ, light.shape)
    codes = BLACK + electrons / ELECTRONS * (FULL - BLACK)
    return np.clip(np.rint(codes), 0, FULL).astype(np.uint16) * 16


def write(folder: Path, seed: int, scale: float = 0.075) -> Path:
    """A series and its dark frames; returns the table."""
    random = np.random.default_rng(seed)
    (folder / "series").mkdir(parents=True)
    (folder / "dark").mkdir()
    lines = ["photograph,wavelength,bandwidth,power"]
    for nm in NM.tolist():
        light = scale * power(np.array(nm)) * seen(nm)[:, None, None] * shape()
        codes = photograph(light, random)
        tifffile.imwrite(folder / "series" / f"{nm:.0f}.tif", codes, photometric="rgb",
                         planarconfig="separate")  # fmt: skip
        lines.append(f"{nm:.0f}.tif,{nm:g},{WIDTH:g},{power(np.array(nm)):.8g}")
    dark = photograph(np.zeros((8 * 3, ROWS, COLUMNS)), random).reshape(8, 3, ROWS, COLUMNS)
    for number, one in enumerate(dark):
        tifffile.imwrite(folder / "dark" / f"{number}.tif", one, photometric="rgb",
                         planarconfig="separate")  # fmt: skip
    table = folder / "series.csv"
    table.write_text("\n".join(lines) + "\n")
    return table


OPTIONS = {"saturation": FULL * 16}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("monochromator")
    write(folder, 1)
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> impasto.calibrate.MonochromatorCamera:
    return camera_from_monochromator(
        folder / "series", folder / "series.csv", dark=folder / "dark", **OPTIONS
    )


def relative(found: impasto.calibrate.MonochromatorCamera) -> tuple[np.ndarray, np.ndarray]:
    """Errors and standard deviations, relative to each band's largest value.

    The unit of power is free, and the light of the patch: one factor for all bands.
    """
    expected = truth(NM)
    factor = (found.sensitivities * expected).sum() / np.square(expected).sum()
    return found.sensitivities / factor - expected, found.sigma / factor


def test_sensitivities_are_those_of_the_camera_within_their_errors(
    found: impasto.calibrate.MonochromatorCamera,
) -> None:
    """93 numbers: beyond four standard deviations one in 16000 lies.

    What the correction leaves of the bandpass: with a triangle of width b and steps d, b^4 / 360
    - b^4 / 144 - b^2 d^2 / 144 times the fourth derivative, which is at most 3 / s^4 of a Gaussian
    of width s; 4e-4 for the narrowest, and for the second maximum as much of 2 %. At the ends, to
    which second differences are continued on a line, it is b^2 d^2 / 12 times that derivative,
    where the curves are below a tenth: 0.1 * 12 * 100 * 7e-6, 8e-4.
    """
    error, sigma = relative(found)
    assert (np.abs(error[:, 1:-1]) < 4.0 * sigma[:, 1:-1] + 4e-4).all()
    assert (np.abs(error) < 4.0 * sigma + 8e-4).all()
    assert found.reading.lit.sum() > 200


def test_the_bandwidth_is_corrected_for(folder: Path, found: object) -> None:
    """b^2 / 12 times the second derivative at the largest value, 1 / s^2."""
    plain = camera_from_monochromator(
        folder / "series", folder / "series.csv", dark=folder / "dark", correct=False, **OPTIONS
    )
    error, sigma = relative(plain)
    narrow = int(np.abs(NM - CENTRES[2]).argmin())
    fall = WIDTH**2 / 12.0 / SPREADS[2] ** 2
    assert fall > 0.015
    # The common factor takes a part of what all bands lose: half of it is left at least.
    assert error[2, narrow] < -0.5 * fall + 4.0 * sigma[2, narrow]
    assert (plain.correction == 0.0).all()


def test_stated_errors_hold_over_series(tmp_path: Path) -> None:
    """Chi square of 4 x 93 numbers: 1 within 0.07, one standard deviation.

    Neighbours share their noise through the correction, which widens that to 0.1; what the bandpass
    leaves and what successive differences see of the uneven light are smaller.
    """
    squares = []
    for seed in range(4):
        own = tmp_path / str(seed)
        table = write(own, 100 + seed)
        error, sigma = relative(
            camera_from_monochromator(own / "series", table, dark=own / "dark", **OPTIONS)
        )
        squares.append(np.square(error / sigma)[:, 1:-1].mean())
    assert 0.6 < np.mean(squares) < 1.4


def test_leakage_is_reported(found: impasto.calibrate.MonochromatorCamera) -> None:
    """The second maximum against its integral: blue has 1 % at 455 +- 3.03 * 26 nm."""
    fine = np.arange(400.0, 700.05, 0.1)
    blue = truth(fine)[2]
    outside = blue[fine > 535.0].sum() / blue.sum()
    share, sigma = found.leakage[2]
    assert tuple(found.passed[2]) in {(400.0, 530.0), (400.0, 540.0)}
    # Where it ends is decided in steps of 10 nm, which hold 1 % of 65 nm at 535 nm: 0.1 %.
    assert abs(share - outside) < 4.0 * sigma + 1.5e-3
    assert sigma < 1e-3
    assert [said.split(":")[0] for said in found.findings if "lies outside of" in said] == ["blue"]


def test_the_command_writes_a_camera(
    folder: Path, found: impasto.calibrate.MonochromatorCamera, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "camera.csv"
    words = [
        "calibrate", "monochromator", str(folder / "series"), "--series",
        str(folder / "series.csv"), "--dark", str(folder / "dark"), "--saturation", "65520",
        "--out", str(out), "--illuminant", "D50",
    ]  # fmt: skip
    assert main(words) == 0
    assert "lies outside of" in " ".join(capsys.readouterr().err.split())
    camera = read_camera(out)
    assert camera.bands == ("red", "green", "blue")
    written = np.maximum(found.sensitivities, 0.0)
    assert np.abs(camera.sensitivities - written).max() < 1e-9 * written.max()
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    head = out.read_text().splitlines()[0]
    assert head == "wavelength,red,green,blue,sigma red,sigma green,sigma blue,illuminant"
    assert np.abs(table[:, 4:7].T - found.sigma).max() < 1e-9 * written.max()
    assert cv2.imread(str(tmp_path / "camera.png")).std() > 10.0
    assert main([*words[:-2], "--illuminant", "3000K"]) == 1
    # Without a light the reader asks for one.
    plain = tmp_path / "plain.csv"
    found.save(plain)
    with pytest.raises(ArgumentError, match="illuminant: "):
        read_camera(plain)
    assert read_camera(plain, illuminant="A").illuminant == "A"


def test_a_shorter_exposure_replaces_a_clipped_one(folder: Path, tmp_path: Path) -> None:
    """Red at 610 nm is overexposed four times; another photograph has an eighth of that."""
    own = tmp_path / "own"
    table = write(own, 1)
    random = np.random.default_rng(5)
    light = 0.075 * power(np.array(610.0)) * seen(610.0)[:, None, None] * shape()
    for name, factor in (("610.tif", 4.0), ("short.tif", 0.5)):
        tifffile.imwrite(own / "series" / name, photograph(factor * light, random),
                         photometric="rgb", planarconfig="separate")  # fmt: skip
    lines = table.read_text().splitlines()
    timed = [lines[0] + ",seconds"]
    timed += [line + (",4" if line.startswith("610") else ",1") for line in lines[1:]]
    table.write_text("\n".join(timed) + "\n")
    with pytest.raises(ArgumentError, match=r"short\.tif"):
        camera_from_monochromator(own / "series", table, dark=own / "dark", **OPTIONS)
    short = own / "series" / "short.tif"
    kept = short.read_bytes()
    short.unlink()
    with pytest.raises(ArgumentError, match=r"clipped: 610\.tif \(610 nm, band 0\)"):
        camera_from_monochromator(own / "series", table, dark=own / "dark", **OPTIONS)
    short.write_bytes(kept)
    line = next(one for one in timed if one.startswith("610")).split(",")
    table.write_text("\n".join([*timed, ",".join(["short.tif", *line[1:4], "0.5"])]) + "\n")
    again = camera_from_monochromator(own / "series", table, dark=own / "dark", **OPTIONS)
    error, sigma = relative(again)
    assert (np.abs(error[:, 1:-1]) < 4.0 * sigma[:, 1:-1] + 4e-4).all()
    assert again.findings[0].endswith("were taken: 610.tif (red)")


HEAD = "photograph,wavelength,bandwidth,power\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("photograph,wavelength,power\na.tif,400,1\n", "line 1: expected the columns photograph,"),
        (HEAD, "names no photograph"),
        (HEAD + "400.tif,400,ten,1\n", "line 2: expected a name and numbers"),
        (HEAD + "400.tif,400,10,0\n", "line 2: expected a wavelength, a bandwidth and a power"),
        (HEAD + "400.tif,400,10,nan\n", "line 2: expected a wavelength"),
        (HEAD + "401.tif,400,10,1\n", "not in "),
        (HEAD + "400.tif,400,10,1\n400.tif,410,10,1\n", "more than one line for 400.tif"),
        (HEAD + "400.tif,400,10,1\n", "has no line for 410.tif, 420.tif, 430.tif and 27 more"),
    ],
)
def test_tables_that_do_not_fit_are_refused(
    text: str, said: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "series.csv"
    table.write_text(text)
    words = ["calibrate", "monochromator", str(folder / "series"), "--series", str(table)]
    assert main([*words, "--out", str(tmp_path / "camera.csv"), "--quiet"]) in {1, 3}
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "camera.csv").exists()


def test_the_area_can_be_given(folder: Path) -> None:
    where = folder / "series", folder / "series.csv"
    found = camera_from_monochromator(
        *where, dark=folder / "dark", region=(8, 10, 10, 12), **OPTIONS
    )
    assert found.reading.lit.sum() == 120
    with pytest.raises(ArgumentError, match="region: expected TOP LEFT HEIGHT WIDTH of 16 pixels"):
        camera_from_monochromator(*where, region=(20, 30, 10, 12))

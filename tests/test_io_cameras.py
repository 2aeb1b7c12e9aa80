"""Cameras in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impasto import ArgumentError, Camera, CorruptInputError, simulate
from impasto.colour import xyz_from_spectrum
from impasto.io import read_camera, write_camera


@pytest.mark.parametrize("name", ["rgb", "six-band"])
def test_a_camera_comes_back(name: str, tmp_path: Path) -> None:
    camera = simulate.camera(name)
    write_camera(tmp_path / "camera.csv", camera)
    again = read_camera(tmp_path / "camera.csv")
    assert again.bands == camera.bands
    grid = np.arange(400.0, 701.0, 10.0)
    # Ten digits are written; the light comes back as a table on the camera's own grid, between
    # whose points (5 nm) a blackbody of 3000 K bends by less than 1e-4 of its value.
    np.testing.assert_allclose(again.operator(grid), camera.operator(grid), rtol=0, atol=2e-5)


def test_the_light_may_be_told_instead(tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text("Wavelength (nm),red,green\n400,0,1\n\n700,1,0\n")
    camera = read_camera(path, illuminant="A")
    assert camera.bands == ("red", "green")
    assert camera.illuminant == "A"
    with pytest.raises(ArgumentError, match="illuminant"):
        read_camera(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "first line"),
        ("red,green\n1,2\n", "first line"),
        ("wavelength,red\n400,1\n", "two wavelengths"),
        ("wavelength,red\n400,1\n500,x\n", "line 3"),
        ("wavelength,red\n400,1\n500,1,1\n", "line 3"),
        ("wavelength,red\n500,1\n400,1\n", "wavelengths"),
        ("wavelength,red\n400,nan\n500,1\n", "finite"),
    ],
)
def test_a_damaged_file_is_named(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text(text)
    with pytest.raises(CorruptInputError, match=told) as caught:
        read_camera(path, illuminant="A")
    assert "camera.csv" in str(caught.value)


def test_a_picture_is_no_camera(tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(CorruptInputError, match="text"):
        read_camera(path)


def test_the_srgb_camera_reads_srgb() -> None:
    """What IEC 61966-2-1 says of a colour's XYZ under D65 is what the camera's bands read."""
    grid = np.arange(400.0, 701.0, 5.0)
    spectra = np.stack([np.full(grid.size, 0.5), np.linspace(0.1, 0.9, grid.size)])
    matrix = np.array(
        [
            [3.2406, -1.5372, -0.4986],
            [-0.9689, 1.8758, 0.0415],
            [0.0557, -0.2040, 1.0570],
        ]
    )
    expected = spectra @ xyz_from_spectrum(grid, "D65").T @ matrix.T
    # The standard's matrix has four digits and a white that differs from D65's in the fourth;
    # the camera's bands are normalised by their white.
    np.testing.assert_allclose(Camera.srgb().response(spectra, grid), expected, rtol=0, atol=1e-3)

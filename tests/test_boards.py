"""Near lamps on a relief, corrected by a white board: the numbers of docs/calibrate.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto.calibrate import board_strengths
from impasto.io import LightFile, Session, write_lights, write_session
from oracles import near_lamps

SIZE = 64


@pytest.fixture(scope="module")
def made() -> near_lamps.Scene:
    """Lamps at 1.5 widths, a relief with slopes of 1.7 degrees."""
    return near_lamps.scene(SIZE, 1.5, 1.7)


@pytest.fixture(scope="module")
def folder(made: near_lamps.Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("near")
    names = near_lamps.photographs(home, made)
    lengths = np.linalg.norm(made.lamps, axis=1)
    directions = made.lamps / lengths[:, None]
    write_lights(home / "lamps.lp", directions, names)
    dome = LightFile(
        home / "lamps.dome", "dome", None, directions, lengths,
        positions=made.lamps, width_mm=float(SIZE),
    )  # fmt: skip
    write_lights(home / "lamps.dome", dome)
    return home


def errors(
    folder: Path, made: near_lamps.Scene, lights: str, **options: object
) -> tuple[float, float]:
    """Degrees and share of the albedo."""
    stack = impasto.read_stack(
        folder / "painting", lights=folder / lights, dark=folder / "dark.tif", **options
    )
    found = impasto.fit_normals(stack)
    return near_lamps.errors(made, found.normal, found.albedo.reshape(SIZE, SIZE))


def test_without_a_board_normals_are_off_by_tens_of_degrees(
    folder: Path, made: near_lamps.Scene
) -> None:
    """Light falls to a third from side to side of the picture: the normals follow it."""
    assert errors(folder, made, "lamps.lp")[0] > 20.0


def test_a_board_and_positions_leave_rounding(folder: Path, made: near_lamps.Scene) -> None:
    """Asked are 0.1 degrees and 0.3 %.

    Half a code of 65535 over 0.05 of full scale is 0.015 % in one photograph: 0.01 degrees.
    """
    angle, albedo = errors(folder, made, "lamps.dome", white=folder / "white")
    assert angle < 0.01
    assert albedo < 2e-4


def test_a_board_and_one_direction_for_each_lamp(folder: Path, made: near_lamps.Scene) -> None:
    """0.1 degrees all the same; the albedo needs positions.

    Directions differ by atan(0.5 / 1.5) at the border. To first order of slope s, light over the
    board's is 1 + s . (l_xy / l_z): an error of l_xy / l_z of at most 0.5 averages out over the
    lamps in the albedo but for s times the mean error: 1.7 degrees times 0.3 is 0.9 %.
    """
    angle, albedo = errors(folder, made, "lamps.lp", white=folder / "white")
    assert angle < 0.1
    assert 0.003 < albedo < 0.009


def test_strengths_of_the_board_command_leave_the_vignetting(
    folder: Path, made: near_lamps.Scene
) -> None:
    """Fall-off follows from positions; the lens, darker by 0.4 r^2, stays in the albedo.

    All lamps share it, so normals do not see it; its mean over a square of side 1 is 0.4 / 6.
    """
    path = folder / "strengths.txt"
    board_strengths(folder / "white", folder / "lamps.dome", dark=folder / "dark.tif").save(path)
    angle, albedo = errors(folder, made, "lamps.dome", intensities=path)
    assert angle < 0.01
    assert albedo == pytest.approx(0.4 / 6, abs=0.01)


def test_a_session_says_the_same(folder: Path, made: near_lamps.Scene) -> None:
    path = folder / "session.toml"
    write_session(
        path,
        Session(images="painting", lights="lamps.dome", white="white", dark="dark.tif"),
    )
    stack = impasto.read_stack(path)
    found = impasto.fit_normals(stack)
    angle, albedo = near_lamps.errors(made, found.normal, found.albedo.reshape(SIZE, SIZE))
    assert angle < 0.01
    assert albedo < 2e-4

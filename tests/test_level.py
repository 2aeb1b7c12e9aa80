"""The plane of a panel: found among strokes, reported, and taken out of heights and shadows."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, Level, Scene, Surface, find_level, simulate
from impasto.cli import main

SIZE = (90, 120)
TILT = np.radians(10.0)


def turn(axis: tuple[float, float], angle: float) -> np.ndarray:
    """Rotation about an axis in the picture (Rodrigues), in float64."""
    x, y = np.array(axis) / np.hypot(*axis)
    k = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def relief(seed: int = 0) -> np.ndarray:
    """Normals of strokes without a slope of their own: differences of a periodic height."""
    rng = np.random.default_rng(seed)
    smooth = np.fft.fft2(rng.normal(size=SIZE))
    fy, fx = np.fft.fftfreq(SIZE[0])[:, None], np.fft.fftfreq(SIZE[1])[None]
    keep = np.hypot(fx, fy)
    height = np.real(np.fft.ifft2(smooth * np.exp(-((keep / 0.1) ** 2)) * (keep > 0.03)))
    height *= 0.2 / height.std()
    p = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / 2.0
    q = -(np.roll(height, -1, 0) - np.roll(height, 1, 0)) / 2.0
    normal = np.stack([-p, -q, np.ones_like(p)])
    return normal / np.linalg.norm(normal, axis=0)


def leaning(normal: np.ndarray, axis: tuple[float, float] = (0.0, 1.0)) -> np.ndarray:
    return np.einsum("ij,jyx->iyx", turn(axis, TILT), normal).astype(np.float32)


@pytest.mark.parametrize(
    ("axis", "azimuth", "side"),
    [((0, 1), 0.0, "right"), ((-1, 0), 90.0, "top"), ((1, 1), -45.0, "lower right")],
)
def test_the_plane_is_found_among_strokes(
    axis: tuple[float, float], azimuth: float, side: str
) -> None:
    normal = leaning(relief(), axis)
    level = find_level(normal)
    # 10,800 slopes that scatter by 0.07 over patches of some 40 pixels: 0.07 / sqrt(270) is 0.24
    # degrees if they were independent; those of a closed relief cancel to a third of that or less.
    assert abs(np.degrees(level.angle) - 10.0) < 0.1
    assert abs(np.degrees(level.azimuth) - azimuth) < 0.5
    assert level.leans
    assert str(level).endswith(f" degrees to the {side}")
    np.testing.assert_allclose(np.linalg.norm(level.normal), 1.0, atol=1e-12)


def test_a_frame_and_holes_do_not_tilt_it() -> None:
    """A quarter of the picture shows a moulding at 40 degrees; the mean slope is off by 11."""
    normal = leaning(relief())
    normal[:, :, :30] = np.array([-np.sin(0.7), 0.0, np.cos(0.7)], dtype=np.float32)[:, None, None]
    normal[:, :20, 60:80] = np.nan
    normal[2, 50:60, 90:] = -1.0
    level = find_level(normal)
    assert abs(np.degrees(level.angle) - 10.0) < 0.3
    assert 0.6 < level.share < 0.8
    assert level.is_panel


def test_a_round_object_has_no_plane() -> None:
    y, x = np.mgrid[-1:1:90j, -1:1:90j] * 0.68
    ball = np.stack([x, -y, np.sqrt(1.0 - x * x - y * y)])
    level = find_level(ball)
    assert not level.is_panel
    assert not level.leans
    assert "no panel" in str(level)


def test_slow_bending_is_told_from_strokes() -> None:
    """A warp of 2 % of the width, across strokes as steep as its ends."""
    x = np.mgrid[:90, :120][1]
    # Depth k x^2 / 2 at x = 1/2 of the side is k / 8.
    curvature = 0.16
    strokes = relief()
    p = -strokes[0] / strokes[2] + curvature * (x - 59.5) / 120
    q = -strokes[1] / strokes[2]
    normal = np.stack([-p, -q, np.ones_like(p)])
    normal /= np.linalg.norm(normal, axis=0)
    level = find_level(normal, bend=True)
    # The slopes' scatter over the patches, and the leverage of a slope of x: sqrt(12) * 0.07 /
    # sqrt(270) is 0.015.
    np.testing.assert_allclose(level.bend, (curvature, 0.0, 0.0), atol=0.02)
    assert abs(level.sagitta - 0.02) < 0.0025
    assert find_level(normal).bend == (0.0, 0.0, 0.0)
    # About plane and bending, only the strokes are left: their height is known.
    flat = impasto.integrate_normals(strokes)
    about = impasto.integrate_normals(normal, level=level)
    bent = impasto.integrate_normals(normal)
    assert np.std(bent - flat) > 5.0 * np.std(about - flat)


def test_heights_about_the_plane_are_those_of_the_level_panel() -> None:
    normal = relief()
    flat = impasto.integrate_normals(normal, 0.1)
    about = impasto.integrate_normals(leaning(normal), 0.1, level=True)
    # Turned there and back in single precision, with a plane that is off by 0.1 degrees at most:
    # 0.0017 of 12 mm from side to side, a deviation of 6 um.
    assert np.std(about - flat) < 0.006
    assert np.std(impasto.integrate_normals(leaning(normal), 0.1) - flat) > 0.3
    known = find_level(leaning(normal))
    np.testing.assert_array_equal(
        impasto.integrate_normals(leaning(normal), 0.1, level=known), about
    )


def test_a_leaning_wall_throws_its_shadow_along_the_panel() -> None:
    """A wall 4 pixels high: 4 / tan(20 degrees) is 11 pixels on the panel, however it leans."""
    height = np.zeros((30, 80), np.float32)
    height[:, 50] = 4.0
    slope = np.tan(TILT) * np.arange(80, dtype=np.float32)
    light = (np.cos(np.radians(20.0)), 0.0, np.sin(np.radians(20.0)))
    level = impasto.cast_shadows(height, 1.0, light)
    tilted = impasto.cast_shadows(height + slope, 1.0, light, level=True)
    np.testing.assert_array_equal(tilted, level)
    assert (level[15] == 0).sum() == 10
    # A light at 8 degrees is behind a panel that rises by 10 towards it.
    low = (np.cos(np.radians(8.0)), 0.0, np.sin(np.radians(8.0)))
    assert impasto.cast_shadows(height + slope, 1.0, low)[15, :40].max() == 0.0
    assert impasto.cast_shadows(height + slope, 1.0, low, level=True)[15, :15].min() == 1.0


def scene(shadows: bool) -> Scene:
    elevation = np.radians(8.0)
    light = DistantLight((-np.cos(elevation), 0.0, np.sin(elevation)))
    return Scene([light], shadows=shadows, exposure=3.0)


def test_raking_light_shines_on_the_panel_however_it_leans() -> None:
    normal = relief()
    diffuse = np.full((3, *SIZE), 0.5, np.float32)
    flat = impasto.render(Surface(normal, diffuse), scene(shadows=True))
    tilted = Surface(leaning(normal), diffuse)
    level = impasto.render(tilted, scene(shadows=True))
    # The plane is found to 0.1 degrees: 0.0017 of light times 0.5 times the exposure; where a
    # shadow ends one pixel further, more.
    assert np.quantile(np.abs(level.linear - flat.linear), 0.9) < 0.005
    assert flat.linear.mean() > 0.1
    stood = impasto.render(tilted, scene(shadows=True), level=False)
    assert stood.linear.mean() < 0.2 * flat.linear.mean()
    # Without shadows only where it is asked for.
    plain = impasto.render(tilted, scene(shadows=False))
    assert plain.linear.mean() < 0.5 * flat.linear.mean()
    turned = impasto.render(tilted, scene(shadows=False), level=True)
    assert turned.linear.mean() > 0.9 * flat.linear.mean()
    known = impasto.render(tilted, scene(shadows=True), level=find_level(tilted.normal))
    np.testing.assert_array_equal(known.linear, level.linear)


def test_a_level_panel_and_a_known_height_are_left_alone() -> None:
    diffuse = np.full((3, *SIZE), 0.5, np.float32)
    upright = Surface(relief(), diffuse)
    np.testing.assert_array_equal(
        impasto.render(upright, scene(shadows=True)).linear,
        impasto.render(upright, scene(shadows=True), level=False).linear,
    )
    painting = simulate.painting(1, (40, 40))
    np.testing.assert_array_equal(
        impasto.render(painting, scene(shadows=True)).linear,
        impasto.render(painting, scene(shadows=True), level=False).linear,
    )


def test_what_cannot_be_used_is_refused() -> None:
    with pytest.raises(ArgumentError, match="normal: expected shape"):
        find_level(np.zeros((2, 4, 4)))
    with pytest.raises(ArgumentError, match="at least ten"):
        find_level(np.full((3, 4, 4), np.nan))
    with pytest.raises(ArgumentError, match="level: expected"):
        impasto.integrate_normals(relief(), level="yes")  # type: ignore[arg-type]
    assert Level((0.0, 0.0)).angle == 0.0


def test_the_report_and_the_command_line_say_it(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The icon leans by 10 degrees: raking light from the left left it black."""
    icon, out = data / "icon_rti" / "dirs.lp", tmp_path / "fit"
    words = f"fit {icon} --out {out} --region 150 150 96 96 --effort draft --pooling painting"
    assert main(words.split()) == 0
    found = json.loads((out / "report.json").read_text(encoding="utf-8"))["results"]["level"]
    assert 8.0 < found["angle_degrees"] < 13.0
    assert abs(found["azimuth_degrees"]) < 30.0
    assert "the panel faces 1" in capsys.readouterr().err
    mean = {}
    for name, more in (("level", ""), ("stood", " --no-level")):
        path = tmp_path / f"{name}.png"
        words = f"render {out} --light 180,8 --shadows --exposure 8 --out {path}{more}"
        assert main(words.split()) == 0
        picture = cv2.imread(str(path))
        assert picture is not None
        mean[name] = float(picture.mean())
    assert "the lights shine on its own plane" in capsys.readouterr().err
    assert mean["level"] > 40.0
    assert mean["stood"] < 5.0

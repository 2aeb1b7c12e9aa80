"""Pictures of maps say what the maps hold."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from impasto import ArgumentError, Status, pictures


def lightness(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """CIE 1976 lightness of 8-bit sRGB ``(..., 3)``, from IEC 61966-2-1 and CIE 15."""
    value = rgb / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    return np.asarray(
        np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)
    )


def test_the_ramp_grows_evenly_lighter() -> None:
    steps = np.diff(lightness(pictures.colour_ramp())[::15])
    # Greys have L* = 116 L - 16 exactly, so even steps of L are even steps of L*; a constant chroma
    # bends that by the few per cent in which the two scales disagree on colours. 1.25 leaves room
    # for the rounding of a step of about 5 to 8-bit codes.
    assert steps.min() > 0
    assert steps.max() / steps.min() < 1.25


def test_a_normal_facing_the_viewer_is_the_familiar_blue() -> None:
    normal = np.zeros((3, 2, 2))
    normal[2] = 1.0
    assert pictures.normal_panel(normal).picture[0, 0].tolist() == [128, 128, 255]


def test_y_up_is_green() -> None:
    normal = np.zeros((3, 1, 2))
    normal[1] = [1.0, -1.0]
    picture = pictures.normal_panel(normal).picture
    assert picture[0, 0, 1] == 255
    assert picture[0, 1, 1] == 0


def test_mid_grey_goes_through_the_srgb_curve() -> None:
    # 0.2140 is the linear value of the code 127.5 (IEC 61966-2-1).
    panel = pictures.colour_panel(np.full((3, 1, 1), 0.2140), "grey")
    assert panel.picture[0, 0].tolist() in ([127] * 3, [128] * 3)


def test_six_bands_show_long_wavelengths_red() -> None:
    bands = np.zeros((6, 1, 1))
    bands[5] = 1.0
    assert pictures.colour_panel(bands, "long").picture[0, 0].tolist() == [255, 0, 0]


def test_the_scale_of_a_ramp_is_printed_and_ignores_wild_pixels() -> None:
    plane = np.linspace(0.0, 1.0, 100_000).reshape(100, 1000)
    plane[0, 0] = 1e9
    panel = pictures.ramp_panel(plane, "x", unit="mm")
    # 1st and 99th percentile of an even ramp.
    assert panel.bar == ("0.01", "0.99")
    panel = pictures.ramp_panel(plane, "x", low=0.0, high=2.0, scale=10.0)
    assert panel.bar == ("0", "2")


@pytest.mark.parametrize("plane", [np.full((20, 20), np.nan), np.zeros((20, 20))])
def test_empty_and_constant_planes_have_a_picture(plane: NDArray[np.float64]) -> None:
    assert pictures.ramp_panel(plane, "x").picture.shape == (20, 20, 3)


def test_unknown_pixels_are_a_checkerboard() -> None:
    normal = np.full((3, 32, 32), np.nan)
    picture = pictures.normal_panel(normal).picture
    assert np.unique(picture).tolist() == [58, 74]
    assert (picture[:8, :8] == 58).all()
    assert (picture[:8, 8:16] == 74).all()


def test_the_legend_of_statuses_counts_them() -> None:
    status = np.zeros((10, 10), np.uint8)
    status[0] = Status.DARK
    panel = pictures.status_panel(status)
    assert [name for name, _ in panel.classes] == ["fitted 90.0 %", "dark 10.0 %"]
    assert panel.picture[0, 0].tolist() == list(pictures.STATUS_COLOURS[Status.DARK])


def test_every_status_has_a_colour_of_its_own() -> None:
    assert set(pictures.STATUS_COLOURS) == set(Status)
    assert len(set(pictures.STATUS_COLOURS.values())) == len(Status)


@pytest.mark.parametrize("count", [1, 2, 5, 9])
@pytest.mark.parametrize("shape", [(40, 60), (90, 30)])
def test_a_sheet_holds_every_panel_in_full(count: int, shape: tuple[int, int]) -> None:
    colours = [(200, 10 * i, 250 - 10 * i) for i in range(count)]
    panels = [
        pictures.Panel(f"panel {i}", np.full((*shape, 3), colour, np.uint8))
        for i, colour in enumerate(colours)
    ]
    sheet = pictures.contact_sheet(panels, title="All", width=120)
    height = round(120 * shape[0] / shape[1])
    for colour in colours:
        found = (sheet == np.array(colour, np.uint8)).all(axis=-1)
        assert found.sum() == 120 * height


def test_a_title_too_long_for_its_place_stays_in_it() -> None:
    panel = pictures.Panel("a very long title " * 20, np.zeros((50, 50, 3), np.uint8))
    sheet = pictures.contact_sheet([panel], title="sheet " * 50, width=200)
    assert (sheet[:, -10:] == np.array(pictures.BACKGROUND)).all()


def test_shapes_are_refused_by_name() -> None:
    with pytest.raises(ArgumentError, match="normal"):
        pictures.normal_panel(np.zeros((2, 4, 4)))
    with pytest.raises(ArgumentError, match="plane"):
        pictures.ramp_panel(np.zeros((2, 4, 4)), "x")
    with pytest.raises(ArgumentError, match="panels"):
        pictures.contact_sheet([], title="x")


def test_a_diagram_shows_points_on_their_curve() -> None:
    x = np.linspace(0.0, 1.0, 50)
    line = np.stack([x, 1.0 - x], axis=1)
    panel = pictures.curve_panel(line[::7], line, "falling", size=(100, 200), axis=("0", "1"))
    assert panel.picture.shape == (100, 200, 3)
    bright = panel.picture.max(axis=2) > 120
    # The line begins high on the left and ends low on the right.
    assert bright[:40, :40].any()
    assert bright[60:, 160:].any()
    assert not bright[:40, 160:].any()


def test_a_diagram_of_nothing_is_empty() -> None:
    unknown = np.full((3, 2), np.nan)
    panel = pictures.curve_panel(unknown, unknown, "nothing")
    assert len(np.unique(panel.picture.reshape(-1, 3), axis=0)) == 2


def test_a_sheet_without_title_has_no_heading() -> None:
    panel = pictures.normal_panel(np.ones((3, 8, 8), np.float32))
    assert len(pictures.contact_sheet([panel])) < len(pictures.contact_sheet([panel], title="x"))


@pytest.mark.parametrize("shape", [(300, 1), (1, 400)])
def test_a_strip_of_pixels_makes_a_sheet_of_ordinary_size(shape: tuple[int, int]) -> None:
    panel = pictures.ramp_panel(np.zeros(shape), "strip")
    sheet = pictures.contact_sheet([panel, panel])
    assert sheet.shape[0] * sheet.shape[1] < 3_000_000


# Diagrams --------------------------------------------------------------------------------------


def test_a_line_lies_where_its_axes_say() -> None:
    line = pictures.Series("", [(0.0, 0.5), (10.0, 0.5)], (255, 0, 0))
    dot = pictures.Series("", [(5.0, 0.9)], (0, 255, 0), dots=True)
    panel = pictures.diagram_panel([line, dot], "", x=(0.0, 10.0), y=(0.0, 1.0), size=(200, 300))
    red = np.argwhere((panel.picture == (255, 0, 0)).all(axis=-1))
    green = np.argwhere((panel.picture == (0, 255, 0)).all(axis=-1))
    # The axes run from 10 above the bottom to 14 below the top, from 44 to 12 before the right.
    assert abs(red[:, 0].mean() - (190 + 14) / 2) <= 1
    assert abs(red[:, 1].min() - 44) <= 1
    assert abs(red[:, 1].max() - 288) <= 1
    np.testing.assert_allclose(green.mean(axis=0), [190 - 0.9 * 176, 44 + 0.5 * 244], atol=1)
    with pytest.raises(ArgumentError, match="ranges that rise"):
        pictures.diagram_panel([line], "", x=(1.0, 1.0), y=(0.0, 1.0))


def test_bars_are_as_high_as_their_values() -> None:
    bars = [("red", 0.5, (255, 0, 0)), ("green", 1.0, (0, 255, 0))]
    picture = pictures.bar_panel(bars, "").picture
    heights = [int((picture == colour).all(axis=-1).any(axis=1).sum()) for _, _, colour in bars]
    assert heights[1] == 460 - 80
    # Half of an even number of rows.
    assert heights[0] == heights[1] // 2


def test_needles_point_where_the_normals_lean() -> None:
    normal = np.zeros((3, 10, 10))
    normal[0], normal[1], normal[2] = 0.6, 0.3, np.sqrt(1.0 - 0.45)
    normal[:, :5] = np.nan
    panel = pictures.needle_panel(normal, "", needles=1, gain=0.5)
    # One needle from the middle: right by 0.6 and up by 0.3, half the width long at most.
    amber = np.argwhere((panel.picture == (232, 161, 90)).all(axis=-1)).mean(axis=0)
    np.testing.assert_allclose(amber, 230.0, atol=1)
    light = np.argwhere(panel.picture.min(axis=-1) > 180)
    assert abs(light[:, 1].max() - (230 + 0.5 * 0.6 * 460)) <= 2
    assert abs(light[:, 0].min() - (230 - 0.5 * 0.3 * 460)) <= 2
    unknown = pictures.needle_panel(np.full((3, 10, 10), np.nan), "")
    assert unknown.picture.std(axis=(0, 1)).max() == 0.0
    with pytest.raises(ArgumentError, match="normal: expected"):
        pictures.needle_panel(np.zeros((2, 4, 4)), "")

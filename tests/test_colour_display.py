"""Displays: standard ones, measured ones, and white that does not clip."""

from __future__ import annotations

import json

import colour
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from impasto.colour import Display, adaptation, as_display, read_display, white_point, white_scale
from impasto.colour.curves import MeasuredCurve
from impasto.errors import ArgumentError, CorruptInputError
from oracles import monitor

CODES = np.arange(256) / 255.0


def delta_e(xyz, other, white):
    """CIEDE2000 by colour-science, planes in."""
    xy = colour.XYZ_to_xy(white)
    first, second = (
        colour.XYZ_to_Lab(np.moveaxis(value / white[1], 0, -1), xy) for value in (xyz, other)
    )
    return colour.delta_E(first, second, method="CIE 2000")


@pytest.mark.parametrize(("name", "theirs"), [("srgb", "sRGB"), ("Display P3", "Display P3")])
def test_standard_matrices_are_colour_sciences(name, theirs):
    space = colour.RGB_COLOURSPACES[theirs]
    forward = colour.models.normalised_primary_matrix(space.primaries, space.whitepoint)
    display = Display.named(name)
    # Two 3 x 3 inversions of condition 4 with entries below 4.
    np.testing.assert_allclose(display.xyz_from_linear, forward, atol=1e-14)
    np.testing.assert_allclose(display.linear_from_xyz, np.linalg.inv(forward), atol=1e-12)


def test_srgb_is_the_printed_standard():
    # IEC 61966-2-1 prints four decimals of the matrix to XYZ (its inverse was rounded twice).
    printed = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    np.testing.assert_allclose(Display.named("sRGB").xyz_from_linear, printed, atol=5.1e-5)


@pytest.mark.parametrize("name", ["srgb", "display-p3"])
def test_standard_curves_are_colour_sciences(name):
    linear = np.linspace(0.0, 1.0, 4001)
    planes = np.broadcast_to(linear, (3, linear.size))
    expected = colour.models.eotf_inverse_sRGB(linear)
    np.testing.assert_allclose(Display.named(name).encode(planes), [expected] * 3, atol=1e-15)
    decoded = Display.named(name).decode(planes)
    np.testing.assert_allclose(decoded, [colour.models.eotf_sRGB(linear)] * 3, atol=1e-15)


@pytest.mark.parametrize(
    "display",
    [
        Display.named("srgb"),
        Display.named("display-p3"),
        Display.calibrated(**monitor.session()),
        Display.calibrated(**{**monitor.session(), "ramp": None}, curve=(2.2, 1.8, 2.4)),
        Display.calibrated(
            white=[95.0, 100.0, 109.0], primaries=[[0.64, 0.33], [0.3, 0.6], [0.15, 0.06]]
        ),
    ],
    ids=["srgb", "p3", "ramps", "gammas", "chromaticities"],
)
def test_every_code_survives_the_round_trip(display):
    codes = np.stack([CODES, CODES[::-1], np.roll(CODES, 100)])
    # Half of a 16-bit code.
    np.testing.assert_allclose(display.encode(display.decode(codes)), codes, atol=0.5 / 65535)
    xyz = display.xyz_of(codes)
    np.testing.assert_allclose(display.encode(display.linear_of(xyz)), codes, atol=0.5 / 65535)


@pytest.mark.parametrize("name", ["srgb", "display-p3"])
def test_full_drive_is_white_and_no_drive_is_black(name):
    display = Display.named(name)
    np.testing.assert_allclose(display.linear_of(display.xyz_of(np.ones(3))), 1.0, atol=1e-14)
    np.testing.assert_array_equal(display.xyz_of(np.zeros(3)), 0.0)
    assert display.white.xyz[1] == pytest.approx(1.0, rel=1e-14)


# A ramp of 52 steps (every fifth code) or 17; the tolerance is the colour difference of the
# interpolation between steps, far below what is seen. All 9^3 mixed codes, not only the ramps.
@pytest.mark.parametrize(("steps", "limit"), [(52, 0.05), (17, 0.25)])
def test_a_calibrated_display_shows_what_the_monitor_shows(steps, limit):
    display = Display.calibrated(**monitor.session(steps))
    levels = np.linspace(0.0, 1.0, 9) ** 1.5
    codes = np.stack(np.meshgrid(levels, levels, levels)).reshape(3, -1)
    white = monitor.xyz(np.ones(3))
    shown = display.xyz_of(codes) * white[1]
    assert delta_e(shown, monitor.xyz(codes), white).max() < limit
    # And backwards: ask for a colour, send the codes to the monitor, read it.
    asked = monitor.xyz(codes) / white[1]
    read = monitor.xyz(display.encode(display.linear_of(asked)))
    assert delta_e(read, monitor.xyz(codes), white).max() < limit


def test_calibration_by_chromaticities_and_gammas_equals_that_by_readings():
    session = monitor.session()
    x, y, z = np.asarray(session["primaries"]).T - monitor.xyz(np.zeros(3))[:, None]
    chromaticities = np.stack([x, y], axis=1) / (x + y + z)[:, None]
    by_xy = Display.calibrated(**{**session, "primaries": chromaticities})
    by_xyz = Display.calibrated(**session)
    np.testing.assert_allclose(by_xy.xyz_from_linear, by_xyz.xyz_from_linear, rtol=1e-12)
    np.testing.assert_allclose(by_xyz.calibration.balance, 1.0, rtol=1e-12)


def test_the_black_is_a_floor():
    display = Display.calibrated(**monitor.session())
    white, black = monitor.xyz(np.ones(3)), monitor.xyz(np.zeros(3))
    np.testing.assert_allclose(display.xyz_of(np.zeros(3)), black / white[1], rtol=1e-12)
    np.testing.assert_allclose(display.xyz_of(np.ones(3)), white / white[1], rtol=1e-12)
    np.testing.assert_array_equal(display.encode(display.linear_of(0.5 * black / white[1])), 0.0)
    assert display.calibration.peak_luminance == pytest.approx(white[1])
    np.testing.assert_allclose(display.calibration.black, black / white[1], rtol=1e-14)


def test_a_noisy_ramp_stays_monotone_and_close():
    display = Display.calibrated(**monitor.session(256, noise=0.01, seed=4))
    assert 0.0 < display.calibration.largest_fall < 0.05
    codes = np.broadcast_to(np.linspace(0.0, 1.0, 2001), (3, 2001))
    assert (np.diff(display.decode(codes)) >= 0.0).all()
    assert (np.diff(display.table(4096)) >= 0.0).all()
    # 1 % of noise per reading: three sigma and what pooling leaves of it.
    np.testing.assert_allclose(
        display.decode(codes), Display.calibrated(**monitor.session(256)).decode(codes), atol=0.04
    )


def test_a_crushed_ramp_can_be_inverted():
    # Codes 0 to 3 emit nothing and the last three the same: the lowest code stands for each.
    codes = np.arange(16.0)
    light = np.clip(codes - 3.0, 0.0, 10.0) ** 2.0
    curve = MeasuredCurve(codes, light)
    light_again = curve.decode(curve.encode(np.linspace(0.0, 1.0, 500)))
    np.testing.assert_allclose(light_again, np.linspace(0.0, 1.0, 500), atol=1e-12)
    assert curve.encode(np.array(0.0)) == 0.0
    assert curve.decode(np.array(3.0 / 15.0)) == 0.0
    assert curve.encode(np.array(1.0)) == 13.0 / 15.0


@settings(deadline=None, max_examples=60)
@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=40), st.integers(0, 2**31))
@example([0.0, 0.0, 0.0, 0.0, 0.70821639853359], 0)
def test_a_measured_curve_never_falls_and_ends_at_0_and_1(steps, seed):
    light = np.concatenate([[0.0], np.cumsum(np.array(steps) + 1e-3)])
    codes = np.cumsum(np.random.default_rng(seed).uniform(0.1, 1.0, light.size))
    curve = MeasuredCurve(codes - codes[0], light)
    dense = curve.decode(np.linspace(0.0, 1.0, 3001))
    assert (np.diff(dense) >= 0.0).all()
    assert dense[0] == 0.0
    assert dense[-1] == pytest.approx(1.0, abs=1e-15)
    relative = (light - light[0]) / (light[-1] - light[0])
    # Readings are met exactly, up to taking a root and the power back.
    np.testing.assert_allclose(curve.decode(curve.codes), relative, atol=1e-14)


@pytest.mark.parametrize("n", [2, 256, 4096, 65536])
def test_the_table_samples_the_curve(n):
    display = Display.named("srgb")
    table = display.table(n)
    assert table.shape == (3, n)
    assert table.dtype == np.float32
    linear = np.linspace(0.0, 1.0, n)
    np.testing.assert_array_equal(table[1], colour.models.eotf_inverse_sRGB(linear).astype("f4"))
    assert (table[:, 0] == 0.0).all()
    assert (table[:, -1] == 1.0).all()


def test_a_table_of_4096_is_good_to_a_hundredth_of_a_code():
    # Chord error of the sRGB curve: h^2 / 8 x 2367 (its largest second derivative, at 0.0031) with
    # h = 1 / 4095 is 1.8e-5, that is 0.0045 of an 8-bit code.
    linear = np.linspace(0.0, 1.0, 1_000_003)
    table = Display.named("srgb").table(4096)[0]
    found = np.interp(linear, np.linspace(0.0, 1.0, 4096), table)
    assert np.abs(found - colour.models.eotf_inverse_sRGB(linear)).max() * 255.0 < 0.01


def test_encode_clips_and_lets_nan_through():
    codes = Display.named("srgb").encode([[-0.5, 0.2], [2.0, np.nan], [np.inf, -np.inf]])
    np.testing.assert_allclose(codes[:, 0], [0.0, 1.0, 1.0], atol=1e-15)
    assert np.isnan(codes[1, 1])
    assert codes[2, 1] == 0.0


def test_the_papers_white_is_scaled_to_fit():
    # Linear (1.374, .932, .573) at d = .56: by hand from P(4163.8 K) and the sRGB matrix.
    white = adaptation(2856.0, 6504.0, 0.56).adapted_white
    shown = white_scale(white, "srgb")
    np.testing.assert_allclose(shown.linear / shown.scale, [1.374, 0.932, 0.573], atol=1e-3)
    assert shown.scale == pytest.approx(0.728, abs=5e-4)
    assert shown.channel == "red"
    assert shown.clipped == ()
    assert shown.unreachable == ()
    # d = 0 needs red at 1.845.
    assert 1.0 / white_scale(white_point(2856.0), "srgb").scale == pytest.approx(1.845, abs=1e-3)


@settings(deadline=None)
@given(st.floats(1000.0, 30000.0), st.sampled_from(["srgb", "display-p3"]))
def test_a_fitted_white_never_clips_and_uses_the_whole_display(kelvin, name):
    shown = white_scale(white_point(kelvin), name)
    assert shown.linear.max() <= 1.0
    assert shown.linear.max() == pytest.approx(1.0, rel=1e-15)
    assert shown.clipped == ()
    assert 0.0 < shown.scale <= 1.0
    assert ("blue" in shown.unreachable) == (shown.linear[2] < 0.0)


def test_clipping_on_request_is_reported():
    shown = white_scale(white_point("A"), "srgb", "luminance")
    assert shown.scale == 1.0
    assert shown.clipped == ("red",)
    assert white_scale(white_point("A"), "srgb", 0.5).clipped == ()
    assert white_scale(white_point(1500.0), "srgb").unreachable == ("blue",)


CRT = monitor.session()


def session_file(folder, **changes):
    """The monitor's session as a file."""
    codes, readings = CRT["ramp"]
    content = {name: np.asarray(CRT[name]).tolist() for name in ("white", "primaries", "black")}
    content["ramp"] = {"codes": codes.tolist(), "readings": readings.tolist()}
    path = folder / "crt.json"
    path.write_text(json.dumps(content | changes), encoding="utf-8")
    return path


def test_a_display_read_from_its_file_is_the_one_measured(tmp_path):
    path = session_file(tmp_path)
    display, direct = read_display(path), Display.calibrated(**CRT)
    assert display.name == "crt"
    np.testing.assert_array_equal(display.xyz_from_linear, direct.xyz_from_linear)
    np.testing.assert_array_equal(display.table(300), direct.table(300))
    for name in (path, str(path), display):
        assert as_display(name).name == "crt"
    assert as_display("sRGB").name == "srgb"
    assert read_display(session_file(tmp_path, ramp=None, curve=2.2, name="left")).name == "left"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"whyte": 1}, "crt.json: has unknown keys"),
        ({"ramp": [1, 2]}, "crt.json: ramp: expected"),
        ({"white": [1.0, None, 1.0]}, "crt.json: white"),
        ({"white": ["a", "b", "c"]}, "crt.json: "),
        ({"primaries": [[1.0], [2.0, 3.0]]}, "crt.json: "),
        (
            {"ramp": {"codes": [0, 1, 2], "readings": [0, 5, 1]}},
            "crt.json: ramp: the readings fall",
        ),
    ],
)
def test_a_bad_file_is_named(tmp_path, changes, words):
    with pytest.raises(CorruptInputError, match=words):
        read_display(session_file(tmp_path, **changes))


def test_files_that_are_no_measurements(tmp_path):
    path = tmp_path / "crt.json"
    for text, words in (
        ("{", "cannot be read as JSON"),
        ("[]", "expected an object"),
        ("{}", "lacks"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(CorruptInputError, match=words):
            read_display(path)
    path.write_bytes(bytes([255, 254, 0]))
    with pytest.raises(CorruptInputError, match="cannot be read as JSON"):
        read_display(path)
    with pytest.raises(FileNotFoundError):
        read_display(tmp_path / "none.json")
    with pytest.raises(ArgumentError, match="display: expected"):
        as_display("crt")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"white": [1.0, 0.0, 1.0]}, "white: expected finite XYZ"),
        ({"white": [1.0, np.nan, 1.0]}, "white: expected finite XYZ"),
        ({"black": [1.0, 2.0]}, "black: expected finite XYZ"),
        ({"black": [-1.0, 0.1, 0.1]}, "black: expected finite XYZ"),
        ({"black": [20.0, 20.0, 20.0]}, "more than a tenth"),
        ({"primaries": np.ones((2, 3))}, "primaries: expected finite XYZ"),
        ({"primaries": np.full((3, 3), np.nan)}, "primaries: expected finite XYZ"),
        ({"primaries": np.ones((3, 3))}, "one line"),
        ({"primaries": 3.0 * np.asarray(CRT["primaries"])}, "miss the white"),
        ({"primaries": [[0.3, 0.3], [0.4, 0.4], [0.5, 0.5]]}, "one line"),
        ({"primaries": [[0.6, 0.3], [0.5, 0.4], [0.6, 0.2]]}, "outside their triangle"),
        ({"primaries": [[0.6, 0.0], [0.3, 0.6], [0.15, 0.06]]}, "y > 0"),
        ({"ramp": ([0.0, 128.0, 255.0], [0.0, 1.0])}, "expected 3 finite readings"),
        ({"ramp": ([0.0, 128.0, 255.0], [0.0, np.nan, 1.0])}, "finite readings"),
        ({"ramp": ([0.0, 255.0], [0.0, 1.0])}, "m >= 3"),
        ({"ramp": ([10.0, 128.0, 255.0], [0.0, 1.0, 2.0])}, "increase from 0"),
        ({"ramp": ([0.0, 128.0, 128.0], [0.0, 1.0, 2.0])}, "increase from 0"),
        ({"ramp": ([0.0, 128.0, 255.0], [0.0, 3.0, 2.0])}, "fall by 50.0%"),
        ({"ramp": ([0.0, 128.0, 255.0], [2.0, 1.0, 2.0])}, "must exceed"),
        ({"ramp": ([0.0, 128.0, 255.0], np.zeros((2, 3)))}, r"\(m,\) or \(3, m\)"),
        ({"ramp": None, "curve": "rec709"}, "curve: expected"),
        ({"ramp": None, "curve": 0.0}, "gamma: expected 0.2 to 5"),
        ({"ramp": None, "curve": (2.2, 2.2)}, "one gamma or three"),
    ],
)
def test_bad_measurements_say_what_is_wrong(changes, words):
    with pytest.raises(ArgumentError, match=words):
        Display.calibrated(**{**CRT, **changes})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Display.named("adobe"), "'srgb' or 'display-p3'"),
        (lambda: Display.named("srgb").table(1), "at least 2"),
        (lambda: Display.named("srgb").encode(np.zeros((4, 3))), r"expected shape \(3, ...\)"),
        (lambda: white_scale([0.0, 0.0, 0.0], "srgb"), "white: expected finite XYZ"),
        (lambda: white_scale([1.0, 1.0, 1.0], "srgb", "max"), '"fit", "luminance"'),
        (lambda: white_scale([1.0, 1.0, 1.0], "srgb", 0.0), "positive scale"),
    ],
)
def test_bad_arguments_say_what_is_wrong(call, words):
    with pytest.raises(ArgumentError, match=words):
        call()

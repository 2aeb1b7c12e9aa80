"""Stacks: what is refused, what is kept in place, and what a stored number means."""

from __future__ import annotations

import copy
import pickle
import warnings
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, Encoding, GeometryError, simulate

LIGHTS = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])


def stack(samples: np.ndarray | None = None, **options: object) -> impasto.Stack:
    samples = np.zeros((3, 2, 4, 5), np.float32) if samples is None else samples
    return impasto.Stack(samples, lights=LIGHTS, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32])
def test_samples_are_not_copied(dtype: type) -> None:
    samples = np.zeros((3, 2, 4, 5), dtype)
    assert np.shares_memory(stack(samples).samples, samples)


def test_what_is_printed_fits_a_line() -> None:
    capture = simulate.default_capture("tominaga-rgb-camera", size=(24, 20))
    normals = impasto.fit_normals(capture.stack)
    sbrdf = impasto.fit_sbrdf(capture.stack, normals=normals, pooling="painting")
    spectra = impasto.fit_reflectance(capture.stack, sbrdf, capture.truth.camera)
    image = impasto.render(sbrdf, impasto.Scene(LIGHTS[1:]), reflectance=spectra)
    things = (capture, capture.stack, capture.stack.rig, capture.truth.camera)
    printed = [repr(thing) for thing in (*things, normals, sbrdf, spectra, image)]
    assert [line for line in printed if len(line) > 120 or "\n" in line] == []
    assert printed[1] == "<Stack 9 photographs of 20 x 24 pixels, 3 bands, uint16, linear>"
    assert printed[2].startswith("<Rig 9 lights, pixels of 0.2 mm>")
    assert printed[3] == "<Camera red, green, blue from 380 to 780 nm under 3000 K>"
    assert "robust, 100.0 % estimated" in printed[4]


def test_other_numbers_become_float32() -> None:
    assert stack(np.zeros((3, 2, 4, 5), np.float64)).samples.dtype == np.float32


def test_three_axes_are_one_band() -> None:
    assert stack(np.zeros((3, 4, 5), np.float32)).shape == (3, 1, 4, 5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"samples": np.zeros((4, 5))}, "samples: expected"),
        ({"samples": np.zeros((3, 0, 4, 5))}, "samples: an axis is empty"),
        ({"samples": np.zeros((3, 2, 4, 5), complex)}, "samples: expected real numbers"),
        ({"samples": np.zeros((2, 2, 4, 5))}, "lights: 2 observations need 2 lights, found 3"),
        ({"mask": np.ones((5, 4))}, r"mask: expected shape \(4, 5\)"),
        ({"saturation": [1.0, 2.0, 3.0]}, "saturation: expected one number or one per band"),
        ({"scale": -1.0}, "scale: expected positive"),
        ({"black": np.nan}, "black: found NaN"),
        ({"bands": ["red"]}, "bands: expected 2 names"),
        ({"encoding": "rec709"}, "encoding: expected"),
    ],
)
def test_a_wrong_argument_is_named(options: dict[str, object], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        stack(**options)


def test_integers_know_their_full_scale() -> None:
    codes = np.array([0, 51, 255], np.uint8).reshape(1, 1, 1, 3).repeat(3, axis=0)
    linear = stack(codes).linear(0)
    np.testing.assert_allclose(linear[0, 0, :2], [0.0, 0.2], rtol=1e-6)
    assert np.isposinf(linear[0, 0, 2])


def test_a_code_that_integers_do_not_reach_clips_nothing() -> None:
    codes = np.full((3, 1, 1, 1), 255, np.uint8)
    with pytest.raises(ArgumentError, match="saturation: expected at most 255, the largest code"):
        stack(codes, saturation=300)
    assert not np.isinf(stack(codes, saturation=np.inf).linear(0)).any()
    # Floats, and codes with a scale of their own, may be any.
    assert stack(codes.astype(np.float32), saturation=300).saturation == 300
    assert stack(codes, saturation=300, scale=0.01).saturation == 300


def test_black_and_scale_turn_stored_into_linear() -> None:
    codes = np.full((3, 1, 1, 1), 164, np.uint16)
    linear = stack(codes, black=64.0, scale=0.005, saturation=4095).linear(1)
    # (164 - 64) * 0.005, both exactly representable up to one rounding.
    np.testing.assert_allclose(linear, 0.5, rtol=2e-7)


def test_a_sample_clipped_to_a_number_between_two_floats_is_clipped() -> None:
    """0.9 is 0.89999998 in single precision, of which the fits have always said so."""
    samples = np.full((3, 1, 1, 1), 0.9, np.float32)
    assert np.isposinf(stack(samples, saturation=0.9).linear(0)).all()


def test_take_keeps_names_lights_and_levels_together() -> None:
    whole = stack(names=["a", "b", "c"], saturation=0.9)
    part = whole.take([2, -3])
    assert part.names == ("c", "a")
    np.testing.assert_allclose(part.rig.directions, LIGHTS[[2, 0]])
    assert part.saturation is not None
    np.testing.assert_allclose(part.saturation, 0.9)


def test_take_of_neighbours_shares_memory() -> None:
    whole = stack()
    assert np.shares_memory(whole.take([1, 2]).samples, whole.samples)


@pytest.mark.parametrize(
    "indices",
    [[], [3], [-4], np.array([3]), np.array([0.0]), np.array([[0]]),
     np.ma.array([0, 1], mask=[False, True])],
)  # fmt: skip
def test_take_refuses_what_is_not_there(indices: Any) -> None:
    with pytest.raises(ArgumentError, match="indices"):
        stack().take(indices)


@pytest.mark.parametrize("kind", [list, tuple, np.array, np.uint8])
def test_take_counts_in_any_whole_numbers(kind: Any) -> None:
    whole = stack()
    assert whole.take(kind([2, 0])).names == (whole.names[2], whole.names[0])


@pytest.mark.parametrize("curve", ["linear", "srgb", "2.2", "gamma:1.8"])
@pytest.mark.parametrize("white", [255.0, 65535.0, 1.0])
def test_encode_undoes_decode(curve: str, white: float) -> None:
    encoding = Encoding(curve, white)
    coded = np.linspace(0.0, white, 256, dtype=np.float32)
    # Two single-precision powers: a few 1e-6 relative, or of full scale near zero.
    np.testing.assert_allclose(
        encoding.encode(encoding.decode(coded)), coded, rtol=1e-5, atol=1e-6 * white
    )


@pytest.mark.parametrize("curve", ["linear", "srgb", "2.2", "points:0,0 0.5,0.21 1,1"])
def test_single_precision_costs_no_code(curve: str) -> None:
    """A power and products in single precision: 1e-6 of full scale, .07 of a 16-bit code."""
    encoding = Encoding(curve, 65535.0)
    light = np.r_[np.linspace(-0.1, 3.0, 4001), 1e-9, 0.0, np.inf].astype(np.float32)
    before = light.copy()
    for clip in (True, False):
        codes = encoding.encode(light, clip=clip)
        expected = encoding.encode(light.astype(np.float64), clip=clip)
        assert codes.dtype == np.float32
        np.testing.assert_allclose(codes, expected, rtol=1e-6, atol=1e-6 * 65535.0)
    assert light.tobytes() == before.tobytes(), "the caller's array is as it was"
    assert np.isnan(encoding.encode(np.array([np.nan], np.float32))).all()
    assert encoding.encode(np.float32(0.5)).shape == ()


def test_srgb_has_the_published_knee_and_middle() -> None:
    # IEC 61966-2-1: code 188 of 255 is about half the light.
    assert float(Encoding("srgb", 255.0).decode(188)) == pytest.approx(0.5029, abs=5e-5)
    assert float(Encoding("srgb").decode(0.04045)) == pytest.approx(0.04045 / 12.92, rel=1e-5)


def test_encode_clips_to_the_files_range() -> None:
    np.testing.assert_array_equal(Encoding("srgb", 255.0).encode([-1.0, 2.0]), [0.0, 255.0])


def test_an_encoding_needs_a_positive_white() -> None:
    with pytest.raises(ArgumentError, match="white"):
        Encoding("srgb", 0.0)


def test_directions_are_normalised() -> None:
    rig = impasto.Rig([[0.0, 3.0, 4.0]])
    np.testing.assert_allclose(rig.directions, [[0.0, 0.6, 0.8]])


@pytest.mark.parametrize("row", [[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 0.0]])
def test_a_light_without_direction_is_refused(row: list[float]) -> None:
    with pytest.raises(GeometryError, match="row 1"):
        impasto.Rig([[0.0, 0.0, 1.0], row])


def test_the_numbers_of_a_rig_are_those_of_its_own_lights() -> None:
    """Arrays of lights are made once; a part, a copy and a file of a rig have none of another's."""
    lights = [
        impasto.DistantLight((0, 0, 1), 2.0),
        impasto.PointLight((30, 0, 40), 3.0, falloff=False),
        impasto.PointLight((0, 60, 80), 4.0),
    ]
    rig = impasto.Rig(lights, pitch_mm=0.1)
    untouched = pickle.dumps(rig)
    assert rig.intensities.tolist() == [2.0, 3.0, 4.0]
    assert rig.vectors.tolist() == [[0, 0, 1], [30, 0, 40], [0, 60, 80]]
    assert rig.directions.tolist() == [[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]]
    assert rig.near.tolist() == [False, True, True]
    assert rig.falloff.tolist() == [False, False, True]
    assert rig.take([2, 0]).intensities.tolist() == [4.0, 2.0]
    assert rig.take([2, 0]).near.tolist() == [True, False]
    rig.intensities[0] = 9.0
    assert rig.intensities.tolist() == copy.copy(rig).intensities.tolist() == [2.0, 3.0, 4.0]
    assert pickle.dumps(rig) == untouched


def test_point_lights_need_the_size_of_a_pixel() -> None:
    light = impasto.PointLight((0.0, 100.0, 500.0))
    with pytest.raises(GeometryError, match="pitch_mm"):
        impasto.Rig([light])
    assert impasto.Rig([light], pitch_mm=0.1).pitch_mm == 0.1


@pytest.mark.parametrize("views", [np.zeros((2, 3)), [0.0, 0.0, 0.0], [1.0, 0.0]])
def test_views_must_be_directions(views: object) -> None:
    with pytest.raises(ArgumentError, match="views"):
        impasto.Rig(LIGHTS, views=views)  # type: ignore[arg-type]


@pytest.mark.parametrize("intensity", [0.0, -1.0, np.nan])
def test_a_light_needs_strength(intensity: float) -> None:
    with pytest.raises(ArgumentError, match="intensity"):
        impasto.DistantLight((0.0, 0.0, 1.0), intensity)


def test_statuses_have_the_numerics_numbers() -> None:
    from impasto import _core

    def snake(name: str) -> str:
        return "".join("_" + c if c.isupper() else c for c in name).strip("_").upper()

    assert {snake(name): code for name, code in _core.STATUS} == {
        status.name: int(status) for status in impasto.Status
    }


def test_nan_that_signal_are_nan_like_others() -> None:
    """As a damaged file may hold them; processors raise a flag where one becomes a double."""
    samples = np.ones((3, 2, 4, 5), np.float32)
    samples.view(np.uint32)[0, 0, 0, 0] = 0x7F800001
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = stack(samples)
    assert np.isnan(found.samples[0, 0, 0, 0])

"""Arguments and saved results that cannot be used are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from impasto import (
    ArgumentError,
    CorruptInputError,
    DistantLight,
    GeometryError,
    ImpastoWarning,
    PointLight,
    Rig,
    Scene,
    Surface,
    doctor,
    fit_normals,
    fit_reflectance,
    fit_sbrdf,
    integrate_normals,
    load_sbrdf,
    render,
    simulate,
    systems,
)
from test_bad_input import SIZE, altered, session, stack, told


def test_integers_of_other_types_and_orders() -> None:
    """The other byte order is the same type; other integers do not say which code is white."""
    codes = np.rint(30000 * np.clip(stack().samples, 0, 2)).astype(np.uint16)
    native = altered(codes)
    foreign = altered(codes.astype(">u2"))
    assert foreign.samples.dtype == np.uint16
    np.testing.assert_array_equal(foreign.scale, native.scale)
    np.testing.assert_array_equal(foreign.saturation, native.saturation)
    np.testing.assert_array_equal(foreign.linear(0), native.linear(0))
    assert altered(stack().samples.astype(">f4")).samples.dtype == np.float32
    for dtype in (np.int16, np.int32, np.uint32, np.int64):
        with pytest.raises(ArgumentError, match=r"samples: .*scale="):
            altered((codes // 2).astype(dtype))
        scaled = altered(codes.astype(np.int64), scale=1 / 65535, saturation=65535)
        np.testing.assert_array_equal(scaled.linear(0), native.linear(0))


def test_masked_samples_are_missing() -> None:
    codes = np.rint(30000 * np.clip(stack().samples, 0, 2)).astype(np.uint16)
    masked = np.ma.masked_array(codes, mask=False)
    masked[2, :, 5, 7] = np.ma.masked
    held = altered(masked)
    expected = altered(codes).linear(2)
    expected[:, 5, 7] = np.nan
    np.testing.assert_array_equal(held.linear(2), expected)
    assert fit_normals(held).rejected[1, 5, 7] == 1


@pytest.mark.parametrize(
    "bands", [["a", "a", "b"], ["a", "", "b"], ["a", "b", "x" * 201], ["a", "b", "c\0"]]
)
def test_bands_that_could_not_be_told_apart(bands: list[str]) -> None:
    with pytest.raises(ArgumentError, match="bands"):
        altered(stack().samples, bands=bands)


def test_lights_behind_the_painting() -> None:
    behind = stack().rig.directions * (1.0, 1.0, -1.0)
    bad = altered(stack().samples, behind)
    assert doctor.examine(bad)["horizon"].severity == "error"
    for fit in (fit_normals, fit_sbrdf):
        with pytest.raises(GeometryError, match="lights: all 9 lights lie behind"):
            fit(bad)
    one = stack().rig.directions.copy()
    one[0, 2] *= -1
    assert doctor.examine(altered(stack().samples, one))["horizon"].severity == "warning"


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: Scene([(0, 0, 1)], exposure="x"), "exposure"),
        (lambda: Scene([(0, 0, 1)], exposure=1e-40), "exposure"),
        (lambda: Scene([(0, 0, 1)], exposure=1e40), "exposure"),
        (lambda: Scene([(0, 0, 1)], adaptation="x"), "adaptation"),
        (lambda: Scene([(0, 0, 1)], adaptation_mode="xx"), "adaptation_mode"),
        (lambda: Scene([(0, 0, 1)], background="x"), "background"),
        (lambda: DistantLight((0, 0, 1), "a"), "intensity"),
        (lambda: DistantLight((0, 0, 1), 1e-39), "intensity"),
        (lambda: DistantLight((0, 0, 1), 1e39), "intensity"),
        (lambda: DistantLight((0, 0, 1e200)), "direction"),
        (lambda: PointLight((0, 0, 1e31)), "position"),
        (lambda: Rig([(0, 0, 1)], pitch_mm="a"), "pitch_mm"),
        (lambda: Rig([(0, 0, 1)], pitch_mm=0), "pitch_mm"),
        (lambda: Rig([(0, 0, 1)], views="x"), "views"),
        (lambda: integrate_normals(np.ones((3, 4, 4)), "a"), "pitch_mm"),
        (lambda: integrate_normals(np.ones((3, 4, 4)), 0), "pitch_mm"),
        (lambda: integrate_normals(np.ones((3, 4, 4)), 1e39), "pitch_mm"),
        (lambda: altered(stack().samples, scale="x"), "scale"),
        (lambda: altered(stack().samples, saturation="x"), "saturation"),
        (lambda: altered(stack().samples, black="x"), "black"),
        (lambda: fit_sbrdf(stack(), index="a", pooling="painting"), "index"),
        (lambda: fit_sbrdf(stack(), index=True, pooling="painting"), "index"),
        (lambda: fit_sbrdf(stack(), index=101, pooling="painting"), "index"),
        (lambda: altered(stack().samples, saturation=0), "saturation"),
        (lambda: altered(stack().samples, saturation=[1.0, -1.0, 1.0]), "saturation"),
        (lambda: surface(-5.0, 0.1), "beta"),
        (lambda: surface(5.0, -0.1), "gamma"),
        (lambda: simulate.painting(-1, SIZE), "seed"),
        (lambda: simulate.painting(0.5, SIZE), "seed"),  # type: ignore[arg-type]
    ],
)
def test_arguments_of_the_wrong_type_or_out_of_range(call: Callable[[], Any], word: str) -> None:
    with pytest.raises(ArgumentError, match=f"^{word}: "):
        call()


def surface(beta: float, gamma: float, length: float = 1.0) -> Surface:
    """Flat and grey, with one lobe."""
    normal = np.zeros((3, *SIZE))
    normal[2] = length
    return Surface.torrance_sparrow(normal, np.full((3, *SIZE), 0.4), beta, gamma)


def test_degrees_for_radians_and_normals_of_another_length_are_pointed_out() -> None:
    with pytest.warns(ImpastoWarning, match="^normal: .* found lengths of about 3, by which"):
        assert surface(5.0, 0.1, length=3.0).shape == SIZE
    with pytest.warns(ImpastoWarning, match=r"^gamma: .* radians, 7 degrees are 0\.122"):
        surface(5.0, 7.0)
    # Neither the widest lobe that is fitted nor one without any width, which `overview` draws.
    for gamma in (1.25, 1e4):
        surface(5.0, gamma)


def test_vectors_with_holes_and_of_eight_bits_are_unit_vectors() -> None:
    normal = np.zeros((3, *SIZE))
    normal[2] = 1.0
    normal[:, :4] = np.nan
    normal[:, 4:6] = 0.0
    coded = np.rint((normal + 1.0) * 127.5) / 127.5 - 1.0
    for one in (normal, coded):
        assert Surface(one, np.full((3, *SIZE), 0.4)).shape == SIZE


def test_arguments_that_were_swapped_or_are_something_else() -> None:
    """What a call needs is told by its name, not by the attribute that was missed."""
    photographs = simulate.default_capture("tominaga-rgb-camera", size=SIZE)
    taken, camera = photographs.stack, photographs.truth.camera
    six = simulate.default_capture(size=SIZE).stack
    fit = fit_sbrdf(taken, pooling="painting")
    scene = Scene([(0, 0.7, 0.7)])
    calls: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], str]] = [
        (render, (scene, fit), {}, "scene: expected an impasto.Scene.*found PooledSbrdf"),
        (render, (fit, DistantLight((0, 0, 1))), {}, "scene: .*found DistantLight"),
        (render, (fit.normals, scene), {}, "surface: expected what impasto.fit_sbrdf.*Normals"),
        (render, ("demo", scene), {}, "surface: .*found str"),
        (render, (fit, scene), {"reflectance": camera}, "reflectance: expected what.*Camera"),
        (fit_reflectance, (fit, taken, camera), {}, "stack: expected an impasto.Stack or None"),
        (fit_reflectance, (taken, camera, fit), {}, "camera: .*found PooledSbrdf"),
        (fit_reflectance, (taken, fit, "srgb"), {}, "camera: .*found str"),
        (fit_reflectance, (None, taken, camera), {}, "diffuse: .*found Stack"),
        (fit_reflectance, (six, fit, camera), {}, "stack: expected .*bands and pixels"),
        (integrate_normals, (fit.normals,), {}, r"normal: .*found Normals; give its \.normal"),
        (
            fit_sbrdf,
            (taken,),
            {"pooling": "segment", "segments": "parts.png"},
            r"segments: .*found the path 'parts\.png'; impasto\.io\.read_labels",
        ),
        (fit.with_bands, (["red"],), {}, r"chosen: expected numbers of bands, found \['red'\]"),
    ]
    for call, positional, named, words in calls:
        with pytest.raises(ArgumentError, match=f"^{words}"):
            call(*positional, **named)


def test_places_are_chosen_alike_from_stacks_rigs_and_bands() -> None:
    """By numbers, from the end where negative; not by truth values, which would be 0 and 1."""
    taken = simulate.default_capture("tominaga-rgb-camera", size=SIZE).stack
    fit = fit_sbrdf(taken, pooling="painting")
    assert fit.with_bands([-1, 0]).bands == fit.with_bands(np.array([2, 0])).bands
    np.testing.assert_array_equal(fit.with_bands([-1]).diffuse, fit.diffuse[[2]])
    assert taken.take(range(-2, 0)).names == taken.take([7, 8]).names
    assert taken.rig.take([-1]).lights == taken.rig.lights[-1:]
    choices: list[tuple[Callable[[Any], Any], int, str]] = [
        (fit.with_bands, 3, "chosen: expected {}bands?"),
        (taken.take, 9, "indices: expected {}observations?"),
        (taken.rig.take, 9, "indices: expected {}observations?"),
    ]
    for choose, count, words in choices:
        some, least = words.format("numbers of "), words.format("at least one ")
        refused: dict[str, list[Any]] = {
            f"{some} from 0 to {count - 1} .*found {count}": [[0, count]],
            f"{some} from 0 to {count - 1} .*found -{count + 1}": [[-count - 1]],
            f"{least}, found none": [[], np.array([], int)],
            f"{some}, found": [[0.0, 1.7], ["0"], "01", 1, None, [[0, 1]]],
            f"{some}, found .*np.flatnonzero": [[True, False], np.ones(count, bool)],
        }
        for expected, chosen in refused.items():
            for one in chosen:
                with pytest.raises(ArgumentError, match=f"(?s)^{expected}"):
                    choose(one)


def test_a_simulation_says_which_of_its_arguments_is_something_else() -> None:
    """Swapped arguments, wholes in place of their parts, and what belongs to another painting."""
    captured = simulate.default_capture("tominaga-rgb-camera", size=SIZE)
    taken, truth = captured.stack, captured.truth
    painting, camera, rig = truth.painting, truth.camera, truth.rig
    system = systems.get("tominaga-rgb-camera")
    fit, spectra = system.measure(taken, camera)
    larger = simulate.default_capture("tominaga-rgb-camera", size=(SIZE[0] + 8, SIZE[1])).truth
    size = f"{SIZE[1]} x {SIZE[0]} pixels"
    calls: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], str]] = [
        (system.measure, (camera, taken), {}, "stack: expected an impasto.Stack.*found Camera$"),
        (system.measure, (captured, camera), {}, r"stack: .*found Capture; give its \.stack"),
        (system.measure, (taken, truth), {}, r"camera: .*found Truth; give its \.camera"),
        (system.measure, (taken, simulate.camera("six-band")), {}, "camera: expected the 3 bands"),
        (system.fit_normals, (painting,), {}, "stack: .*found Painting"),
        (systems.get, (["impasto"],), {}, r"name: .*found \['impasto'\]"),
        (systems.get, ("impast",), {}, "name: .*did you mean 'impasto'"),
        (simulate.capture, (camera, painting), {}, "painting: expected an impasto.*Camera$"),
        (simulate.capture, (truth,), {}, r"painting: .*found Truth; give its \.painting"),
        (simulate.capture, (painting, camera), {}, "rig: expected an impasto.Rig or.*Camera$"),
        (simulate.capture, (painting, taken), {}, r"rig: .*found Stack; give its \.rig"),
        (simulate.capture, (painting, None), {}, "rig: .*found NoneType"),
        (simulate.capture, (painting, "rgb"), {}, "rig: .*'snel-lafortune'.*found 'rgb'"),
        (simulate.capture, (painting, rig, rig), {}, "camera: expected an impasto.Camera.*Rig$"),
        (simulate.capture, (painting, rig, "rbg"), {}, "camera: .*found 'rbg'; did you mean 'rgb'"),
        (simulate.capture, (painting,), {"noise": 0.1}, "noise: expected True, False.*float"),
        (simulate.capture, (painting,), {"exposure": "x"}, "exposure: expected a share.*'x'"),
        (simulate.capture, (painting,), {"frames": 1.5}, "frames: .*found 1.5"),
        (simulate.capture, (painting,), {"bits": True}, "bits: .*found True"),
        (simulate.capture, (painting,), {"shadows": "no"}, "shadows: .*found 'no'"),
        (simulate.capture, (painting,), {"falloff": "no"}, "falloff: .*found 'no'"),
        (simulate.score, (fit, truth), {}, "truth: expected the truth of an.*found PooledSbrdf"),
        (simulate.score, (captured, fit), {}, r"truth: .*found Capture; give its \.truth"),
        (simulate.score, (painting, fit), {}, "truth: .*found Painting"),
        (simulate.score, (truth, spectra), {}, "sbrdf: expected what impasto.*Reflectance"),
        (simulate.score, (truth, fit.normals), {}, "sbrdf: .*found Normals"),
        (simulate.score, (truth, fit, camera), {}, "reflectance: expected what impasto.*Camera"),
        (simulate.score, (larger, fit), {}, f"sbrdf: .*as of the painting, found {size[:-7]}"),
        (simulate.score, (truth, larger), {}, f"sbrdf: expected {size}"),
        (simulate.score, (larger, larger, spectra), {}, "reflectance: expected .* pixels"),
    ]
    for call, positional, named, words in calls:
        with pytest.raises(ArgumentError, match=f"^{words}"):
            call(*positional, **named)


def test_the_command_line_names_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = session(tmp_path / "session")
    for dark in ("nan", "inf", "65535"):
        assert told(capsys, "doctor", path, f"--dark={dark}") == 1
        assert "--dark" in told.err
    assert told(capsys, "demo", "--seed=-1", "--out", tmp_path / "demo") == 1
    assert "--seed" in told.err
    assert not (tmp_path / "demo").exists()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The arrays of a saved fit, whose index was a numpy number."""
    path = tmp_path_factory.mktemp("saved") / "sbrdf.npz"
    fit_sbrdf(stack(), index=np.float32(1.5), pooling="painting").save(path)
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("normal", np.zeros((3, *SIZE), complex)),
        ("diffuse", np.zeros((2, *SIZE), np.float32)),
        ("status", np.zeros(SIZE, np.float32)),
        ("covariance", np.zeros((3, 3))),
        ("covariance", np.full((2, 2), -np.inf)),
        ("curve", np.zeros((4, 2))),
        ("path", np.zeros(4)),
        ("beta", np.array(-0.1)),
        ("beta", np.array(np.nan)),
        ("gamma", np.array(0.0)),
        ("gamma", np.array(np.inf)),
        ("index", np.array(0.5)),
        ("verdict", np.array("perhaps")),
        ("bands", np.arange(3)),
        ("normals.normal", np.zeros((3, 4, 4), np.float32)),
        ("normals.rejected", np.zeros((3, *SIZE), np.uint16)),
        ("normals.status", np.full(SIZE, 300, np.uint16)),
        ("normals.used", np.full(SIZE, "x")),
    ],
)
def test_damaged_results(
    tmp_path: Path, whole: dict[str, np.ndarray], name: str, value: np.ndarray
) -> None:
    path = tmp_path / "sbrdf.npz"
    np.savez(path, **(whole | {name: value}))
    with pytest.raises(CorruptInputError, match=rf"sbrdf\.npz.*{name}"):
        load_sbrdf(path)
    np.savez(path, **whole)
    assert load_sbrdf(path).index == 1.5

"""The third paper's system: highlights, views in files, and the system by name."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import impasto
from impasto import simulate, systems
from impasto.cli import main
from impasto.figures import figures
from impasto.io import read_lights, write_lights

NAME: Any = "snel-lafortune"
LIGHTS = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (-0.6, 0.0, 0.8)]


# Highlights ------------------------------------------------------------------------------------


def clipped_stack(samples: Any, levels: Any, **options: Any) -> impasto.Stack:
    values = np.minimum(np.asarray(samples, np.float32), np.asarray(levels, np.float32)[:, None])
    return impasto.Stack(values[..., None], lights=LIGHTS, saturation=levels, **options)


def test_clipped_bands_take_the_colour_of_the_brightest_whole_sample() -> None:
    """By hand: one pixel, colour (0.4, 0.3, 0.2) in the brightest sample that is not clipped."""
    true = np.array([[0.2, 0.1, 0.1], [0.4, 0.3, 0.2], [0.9, 0.8, 0.5], [0.9, 0.8, 1.4]])
    levels = [0.8, 0.6, 1.0]
    stack = clipped_stack(true[:, :, None], levels)
    found = impasto.reconstruct_highlights(stack)
    first, second, third, fourth = (found.linear(i)[:, 0, 0] for i in range(4))
    np.testing.assert_array_equal(first, true[0].astype(np.float32))
    np.testing.assert_array_equal(second, true[1].astype(np.float32))
    # Blue alone is seen: 0.5 / 0.2 times the colour.
    np.testing.assert_allclose(third, [1.0, 0.75, 0.5], rtol=1e-6)
    # Nothing is seen: it remains clipped, and fits leave it out.
    assert np.isposinf(fourth).all()
    assert found.samples.dtype == np.float32
    assert (found.rig.directions == stack.rig.directions).all()


def test_a_pixel_without_a_whole_sample_remains_clipped() -> None:
    true = np.full((4, 3, 1), 0.5)
    stack = clipped_stack(true, [0.4, 0.4, 1.0])
    found = impasto.reconstruct_highlights(stack).linear(0)[:, 0, 0]
    assert np.isposinf(found[:2]).all()
    assert found[2] == np.float32(0.5)


def test_codes_and_black_levels_are_linear_light() -> None:
    rng = np.random.default_rng(3)
    codes = rng.integers(200, 4096, (4, 3, 5, 6)).astype(np.uint16)
    scale = np.array([1.5, 1.0, 3.0]) / 4000.0
    stack = impasto.Stack(codes, lights=LIGHTS, saturation=4000.0, scale=scale, black=100.0)
    found = impasto.reconstruct_highlights(stack)
    light = (codes - 100.0) * scale[:, None, None]
    over = codes >= 4000
    brightness = np.where(over.any(axis=1), -np.inf, light.mean(axis=1))
    for i, y, x in np.ndindex(4, 5, 6):
        best = brightness[:, y, x].argmax()
        expected = light[i, :, y, x].copy()
        clipped = over[i, :, y, x]
        if clipped.all() or not np.isfinite(brightness[best, y, x]):
            expected[clipped] = np.inf
        else:
            colour = light[best, :, y, x]
            gain = expected[~clipped].sum() / colour[~clipped].sum()
            expected[clipped] = colour[clipped] * gain
        # Three roundings of single precision.
        np.testing.assert_allclose(found.linear(i)[:, y, x], expected, rtol=5e-7)
    assert over.any()


def test_one_band_has_no_colour() -> None:
    stack = impasto.Stack(np.ones((4, 1, 2, 2), np.float32), lights=LIGHTS, saturation=0.5)
    with pytest.raises(impasto.ArgumentError, match="found one band only"):
        impasto.reconstruct_highlights(stack)


# A light file with views -----------------------------------------------------------------------


def test_a_table_carries_lights_and_views(tmp_path: Path) -> None:
    rig = simulate.rig(NAME)
    names = [f"photo {i}, raw.tif" for i in range(len(rig))]
    write_lights(tmp_path / "lights.csv", rig, names)
    file = read_lights(tmp_path / "lights.csv", strict=True)
    assert file.names == tuple(names)
    # As for .lp: normalising may move the last bit.
    np.testing.assert_allclose(file.directions, rig.directions, rtol=0, atol=2.3e-16)
    assert file.views is not None
    np.testing.assert_array_equal(file.views, rig.views)
    write_lights(tmp_path / "again.csv", file)
    np.testing.assert_array_equal(read_lights(tmp_path / "again.csv").views, rig.views)
    first = (tmp_path / "lights.csv").read_text("utf-8").splitlines()[0]
    assert first == "photograph,light_x,light_y,light_z,view_x,view_y,view_z"


@pytest.mark.parametrize(
    ("text", "views"),
    [
        ("a.tif,0.6,0,0.8,0,0,2\nb.tif,0,0.6,0.8,0.6,0,0.8\n", [(0, 0, 1), (0.6, 0, 0.8)]),
        ("0,6;0;0,8;0;0;2\n0;0,6;0,8;0,6;0;0,8\n", [(0, 0, 1), (0.6, 0, 0.8)]),
        ("a.tif,0.6,0,0.8\nb.tif,0,0.6,0.8\n", None),
    ],
)
def test_tables_of_other_programs(tmp_path: Path, text: str, views: Any) -> None:
    path = tmp_path / "lights.csv"
    path.write_text(text, "utf-8")
    file = read_lights(path)
    np.testing.assert_allclose(file.directions, [(0.6, 0, 0.8), (0, 0.6, 0.8)], atol=1e-15)
    if views is None:
        assert file.views is None
    else:
        np.testing.assert_allclose(file.views, views, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a,0.6,0,0.8,0,0,1\nb,0,0.6,0.8\n", "some lines have a view"),
        ("a,0.6,0,0.8,0,0,1\nb,0,0.6,0.8,0,0\n", "line 2: expected"),
        ("a,0.6,0,0.8,0,0,1\nb,0,0.6,0.8,0,0,-1\n", "behind the painting"),
        ("a,0.6,0,0.8,0,0,0\n", "has no length"),
    ],
)
def test_views_that_cannot_be_used_are_refused(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "lights.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(impasto.CorruptInputError, match=told):
        read_lights(path)


def test_an_lp_file_does_not_lose_views(tmp_path: Path) -> None:
    rig = simulate.rig(NAME).take([0, 100])
    with pytest.raises(impasto.ArgumentError, match=r"ends in \.csv"):
        write_lights(tmp_path / "lights.lp", rig, ["a.tif", "b.tif"])
    assert not (tmp_path / "lights.lp").exists()


# The system ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def capture() -> simulate.Capture:
    return simulate.default_capture(NAME, seed=2, size=(16, 16))


def test_a_sensitive_band_clips_first(capture: simulate.Capture) -> None:
    stack = capture.stack
    assert stack.saturation is not None
    over = (stack.samples >= stack.saturation[:, None, None]).mean(axis=(0, 2, 3))
    assert over[1] > over[0] >= over[2]
    assert over[1] > 1e-3
    np.testing.assert_allclose(stack.scale[1] / stack.scale, (2 / 3, 1, 1 / 3), rtol=1e-12)
    # Relative to the white board, all bands have the same light.
    whole = simulate.capture(
        capture.truth.painting, NAME, noise=False, bits=None, exposure=0.1, model="lafortune"
    ).stack
    fine = ~(stack.samples[5] >= stack.saturation[:, None, None])
    # Noise of 30,000 electrons at full scale, of which blue has a third: 1 % at 0.3 of white.
    np.testing.assert_allclose(stack.linear(5)[fine], whole.linear(5)[fine], atol=0.06)


def test_reconstructed_highlights_are_near_the_truth(capture: simulate.Capture) -> None:
    stack = capture.stack
    rebuilt = systems.get(NAME).prepared(stack)
    true = simulate.capture(
        capture.truth.painting, NAME, noise=False, bits=None, exposure=0.1, model="lafortune"
    ).stack
    ratios = []
    for i in range(len(stack.rig)):
        over = np.isinf(stack.linear(i)) & np.isfinite(rebuilt.linear(i))
        ratios.append((rebuilt.linear(i) / true.linear(i))[over])
    ratio = np.concatenate(ratios)
    assert len(ratio) > 100
    # The colour of the sample that is just not overexposed contains more paint than a highlight
    # does: "the reconstruction of the highlight is not fully accurate".
    assert abs(np.median(ratio) - 1.0) < 0.03
    assert np.percentile(np.abs(ratio - 1.0), 95) < 0.2


def test_the_system_fits_lobes_about_its_own_normals(capture: simulate.Capture) -> None:
    system = systems.get(NAME)
    sbrdf, reflectance = system.measure(capture.stack)
    assert isinstance(sbrdf, impasto.LafortuneSbrdf)
    assert reflectance is None
    assert sbrdf.verdict == "fitted"
    rebuilt = impasto.reconstruct_highlights(capture.stack)
    expected = impasto.fit_sbrdf(rebuilt, model="lafortune", lobes=3)
    np.testing.assert_array_equal(sbrdf.normal, expected.normal)
    np.testing.assert_array_equal(sbrdf.specular, expected.specular)
    # Recorded: 0.014 degrees on a painting 64 times as large.
    assert simulate.score(capture.truth, sbrdf).normal_mean < 0.1
    pictures = system.render(sbrdf)
    assert list(pictures) == ["figure-12-without-normals", "figure-12-with-normals"]
    with_, without = (pictures[f"figure-12-{word}-normals"] for word in ("with", "without"))
    assert np.abs(with_.linear - without.linear).max() > 0.05
    drawn = figures(system, capture.stack, sbrdf)
    assert sorted(drawn) == ["figure-13", "figure-14", "figure-15", "figure-3"]
    assert all(picture.std() > 5 for picture in drawn.values())


def test_the_system_is_one_option_of_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo, out, again = (tmp_path / name for name in ("demo", "out", "again"))
    words = ["--system", NAME, "--quiet"]
    assert main(["demo", "--out", str(demo), "--size", "16", *words]) == 0
    report = json.loads((demo / "report.json").read_text("utf-8"))
    for truth in ("truth", "truth_censored"):
        assert report["results"][truth]["normal_mean"] < 0.1
    assert report["options"]["highlights"] == "reconstructed"
    shot = demo / "photographs"
    assert (shot / "lights.csv").is_file()
    assert not (shot / "lights.lp").exists()
    read = ["--dark", "1024", "--saturation", "65520", "--no-check"]
    assert main(["fit", str(shot), "--out", str(out), *read, *words]) == 0
    stored = [impasto.load_sbrdf(folder / "sbrdf.npz") for folder in (demo, out)]
    np.testing.assert_array_equal(stored[0].normal, stored[1].normal)
    assert (stored[1].rig.views == simulate.rig(NAME).views).all()
    assert main(["render", str(out), "--out", str(again), "--system", NAME, "--quiet"]) == 0
    for name in systems.get(NAME).pictures:
        pictures = [cv2.imread(str(folder / f"{name}.png")) for folder in (demo, out, again)]
        assert pictures[0].std() > 5
        assert (pictures[0] == pictures[1]).all()
        assert (pictures[0] == pictures[2]).all()
    # One pair in ten is enough for the other options.
    some, every = tmp_path / "some", read_lights(shot / "lights.csv")
    some.mkdir()
    assert every.names is not None
    names = every.names[::10]
    for name in names:
        shutil.copy(shot / name, some)
    write_lights(some / "lights.csv", simulate.rig(NAME).take(range(0, 770, 10)), names)
    repaired = tmp_path / "repaired.csv"
    words_of = ["doctor", str(some), *read[:-1], "--json", "--write"]
    main([*words_of, str(repaired)])
    found, listed = read_lights(repaired), read_lights(some / "lights.csv")
    np.testing.assert_array_equal(found.views, listed.views)
    assert main([*words_of, str(tmp_path / "repaired.lp")]) == 1
    assert "ends in .csv" in capsys.readouterr().err
    specular = []
    for highlights in ("reconstructed", "censored"):
        to = tmp_path / highlights
        option = ["--highlights", highlights, "--out", str(to)]
        assert main(["fit", str(some), *option, *read, *words]) == 0
        specular.append(impasto.load_sbrdf(to / "sbrdf.npz").specular)
    assert not np.array_equal(*specular)
    capsys.readouterr()
    for wrong, told in (
        (["fit", str(shot), "--out", str(out), "--pooling", "painting", *words], "--pooling"),
        (["fit", str(shot), "--out", str(out), "--extraction", "papers", *words], "--extraction"),
        (["render", str(out), "--out", str(again), "--light", "90,45", *words], "has its own"),
        (["render", str(out), "--out", str(again), "--system", "impasto"], "has no figures"),
    ):
        assert main(wrong) == 2
        assert told in capsys.readouterr().err

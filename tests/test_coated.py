"""Diffuse light that crosses a varnish: against plain float64 numpy, and in fits.

The oracle is ``oracles/forward.py``: Snell's law and Fresnel's amplitudes, by angles.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointLight, PointView, Scene, Status
from oracles import forward as oracle

SHAPE = (21, 24)
PITCH = 0.5
GAMMA = 0.12


def lights(count: int = 40) -> np.ndarray:
    """Directions on a spiral, 6 to 72 degrees from the vertical."""
    turn = np.arange(count)
    tilt = np.radians(6.0 + 66.0 * turn / (count - 1))
    around = turn * np.pi * (3.0 - np.sqrt(5.0))
    side = np.sin(tilt)
    return np.stack([side * np.cos(around), side * np.sin(around), np.cos(tilt)], axis=1)


def maps(slope: float) -> tuple[Any, Any]:
    """Normals with slopes of this deviation, and colours of three bands."""
    rng = np.random.default_rng(20)
    slopes = rng.normal(0.0, slope, (2, *SHAPE))
    normal = np.stack([-slopes[0], -slopes[1], np.ones(SHAPE)])
    normal /= np.linalg.norm(normal, axis=0)
    return normal.astype(np.float32), rng.uniform(0.1, 0.7, (3, *SHAPE)).astype(np.float32)


def near_rig() -> impasto.Rig:
    lamps: list[Any] = [
        DistantLight((0.0, 0.0, 1.0)),
        DistantLight((0.7, 0.1, 0.7), intensity=1.7),
        PointLight((30.0, 10.0, 40.0), 0.8),
        DistantLight((0.98, 0.0, 0.2)),
    ]
    return impasto.Rig(lamps, views=[0.3, -0.2, 0.93], pitch_mm=PITCH)


def photographs(*, coated: bool) -> tuple[Any, impasto.Stack]:
    """Normals, and photographs with noise: one varnish lobe over paint, coated or bare."""
    normal, diffuse = maps(0.35)
    rig = impasto.Rig(lights())
    clean = oracle.stack(normal, diffuse, 4.0, GAMMA, rig, coated=coated)
    noise = np.random.default_rng(3).normal(0.0, 0.001, clean.shape)
    return normal, impasto.Stack((clean + noise).astype(np.float32), lights=rig)


@pytest.fixture(scope="module")
def varnished() -> tuple[Any, impasto.Stack]:
    return photographs(coated=True)


def errors(found: Any, normal: Any) -> Any:
    """Degrees."""
    cosine = np.clip((found.normal * normal).sum(axis=0), -1.0, 1.0)
    return np.degrees(np.arccos(cosine))


@pytest.mark.parametrize("index", [1.45, 1.0, 1.8])
def test_samples_agree_with_the_formula(index: float) -> None:
    normal, diffuse = maps(0.6)
    options: dict[str, Any] = {"index": index, "coated": True}
    surface = impasto.Surface.torrance_sparrow(normal, diffuse, 5.0, 0.2, **options)
    exact = oracle.stack(normal, diffuse, 5.0, 0.2, near_rig(), **options)
    # As without the interface (test_torrance_sparrow.py); t has some ten roundings of 6e-8 more.
    np.testing.assert_allclose(surface.predict(near_rig()), exact, rtol=2e-5, atol=5e-6)


def test_without_an_interface_nothing_is_lost() -> None:
    normal, diffuse = maps(0.3)
    bare = impasto.Surface(normal, diffuse)
    rig = impasto.Rig(lights(), views=[0.0, 0.0, 1.0])
    coated = replace(bare, coated=True, index=1.0).predict(rig)
    # An interface of index 1 transmits everything: ten roundings of 6e-8. There the square root is
    # the cosine, as the difference of numbers near 1: at grazing incidence, where samples are below
    # 1e-3, its last digits are lost.
    np.testing.assert_allclose(coated, bare.predict(rig), rtol=1e-6, atol=2e-7)
    # A varnish takes a fifth of the light at 75 degrees and nothing at 0.
    flat = np.zeros((3, 1, 1), np.float32)
    flat[2] = 1.0
    directions = [(0.0, 0.0, 1.0), (np.sin(np.radians(75.0)), 0.0, np.cos(np.radians(75.0)))]
    white = impasto.Surface(flat, np.ones((1, 1, 1)), coated=True).predict(directions)
    assert white[0, 0, 0, 0] == pytest.approx(1.0, abs=1e-6)
    expected = oracle.transmittance(np.radians(75.0))
    assert white[1, 0, 0, 0] / np.cos(np.radians(75.0)) == pytest.approx(expected, rel=1e-6)
    assert expected == pytest.approx(0.78, abs=0.01)


@pytest.mark.parametrize("near", [False, True])
def test_a_picture_shows_what_is_predicted(near: bool) -> None:
    """Slanted light and near eye; matte and with a lobe; what has no normal stays unknown."""
    normal, diffuse = maps(0.4)
    normal[:, 3, 4] = np.nan
    lamp = PointLight((30.0, 10.0, 40.0), 0.8) if near else DistantLight((0.7, 0.1, 0.7))
    eye: Any = PointView((5.0, 0.0, 60.0)) if near else (0.0, 0.0, 1.0)
    rig = impasto.Rig([lamp], views=eye, pitch_mm=PITCH)
    for beta in (0.0, 5.0):
        surface = impasto.Surface.torrance_sparrow(
            normal, diffuse, beta, 0.2, coated=True, pitch_mm=PITCH
        )
        shown = surface.predict(rig)[0]
        scene = Scene([lamp], view=eye, exposure=1.0)
        seen = impasto.render(surface, scene).linear
        bare = impasto.render(replace(surface, coated=False), scene).linear
        known = np.isfinite(shown).all(axis=0)
        assert known.sum() == known.size - 1
        assert not known[3, 4]
        # Bands are linear sRGB: to XYZ and back is a few roundings of 6e-8, times the largest
        # entries of the two matrices, 1 and 3.2, with sums of up to 2.
        np.testing.assert_allclose(seen[:, known], shown[:, known], rtol=0, atol=4e-6)
        assert (bare[:, known] >= seen[:, known] - 4e-6).all()


def test_a_slanted_picture_shows_what_is_predicted() -> None:
    flat = np.zeros((3, *SHAPE), np.float32)
    flat[2] = 1.0
    surface = impasto.Surface(flat, np.full((3, *SHAPE), 0.5, np.float32), coated=True)
    view = np.array([np.sin(1.1), 0.0, np.cos(1.1)])
    seen = impasto.render(surface, Scene([DistantLight((0.7, 0.1, 0.7))], view=view, exposure=1.0))
    shown = surface.predict([(0.7, 0.1, 0.7)], views=view)[0, :, 0, 0]
    middle = seen.linear[:, seen.linear.shape[1] // 2, seen.linear.shape[2] // 2]
    # As above.
    np.testing.assert_allclose(middle, shown, rtol=0, atol=4e-6)
    # 63 degrees from the normal the interface keeps 6 % of the light.
    frontal = surface.predict([(0.7, 0.1, 0.7)])[0, :, 0, 0]
    np.testing.assert_allclose(shown / frontal, oracle.transmittance(1.1), rtol=1e-5)


def test_a_shadow_is_a_shadow_under_varnish_too() -> None:
    normal, diffuse = maps(0.0)
    height = np.zeros(SHAPE, np.float32)
    height[:, 12] = 2.0
    surface = impasto.Surface(normal, diffuse, coated=True, height=height, pitch_mm=PITCH)
    scene = Scene([DistantLight((0.8, 0.0, 0.6))], shadows=True, exposure=1.0)
    dark = impasto.render(surface, scene).linear.max(axis=0) == 0.0
    bare = impasto.render(replace(surface, coated=False), scene).linear.max(axis=0) == 0.0
    assert dark.any()
    np.testing.assert_array_equal(dark, bare)


def test_normals_under_varnish_are_found(varnished: Any) -> None:
    normal, stack = varnished
    bare = impasto.fit_sbrdf(stack, pooling="pixel", lobes=1, ambient=False)
    coated = impasto.fit_sbrdf(stack, pooling="pixel", lobes=1, ambient=False, coated=True)
    assert (coated.status < Status.DARK).all()
    # Noise of 0.001 in 40 photographs of three bands of reflectance 0.4: a slope of the samples by
    # tilt of 0.4 sin 45 gives 0.001 / (0.28 sqrt 120) = 3e-4 rad = 0.02 degrees along either axis.
    # Weights that follow residuals and the width of the lobe cost less than a factor of 3.
    assert np.median(errors(coated, normal)) < 0.06
    # Without it flanks that are darker than Lambert's law look steeper: dln t / dtilt is 0.14 at 60
    # degrees, where dln cos / dtilt is 1.7, of a few percent of the samples each.
    assert np.median(errors(bare, normal)) > 0.5
    # Colours relative to a frontal light and view.
    _, diffuse = maps(0.35)
    np.testing.assert_allclose(np.median(coated.diffuse / diffuse), 1.0, atol=3e-3)
    np.testing.assert_allclose(np.nanmedian(coated.gamma[0]), GAMMA, rtol=0.02)
    again = coated.predict()
    assert np.std(again - stack.samples) < 0.00105


def test_one_lobe_for_a_varnished_painting(varnished: Any, tmp_path: Path) -> None:
    normal, stack = varnished
    bare = impasto.fit_sbrdf(stack, pooling="painting")
    coated = impasto.fit_sbrdf(stack, pooling="painting", coated=True)
    assert coated.coated
    assert not bare.coated
    # As above. Without it, robust weights leave out flanks that Lambert's law does not describe,
    # where others remain.
    assert np.mean(errors(coated, normal)) < 0.06
    assert np.mean(errors(bare, normal)) > 0.25
    np.testing.assert_allclose([coated.beta, coated.gamma], [4.0, GAMMA], rtol=0.02)
    assert np.std(coated.predict() - stack.samples) < 0.00105
    assert "under a varnish" in repr(coated)
    coated.save(tmp_path / "fit.npz")
    again = impasto.load_sbrdf(tmp_path / "fit.npz")
    assert again.predict().tobytes() == coated.predict().tobytes()
    impasto.learn_sbrdf(stack, pooling="painting", coated=True).save(tmp_path / "learned.npz")
    tile = impasto.load_learned(tmp_path / "learned.npz").apply(stack, slice(5, 14), slice(2, 19))
    assert tile.predict().tobytes() == coated[5:14, 2:19].predict().tobytes()


def test_without_a_highlight_normals_are_those_of_photometric_stereo() -> None:
    """Lambert's law: stereo knows no varnish, and its colours are shown as it understands them."""
    normal, diffuse = maps(0.2)
    rig = impasto.Rig(lights())
    stack = impasto.Stack(impasto.Surface(normal, diffuse).predict(rig), lights=rig)
    found = impasto.fit_sbrdf(stack, pooling="painting", coated=True)
    assert found.verdict == "no-highlight"
    assert not found.coated
    stereo = impasto.fit_normals(stack)
    assert found.normal.tobytes() == stereo.normal.tobytes()
    shown = impasto.Surface(stereo.normal, stereo.albedo).predict(rig)
    # Samples in single precision.
    np.testing.assert_allclose(found.predict(), shown, atol=1e-6)


def test_colours_of_photometric_stereo_know_no_varnish(varnished: Any) -> None:
    with pytest.raises(impasto.ArgumentError, match="coated: joint=False"):
        impasto.fit_sbrdf(varnished[1], pooling="painting", joint=False, coated=True)


def test_a_given_answer_is_not_asked_again(varnished: Any) -> None:
    for coated in (False, True):
        found = impasto.fit_sbrdf(varnished[1], refine=False, residuals=False, coated=coated)
        assert found.chosen is not None
        assert {one.coated for one in found.chosen.tried} == {coated}
        assert found.coated is coated


def test_held_out_photographs_tell_varnish_from_bare_paint(varnished: Any) -> None:
    for coated, (_, stack) in ((True, varnished), (False, photographs(coated=False))):
        found = impasto.fit_sbrdf(stack, refine=False, residuals=False)
        assert found.chosen is not None
        assert found.chosen.best.coated is coated
        assert found.chosen.tried[-1].coated
        assert ("under a varnish" in str(found.chosen)) is coated
        if coated:
            assert isinstance(found, impasto.LobeSbrdf | impasto.PooledSbrdf)
            assert found.coated
            assert "under a varnish" in repr(found)
            told = impasto.fit_sbrdf(stack, refine=False, **found.chosen.best.options)
            assert told.normal.tobytes() == found.normal.tobytes()


def test_a_file_keeps_it(varnished: Any, tmp_path: Path) -> None:
    found = impasto.fit_sbrdf(varnished[1], refine=False, residuals=False)
    found.save(tmp_path / "fit.npz")
    again = impasto.load_sbrdf(tmp_path / "fit.npz")
    assert isinstance(again, impasto.LobeSbrdf | impasto.PooledSbrdf)
    assert again.coated
    assert again.chosen == found.chosen
    assert again.report()["coated"] is True
    assert again.predict().tobytes() == found.predict(fidelity="model").tobytes()
    some = again.with_bands([1])[2:9, 3:20]
    np.testing.assert_array_equal(some.predict(), again.predict()[:, 1:2, 2:9, 3:20])


def test_tiles_are_the_whole_bit_for_bit(varnished: Any, tmp_path: Path) -> None:
    stack = varnished[1]
    whole = impasto.fit_sbrdf(stack, pooling="pixel", coated=True)
    learned = impasto.learn_sbrdf(stack, pooling="pixel", coated=True)
    learned.save(tmp_path / "learned.npz")
    tile = impasto.load_learned(tmp_path / "learned.npz").apply(stack, slice(5, 14), slice(2, 19))
    part = whole[5:14, 2:19]
    assert isinstance(tile, impasto.LobeSbrdf)
    assert tile.coated
    for name in ("normal", "diffuse", "specular", "gamma", "sigma"):
        assert getattr(tile, name).tobytes() == getattr(part, name).tobytes(), name
    assert tile.predict().tobytes() == part.predict().tobytes()
    threads = impasto.fit_sbrdf(stack, pooling="pixel", coated=True, threads=3)
    assert threads.normal.tobytes() == whole.normal.tobytes()


@pytest.mark.parametrize("value", ["yes", 1, None])
def test_a_surface_is_coated_or_not(value: Any) -> None:
    with pytest.raises(impasto.ArgumentError, match="coated"):
        impasto.Surface(*maps(0.1), coated=value)

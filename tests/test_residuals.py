"""Kriging of what the model leaves of the photographs."""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointView, Rig, Scene, _core
from impasto.fit.choice import decibels
from impasto.fit.residuals import (
    LearnedResiduals,
    apply_residuals,
    kriging_weights,
    learn_residuals,
    principal_components,
)
from impasto.fit.sbrdf import fit_sbrdf
from test_choice import dome, photographs

NEW = [(0.25, -0.2, 0.9), (-0.3, 0.5, 0.8), (0.1, 0.1, 1.0)]


def uneven(stack: impasto.Stack) -> impasto.Stack:
    """The photographs under lamps whose strength varies over the dome, as no model says."""
    lights = stack.rig.directions
    strength = 1.0 + 0.35 * np.sin(5.0 * lights[:, 0]) * np.cos(4.0 * lights[:, 1])
    linear = np.array([stack.linear(i) for i in range(len(lights))])
    linear = np.where(np.isfinite(linear), linear, 1.0) * strength[:, None, None, None]
    samples = linear.astype(np.float32) * 0.6
    return impasto.Stack(samples, lights=lights, pitch_mm=0.2)


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    return uneven(photographs("patches", 48))


@pytest.fixture(scope="module")
def fitted(stack: impasto.Stack) -> impasto.Sbrdf:
    found = fit_sbrdf(stack, refine=False, relief=False)
    assert found.residuals is not None
    return found


def test_weights_are_those_of_the_conditional_mean() -> None:
    """The conditional mean of a joint normal distribution, by its precision matrix instead."""
    rng = np.random.default_rng(1)
    known = rng.uniform(-0.5, 0.5, (9, 2))
    wanted = rng.dirichlet(np.ones(9), 4) @ known  # inside the hull
    process = LearnedResiduals(np.eye(9), 0.3, 0.1, 1.0, 0.0)
    places = np.concatenate([known, wanted])
    steps = np.sqrt(3.0 * ((places[:, None] - places) ** 2).sum(axis=-1)) / 0.3
    joint = (1.0 + steps) * np.exp(-steps) + 0.1 * np.eye(13)
    precision = np.linalg.inv(joint)
    expected = -np.linalg.solve(precision[9:, 9:], precision[9:, :9])
    # Two inversions of a matrix of condition 100 in double precision.
    np.testing.assert_allclose(kriging_weights(known, wanted, process), expected, atol=1e-12)


def test_principal_components_hold_most_of_the_residuals() -> None:
    rng = np.random.default_rng(2)
    residual = (rng.normal(size=(10, 3)) @ rng.normal(size=(3, 600))).astype(np.float32)
    basis = principal_components(residual)[:3]
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    # Three components are all there is, up to single precision.
    np.testing.assert_allclose(basis.T @ (basis @ residual), residual, atol=1e-4)


def test_without_noise_known_lights_show_the_photographs(stack: impasto.Stack) -> None:
    model = fit_sbrdf(stack, pooling="painting")
    process = LearnedResiduals(np.eye(len(stack.rig)), 0.05, 1e-6, 1.0, 0.0)
    kept = replace(model, residuals=apply_residuals(process, stack, model, threads=2))
    truth = np.array([stack.linear(i) for i in range(len(stack.rig))])
    assert decibels(kept.predict(fidelity="model"), truth).mean() < 40.0
    # Residuals of up to some 100 codes in half precision have steps of 0.06, tables 0.01.
    assert decibels(kept.predict(), truth).min() > 65.0 - 10.0


@pytest.mark.parametrize("kind", [np.float32, np.uint16, np.float16])
def test_scores_are_those_of_plain_numpy(stack: impasto.Stack, kind: Any) -> None:
    """Of photographs with a black level, some of them clipped, under lamps of two strengths."""
    lights = [
        DistantLight((x, y, z), 1.0 + index % 2)
        for index, (x, y, z) in enumerate(stack.rig.directions.tolist())
    ]
    unit = 40000.0 if kind is np.uint16 else 1.0
    stored = (unit * (np.minimum(stack.samples, 1.2) + 0.1)).astype(kind)
    clipped = impasto.Stack(
        stored, lights=lights, scale=1.0 / unit, black=0.1 * unit, saturation=0.6 * unit
    )
    model = fit_sbrdf(clipped, pooling="painting")
    rng = np.random.default_rng(4)
    basis = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(48, 48)))[0][:5])
    kept = apply_residuals(LearnedResiduals(basis, 0.3, 0.1, 0.4, 0.0), clipped, model, threads=1)
    shown = np.nan_to_num(model.predict(fidelity="model"), nan=0.0).astype(np.float64)
    linear = np.array([clipped.linear(index) for index in range(48)])
    assert 0.001 < np.isinf(linear).mean() < 0.5
    seen = np.where(np.isinf(linear), np.maximum(shown, 0.5), linear)
    strength = np.array([light.intensity for light in lights])[:, None, None, None]
    light = np.clip(np.array([seen, shown]) / strength / 0.4, 0.0, 1.0)
    codes = 255.0 * np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    expected = np.tensordot(basis, codes[0] - codes[1], axes=1)
    known = np.isfinite(kept.maps.astype(np.float32))
    assert known.mean() > 0.9
    assert np.abs(expected).max() > 20.0
    # Tables are within 0.012 of a code, of the photograph and of what is shown: 0.024 of each of 48
    # residuals, whose weights have squares of sum 1. Half precision has 11 bits.
    within = 0.024 * np.sqrt(48) + np.abs(expected) * 2.0**-11
    assert (np.abs(kept.maps - expected)[known] <= within[known]).all()


def test_new_lights_look_more_like_photographs(stack: impasto.Stack) -> None:
    promised, came = [], []
    for first in (0, 3):
        held = np.arange(first, 48, 6)
        known = fit_sbrdf(stack.take(np.setdiff1d(np.arange(48), held)), refine=False, relief=False)
        assert known.residuals is not None
        truth = np.array([stack.linear(i) for i in held])
        rig = stack.take(held).rig
        model = decibels(known.predict(rig, fidelity="model"), truth).mean()
        both = decibels(known.predict(rig), truth).mean()
        assert both > model + 1.0
        promised.append(known.residuals.gain)
        came.append(both - model)
    # What was promised is what came, within what 16 photographs scatter: each by 4.7 dB, their mean
    # by 1.2; one and a half of that.
    assert np.mean(came) == pytest.approx(np.mean(promised), abs=1.8)


def test_a_model_that_says_all_keeps_nothing() -> None:
    assert fit_sbrdf(photographs("matte", 24), refine=False, relief=False).residuals is None


def test_another_view_and_the_model_alone_leave_residuals_out(fitted: impasto.Sbrdf) -> None:
    alone = replace(fitted, residuals=None)
    slanted = (0.4, 0.0, 0.9)
    assert fitted.predict(NEW, slanted).tobytes() == alone.predict(NEW, slanted).tobytes()
    assert fitted.predict(NEW, fidelity="model").tobytes() == alone.predict(NEW).tobytes()
    assert fitted.predict(NEW).tobytes() != alone.predict(NEW).tobytes()
    with pytest.raises(impasto.ArgumentError, match="fidelity"):
        fitted.predict(NEW, fidelity="photograph")  # type: ignore[arg-type]


def test_far_from_every_light_the_model_remains(fitted: impasto.Sbrdf) -> None:
    assert fitted.residuals is not None
    grazing = Rig([DistantLight((0.0, 0.999, 0.04))])
    far = np.abs(fitted.residuals.weights(fitted.rig, grazing)).max()
    near = np.abs(fitted.residuals.weights(fitted.rig, fitted.rig)).max()
    # The lowest light of the dome lies 0.37 away in stereographic coordinates: 5 % is left. Between
    # two lights, where the hull is nearest, weights are at most those at both together.
    assert far <= 2.0 * near * np.exp(-0.5 * (0.37 / 0.15) ** 2)


def test_beyond_the_lights_there_is_the_nearest_value_faded_out() -> None:
    square = np.array([(0.0, 0.0), (0.4, 0.0), (0.4, 0.4), (0.0, 0.4), (0.2, 0.1)])
    process = LearnedResiduals(np.eye(5), 0.3, 0.01, 1.0, 0.0)
    edge, beyond, inside = kriging_weights(
        square, np.array([(0.4, 0.1), (0.7, 0.1), (0.39, 0.1)]), process
    )
    # Two widths of 0.15 beyond.
    np.testing.assert_allclose(beyond, edge * np.exp(-2.0), atol=1e-7)
    assert np.abs(inside - edge).max() < 0.1
    line = np.array([(0.1 * i, 0.0) for i in range(5)])
    on, off = kriging_weights(line, np.array([(0.2, 0.0), (0.2, 0.3)]), process)
    np.testing.assert_allclose(off, on * np.exp(-2.0), atol=1e-7)


def test_what_no_model_explains_is_shown_as_photographed(stack: impasto.Stack) -> None:
    """A corner in deep shadow under all but a few lamps has no model, but photographs."""
    samples = np.array([stack.linear(i) for i in range(len(stack.rig))])
    samples[6:, :, :4, :4] = 0.0
    dark = impasto.Stack(samples, lights=stack.rig.directions, pitch_mm=0.2)
    masked = np.ones(samples.shape[2:], np.bool_)
    masked[-4:, -4:] = False
    found = fit_sbrdf(dark._replace(mask=masked), refine=False, relief=False)
    assert (found.status[:4, :4] >= impasto.Status.DARK).all()
    shown = found.predict(NEW)
    known = found.predict(dark.rig.take([1]))[0, :, :4, :4]
    # One of the few photographs that show the corner: its details, dimmed by black neighbours that
    # a process with independent noise mixes in.
    true = dark.linear(1)[:, :4, :4]
    assert np.corrcoef(known.ravel(), true.ravel())[0, 1] > 0.98
    assert 0.6 * true.sum() < known.sum() < 1.05 * true.sum()
    grazing = found.predict([(0.0, 0.999, 0.04)])
    assert np.isnan(grazing[..., :4, :4]).all()
    assert np.isnan(shown[..., -4:, -4:]).all()
    assert np.isnan(found.predict(NEW, fidelity="model")[..., :4, :4]).all()


def test_crops_turns_and_bands_keep_them(fitted: impasto.Sbrdf) -> None:
    shown = fitted.predict(NEW)
    part = fitted[5:20, 8:30].predict(NEW)
    assert part.tobytes() == np.ascontiguousarray(shown[..., 5:20, 8:30]).tobytes()
    turned_lights = [(-y, x, z) for x, y, z in NEW]
    turned = fitted.rotated(1).predict(turned_lights)
    # Coordinates of lights change places: the operator's sums run in another order.
    np.testing.assert_allclose(turned, np.rot90(shown, axes=(2, 3)), rtol=1e-4, atol=1e-5)
    red = fitted.with_bands([0]).predict(NEW)
    np.testing.assert_allclose(red, shown[:, :1], rtol=1e-5, atol=1e-6)


def test_a_file_keeps_them(fitted: impasto.Sbrdf, tmp_path: Path) -> None:
    fitted.save(tmp_path / "fit.npz")
    again = impasto.load_sbrdf(tmp_path / "fit.npz")
    assert again.predict(NEW).tobytes() == fitted.predict(NEW).tobytes()


def test_a_picture_shows_what_is_predicted(fitted: impasto.Sbrdf) -> None:
    lights = [DistantLight(NEW[0], intensity=0.7), DistantLight(NEW[1], intensity=0.4)]
    image = impasto.render(fitted, Scene(lights, exposure=1.0))
    shown = fitted.predict(Rig(lights)).sum(axis=0)
    # Bands are linear sRGB under D65: what is shown, up to the digits of the matrices.
    np.testing.assert_allclose(image.linear, shown, rtol=1e-3, atol=1e-5)
    model = impasto.render(fitted, Scene(lights, exposure=1.0), fidelity="model")
    assert np.abs(model.linear - image.linear).max() > 0.01


def test_a_slanted_picture_has_none(fitted: impasto.Sbrdf) -> None:
    # It is foreshortened, and the residuals are those of the view of the photographs.
    scene = impasto.Scene([(0.2, 0.3, 0.9)], view=(0.6, 0.0, 0.8))
    image = impasto.render(fitted, scene)
    assert image.xyz.shape[2] < fitted.shape[1]
    model = impasto.render(fitted, scene, fidelity="model")
    np.testing.assert_array_equal(image.xyz, model.xyz)


def test_a_picture_of_a_part_is_a_part_of_the_picture(fitted: impasto.Sbrdf) -> None:
    """Under a near lamp, whose direction from the middle of a part is another."""
    scene = Scene([impasto.PointLight((3.0, 5.0, 12.0), intensity=0.8)], exposure=1.0)
    whole, part = (impasto.render(one, scene).linear for one in (fitted, fitted[5:20, 8:30]))
    # Coordinates in single precision, of a few mm.
    np.testing.assert_allclose(part, whole[:, 5:20, 8:30], rtol=1e-4, atol=1e-5)
    model = impasto.render(fitted, scene, fidelity="model").linear
    assert np.abs(model - whole).max() > 0.01


def test_a_near_camera_is_another_view_than_a_distant_one(fitted: impasto.Sbrdf) -> None:
    assert fitted.residuals is not None
    eyes = [PointView((0.0, 0.0, 60.0)), PointView((0.0, 0.0, 61.0)), PointView((0.0, 0.0, 90.0))]
    lights = [DistantLight(direction) for direction in fitted.rig.directions]
    known = Rig(lights, views=eyes[0], pitch_mm=0.2)
    new = [Rig([DistantLight(NEW[0])], views=eye, pitch_mm=0.2) for eye in eyes]
    same, beside, far = (fitted.residuals.weights(known, rig).any() for rig in new)
    assert same
    assert beside
    assert not far
    distant = Rig([DistantLight(NEW[0])], pitch_mm=0.2)
    assert not fitted.residuals.weights(known, distant).any()
    assert not fitted.residuals.weights(fitted.rig, new[0]).any()


def test_segments_keep_none(stack: impasto.Stack) -> None:
    with pytest.raises(impasto.ArgumentError, match="residuals: a fit with segments keeps none"):
        fit_sbrdf(stack, segments=np.zeros((40, 40), int), residuals=True)


def test_several_views_keep_none(stack: impasto.Stack) -> None:
    views = np.tile([[0.0, 0.0, 1.0], [0.5, 0.0, 0.85]], (24, 1))
    moved = impasto.Stack(stack.samples, lights=stack.rig.directions, views=views)
    assert learn_residuals(moved, lambda known: fit_sbrdf(known, joint=False), threads=1) is None


def test_any_number_of_threads_learns_the_same_process(stack: impasto.Stack) -> None:
    def fit(known: impasto.Stack) -> Any:
        return fit_sbrdf(known, pooling="painting", refine=False, threads=1)

    one, three = (learn_residuals(stack, fit, threads=threads) for threads in (1, 3))
    assert one is not None
    assert three is not None
    np.testing.assert_array_equal(one.basis, three.basis)
    for name in ("length", "noise", "top", "gain"):
        assert getattr(one, name) == getattr(three, name)


def test_few_lights_of_a_dome_keep_none() -> None:
    known = uneven(photographs("gloss", 7))
    assert learn_residuals(known, lambda s: fit_sbrdf(s, joint=False), threads=1) is None
    assert len(dome(7)) == 7


def test_every_step_of_a_fit_with_residuals_has_its_threads(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, set[int | None]] = {}

    def spied(name: str, function: Any, signature: inspect.Signature) -> Any:
        def call(*args: Any, **named: Any) -> Any:
            bound = signature.bind(*args, **named)
            bound.apply_defaults()
            given.setdefault(name, set()).add(bound.arguments["threads"])
            return function(*args, **named)

        return call

    for name, function in vars(_core).items():
        if inspect.isbuiltin(function):
            signature = inspect.signature(function)
            if "threads" in signature.parameters:
                monkeypatch.setattr(_core, name, spied(name, function, signature))
    assert fit_sbrdf(stack, refine=False, relief=False, threads=1).residuals is not None
    assert {"fit_normals", "fit_lobes", "predict"} <= given.keys()
    assert {name: counts for name, counts in given.items() if counts != {1}} == {}

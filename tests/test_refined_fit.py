"""Fits that refine the rig by themselves: ``fit_sbrdf(stack)``, ``learn_sbrdf`` and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointView, Rig, Scene
from impasto.cli import main
from impasto.io import write_stack
from test_broad_lobes import photographs as varnished
from test_rig_refinement import SHAPE, error, photographs

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """Photographs by a near camera, under a rig that says nothing of it."""
    return photographs(3.0, np.inf)[1]


@pytest.fixture(scope="module")
def fitted(stack: impasto.Stack) -> impasto.Sbrdf:
    return impasto.fit_sbrdf(stack)


def test_the_shortest_call_refines_the_rig(stack: impasto.Stack, fitted: impasto.Sbrdf) -> None:
    normal = photographs(3.0, np.inf)[0]
    assert fitted.rig.refinement is not None
    assert fitted.rig.refinement.camera.accepted
    asked = impasto.fit_sbrdf(stack, pooling="pixel", refine=True)
    assert asked.rig.viewpoints == fitted.rig.viewpoints
    left = impasto.fit_sbrdf(stack, refine=False)
    assert left.rig.refinement is None
    # The camera at 3 half-sides turns halfway vectors by up to 0.5 atan(1/3) = 9 degrees.
    assert error(normal, stack, fitted.rig) < 0.3 * error(normal, stack, left.rig)


def test_it_is_left_out_where_it_cannot_help(stack: impasto.Stack, fitted: impasto.Sbrdf) -> None:
    assert impasto.fit_sbrdf(stack, pooling="pixel").rig.refinement is None
    few = impasto.fit_sbrdf(stack.take(range(0, 40, 2)))
    assert few.rig.refinement is None
    own = impasto.fit_sbrdf(stack, normals=impasto.fit_normals(stack))
    assert own.rig.refinement is None
    again = impasto.fit_sbrdf(stack._replace(rig=fitted.rig))
    assert again.rig.refinement == fitted.rig.refinement
    assert again.rig.vectors.tolist() == fitted.rig.vectors.tolist()
    views = np.tile([[0.0, 0.0, 1.0], [0.3, 0.0, 0.95]], (20, 1))
    moved = impasto.Stack(stack.samples, lights=stack.rig.directions, views=views, pitch_mm=2.0)
    assert impasto.fit_sbrdf(moved).rig.refinement is None
    dark = stack._replace(samples=np.zeros_like(stack.samples))
    assert impasto.fit_sbrdf(dark).rig.refinement is None
    with pytest.raises(impasto.ArgumentError, match="no pixel can be fitted"):
        impasto.fit_sbrdf(dark, refine=True)
    with pytest.raises(impasto.ArgumentError, match="refine: expected True or False"):
        impasto.fit_sbrdf(stack, refine="yes")  # type: ignore[call-overload]


def test_tiles_have_the_refined_rig(
    stack: impasto.Stack, fitted: impasto.Sbrdf, tmp_path: Path
) -> None:
    learned = impasto.learn_sbrdf(stack)
    learned.save(tmp_path / "learned.npz")
    loaded = impasto.load_learned(tmp_path / "learned.npz")
    whole = loaded.apply(stack)
    assert whole.normal.tobytes() == fitted.normal.tobytes()
    part = loaded.apply(stack, slice(8, 20), slice(4, 16))
    assert part.normal.tobytes() == fitted.normal[:, 8:20, 4:16].tobytes()
    assert part.rig.view_positions.tolist() == fitted.rig.view_positions.tolist()
    assert part.rig.origin == stack[8:20, 4:16].rig.origin
    with pytest.raises(impasto.ArgumentError, match="expected 40 photographs, found 39"):
        loaded.apply(stack.take(range(39)))


def test_rigs_of_directions_are_lamps_of_the_refined_rig(
    stack: impasto.Stack, fitted: impasto.Sbrdf
) -> None:
    towards = stack.rig.directions[3:5]
    shown = fitted.predict(towards)
    assert fitted.predict(Rig(towards, pitch_mm=2.0)).tobytes() == shown.tobytes()
    slanted = Rig(towards, views=(0.0, 0.3, 0.95), pitch_mm=2.0)
    frontal = Rig([DistantLight(tuple(one), 2.0) for one in towards], pitch_mm=2.0)
    for other in (slanted, frontal):
        assert np.nanmax(np.abs(fitted.predict(other) - shown)) > 0.01


def test_pictures_are_seen_from_where_the_camera_was(fitted: impasto.Sbrdf) -> None:
    x, y, z = fitted.rig.view_positions[0].tolist()
    assert fitted.eye() == PointView((x, y, z))
    light = DistantLight((0.3, 0.2, 0.93))
    near = fitted.render(Scene([light], exposure=1.0))
    same = fitted.render(Scene([light], exposure=1.0, view=PointView((x, y, z))))
    assert near.linear.tobytes() == same.linear.tobytes()
    far = fitted.render(Scene([light], exposure=1.0, view=(0.0, 0.0, 1.0)))
    # The lobe is 0.15 rad wide, the corners see it from 25 degrees aside.
    assert np.nanmax(np.abs(near.linear - far.linear)) > 0.05
    assert fitted[2:9, 3:8].eye() == fitted.eye()
    distant = replace(fitted, rig=Rig(fitted.rig, views=(0.0, 0.0, 1.0)), residuals=None)
    assert distant.eye() == (0.0, 0.0, 1.0)


def test_the_command_refines_and_says_so(
    stack: impasto.Stack, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stack(tmp_path / "stack.npz", stack)
    words = ["fit", str(tmp_path / "stack.npz"), "--out"]
    assert main([*words, str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert "refined" in said
    assert "half-sides away" in said
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["results"]["rig"]["camera"]["accepted"] is True
    found = impasto.load_sbrdf(tmp_path / "out")
    assert found.rig.refinement is not None
    assert found.shape == SHAPE
    assert main([*words, str(tmp_path / "left"), "--no-refine"]) == 0
    assert impasto.load_sbrdf(tmp_path / "left").rig.refinement is None
    assert "half-sides away" not in capsys.readouterr().err


@pytest.mark.parametrize("coated", [True, False])
def test_strengths_do_not_stand_for_what_a_varnish_keeps_back(coated: bool) -> None:
    _, even = varnished(0.12, 0.001, coated=coated)
    strength = np.random.default_rng(5).uniform(0.6, 1.4, len(even.rig))
    samples = even.samples * strength[:, None, None, None].astype(np.float32)
    uneven = impasto.Stack(samples, lights=even.rig.directions)
    rig = impasto.refine_rig(uneven, camera=False, lamps=False)
    found = np.log(rig.intensities / strength)
    # Noise of 0.1 % of white in 144 pixels of three bands leaves some 0.1 %; with surfaces of
    # the wrong kind 7 %.
    assert np.abs(found - np.median(found)).mean() < 0.003


def test_a_rig_is_left_as_it_is_where_errors_are_those_of_rounding() -> None:
    _, even = varnished(0.12, 0.0)
    rig = impasto.refine_rig(even)
    assert rig.refinement is not None
    assert not rig.refinement.accepted
    assert "rounding" in rig.refinement.camera.reason
    assert "rounding" in rig.refinement.strengths.reason
    assert rig.intensities.tobytes() == even.rig.intensities.tobytes()
    kept = impasto.refine_rig(even, camera=False, strengths=False).refinement
    assert kept is not None
    assert kept.camera.reason == "not requested"
    assert kept.strengths.reason == "not estimated"

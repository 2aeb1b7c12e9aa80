"""Rigs refined from their own photographs, against those that were put in.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, PointLight, PointView, Rig
from impasto.fit import rig_elimination, rig_refinement, rig_search
from impasto.fit.coordinate_search import coordinate_search
from impasto.fit.held_out import HeldOut
from impasto.fit.subsample import subsampled, subsampled_to
from impasto.io import write_stack
from impasto.io.session.rigs import without_falloff
from oracles import forward as oracle
from oracles.rigs import spiral

SHAPE = (24, 24)
PITCH = 2.0
HALF = 24.0
"""Half of the side in mm."""
NOISE = 0.002


def photographs(
    camera: float, lamps: float, specular: float = 4.0
) -> tuple[Any, impasto.Stack, Rig]:
    """Normals, photographs under the given, distant rig, and the rig that they were taken with.

    Distances are in halves of the side.
    """
    rng = np.random.default_rng(3)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    given = [DistantLight(tuple(d)) for d in spiral(40).tolist()]
    lights = (
        given
        if math.isinf(lamps)
        else [PointLight(tuple(lamps * HALF * np.array(light.direction))) for light in given]
    )
    eye = (0.0, 0.0, 1.0 if math.isinf(camera) else camera * HALF)
    towards, _ = oracle.to_light(SHAPE, PITCH, eye)
    if math.isinf(camera):
        towards = np.array(eye)
    images = []
    for light in lights:
        direction, gain = np.array(light.direction), 1.0
        if isinstance(light, PointLight):
            direction, squared = oracle.to_light(SHAPE, PITCH, light.position)
            gain = (lamps * HALF) ** 2 / squared
        images.append(gain * oracle.radiance(normal, diffuse, specular, 0.15, direction, towards))
    samples = np.array(images) + rng.normal(0.0, NOISE, (40, *diffuse.shape))
    view = None if math.isinf(camera) else PointView(eye)
    stack = impasto.Stack(samples.astype(np.float32), lights=Rig(given, pitch_mm=PITCH))
    return normal, stack, Rig(lights, views=view, pitch_mm=PITCH)


def error(normal: Any, stack: impasto.Stack, rig: Rig) -> float:
    """Mean error of the normals in degrees."""
    found = impasto.fit_sbrdf(stack._replace(rig=rig), pooling="pixel").normal
    return float(np.degrees(np.arccos(np.clip((found * normal).sum(axis=0), -1.0, 1.0))).mean())


@pytest.fixture(scope="module")
def near() -> tuple[Any, impasto.Stack, Rig, Rig]:
    normal, stack, true = photographs(3.0, 4.0)
    return normal, stack, true, impasto.refine_rig(stack)


def test_a_near_camera_and_near_lamps_are_found(near: Any) -> None:
    normal, stack, true, refined = near
    report = refined.refinement
    assert report.camera.accepted
    assert report.lamps.accepted
    # What tests/test_bundle_adjustment.py asks with uneven strengths is 2 and 1 %.
    assert report.camera.found == pytest.approx(3.0, rel=0.05)
    assert report.lamps.found == pytest.approx(4.0, rel=0.05)
    assert report.half_mm == HALF
    np.testing.assert_allclose(refined.view_positions[:, 2], 72.0, rtol=0.05)
    known, given, found = (error(normal, stack, rig) for rig in (true, stack.rig, refined))
    assert found < 1.3 * known
    assert found < 0.2 * given
    assert report.gain > 3.0 * report.scatter
    lines = str(report).splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("camera: ")
    assert "half-sides away" in lines[0]
    assert lines[1].startswith("lamps: ")
    assert "held as given: " in lines[2]
    assert "refined" in repr(refined)


def test_a_distant_rig_stays_as_given() -> None:
    _, stack, _ = photographs(math.inf, math.inf)
    refined = impasto.refine_rig(stack)
    report = refined.refinement
    assert report is not None
    assert not report.accepted
    assert report.open[0] == "tilt of the painting"
    assert refined.lights == stack.rig.lights
    assert not refined.near_views.any()


def test_any_number_of_threads_gives_the_same_rig(near: Any) -> None:
    again = impasto.refine_rig(near[1], threads=2)
    assert again.vectors.tobytes() == near[3].vectors.tobytes()
    assert again.view_positions.tobytes() == near[3].view_positions.tobytes()
    assert again.refinement == near[3].refinement


def test_what_is_not_asked_for_stays(near: Any) -> None:
    stack, calls = near[1], list[tuple[int, int]]()

    def report(done: int, total: int) -> None:
        calls.append((done, total))

    lamps = impasto.refine_rig(stack, camera=False, strengths=False, progress=report)
    assert not lamps.near_views.any()
    assert lamps.refinement is not None
    assert lamps.refinement.camera.reason == "not requested"
    assert (lamps.intensities == 1.0).all()
    assert lamps.near.all()
    assert calls[-1][0] == calls[-1][1]
    # Without fall-off in the photographs, near lamps have none.
    flat = impasto.refine_rig(stack, camera=False, strengths=False, falloff=False)
    assert not flat.falloff.any()


def test_it_is_saved_and_goes_to_other_stacks(near: Any, tmp_path: Path) -> None:
    _, stack, _, refined = near
    write_stack(tmp_path / "stack.npz", stack._replace(rig=refined))
    again = impasto.read_stack(tmp_path / "stack.npz").rig
    assert again.refinement == refined.refinement
    assert again.viewpoints == refined.viewpoints
    fitted = impasto.fit_sbrdf(stack._replace(rig=refined), pooling="pixel")
    fitted.save(tmp_path / "fit.npz")
    loaded = impasto.load_sbrdf(tmp_path / "fit.npz").rig
    assert loaded.refinement == refined.refinement
    assert loaded.viewpoints == refined.viewpoints
    assert loaded.lights == refined.lights
    other = impasto.Stack(stack.samples, lights=refined)
    assert other.rig.refinement == refined.refinement
    for same in (refined.take([0, 3]), refined.rotated(1), refined.part(1.0, 2.0)):
        assert same.refinement == refined.refinement
    with pytest.raises(ArgumentError, match="no saved refinement"):
        impasto.RigRefinement.from_json("{}")


def test_new_lamps_are_those_of_the_rig(near: Any) -> None:
    _, stack, _, refined = near
    towards = refined.directions[[4, 9]]
    new = refined.at(towards)
    np.testing.assert_allclose(new.vectors, refined.vectors[[4, 9]], rtol=1e-9)
    np.testing.assert_allclose(new.intensities, refined.intensities[[4, 9]], rtol=1e-6)
    assert new.view_positions.tolist() == refined.view_positions[:2].tolist()
    twice = refined.at([DistantLight(tuple(towards[0]), 2.0)])
    np.testing.assert_allclose(twice.intensities, 2.0 * new.intensities[:1])
    fitted = impasto.fit_sbrdf(stack._replace(rig=refined), pooling="pixel")
    # Plain directions are lamps of the refined rig; lights and rigs are what they say.
    assert fitted.predict(towards).tobytes() == fitted.predict(new).tobytes()
    distant = [DistantLight(tuple(one)) for one in towards.tolist()]
    assert np.abs(fitted.predict(distant) - fitted.predict(new)).max() > 0.01
    plain = replace(fitted, rig=Rig(refined.lights, views=refined.viewpoints, pitch_mm=PITCH))
    assert np.array_equal(plain.predict(towards), fitted.predict(distant), equal_nan=True)


def test_lamps_keep_their_size(tmp_path: Path) -> None:
    """In files, beside a white board, and among other lamps of a rig."""
    near = Rig([PointLight((0.0, 300.0, 400.0), radius=20.0)] * 3, pitch_mm=PITCH)
    far = Rig([DistantLight((0.0, 0.6, 0.8), radius=0.05)] * 3, pitch_mm=PITCH)
    for rig in (near, far):
        stack = impasto.Stack(np.ones((3, 1, 4, 5), np.float32), lights=rig)
        write_stack(tmp_path / "stack.npz", stack)
        read = impasto.read_stack(tmp_path / "stack.npz")
        for same in (read.rig, without_falloff(rig), rig.take([2, 0, 1]), rig.rotated(1)):
            assert same.radii.tolist() == rig.radii.tolist()
    # Seen from the middle of the painting it is as large as it was.
    moved = near.at(far).radii
    assert moved == pytest.approx(500.0 * np.tan(0.05))
    assert far.at(near).radii == pytest.approx(np.arctan(20.0 / 500.0))
    assert far.at([(0.0, 0.0, 1.0)]).radii.tolist() == [0.0]
    # The largest that there are, whose radii may round to either side of half their distance.
    azimuths = np.linspace(0.0, 6.0, 50)
    around = np.stack([np.cos(azimuths), np.sin(azimuths), 1.3 + azimuths], axis=1)
    widest = near.at([DistantLight(tuple(one), radius=np.pi / 4) for one in around.tolist()])
    assert widest.radii == pytest.approx(250.0)


def test_new_lamps_fall_off_as_the_nearest() -> None:
    places = [(-400.0, 10.0, 300.0), (-300.0, -200.0, 300.0), (400.0, 10.0, 300.0)]
    lamps = [PointLight(place, falloff=place[0] > 0.0) for place in places]
    rig = Rig(lamps, pitch_mm=1.0)
    assert rig.at([(-0.6, 0.1, 0.7), (0.7, 0.0, 0.6)]).falloff.tolist() == [False, True]


@pytest.mark.slow
def test_distant_lamps_that_are_found_to_be_near_keep_their_size(near: Any) -> None:
    _, stack, _, refined = near
    given = [replace(light, radius=0.05) for light in stack.rig.lights]
    found = impasto.refine_rig(stack._replace(rig=stack.rig.with_lights(given)))
    assert found.vectors.tobytes() == refined.vectors.tobytes()
    assert found.near.all()
    far = np.linalg.norm(found.vectors, axis=1)
    assert found.radii == pytest.approx(far * np.tan(0.05))


def test_views_that_differ_have_no_new_lamps() -> None:
    rig = Rig([DistantLight((0, 0.6, 0.8))] * 2, views=[(0, 0, 1), (0, 0.6, 0.8)])
    with pytest.raises(ArgumentError, match="different views"):
        rig.at([(0.0, 0.0, 1.0)])


@pytest.mark.slow
@pytest.mark.parametrize(("camera", "lamps"), [(1.2, math.inf), (math.inf, 1.3)])
def test_what_is_very_near_is_found(camera: float, lamps: float) -> None:
    _, stack, _ = photographs(camera, lamps)
    report = impasto.refine_rig(stack).refinement
    assert report is not None
    for one, true in ((report.camera, camera), (report.lamps, lamps)):
        assert one.accepted == math.isfinite(true)
        assert not one.accepted or one.found == pytest.approx(true, rel=0.02)


def test_what_reaches_the_bound_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (rig_search, rig_elimination, rig_refinement):
        monkeypatch.setattr(module, "NEAREST", 0.25)  # the camera is at 1 / 3
    _, stack, _ = photographs(3.0, math.inf)
    report = impasto.refine_rig(stack, lamps=False, strengths=False).refinement
    assert report is not None
    assert not report.camera.accepted
    assert report.camera.reason == "it would be nearer than 4 half-sides"


def test_one_ring_and_a_few_pixels_tell_nothing(near: Any) -> None:
    stack = near[1]
    around = np.arange(12) * np.pi / 6.0
    ring = np.stack([0.8 * np.cos(around), 0.8 * np.sin(around), np.full(12, 0.6)], axis=1)
    low = impasto.refine_rig(stack.take(range(12))._replace(rig=Rig(ring, pitch_mm=PITCH)))
    mask = np.zeros(SHAPE, dtype=np.bool_)
    mask[10:12, 10:12] = True
    few = impasto.refine_rig(stack._replace(mask=mask))
    for rig, reason in ((low, "lamps of one elevation"), (few, "4 pixels that can be fitted")):
        assert rig.refinement is not None
        assert not rig.refinement.accepted
        assert rig.refinement.camera.reason.startswith(reason)


def test_a_rig_that_cannot_be_refined_is_refused(near: Any) -> None:
    stack = near[1]
    with pytest.raises(ArgumentError, match="at least 10 photographs to be refined, found 9"):
        impasto.refine_rig(stack.take(range(9)))
    black = impasto.Stack(np.zeros((12, 1, 8, 8), np.float32), lights=spiral(12))
    with pytest.raises(ArgumentError, match="no pixel can be fitted"):
        impasto.refine_rig(black)
    wrong: Any = "yes"
    with pytest.raises(ArgumentError, match="camera: "):
        impasto.refine_rig(stack, camera=wrong)


def test_a_sparse_mask_keeps_places_for_near_cameras(near: Any) -> None:
    _, stack, true, _ = near
    mask = np.zeros(SHAPE, bool)
    mask[::6, ::6] = True
    masked = impasto.Stack(stack.samples, lights=Rig(stack.rig, views=true.viewpoints), mask=mask)
    few = subsampled_to(masked, 10_000)
    # Packed into a smaller picture, pixels would see the camera from other places.
    assert few.shape[2:] == (19, 19)
    middle = few.rig.view_positions[0]
    # The box has rows and columns 0 to 18: its middle is 2.5 pixels left of and above the whole's.
    np.testing.assert_allclose(middle, (5.0, -5.0, 72.0))


def test_a_part_of_a_painting_sees_the_same_rig(near: Any) -> None:
    """The sample of a part under the whole's rig predicts what the part's photographs show."""
    _, stack, true, _ = near
    part = stack._replace(rig=true)[4:24, 8:24]
    test = HeldOut(part, 10_000, index=1.45, threads=1)
    right = test.errors(part.rig, 2).trim
    shifted = test.errors(Rig(part.rig, origin=(0.0, 0.0)), 2).trim
    assert right < 0.8 * shifted


def test_strengths_of_the_icon_are_accepted_beside_distances(data: Path) -> None:
    """Gold under varnish, every seventh pixel, a sixth of the photographs held out.

    Without this sixth, neither strengths nor distances are worth enough one by one; and medians of
    what two lobes leave find strengths that one lobe bends.
    """
    whole = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    stack = subsampled(whole, 7)
    held = np.arange(1, 72, 6)
    seen, new = stack.take(np.setdiff1d(np.arange(72), held)), stack.take(held).rig
    truth = np.rint(stack.encode(np.array([stack.linear(i) for i in held])))

    def decibels(rig: impasto.Rig, lit: impasto.Rig) -> float:
        surface = impasto.fit_sbrdf(seen._replace(rig=rig), pooling="pixel")
        shown = stack.encode(np.nan_to_num(surface.predict(lit)))
        error = (np.clip(shown, 0.0, 255.0) - truth) ** 2
        return float(np.mean(10.0 * np.log10(255.0**2 / error.mean(axis=(1, 2, 3)))))

    refined = impasto.refine_rig(seen)
    report = refined.refinement
    assert report is not None
    assert report.strengths.accepted
    assert "together" in str(report)
    # 2.5 dB with strengths and distances of one lobe, 2.9 with medians.
    assert decibels(refined, refined.at(new)) - decibels(seen.rig, new) > 2.7


def test_a_coordinate_search_ends_at_the_minimum() -> None:
    calls = []

    def bowl(at: Any) -> float:
        calls.append(tuple(at))
        return float((at[0] - 0.31) ** 2 + 2.0 * (at[1] - 0.12) ** 2 + 0.5 * at[0] * at[1])

    # d/dx: 2 (x - .31) + .5 y = 0; d/dy: 4 (y - .12) + .5 x = 0.
    x, y = np.linalg.solve([[2.0, 0.5], [0.5, 4.0]], [0.62, 0.48])
    best, least = coordinate_search(
        bowl, np.zeros(2), np.array([0.1, 0.1]), low=np.zeros(2), high=np.ones(2)
    )
    # Axes are searched in turn: what their coupling leaves shrinks with the steps, to a fortieth.
    np.testing.assert_allclose(best, (x, y), atol=0.025)
    assert least == bowl(best)
    assert len(calls) == len(set(calls)) + 1
    edge, _ = coordinate_search(
        bowl, np.zeros(2), np.array([0.1, 0.0]), low=np.zeros(2), high=np.full(2, 0.2)
    )
    assert edge.tolist() == [0.2, 0.0]


def test_photographs_of_any_exposure_have_the_same_rig(near: Any) -> None:
    stack, refined = near[1], near[3]
    dark = np.asarray(stack.samples) * np.float32(2.0**-20)
    again = impasto.refine_rig(stack._replace(samples=dark))
    # A power of two changes no bit of a sample but its exponent.
    assert again.vectors.tobytes() == refined.vectors.tobytes()
    assert again.view_positions.tobytes() == refined.view_positions.tobytes()

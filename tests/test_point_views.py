"""Cameras so near that pixels see them in different directions."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, GeometryError, PointLight, PointView, Rig, Scene
from impasto.io import write_stack

sys.path.insert(0, str(Path(__file__).parent / "oracles"))
import forward

SIZE = (29, 43)
PITCH = 2.0
EYES = [(15.0, -20.0, 90.0), (-60.0, 10.0, 70.0)]


def painting(beta: float = 3.0, gamma: float = 0.15) -> impasto.Surface:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] / 7.0
    normal = np.stack([0.2 * np.sin(x + y), 0.2 * np.cos(y - 0.5 * x), np.ones(SIZE)])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = np.random.default_rng(3).uniform(0.1, 0.8, (2, *SIZE)).astype(np.float32)
    return impasto.Surface.torrance_sparrow(
        normal.astype(np.float32), diffuse, beta, gamma, pitch_mm=PITCH
    )


def expected(surface: impasto.Surface, light: tuple[float, ...], eye: tuple[float, ...]):
    """Eq. 9 in float64, the direction to the eye formed at every pixel."""
    towards, _ = forward.to_light(SIZE, PITCH, eye)
    return forward.radiance(surface.normal, surface.diffuse, 3.0, 0.15, light, towards)


def test_a_prediction_follows_the_formula_at_every_pixel() -> None:
    surface = painting()
    light = DistantLight((0.3, 0.4, 0.8))
    views = [PointView(eye) for eye in EYES]
    shown = surface.predict(Rig([light] * 2, views=views, pitch_mm=PITCH))
    for image, eye in zip(shown, EYES, strict=True):
        # A lobe of gamma 0.15 changes by up to 1 / gamma of its value per radian: directions and
        # normals of 6e-8 each leave some 1e-6 of values up to 2.
        want = expected(surface, light.direction, eye)
        np.testing.assert_allclose(image, want, rtol=2e-5, atol=2e-6)
    # The views matter: as distant ones they would show something else.
    distant = surface.predict(Rig([light] * 2, views=EYES, pitch_mm=PITCH))
    assert np.abs(distant - shown).max() > 0.05


def test_a_picture_shows_what_each_pixel_shows_to_the_eye() -> None:
    surface = painting()
    scene = Scene([DistantLight((0.3, 0.4, 0.8))], view=PointView(EYES[0]), exposure=1.0)
    assert "mm" in repr(scene)
    grey = impasto.Surface.torrance_sparrow(
        surface.normal, surface.diffuse[[0, 0, 0]], 3.0, 0.15, pitch_mm=PITCH
    )
    image = impasto.render(grey, scene)
    assert image.linear.shape == (3, *SIZE)
    # Grey under D65 on an sRGB display: every channel is the radiance, up to the digits of the
    # matrices of display and observer.
    want = expected(surface, scene.lights[0].direction, EYES[0])[0]
    np.testing.assert_allclose(image.linear[1], want, rtol=1e-3, atol=1e-4)


def test_a_far_camera_is_a_distant_one() -> None:
    surface = painting()
    lights = [DistantLight((0.3, 0.4, 0.8)), PointLight((30.0, 20.0, 100.0))]
    direction = np.array([0.2, -0.1, 0.9])
    near = surface.predict(Rig(lights, views=PointView(tuple(direction * 1e6)), pitch_mm=PITCH))
    far = surface.predict(Rig(lights, views=direction, pitch_mm=PITCH))
    # The painting is 90 mm wide: directions differ by 5e-5 rad, a lobe by 1 / gamma times that.
    np.testing.assert_allclose(near, far, rtol=1e-3, atol=1e-3)


def test_a_part_of_the_painting_has_the_bits_of_the_whole() -> None:
    surface = painting()
    rig = Rig([DistantLight((0.3, 0.4, 0.8))], views=PointView(EYES[0]), pitch_mm=PITCH)
    whole = surface.predict(rig)
    # The middle of rows 5 to 19 and columns 10 to 30 against that of 29 rows and 43 columns.
    part = impasto.Surface.torrance_sparrow(
        surface.normal[:, 5:20, 10:31],
        surface.diffuse[:, 5:20, 10:31],
        3.0,
        0.15,
        pitch_mm=PITCH,
        origin=(20.0 - 21.0, 14.0 - 12.0),
    )
    assert part.predict(rig).tobytes() == whole[..., 5:20, 10:31].tobytes()


def test_a_rig_keeps_its_cameras_through_everything(tmp_path: Path) -> None:
    views = [PointView(EYES[0]), (0.0, 0.6, 0.8), PointView(EYES[1])]
    rig = Rig([DistantLight((0.0, 0.6, 0.8))] * 3, views=views, pitch_mm=PITCH)
    assert rig.near_views.tolist() == [True, False, True]
    np.testing.assert_allclose(np.linalg.norm(rig.views, axis=1), 1.0, rtol=1e-15)
    assert np.array_equal(rig.view_positions[[0, 2]], EYES)
    assert Rig(rig.lights, views=rig.viewpoints, pitch_mm=PITCH).viewpoints == rig.viewpoints
    moved = Rig(rig, pitch_mm=2.0 * PITCH, origin=(1.0, 2.0))
    assert (moved.viewpoints, moved.pitch_mm) == (rig.viewpoints, 2.0 * PITCH)
    some = moved.take([1, 0])
    assert some.near_views.tolist() == [False, True]
    assert (some.origin, some.pitch_mm, some.lights) == ((1.0, 2.0), 2.0 * PITCH, rig.lights[:2])
    with pytest.raises(ValueError, match="read-only"):  # moved and rig share them
        moved.views[0] = 0.0
    assert rig.take([2, 1]).view_positions[0].tolist() == list(EYES[1])
    assert rig.rotated(1).view_positions[0].tolist() == [20.0, 15.0, 90.0]
    assert rig.rotated(4).viewpoints == rig.viewpoints
    assert rig.seen_from(5.0, -1.0).view_positions[0].tolist() == [10.0, -19.0, 90.0]
    stack = impasto.Stack(painting().predict(rig), lights=rig)
    write_stack(tmp_path / "stack.npz", stack)
    again = impasto.read_stack(tmp_path / "stack.npz")
    assert again.rig.viewpoints == rig.viewpoints


def test_a_fit_takes_near_cameras_for_what_they_are() -> None:
    surface = painting()
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = [(0.5 * np.cos(a), 0.5 * np.sin(a), 0.75) for a in angles]
    lights = [DistantLight(light) for light in [*ring, *(np.array(ring) * (1.5, 1.5, 1.0))]]
    rig = Rig(lights, views=PointView((0.0, 0.0, 80.0)), pitch_mm=PITCH)
    stack = impasto.Stack(surface.predict(rig), lights=rig)
    fitted = impasto.fit_sbrdf(stack, pooling="painting")
    assert isinstance(fitted, impasto.PooledSbrdf)
    # Samples without noise: what is left is single precision and where searches end.
    assert fitted.beta == pytest.approx(3.0, rel=0.01)
    assert fitted.gamma == pytest.approx(0.15, rel=0.01)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: PointView((0.0, 0.0, 0.0)), "position: a camera cannot stand on the painting"),
        (
            lambda: Rig([DistantLight((0, 0, 1))], views=PointView((0.0, 0.0, 9.0))),
            "pitch_mm: point views need",
        ),
        (
            lambda: Rig([DistantLight((0, 0, 1))], views=[PointView((0, 0, 9))] * 2, pitch_mm=1.0),
            "views: expected one or 1, found 2",
        ),
        (
            lambda: Scene([DistantLight((0, 0, 1))], view=PointView((0, 5.0, -9.0))),
            "view: the eye must be in front",
        ),
    ],
)
def test_what_is_no_camera_is_refused(call, words: str) -> None:
    with pytest.raises((ArgumentError, GeometryError), match=words):
        call()

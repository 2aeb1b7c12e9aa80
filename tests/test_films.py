"""Films: series of scenes, and files that other programs read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Pillow

import impasto
from impasto import (
    ArgumentError,
    DistantLight,
    GeometryError,
    PointLight,
    PointView,
    Scene,
    animation,
)
from impasto.io.films import film_format, write_film

LAMP = DistantLight((0.3, 0.4, 0.8), intensity=0.7)


def codes(count: int, size: tuple[int, int] = (33, 47)) -> list[NDArray[np.uint8]]:
    """Smooth pictures that differ, two of them equal."""
    y, x = np.mgrid[: size[0], : size[1]]
    planes = [
        np.stack([128 + 100 * np.sin(0.1 * x + k), 3.0 * y + 5 * k, 255 - 4.0 * x], axis=-1)
        for k in range(count)
    ]
    pictures = [np.clip(plane, 0, 255).astype(np.uint8) for plane in planes]
    if count > 2:
        pictures[2] = pictures[1].copy()
    return pictures


def shown(path: Path) -> tuple[list[NDArray[np.uint8]], dict[str, Any]]:
    """The frames of an animated picture, by Pillow."""
    with Pillow.open(path) as film:
        info, frames = dict(film.info), []
        for index in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(index)
            frames.append(np.asarray(film.convert("RGB")))
        info["duration"] = film.info["duration"]
    return frames, info


@pytest.mark.parametrize("fps", [0.5, 12.0, 25.0])
def test_an_animated_png_is_exact_and_has_its_profile(tmp_path: Path, fps: float) -> None:
    path, pictures = tmp_path / "film.png", codes(5)
    icc = impasto.colour.icc_profile(impasto.colour.Display.named("display-p3"))
    write_film(path, iter(pictures), fps=fps, icc=icc)
    frames, info = shown(path)
    np.testing.assert_array_equal(frames, pictures)
    assert info["icc_profile"] == icc
    assert info["loop"] == 0
    # Hundredths of a frame per second, in milliseconds.
    assert info["duration"] == pytest.approx(1000.0 / fps, rel=1e-3)
    # A program that knows no animation shows the first frame, and the same film is the same bytes.
    np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], pictures[0])
    first = path.read_bytes()
    write_film(path, iter(pictures), fps=fps, icc=icc)
    assert path.read_bytes() == first


def test_a_gif_has_256_colours_per_frame(tmp_path: Path) -> None:
    path, pictures = tmp_path / "film.gif", codes(5)
    write_film(path, pictures, fps=10.0)
    frames, info = shown(path)
    # Equal frames become one that lasts longer.
    assert len(frames) in {4, 5}
    assert info["loop"] == 0
    assert info["duration"] in {100, 200}
    # 256 colours of a smooth picture.
    assert np.abs(frames[0].astype(int) - pictures[0]).mean() < 6.0


def test_an_mp4_shows_the_same_colours(tmp_path: Path) -> None:
    path, pictures = tmp_path / "film.mp4", codes(6)
    write_film(path, pictures, fps=12.0)
    film = cv2.VideoCapture(str(path))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(12.0)
    frames = []
    while True:
        there, frame = film.read()
        if not there:
            break
        frames.append(frame[..., ::-1])
    film.release()
    # Odd sizes end in a row and a column more.
    assert [frame.shape for frame in frames] == 6 * [(34, 48, 3)]
    for frame, picture in zip(frames, pictures, strict=True):
        # Half the colour resolution and 8-bit luma of limited range: two codes, and the coder's.
        assert np.abs(frame[:33, :47].astype(int) - picture).mean() < 4.0


@pytest.mark.parametrize("suffix", ["png", "gif", "mp4"])
def test_a_film_that_stops_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    def broken() -> Any:
        yield from codes(2)
        raise KeyboardInterrupt

    path = tmp_path / f"film.{suffix}"
    path.write_bytes(b"an older film")
    with pytest.raises(KeyboardInterrupt):
        write_film(path, broken())
    assert path.read_bytes() == b"an older film"
    assert list(tmp_path.iterdir()) == [path]


WRONG: list[tuple[Any, dict[str, Any], str]] = [
    ([], {}, "at least one"),
    ([np.zeros((2, 2, 3))], {}, "uint8"),
    ([np.zeros((2, 2), np.uint8)], {}, "uint8"),
    ([*codes(1), *codes(1, (5, 6))], {}, r"frame 1 is \(5, 6\)"),
    (codes(1), {"fps": 0.0}, "fps"),
    (codes(1), {"fps": float("nan")}, "fps"),
]


@pytest.mark.parametrize(("frames", "options", "words"), WRONG)
def test_what_is_no_film_is_refused(
    tmp_path: Path, frames: Any, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        write_film(tmp_path / "film.png", frames, **options)
    assert not list(tmp_path.iterdir())


def test_a_format_is_known_by_its_suffix(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    assert [film_format(f"a.{s}") for s in ("PNG", "apng", "gif", "mp4")] == [
        *("PNG", "PNG", "GIF", "MP4")
    ]
    with pytest.raises(ArgumentError, match=r"\.png, \.gif or \.mp4, or a folder, found a\.avi"):
        film_format("a.avi")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setitem(sys.modules, "PIL", None)
    for suffix in ("gif", "mp4"):
        with pytest.raises(impasto.MissingExtraError, match=r"pip install 'impasto\[video\]'"):
            film_format(f"a.{suffix}")
    assert film_format("a.png") == "PNG"


def test_raking_light_goes_round_from_the_right_over_the_top() -> None:
    scenes = animation.raking(Scene([LAMP, LAMP], exposure=2.0), 8, elevation=math.radians(10.0))
    directions = np.array([scene.lights[0].direction for scene in scenes])
    angles = np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) % 360.0
    np.testing.assert_allclose(angles, 45.0 * np.arange(8), atol=1e-9)
    np.testing.assert_allclose(directions[:, 2], math.sin(math.radians(10.0)))
    assert {scene.lights[0].intensity for scene in scenes} == {1.4}
    assert {scene.exposure for scene in scenes} == {2.0}


def test_raking_light_leaves_a_room_as_it_is() -> None:
    gallery = impasto.Environment.named("gallery")
    for lights, illuminants in (([LAMP, LAMP], ["A", "A", 3000.0]), ([], [3000.0])):
        scene = Scene(lights, environment=gallery, illuminant=illuminants)
        (first, *_) = animation.raking(scene, 3)
        assert first.illuminants == (illuminants[0], 3000.0)
        assert first.lights[0].intensity == (1.4 if lights else 1.0)
        assert first.environment is gallery
        with pytest.raises(ArgumentError, match="environment: it would have to turn"):
            animation.turntable(scene, 3)


def test_a_painting_that_turns_shows_its_other_side_to_lights_that_stay() -> None:
    """Angles between light and eye stay; a near lamp keeps its distance."""
    near = PointLight((50.0, 20.0, 300.0))
    scene = Scene([LAMP, near])
    scenes = animation.turntable(scene, 8, angle=math.radians(40.0))
    for index, turned in enumerate(scenes):
        eye = np.array(turned.view if turned.view is not None else (0.0, 0.0, 1.0))
        assert eye @ turned.lights[0].direction == pytest.approx(LAMP.direction[2])
        moved: Any = turned.lights[1]
        assert np.linalg.norm(moved.position) == pytest.approx(np.linalg.norm(near.position))
        assert eye @ moved.position == pytest.approx(300.0)
        # To the right means that its right side goes away from the eye, which then sees it from
        # the left.
        angle = math.radians(40.0) * math.sin(2.0 * math.pi * index / 8)
        np.testing.assert_allclose(eye, (-math.sin(angle), 0.0, math.cos(angle)), atol=1e-12)
    with pytest.raises(GeometryError, match="not in front"):
        animation.turntable(Scene([DistantLight((1.0, 0.0, 0.2))]), 8, angle=math.radians(40.0))
    with pytest.raises(ArgumentError, match="turntable is seen from a direction"):
        animation.turntable(Scene([LAMP], view=PointView((0.0, 0.0, 100.0))), 8)


def test_a_film_has_one_exposure() -> None:
    painting = impasto.simulate.painting(seed=2, size=(32, 32))
    scenes = animation.adapting(Scene([LAMP], illuminant="A"), 5, first=0.0, last=1.0)
    assert [scene.adaptation for scene in scenes] == [0.0, 0.25, 0.5, 0.75, 1.0]
    own = [impasto.render(painting, scene).exposure for scene in scenes]
    assert len(set(own)) == 5
    same = animation.same_exposure(painting, scenes)
    assert {scene.exposure for scene in same} == {min(own)}
    with pytest.raises(ArgumentError, match="flicker"):
        animation.same_exposure(painting, [scenes[0].changed(exposure="maximum")])


def test_a_scene_is_changed_in_what_is_said() -> None:
    scene = Scene(
        [LAMP, LAMP],
        illuminant=["A", 3000.0],
        view=(0.3, 0.0, 1.0),
        adaptation=0.5,
        display="display-p3",
        exposure=2.0,
        shadows=True,
        varnish=impasto.Varnish(yellowness=3.0),
        background=(0.1, 0.2, 0.3),
    )
    same = scene.changed()
    for name in vars(scene):
        if name == "view":
            np.testing.assert_allclose(scene.view, same.view, rtol=1e-15)
        else:
            assert getattr(scene, name) == getattr(same, name), name
    assert scene.changed(adaptation=0.7).adaptation == 0.7
    assert scene.changed(lights=[LAMP], illuminant="A").illuminants == ("A",)
    with pytest.raises(ArgumentError, match="illuminant: expected one per light"):
        scene.changed(lights=[LAMP])
    assert Scene([LAMP, LAMP], illuminant="A").changed(lights=[LAMP]).illuminants == ("A",)


@pytest.mark.parametrize(("frames", "words"), [(0, "frames"), (1.5, "frames")])
def test_wrong_numbers_of_a_series_are_refused(frames: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        animation.raking(Scene([LAMP]), frames)
    with pytest.raises(ArgumentError, match="elevation"):
        animation.raking(Scene([LAMP]), 4, elevation=15.0)
    with pytest.raises(ArgumentError, match="angle"):
        animation.turntable(Scene([LAMP]), 4, angle=2.0)


def test_pictures_stand_in_the_middle() -> None:
    wide = np.full((4, 3, 3), 9, np.uint8)
    (frame,) = animation.centred(iter([wide]), (4, 7), (1, 2, 3))
    assert (frame[:, 2:5] == 9).all()
    assert (frame[:, [0, 1, 5, 6]] == (1, 2, 3)).all()


def of_scene(call: Any) -> Any:
    return lambda wrong: call(wrong, 4)


PAINTING = impasto.simulate.painting(seed=1, size=(8, 8))
PICTURE = [np.zeros((2, 2, 3), np.uint8)]
SERIES: list[tuple[Any, str]] = [
    *(
        (of_scene(call), "scene: expected an impasto.Scene")
        for call in (animation.raking, animation.turntable, animation.adapting)
    ),
    (lambda wrong: animation.raking(Scene([LAMP]), 4, elevation=wrong), "elevation: expected"),
    (lambda wrong: animation.turntable(Scene([LAMP]), 4, angle=wrong), "angle: expected"),
    (
        lambda wrong: animation.adapting(Scene([LAMP]), 4, first=wrong),
        "first: expected a degree from 0",
    ),
    (
        lambda wrong: animation.adapting(Scene([LAMP]), 4, last=wrong),
        "last: expected a degree from 0",
    ),
    (lambda wrong: animation.same_exposure(PAINTING, wrong), "scenes: expected a list"),
    (lambda wrong: animation.same_exposure(wrong, [Scene([LAMP])]), "surface: expected"),
    (lambda wrong: animation.relief(wrong, False, 1.0), "surface: expected"),
    (lambda wrong: list(animation.centred(wrong, (4, 4), (0, 0, 0))), "pictures: expected"),
    (lambda wrong: animation.centred(PICTURE, wrong, (0, 0, 0)), "size: expected whole numbers"),
    (lambda wrong: animation.centred(PICTURE, (4, 4), wrong), "fill: expected three display"),
]


@pytest.mark.parametrize("wrong", [None, -3, "a", [1], []])
@pytest.mark.parametrize(("call", "words"), SERIES)
def test_arguments_of_another_kind_are_refused_by_name(call: Any, words: str, wrong: Any) -> None:
    if wrong == [] and words.startswith("pictures"):
        assert call(wrong) == []
        return
    with pytest.raises(ArgumentError, match=f"^{words}"):
        call(wrong)


def test_scenes_of_a_film_may_be_an_iterator() -> None:
    scenes = animation.raking(Scene([LAMP]), 3)
    listed = animation.same_exposure(PAINTING, scenes)
    once = animation.same_exposure(PAINTING, iter(scenes))
    assert [scene.exposure for scene in once] == [scene.exposure for scene in listed]
    with pytest.raises(ArgumentError, match="pitch_mm: expected a positive width"):
        animation.relief(PAINTING, False, -1.0)


def test_illuminants_go_with_their_lights() -> None:
    room = impasto.Environment(np.full((3, 4, 8), 0.3))
    scene = Scene([LAMP, LAMP], environment=room, illuminant=["A", 3000.0, 2700.0])
    assert scene.changed(environment=None).illuminants == ("A", 3000.0)
    assert scene.changed(lights=[]).illuminants == (2700.0,)
    assert scene.changed(environment=room.rotated(1.0)).illuminants == ("A", 3000.0, 2700.0)
    two = scene.changed(environment=None)
    with pytest.raises(ArgumentError, match=r"one for the environment, found 2.*give illuminant="):
        two.changed(environment=room)
    three = two.changed(environment=room, illuminant=["A", 3000.0, "D65"])
    assert three.illuminants == ("A", 3000.0, "D65")
    alike = Scene([LAMP, LAMP], illuminant="A").changed(environment=room)
    assert alike.illuminants == ("A", "A", "A")


def test_lights_that_are_none_are_refused_in_a_room_and_without() -> None:
    room = impasto.Environment(np.full((3, 4, 8), 0.3))
    wrong: Any
    for environment in (None, room):
        for wrong in (None, 3, "abc", LAMP, {LAMP}, [[["a"]]], object(), iter([LAMP])):
            name = type(wrong).__name__
            with pytest.raises(ArgumentError, match=rf"^lights: expected .* found {name}$"):
                Scene(wrong, environment=environment)
    for wrong in ((math.nan, 0, 1), (0, 0, math.inf)):
        with pytest.raises(ArgumentError, match="normal: expected finite numbers"):
            room.irradiance(wrong)
    np.testing.assert_array_equal(room.irradiance((0, 0, 1e-300)), room.irradiance())

"""A part of a painting under lamps and eyes that are near: the bits of the whole picture.

The parts begin and end at odd places. Pictures seen from the front have no neighbours in them, so
that a part must lack nothing; what a view from the side takes from neighbours is another matter.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointLight, PointView, Rig, Scene, Surface
from impasto.surface import Lobe
from killed_jobs import stack

SIZE = (37, 50)
PARTS = [np.s_[5:36, 11:42], np.s_[0:7, 29:50], np.s_[36:37, 3:4]]
PITCH = 0.5
LAMP = PointLight((-7.0, 5.0, 14.0), 1.3)
SCENES = {
    "distant": Scene([DistantLight((0.3, 0.2, 0.9)), DistantLight((-0.6, 0.2, 0.4), 0.5)]),
    "near": Scene([LAMP, PointLight((40.0, -9.0, 8.0), 0.4)]),
    "flat field": Scene([replace(LAMP, falloff=False)]),
    "disc": Scene([replace(LAMP, radius=3.0), DistantLight((-0.8, 0.1, 0.5), radius=0.1)]),
    "near eye": Scene([LAMP], view=PointView((3.0, -2.0, 30.0))),
    "room": Scene(
        [LAMP],
        environment=impasto.Environment(np.linspace(0.1, 2.0, 384).reshape(3, 8, 16)),
        view=PointView((3.0, -2.0, 30.0)),
    ),
}
FITS: dict[str, dict[str, Any]] = {
    "painting": {"pooling": "painting", "residuals": True},
    "pixel": {"pooling": "pixel", "lobes": 1},
    "lafortune": {"model": "lafortune", "lobes": 1},
}


@pytest.fixture(scope="module", params=FITS)
def whole(request: pytest.FixtureRequest) -> impasto.Sbrdf:
    taken = stack(SIZE)
    taken = taken._replace(rig=Rig(taken.rig, pitch_mm=PITCH))
    return impasto.fit_sbrdf(taken, effort="draft", **FITS[request.param])


@pytest.fixture(scope="module")
def surface() -> Surface:
    """Ambient light, too, which is relative to a lamp's light in the middle of the painting."""
    rng = np.random.default_rng(8)
    normal = rng.normal(0.0, 0.15, (3, *SIZE))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    beta, gamma = rng.uniform(0.0, 9.0, SIZE), rng.uniform(0.06, 0.3, SIZE)
    diffuse, ambient = rng.uniform(0.02, 0.6, (2, 3, *SIZE)).astype(np.float32)
    return Surface.torrance_sparrow(
        normal.astype(np.float32), diffuse, beta, gamma, ambient=0.1 * ambient, pitch_mm=PITCH
    )


def cut(surface: Surface, part: Any) -> Surface:
    """A part of a surface, which knows where it lies."""
    rows, columns = (range(size)[along] for size, along in zip(surface.shape, part, strict=True))
    middle = (
        surface.origin[0] + 0.5 * (columns[0] + columns[-1] + 1 - surface.shape[1]),
        surface.origin[1] - 0.5 * (rows[0] + rows[-1] + 1 - surface.shape[0]),
    )

    def some(value: Any) -> Any:
        return np.ascontiguousarray(value[..., *part]) if np.ndim(value) > 1 else value

    lobes = tuple(Lobe(some(lobe.strength), tuple(map(some, lobe.shape))) for lobe in surface.lobes)
    maps = {name: some(getattr(surface, name)) for name in ("normal", "diffuse", "ambient")}
    return replace(surface, **maps, lobes=lobes, origin=middle)


def light(shown: Any, scene: Scene, **options: Any) -> np.ndarray:
    return impasto.render(shown, scene, output="light", **options).xyz


def same(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and one.tobytes() == np.ascontiguousarray(other).tobytes()


@pytest.mark.parametrize("name", SCENES)
def test_parts_of_a_result_have_the_bits_of_the_whole(name: str, whole: impasto.Sbrdf) -> None:
    scene = SCENES[name]
    everything = light(whole, scene)
    for part in PARTS:
        assert same(light(whole[part], scene), everything[:, *part]), part
    # Codes are made without planes of light.
    shown = impasto.render(whole, scene).display
    assert same(impasto.render(whole[PARTS[0]], scene).display, shown[PARTS[0]])
    if name not in {"distant", "room"}:
        # Where the lamp stands must matter.
        moved = light(replace(whole, rig=whole.rig.part(1.0, 0.0)), scene)
        assert not np.allclose(moved, everything, rtol=1e-4, equal_nan=True)


@pytest.mark.parametrize("name", SCENES)
def test_parts_of_a_surface_with_ambient_light_do(name: str, surface: Surface) -> None:
    scene = SCENES[name]
    everything = light(surface, scene)
    for part in PARTS:
        assert same(light(cut(surface, part), scene), everything[:, *part]), part
    # With every effect, too, whatever the plans leave out.
    planned = impasto.plan(cut(surface, PARTS[0]), scene)
    assert same(planned.forced().render(output="light").xyz, everything[:, *PARTS[0]])


@pytest.mark.parametrize("name", ["near", "disc", "near eye"])
@pytest.mark.parametrize("factor", [2, 3, 5])
def test_parts_of_a_smaller_scale_have_the_bits_of_it(
    name: str, factor: int, surface: Surface
) -> None:
    """Neither 37 nor 50 is a multiple of all: its pixels lie between those of the painting."""
    everything = light(surface, SCENES[name], reduce=factor)
    for top, left, rows, columns in [(0, 0, 2, 3), (1, 2, 5, 4), (3, 5, 3, 4)]:
        part = np.s_[
            top * factor : (top + rows) * factor, left * factor : (left + columns) * factor
        ]
        shown = light(cut(surface, part), SCENES[name], reduce=factor)
        assert same(shown, everything[:, top : top + rows, left : left + columns])


def test_a_perspective_of_a_part_is_that_of_a_painting_of_its_own(surface: Surface) -> None:
    """The same place of lamp and eye, counted from the middle of the part.

    Distances are other sums in single precision, so that light differs by some 1e-6; so does the
    place of a sample, about which light changes by all of itself within a pixel.
    """
    part = cut(surface, PARTS[0])
    part = replace(part, ambient=None)
    right, up = (PITCH * offset for offset in part.origin)
    eye = PointView((9.0, -7.0, 30.0))
    lamp = replace(LAMP, falloff=False)
    scene = Scene([lamp], view=eye, perspective=True, exposure=1.0)

    def moved(place: Any) -> Any:
        x, y, z = place.position
        return replace(place, position=(x - right, y - up, z))

    there = scene.changed(lights=[moved(lamp)], view=moved(eye))
    found = light(part, scene)
    expected = light(replace(part, origin=(0.0, 0.0)), there)
    assert found.shape == expected.shape
    assert found.max() > 0.3
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_part_that_is_learned_from_is_the_painting_of_its_model(tmp_path: Path) -> None:
    """Lobes per pixel have seeds on a grid of the painting, which here is a part of another."""
    taken = stack((60, 70))
    lamps = [PointLight(tuple(40.0 * direction)) for direction in taken.rig.directions]
    taken = taken._replace(rig=Rig(lamps, pitch_mm=PITCH))
    part = taken[7:58, 14:61]
    options: dict[str, Any] = {"pooling": "pixel", "lobes": 1, "effort": "draft"}
    learned = impasto.learn_sbrdf(part, **options)
    found = learned.apply(part)
    assert (found.status == impasto.Status.FITTED).mean() > 0.5
    alone = impasto.fit_sbrdf(part, **options)
    learned.save(tmp_path / "part.npz")
    tile = impasto.load_learned(tmp_path / "part.npz").apply(
        part, rows=slice(12, 30), columns=slice(5, 44)
    )
    for name, values in found.arrays().items():
        if values.shape[-2:] == found.shape:
            assert values.tobytes() == alone.arrays()[name].tobytes(), name
            window = np.ascontiguousarray(values[..., 12:30, 5:44])
            assert window.tobytes() == tile.arrays()[name].tobytes(), name
    # Learned from every third pixel it is the model of the same part.
    every_third = impasto.learn_sbrdf(part, sample=3, **options).apply(part)
    assert (every_third.status == impasto.Status.FITTED).mean() > 0.5
    with pytest.raises(impasto.GeometryError, match="lie beside the pixels"):
        learned.apply(taken[0:20, 0:20])

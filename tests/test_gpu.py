"""Pictures by a graphics card: against float64 numpy, and against the renderer of the CPU.

Any card serves, also a driver that computes on the CPU. Without one the tests are skipped, unless
``IMPASTO_EXPECT_GPU=1`` says that there must be one.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import (
    ArgumentError,
    DistantLight,
    GeometryError,
    GpuUnavailableError,
    PointLight,
    PointView,
    Scene,
    Surface,
    _core,
    gpu,
)
from oracles import forward, lafortune_forward
from processes import run

SIZE = (43, 61)
PITCH = 0.4
RNG = np.random.default_rng(5)


@pytest.fixture(scope="module", autouse=True)
def card() -> str:
    """The name of a card."""
    found = gpu.adapters()
    if not found:
        message = "no graphics card and no software Vulkan (on Debian: mesa-vulkan-drivers)"
        if os.environ.get("IMPASTO_EXPECT_GPU") == "1":
            pytest.fail(message)
        pytest.skip(message)
    return found[0].name


def normals(shape: tuple[int, int] = SIZE) -> np.ndarray:
    normal = RNG.normal(0.0, 0.15, (3, *shape))
    normal[2] = 1.0
    return (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)


def varnished(**options: Any) -> Surface:
    diffuse = RNG.uniform(0.02, 0.6, (3, *SIZE))
    beta = RNG.uniform(0.0, 9.0, SIZE)
    gamma = RNG.uniform(0.06, 0.3, SIZE)
    return Surface.torrance_sparrow(normals(), diffuse, beta, gamma, pitch_mm=PITCH, **options)


def gilded() -> Surface:
    exponent = RNG.uniform(3.0, 40.0, (2, *SIZE))
    psi = 2.0 * np.arctan(RNG.uniform(-1.0, 1.0, (2, *SIZE)) / exponent)
    specular = RNG.uniform(0.0, 0.5, (2, 3, *SIZE))
    return Surface.lafortune(
        normals(),
        RNG.uniform(0.02, 0.6, (3, *SIZE)),
        specular,
        np.sin(psi) - np.cos(psi),
        np.sin(psi) + np.cos(psi),
        exponent,
        pitch_mm=PITCH,
    )


def linear(xyz: np.ndarray) -> np.ndarray:
    """The bands again: without spectra, three bands are linear sRGB."""
    return np.tensordot(impasto.colour.Display.named("srgb").linear_from_xyz, xyz, 1)


# Light of up to 1.5 in single precision, a dozen roundings of 6e-8, and the matrix to XYZ and back.
SINGLE = 4e-6


def test_torrance_sparrow_is_the_formula_of_the_papers() -> None:
    for coated in (False, True):
        surface = varnished(coated=coated)
        lobe = surface.lobes[0]
        renderer = gpu.Renderer(surface, adapter="any")
        for light in ((0.3, 0.1, 0.9), (-0.6, 0.5, 0.4)):
            scene = Scene([DistantLight(light)])
            found = linear(renderer.light(scene)[0])
            expected = forward.radiance(
                surface.normal,
                surface.diffuse,
                lobe.strength,
                lobe.shape[0],
                scene.lights[0].direction,
                (0.0, 0.0, 1.0),
                coated=coated,
            )
            np.testing.assert_allclose(found, expected, atol=SINGLE)
            assert expected.max() > 0.5


def test_lafortune_lobes_are_the_formula_of_the_papers() -> None:
    surface = gilded()
    maps = [np.stack([lobe.shape[k] for lobe in surface.lobes]) for k in range(3)]
    strengths = np.stack([lobe.strength for lobe in surface.lobes])
    scene = Scene([DistantLight((0.2, -0.3, 0.9))])
    found = linear(gpu.Renderer(surface, adapter="any").light(scene)[0])
    expected = lafortune_forward.radiance(
        surface.normal,
        surface.diffuse,
        strengths,
        *maps,
        scene.lights[0].direction,
        (0.0, 0.0, 1.0),
    )
    # d^n in single precision: 40 times the roundings of d, of which there are two.
    np.testing.assert_allclose(found, expected, atol=SINGLE, rtol=2 * 40 * 6e-8)
    assert expected.max() > 0.5


def test_a_near_lamp_is_the_inverse_square() -> None:
    surface = varnished()
    lobe = surface.lobes[0]
    position = (6.0, -4.0, 40.0)
    scene = Scene([PointLight(position)])
    found = linear(gpu.Renderer(surface, adapter="any").light(scene)[0])
    light, squared = forward.to_light(SIZE, PITCH, position)
    expected = forward.radiance(
        surface.normal, surface.diffuse, lobe.strength, lobe.shape[0], light, (0.0, 0.0, 1.0)
    )
    np.testing.assert_allclose(found, expected * (np.square(position).sum() / squared), atol=SINGLE)


SCENES = [
    Scene([DistantLight((0.4, 0.3, 0.8), 0.7), DistantLight((-0.8, 0.2, 0.3))]),
    Scene([PointLight((5.0, 8.0, 30.0)), DistantLight((-0.8, 0.2, 0.5))], exposure=0.6),
    Scene([DistantLight((0.4, 0.3, 0.8))], view=(0.5, -0.2, 0.8), background=(0.2, 0.5, 0.9)),
    Scene([DistantLight((0.7, 0.0, 0.3))], shadows=True, exposure="maximum"),
    Scene([PointLight((9.0, 8.0, 12.0))], shadows=True, view=PointView((3.0, 2.0, 90.0))),
    Scene([DistantLight((0.7, 0.4, 0.3))], shadows=True, display="display-p3"),
]


@pytest.mark.parametrize("number", range(len(SCENES)))
def test_a_frame_is_the_picture_of_the_cpu(number: int) -> None:
    scene = SCENES[number]
    height = (0.6 * RNG.random(SIZE)).astype(np.float32)
    for surface in (varnished(), gilded()):
        surface = replace(surface, height=height)
        surface.normal[:, 3, 4] = np.nan
        renderer = gpu.Renderer(surface, shadows=True, adapter="any")
        expected = impasto.render(surface, scene, fidelity="model", threads=1)
        frame = renderer.frame(scene)
        assert frame.exposure == pytest.approx(expected.exposure, rel=1e-6)
        difference = np.abs(frame.display.astype(int) - expected.display)
        assert difference.max() <= 1
        assert np.asarray(frame).shape == expected.display.shape
        np.testing.assert_array_equal(frame.codes[..., 3], np.rint(255 * expected.coverage))
        assert len(np.unique(frame.display)) > 50, "a picture"


def test_light_is_that_of_the_cpu_and_spectra_serve() -> None:
    painting = impasto.simulate.painting(size=(32, 40), seed=3)
    scene = Scene(
        [DistantLight((0.4, 0.3, 0.8)), DistantLight((-0.5, 0.3, 0.8))],
        illuminant=["A", "D50"],
        adaptation=0.56,
    )
    renderer = gpu.Renderer(painting, adapter="any")
    xyz, coverage = renderer.light(scene)
    expected = impasto.render(painting, scene, fidelity="model", threads=1)
    np.testing.assert_array_equal(coverage, expected.coverage)
    np.testing.assert_allclose(xyz, expected.xyz, atol=SINGLE * expected.xyz.max())


def test_a_varnish_is_put_on_and_taken_off() -> None:
    painting = impasto.simulate.painting(size=(24, 32), seed=3)
    lights = [DistantLight((0.3, 0.3, 0.9))]
    coat = impasto.Varnish(thickness_um=50.0, yellowness=20.0)
    renderer = gpu.Renderer(painting, adapter="any")
    for varnish in (None, coat, coat, None):
        scene = Scene(lights, varnish=varnish)
        expected = impasto.render(painting, scene, fidelity="model", threads=1)
        difference = np.abs(renderer.frame(scene).display.astype(int) - expected.display)
        assert difference.max() <= 1


def test_a_leaning_panel_is_rotated_for_shadows_alone() -> None:
    """As ``render`` does: for scenes with shadows the lights shine on the panel's own plane."""
    normal = normals() + np.float32([0.2, 0.0, 0.0])[:, None, None]
    normal /= np.linalg.norm(normal, axis=0)
    surface = Surface(normal, RNG.uniform(0.1, 0.6, (3, *SIZE)), pitch_mm=PITCH)
    renderer = gpu.Renderer(surface, shadows=True, adapter="any")
    for shadows in (True, False):
        scene = Scene([DistantLight((0.5, 0.2, 0.6))], shadows=shadows)
        expected = impasto.render(surface, scene).display.astype(int)
        found = renderer.frame(scene).display.astype(int)
        assert abs(found - expected).max() <= 1
        assert expected.std() > 5


def test_render_takes_a_card_and_falls_back_with_a_warning() -> None:
    surface, scene = varnished(), Scene([DistantLight((0.3, 0.1, 0.9))])
    expected = impasto.render(surface, scene, output="light").xyz
    found = impasto.render(surface, scene, output="light", backend="gpu").xyz
    np.testing.assert_allclose(found, expected, atol=SINGLE)
    assert found.tobytes() != expected.tobytes()  # a card rounds in its own way
    wrong: Any = "vulkan"
    with pytest.raises(ArgumentError, match="backend"):
        impasto.render(surface, scene, backend=wrong)
    many = replace(surface, lobes=surface.lobes * 9)
    with pytest.warns(impasto.ImpastoWarning, match="the CPU makes the picture"):
        lit = impasto.render(many, scene, backend="gpu", output="light")
    assert lit.xyz.tobytes() == impasto.render(many, scene, output="light").xyz.tobytes()


def test_what_is_clipped_whole_has_the_codes_of_a_card() -> None:
    """The CPU does not light it, a card does."""
    colour = np.array([0.9, -0.2, 0.7], np.float32)[:, None, None] * np.ones(SIZE, np.float32)
    normal = np.zeros((3, *SIZE), np.float32)
    normal[2] = 1.0
    surface = Surface(normal, colour)
    scene = Scene([DistantLight((0.1, 0.2, 1.0))], exposure=3.0)
    plan = impasto.plan(surface, scene)
    assert plan._native.clipped_whole == 1
    expected = plan.render()
    assert (expected.display == (255, 0, 255)).all()
    found = plan.render(backend="gpu")
    assert found.display.tobytes() == expected.display.tobytes()
    assert (found.clipped, found.outside) == (expected.clipped, expected.outside)


@pytest.mark.parametrize("shadows", [False, True])
def test_rooms_and_discs_are_those_of_the_cpu(shadows: bool) -> None:
    """Frames of one renderer under rooms and lamps that change, and single pictures."""
    surface = varnished()
    renderer = gpu.Renderer(surface, adapter="any", shadows=True)
    gallery = impasto.Environment.named("gallery")
    lamp = DistantLight((0.6, 0.2, 0.5), radius=0.08)
    scenes = [
        Scene(environment=gallery, shadows=shadows),
        Scene([lamp], environment=gallery, shadows=shadows),
        Scene([lamp, PointLight((-20.0, 5.0, 40.0), radius=6.0)], shadows=shadows),
        Scene(environment=gallery.rotated(1.0), shadows=shadows),
        Scene(environment=gallery, shadows=shadows),
    ]
    for number, scene in enumerate(scenes):
        expected = impasto.render(surface, scene)
        found = renderer.frame(scene)
        assert abs(found.display.astype(int) - expected.display).max() <= 1
        assert expected.display.std() > 5
        # A single picture has nothing left of the one before: no scene need come again.
        if number < 3:
            alone = impasto.render(surface, scene, backend="gpu", output="light")
            np.testing.assert_allclose(alone.xyz, expected.xyz, atol=SINGLE * expected.xyz.max())


def test_what_a_renderer_cannot_do_is_said() -> None:
    surface = replace(varnished(), pitch_mm=None)
    renderer = gpu.Renderer(surface, adapter="any")
    with pytest.raises(ArgumentError, match=r"make it with shadows=True"):
        renderer.frame(Scene([(0, 0, 1)], shadows=True))
    with pytest.raises(GeometryError, match="pitch_mm"):
        renderer.frame(Scene([PointLight((0, 0, 30))]))
    with pytest.raises(ArgumentError, match="scene"):
        renderer.frame((0, 0, 1))  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="adapter"):
        gpu.Renderer(surface, adapter=3)  # type: ignore[arg-type]
    with pytest.raises(GpuUnavailableError, match='name contains "teapot"'):
        gpu.Renderer(surface, adapter="teapot")
    many = replace(surface, lobes=surface.lobes * 9)
    with pytest.raises(GpuUnavailableError, match="9 lobes, of at most 8"):
        gpu.Renderer(many, adapter="any")


def test_software_is_no_graphics_card() -> None:
    """The CPU's own renderer is faster: "auto" takes a real card or none."""
    if any(found.kind != "cpu" for found in gpu.adapters()):
        assert gpu.Renderer(varnished()).adapter.kind != "cpu"
        return
    with pytest.raises(
        GpuUnavailableError, match=r"no adapter is a graphics card.*backend=\"cpu\""
    ):
        gpu.Renderer(varnished())


def test_cards_describe_themselves(card: str) -> None:
    found = gpu.adapters()
    assert all(one.name and one.backend in {"vulkan", "metal", "dx12"} for one in found)
    renderer = gpu.Renderer(varnished(), adapter=card.upper())
    assert renderer.adapter.name == card
    assert card in repr(renderer)


def test_an_extension_without_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(_core, "gpu_render")
    assert gpu.adapters() == ()
    with pytest.raises(GpuUnavailableError, match="built without"):
        gpu.Renderer(varnished())
    with pytest.raises(GpuUnavailableError, match="built without"):
        gpu.lit_by_card(varnished(), None, None, None, 1, None, "any")  # type: ignore[arg-type]


@pytest.mark.skipif(sys.platform != "linux", reason="reads what Linux says of a process")
def test_no_driver_is_loaded_before_the_first_call() -> None:
    program = """
import numpy as np
import impasto, impasto.gpu
def loaded():
    with open("/proc/self/maps") as maps:
        return "libvulkan" in maps.read()
assert not loaded()
surface = impasto.Surface(np.ones((3, 1, 1)), np.ones((1, 1, 1)))
renderer = impasto.gpu.Renderer(surface, adapter="any")
assert loaded()
print("done")
"""
    assert run(program) == "done\n"


def test_a_perspective_without_a_scale_is_refused() -> None:
    renderer = gpu.Renderer(replace(varnished(), pitch_mm=None), adapter="any")
    eye = impasto.PointView((3.0, 2.0, 40.0))
    with pytest.raises(impasto.GeometryError, match="a perspective needs the width"):
        renderer.frame(impasto.Scene([(0, 0, 1)], view=eye, perspective=True))


def test_metal_shines_through_a_coat_on_a_card_too() -> None:
    """Lobes far stronger than any interface's are metal leaf, which a coat does not dim."""
    size = (16, 16)
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    gold = impasto.Surface.torrance_sparrow(
        normal, np.full((3, *size), 0.05), 300.0, 0.3, pitch_mm=0.5
    )
    scene = impasto.Scene([(0.2, 0.0, 1.0)], varnish=impasto.Varnish(), exposure=0.05)
    # A film is a factor on spectra.
    camera = impasto.simulate.camera("rgb")
    expected = impasto.render(gold, scene, camera=camera).display.astype(int)
    renderer = gpu.Renderer(gold, camera=camera, adapter="any")
    found = renderer.frame(scene).display.astype(int)
    assert expected.max() > 20
    assert np.abs(found[..., :3] - expected).max() <= 1


def test_a_part_lies_in_the_painting_on_a_card_too() -> None:
    """Coordinates are halves of a pixel, exact on the card: the tolerance stays."""
    surface = varnished()
    scene = Scene([PointLight((5.0, 8.0, 20.0)), PointLight((-30.0, 2.0, 9.0), radius=2.0)])
    part = np.s_[6:29, 17:50]
    lobe = surface.lobes[0]
    cut = Surface.torrance_sparrow(
        *(np.ascontiguousarray(a[..., *part]) for a in (surface.normal, surface.diffuse)),
        *(np.ascontiguousarray(a[part]) for a in (lobe.strength, lobe.shape[0])),
        pitch_mm=PITCH,
        origin=(17 + 33 / 2 - 61 / 2, 43 / 2 - 6 - 23 / 2),
    )
    expected = impasto.render(surface, scene, output="light").xyz[:, *part]
    found = gpu.Renderer(cut, adapter="any").light(scene)[0]
    np.testing.assert_allclose(linear(found), linear(expected), atol=SINGLE)
    np.testing.assert_allclose(
        linear(impasto.render(cut, scene, backend="gpu", output="light").xyz),
        linear(expected),
        atol=SINGLE,
    )

"""Pictures and predictions of lobes: every model through the same stages.

The oracle of Lafortune lobes is ``oracles/lafortune_forward.py``, float64 numpy written from the
papers with a tangent frame and plain powers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import DistantLight, PointLight, Scene, Status, simulate
from impasto.surface import Lobe
from oracles import lafortune_forward as oracle

SIZE = (23, 37)
LIGHT = (0.25, 0.15, 0.955)
SLANTED = (0.3, -0.2, 0.93)


def shared(rng: np.random.Generator) -> dict[str, Any]:
    normal = rng.normal(0, 0.15, (3, *SIZE))
    normal[2] = 1.0
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    status = np.zeros(SIZE, np.uint8)
    status[2, 3], status[4, 5] = Status.MASKED, Status.DARK
    plane = np.zeros(SIZE, np.float32)
    stereo = impasto.Normals(
        normal=normal,
        albedo=np.zeros((3, *SIZE), np.float32),
        used=np.zeros(SIZE, np.uint16),
        rejected=np.zeros((4, *SIZE), np.uint16),
        residual=plane,
        condition=plane,
        sigma=plane,
        status=status,
        method="robust",
    )
    diffuse = rng.uniform(0.05, 0.6, (3, *SIZE)).astype(np.float32)
    specular = rng.uniform(0.0, 0.5, (2, 3, *SIZE)).astype(np.float32)
    lobes = rng.integers(0, 3, SIZE).astype(np.uint8)
    specular[:, :, 4, 5], diffuse[:, 4, 5], lobes[4, 5] = 0.0, 0.0, 0
    for lobe in range(2):
        specular[lobe, :, lobes <= lobe] = 0.0
    normal[:, status >= 16] = np.nan
    specular[:, :, 2, 3] = diffuse[:, 2, 3] = np.nan
    return {
        "normal": normal,
        "diffuse": diffuse,
        "specular": specular,
        "lobes": lobes,
        "residual": plane,
        "sigma": plane,
        "status": status,
        "normals": stereo,
        "rig": impasto.Rig([LIGHT], pitch_mm=0.3),
        "bands": ("R", "G", "B"),
    }


@pytest.fixture(scope="module")
def lafortune() -> impasto.LafortuneSbrdf:
    rng = np.random.default_rng(11)
    maps = shared(rng)
    exponent = rng.uniform(3.0, 60.0, (2, *SIZE))
    turn = rng.uniform(-1.5, 1.5, (2, *SIZE)) / exponent
    psi = 2.0 * np.arctan(turn)
    shape = {"cxy": np.sin(psi) - np.cos(psi), "cz": np.sin(psi) + np.cos(psi)}
    shape = {
        name: map_.astype(np.float32) for name, map_ in (shape | {"exponent": exponent}).items()
    }
    for map_ in shape.values():
        for lobe in range(2):
            map_[lobe][maps["lobes"] <= lobe] = np.nan
    sigmas = dict.fromkeys(("specular_sigma", "direction_sigma", "exponent_sigma"), shape["cz"])
    return impasto.LafortuneSbrdf(**maps, **shape, **sigmas, verdict="fitted")


@pytest.fixture(scope="module")
def facets() -> impasto.LobeSbrdf:
    rng = np.random.default_rng(12)
    maps = shared(rng)
    maps["specular"] *= 20.0  # times a Fresnel reflectance of 0.05
    gamma = rng.uniform(0.08, 0.4, (2, *SIZE)).astype(np.float32)
    for lobe in range(2):
        gamma[lobe][maps["lobes"] <= lobe] = np.nan
    ambient = rng.uniform(0.0, 0.02, (3, *SIZE)).astype(np.float32)
    ambient[:, 2, 3] = np.nan
    return impasto.LobeSbrdf(
        **maps,
        gamma=gamma,
        gamma_sigma=gamma,
        ambient=ambient,
        tinted=np.isfinite(gamma),
        converged=maps["status"] < Status.DARK,
        index=1.6,
    )


def known(surface: Any) -> Any:
    return surface.status < Status.DARK


@pytest.mark.parametrize("kind", ["lafortune", "facets"])
@pytest.mark.parametrize(
    "light", [DistantLight(LIGHT, 0.8), PointLight((20.0, 15.0, 60.0), 0.9)], ids=["far", "near"]
)
def test_a_picture_is_what_is_predicted(kind: str, light: Any, request: Any) -> None:
    surface = request.getfixturevalue(kind)
    picture = impasto.render(surface, Scene([light], exposure=1.0))
    expected = surface.predict([light])[0]
    assert np.isnan(expected[:, ~known(surface)]).all()
    assert np.isfinite(expected[:, known(surface)]).all()
    # Bands are linear sRGB: to XYZ and back in single precision is a few roundings of 6e-8, times
    # the largest entries of the two matrices, 1 and 3.2, with sums of up to 2.
    np.testing.assert_allclose(
        picture.linear[:, known(surface)], expected[:, known(surface)], rtol=0, atol=4e-6
    )
    np.testing.assert_array_equal(picture.coverage == 1.0, known(surface))
    matte = impasto.Surface(surface.normal, surface.diffuse, pitch_mm=0.3)
    lobes = expected - matte.predict([light])[0]
    assert np.nanmax(lobes) > 0.05, "lobes are seen"


@pytest.mark.parametrize("view", [(0.0, 0.0, 1.0), SLANTED], ids=["front", "slanted"])
def test_lafortune_lobes_are_the_papers(lafortune: impasto.LafortuneSbrdf, view: Any) -> None:
    fine = known(lafortune)
    shape = {name: np.nan_to_num(getattr(lafortune, name), nan=1.0) for name in lafortune.SHAPE}
    expected = oracle.radiance(
        lafortune.normal, lafortune.diffuse, lafortune.specular, **shape, light=LIGHT, view=view
    )
    found = lafortune.predict([LIGHT], views=[view])[0]
    # d is rounded to 6e-8 a few times, and its power n <= 60 multiplies that: 60 * 3 * 6e-8.
    np.testing.assert_allclose(found[:, fine], expected[:, fine], rtol=1.1e-5, atol=0)


def test_lamps_add_up(lafortune: impasto.LafortuneSbrdf) -> None:
    lights = [DistantLight(LIGHT), PointLight((-20.0, 5.0, 50.0), 0.7)]
    one, two, both = (
        impasto.render(lafortune, Scene(chosen, exposure=1.0)).xyz
        for chosen in (lights[:1], lights[1:], lights)
    )
    fine = known(lafortune)
    np.testing.assert_allclose(both[:, fine], (one + two)[:, fine], rtol=0, atol=2e-6)


@pytest.mark.parametrize("kind", ["lafortune", "facets"])
def test_threads_change_nothing(kind: str, request: Any) -> None:
    surface = request.getfixturevalue(kind)
    scene = Scene([DistantLight(LIGHT)], view=SLANTED)
    one, three = (impasto.render(surface, scene, threads=n) for n in (1, 3))
    assert one.xyz.tobytes() == three.xyz.tobytes()
    assert surface.predict(threads=1).tobytes() == surface.predict(threads=3).tobytes()


def test_a_slanted_view_and_shadows_take_lobes_too(lafortune: impasto.LafortuneSbrdf) -> None:
    scene = Scene([DistantLight((0.9, 0.0, 0.44))], view=SLANTED, shadows=True)
    picture = impasto.render(lafortune, scene)
    assert picture.coverage.shape[1] < SIZE[1]
    assert picture.valid.mean() > 0.8


def test_a_fit_of_the_third_paper_is_rendered() -> None:
    """The whole way: photographs of Snel's rig, the three passes, a picture."""
    painting = simulate.painting(seed=4, size=(16, 18), varnish="patches")
    capture = simulate.capture(painting, "snel-lafortune", "rgb", model="lafortune")
    rig = capture.stack.rig
    sbrdf = impasto.fit_sbrdf(capture.stack.take(range(0, len(rig), 5)), model="lafortune")
    picture = impasto.render(sbrdf, Scene([DistantLight(LIGHT)], exposure=1.0))
    truth = oracle.radiance(
        capture.truth.normal,
        capture.truth.diffuse,
        light=LIGHT,
        view=(0, 0, 1),
        **vars(capture.truth.lobes),
    )
    # Highlights are the hard part: at most pixels the picture is within a hundredth of white.
    assert np.median(np.abs(picture.linear - truth)) < 0.01


def test_the_index_is_that_of_the_fit(facets: impasto.LobeSbrdf) -> None:
    scene = Scene([DistantLight(LIGHT)], exposure=1.0)
    own = impasto.render(facets, scene).xyz
    assert own.tobytes() == impasto.render(facets, scene, index=1.6).xyz.tobytes()
    assert own.tobytes() != impasto.render(facets, scene, index=1.45).xyz.tobytes()
    with pytest.raises(impasto.ArgumentError, match="index"):
        impasto.render(facets, scene, index=0.5)


@pytest.mark.parametrize("kind", ["lafortune", "facets"])
def test_coloured_lobes_have_spectra(kind: str, request: Any) -> None:
    """In the light of the photographs they look as without spectra, in another they do not."""
    surface = request.getfixturevalue(kind)
    lit = surface.surface()
    # Random strengths have colours beyond those of any reflectance: they become those of gold.
    gold = np.array([1.0, 0.8, 0.45], np.float32)[:, None, None]
    lobes = tuple(
        Lobe(np.ascontiguousarray(gold * np.mean(one.strength, axis=0)), one.shape)
        for one in lit.lobes
    )
    lit = replace(lit, diffuse=np.zeros_like(lit.diffuse), ambient=None, lobes=lobes)
    plain = impasto.render(lit, Scene([DistantLight(LIGHT)], exposure=1.0)).linear
    camera = impasto.Camera.srgb()
    day, lamp = (
        impasto.render(
            lit, Scene([DistantLight(LIGHT)], illuminant=name, exposure=1.0), camera=camera
        ).linear
        for name in ("D65", "A")
    )
    # The bands of this camera are those of the display: 0.02 % are numerical integrals.
    np.testing.assert_allclose(day, plain, atol=1e-3 * float(np.nanmax(plain)))
    assert np.nanmax(np.abs(lamp - day)) > 0.1 * np.nanmax(plain)


def test_an_infinite_exponent_is_a_dark_lobe_under_lamps_of_any_size() -> None:
    size = (4, 6)
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    lobe = np.ones((1, *size), np.float32)
    surface = impasto.Surface.lafortune(
        normal, np.full((3, *size), 0.3), 0.5 * np.ones((1, 3, *size)), -lobe, lobe, np.inf * lobe
    )
    matte = impasto.Surface(normal, np.full((3, *size), 0.3))
    for radius in (0.0, 0.1):
        scene = Scene([DistantLight((0.1, 0.0, 1.0), radius=radius)], exposure=1.0)
        shown = impasto.render(surface, scene, output="light")
        expected = impasto.render(matte, scene, output="light")
        assert (shown.coverage == 1.0).all()
        np.testing.assert_allclose(shown.xyz, expected.xyz, rtol=1e-6)


def test_wrong_surfaces_are_refused(lafortune: impasto.LafortuneSbrdf) -> None:
    maps = (lafortune.normal, lafortune.diffuse)
    shape = {name: getattr(lafortune, name) for name in lafortune.SHAPE}
    with pytest.raises(impasto.ArgumentError, match="cz"):
        impasto.Surface.lafortune(*maps, lafortune.specular, **(shape | {"cz": shape["cz"][:1]}))
    with pytest.raises(impasto.ArgumentError, match="ambient"):
        impasto.Surface(*maps, ambient=np.zeros((3, 2, 2)))
    with pytest.raises(impasto.ArgumentError, match="height"):
        impasto.Surface(*maps, height=np.zeros((2, 2)))
    with pytest.raises(impasto.ArgumentError, match="normal"):
        impasto.Surface(lafortune.normal[:2], lafortune.diffuse)
    with pytest.raises(impasto.ArgumentError, match=r"model.*'phong'"):
        impasto.Surface(*maps, model="phong")  # type: ignore[arg-type]
    with pytest.raises(impasto.ArgumentError, match="shape of a lobe of lafortune"):
        impasto.Surface(*maps, (Lobe(0.5, (0.1,)),), "lafortune")
    with pytest.raises(impasto.ArgumentError, match="lobes: expected"):
        impasto.Surface(*maps, (0.5,))  # type: ignore[arg-type]
    with pytest.raises(impasto.ArgumentError, match="gamma: expected a number"):
        impasto.Surface(*maps, (Lobe(0.5, (np.ones((2, 2)),)),))


def test_a_surface_of_arrays_is_predicted_and_rendered() -> None:
    """Matte and flat, under light at 60 degrees: half the diffuse reflectance."""
    normal = np.zeros((3, *SIZE), np.float32)
    normal[2] = 1.0
    matte = impasto.Surface(normal, np.full((3, *SIZE), 0.8))
    half = DistantLight((np.sqrt(0.75), 0.0, 0.5))
    # One rounding of the product in single precision.
    np.testing.assert_allclose(matte.predict([half]), 0.4, rtol=2e-7)
    picture = impasto.render(matte, Scene([half], exposure=1.0))
    # To XYZ and back: a few roundings of 6e-8, times entries of up to 3.2.
    np.testing.assert_allclose(picture.linear, 0.4, atol=2e-6)
    assert repr(matte) == "<Surface 37 x 23 pixels, 3 bands, matte>"


def test_a_result_is_rendered_as_its_surface(
    facets: impasto.LobeSbrdf, lafortune: impasto.LafortuneSbrdf
) -> None:
    scene = Scene([DistantLight(LIGHT)])
    for result in (facets, lafortune):
        whole = impasto.render(result, scene)
        assert impasto.render(result.surface(), scene).xyz.tobytes() == whole.xyz.tobytes()


def test_a_simulated_painting_is_rendered_with_its_own_spectra() -> None:
    painting = simulate.painting(seed=4, size=(16, 18))
    warm, cool = (
        impasto.render(painting, Scene([DistantLight(LIGHT)], illuminant=name))
        for name in ("A", "D65")
    )
    red = [image.xyz[0].mean() / image.xyz[2].mean() for image in (warm, cool)]
    assert red[0] > 2.0 * red[1], "illuminant A is redder than daylight"


@pytest.mark.parametrize("thing", [None, 3.0, {"normal": 1}, impasto.Rig([LIGHT])])
def test_only_surfaces_are_rendered(thing: Any) -> None:
    with pytest.raises(impasto.ArgumentError, match=r"surface: expected .*found"):
        impasto.render(thing, Scene([LIGHT]))


def rough(model: str, *, bands: int = 3) -> impasto.Surface:
    """A slightly curved panel whose normals scatter by 0.06 rad from pixel to pixel, with gaps."""
    rng, size = np.random.default_rng(8), (240, 240)
    rows, columns = np.mgrid[-1 : 1 : size[0] * 1j, -1 : 1 : size[1] * 1j]
    slope = np.stack([0.25 * columns, 0.25 * rows]) + rng.normal(0.0, 0.06, (2, *size))
    normal = np.stack([*slope, np.ones(size)])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = np.full((bands, *size), 0.1, np.float32)
    diffuse[:, rng.random(size) < 0.05] = np.nan
    if model == "lafortune":
        ones = np.ones((1, *size), np.float32)
        strength = np.full((1, bands, *size), 0.5, np.float32)
        return impasto.Surface.lafortune(
            normal.astype(np.float32), diffuse, strength, -ones, ones, 200.0 * ones
        )
    return impasto.Surface.torrance_sparrow(normal.astype(np.float32), diffuse, 20.0, 0.05)


@pytest.mark.parametrize("model", ["torrance-sparrow", "lafortune"])
def test_a_small_picture_has_the_mean_light_of_the_large_one(model: str) -> None:
    surface, factor = rough(model), 20
    scene = Scene([DistantLight((0.2, 0.1, 1.0))], exposure=1.0)
    whole = impasto.render(surface, scene)
    known = whole.coverage > 0
    # Mean light of each group, over the pixels that are known.
    groups = (12, factor, 12, factor)
    light = np.where(known, whole.xyz[1], 0.0).reshape(groups).sum((1, 3))
    mean = light / known.reshape(groups).sum((1, 3))
    small = impasto.render(surface, scene, reduce=factor)
    assert small.display.shape == (12, 12, 3)
    # 380 normals a group: their mean scatters by 0.06 / sqrt(380) = 0.003 rad, which the widened
    # lobe of 0.08 rad sees as 0.03 of its largest value; Gaussians of slopes are not those of
    # angles: 0.04 (crates/impasto/src/surface/reduced.rs).
    assert np.abs(small.xyz[1] - mean).max() < 0.07 * mean.max()
    # The mean of normals alone shows a highlight that nobody sees.
    narrow = impasto.Surface(
        surface.normal[:, ::factor, ::factor],
        surface.diffuse[:, ::factor, ::factor],
        lobes=tuple(
            Lobe(
                lobe.strength[..., ::factor, ::factor] if np.ndim(lobe.strength) else lobe.strength,
                tuple(s[::factor, ::factor] if np.ndim(s) else s for s in lobe.shape),
            )
            for lobe in surface.lobes
        ),
        model=surface.model,
    )
    picked = impasto.render(narrow, scene)
    seen = picked.coverage > 0
    assert np.abs(picked.xyz[1] - mean)[seen].max() > 0.3 * mean.max()
    rows = {row.name: row for row in impasto.plan(surface, scene, reduce=factor).effects}
    assert rows["minification"].decision == "folded"


def test_a_small_picture_of_a_part_lies_where_the_part_does() -> None:
    """Of 50 x 47 pixels, 3 on the right and 2 below fill no group: near lamps must know."""
    size = (47, 53)
    normal = np.zeros((3, *size), np.float32)
    normal[2] = 1.0
    diffuse = np.full((1, *size), 0.5, np.float32)
    surface = impasto.Surface(normal, diffuse, pitch_mm=1.0, origin=(10.0, -20.0))
    scene = Scene([PointLight((15.0, -10.0, 40.0))], exposure=1.0)
    whole = impasto.render(surface, scene).xyz[1, :45, :50]
    small = impasto.render(surface, scene, reduce=5).xyz[1]
    # The light of a group's middle against its mean: 1/24 (5 mm)^2 times the curvature,
    # 3 / (40 mm)^2 of the value along each axis.
    mean = whole.reshape(9, 5, 10, 5).mean((1, 3))
    np.testing.assert_allclose(small, mean, rtol=2 * 25 / 24 * 3 / 1600)
    for wrong in (0, -1, 48, 2.5, "2", None):
        with pytest.raises(impasto.ArgumentError, match="reduce: expected a whole number"):
            impasto.render(surface, scene, reduce=wrong)

"""Rendering: eq. 1 and 9 against plain float64, colour, views, holes, and what is refused."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import impasto
from impasto import ArgumentError, DistantLight, GeometryError, PointLight, Scene

sys.path.insert(0, str(Path(__file__).parent / "oracles"))
import forward

SIZE = (37, 53)
PAPER_LIGHT = DistantLight((0.0, 0.71, 0.71))


def surface(bands: int = 3, **changes: object) -> SimpleNamespace:
    """A wavy painting with a map of gloss."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] / 9.0
    normal = np.stack([0.25 * np.sin(x + y), 0.3 * np.cos(y - 0.5 * x), np.ones(SIZE)])
    normal /= np.linalg.norm(normal, axis=0)
    values: dict[str, object] = {
        "normal": normal.astype(np.float32),
        "diffuse": rng.uniform(0.05, 0.9, (bands, *SIZE)).astype(np.float32),
        "beta": (2.0 + np.sin(x)).astype(np.float32),
        "gamma": (0.12 + 0.05 * np.cos(y)).astype(np.float32),
        "pitch_mm": 0.5,
    }
    return SimpleNamespace(**(values | changes))


def lit(painting: SimpleNamespace, scene: Scene, **options: Any) -> impasto.Image:
    """The painting as a surface, rendered."""
    pitch = getattr(painting, "pitch_mm", None)
    maps = (painting.normal, painting.diffuse, painting.beta, painting.gamma)
    made = impasto.Surface.torrance_sparrow(*maps, pitch_mm=pitch)
    return impasto.render(made, scene, **options)


def spectral(painting: SimpleNamespace) -> SimpleNamespace:
    """Six smooth basis functions; the bands are their coefficients."""
    wavelengths = np.arange(400.0, 701.0, 10.0)
    centres = np.linspace(410.0, 690.0, 6)
    basis = np.exp(-0.5 * ((wavelengths - centres[:, None]) / 35.0) ** 2)
    return SimpleNamespace(
        coefficients=painting.diffuse * 0.7, basis=basis, wavelengths=wavelengths
    )


def expected_xyz(painting, lights, view, matrices, vectors):
    """Eq. 1 / 9 in float64: sum over lights of matrix @ diffuse part + vector * interface part."""
    total = 0.0
    coefficients = np.asarray(painting.diffuse, np.float64)
    for light, matrix, vector in zip(lights, matrices, vectors, strict=True):
        direction, irradiance = np.array(light.direction), light.intensity
        if isinstance(light, PointLight):
            direction, squared = forward.to_light(SIZE, painting.pitch_mm, light.position)
            irradiance = irradiance * np.sum(np.square(light.position)) / squared
        one = np.ones((1, *SIZE))
        both = forward.radiance(
            painting.normal, one, painting.beta, painting.gamma, direction, view
        )
        geometry = forward.radiance(painting.normal, one, 0.0, 1.0, direction, view)
        interface = (both - geometry)[0] * irradiance
        diffuse = geometry[0] * irradiance
        total = total + np.tensordot(matrix, coefficients, 1) * diffuse
        total = total + np.multiply.outer(vector, interface)
    return total


@pytest.mark.parametrize(
    "lights",
    [
        [PAPER_LIGHT],
        [DistantLight((0.6, -0.3, 0.5), 0.4), DistantLight((-0.2, 0.1, 1.0), 0.7)],
        [PointLight((20.0, 30.0, 60.0), 0.8)],
    ],
)
def test_front_view_is_equation_nine(lights: list) -> None:
    painting = surface()
    image = lit(painting, Scene(lights))
    primaries = impasto.colour.Display.named("srgb").xyz_from_linear
    white = primaries.sum(axis=1)
    exact = expected_xyz(
        painting,
        lights,
        np.array([0.0, 0.0, 1.0]),
        [primaries] * len(lights),
        [white] * len(lights),
    )
    # Single precision: some twenty roundings of 6e-8, and the lobe's exponent k phi^2 of up to
    # 20 multiplies the error of phi^2 (1e-6): 2e-5 of the specular part, which is below 1.
    np.testing.assert_allclose(image.xyz, exact, rtol=2e-5, atol=2e-5 * exact.max())
    assert image.valid.all()


def test_illuminants_of_their_own_fold_into_one_matrix_each() -> None:
    painting = surface(bands=6)
    reflectance = spectral(painting)
    lights = [PAPER_LIGHT, DistantLight((0.5, 0.0, 1.0), 0.5)]
    image = lit(painting, Scene(lights, illuminant=["A", "D65"]), reflectance=reflectance)
    operators = [
        impasto.colour.xyz_from_spectrum(reflectance.wavelengths, name) for name in ("A", "D65")
    ]
    exact = expected_xyz(
        SimpleNamespace(**(vars(painting) | {"diffuse": reflectance.coefficients})),
        lights,
        np.array([0.0, 0.0, 1.0]),
        [operator @ reflectance.basis.T for operator in operators],
        [operator.sum(axis=1) for operator in operators],
    )
    # As above.
    np.testing.assert_allclose(image.xyz, exact, rtol=2e-5, atol=2e-5 * exact.max())


def test_codes_are_those_of_the_light_within_half_a_code() -> None:
    image = lit(surface(), Scene([PAPER_LIGHT], display="display-p3"))
    exact = 255.0 * impasto.colour.Display.named("display-p3").encode(image.linear)
    # Half a code of rounding, 7e-4 of the table and the linear light's own single precision.
    assert np.abs(np.moveaxis(image.display, 2, 0) - exact).max() < 0.502
    ratio = image.exposure * np.tensordot(image.screen.linear_from_xyz, image.xyz, 1)
    # Both sides are sums of three single-precision products.
    np.testing.assert_allclose(image.linear, ratio, rtol=1e-5, atol=1e-5)


def test_adaptation_moves_white_and_the_exposure_keeps_it_in_gamut() -> None:
    painting = surface(beta=0.0, gamma=0.1)
    painting.normal = np.zeros((3, *SIZE), np.float32)
    painting.normal[2] = 1.0
    wavelengths = np.arange(400.0, 701.0, 10.0)
    white = SimpleNamespace(
        coefficients=np.ones((1, *SIZE), np.float32),
        basis=np.ones((1, wavelengths.size)),
        wavelengths=wavelengths,
    )
    scene = Scene([DistantLight((0, 0, 1))], illuminant="A", adaptation=0.56)
    image = lit(painting, scene, reflectance=white)
    seen = impasto.colour.adaptation("A", "D65", 0.56).adapted_white
    # A white known from 400 to 700 nm on 10 nm is interpolated and continued: 7e-5 in Z.
    np.testing.assert_allclose(image.xyz[:, 5, 5], seen, rtol=2e-4)
    assert image.display.max() == 255
    assert image.clipped == {"red": 0.0, "green": 0.0, "blue": 0.0}
    # references: 1 / 1.374 for the paper's white on sRGB.
    assert image.exposure == pytest.approx(0.728, abs=2e-3)


@pytest.mark.parametrize("view", [(0.0, 0.0, 1.0), (0.64, 0.0, 0.77)])
@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0), (0.2, 0.1, 0.3)])
def test_the_largest_y_of_the_picture_can_be_white(view: Any, background: Any) -> None:
    painting = surface()
    painting.normal[:, 4, 6] = np.nan
    scene = {"lights": [PAPER_LIGHT], "view": view, "background": background}
    image = lit(painting, Scene(exposure="maximum", **scene))
    usual = lit(painting, Scene(exposure=1.0, **scene))
    # "Let Y_W and Y_max be the maximum Y value in an image and the maximum luminance in the
    # monitor" (six-band paper): of the painting, not of what is behind it.
    highest = usual.xyz[1][usual.coverage == 1.0].max()
    assert image.exposure == pytest.approx(1.0 / highest, rel=1e-6)
    given = lit(painting, Scene(exposure=image.exposure, **scene))
    # The background is added after the light or with it: one rounding of single precision.
    np.testing.assert_allclose(image.xyz, given.xyz, rtol=2e-7, atol=2e-7 * highest)
    np.testing.assert_array_equal(image.coverage, given.coverage)
    assert np.abs(image.display.astype(int) - given.display.astype(int)).max() <= 1


def test_a_black_picture_has_an_exposure() -> None:
    painting = surface(beta=0.0, gamma=0.1)
    painting.diffuse = np.zeros_like(painting.diffuse)
    image = lit(painting, Scene([PAPER_LIGHT], exposure="maximum"))
    assert image.exposure == 1.0
    assert image.display.max() == 0


def test_holes_show_the_background_and_nothing_else_changes() -> None:
    painting, holed = surface(), surface()
    hole = np.zeros(SIZE, bool)
    hole[3:6, 7] = hole[30, 50:] = True
    holed.normal[:, 3:6, 7] = np.nan
    holed.diffuse[1, 30, 50] = np.nan
    holed.gamma[30, 51] = np.nan
    holed.diffuse[0, 30, 52] = np.inf
    scene = Scene([PAPER_LIGHT], background=(0.0, 0.5, 1.0))
    whole, image = lit(painting, scene), lit(holed, scene)
    np.testing.assert_array_equal(image.valid, ~hole)
    np.testing.assert_array_equal(image.display[~hole], whole.display[~hole])
    assert (image.display[hole] == [0, 188, 255]).all()
    assert np.isfinite(image.xyz).all()


@pytest.mark.parametrize("view", [(0, 0, 1), (0.4, -0.3, 1)])
def test_threads_change_no_bit(view: tuple) -> None:
    big = surface()
    for name in ("normal", "diffuse", "beta", "gamma"):
        setattr(big, name, np.tile(getattr(big, name), (4, 5)))
    scene = Scene([DistantLight((0.7, 0.4, 0.3))], view=view, shadows=True)
    one, three = (lit(big, scene, threads=n) for n in (1, 3))
    np.testing.assert_array_equal(one.xyz, three.xyz)
    np.testing.assert_array_equal(one.display, three.display)


def test_a_slanted_view_puts_markers_where_geometry_does() -> None:
    painting = surface(beta=0.0, gamma=0.1)
    painting.normal[:] = np.array([0, 0, 1], np.float32)[:, None, None]
    painting.diffuse[:] = 0.0
    marks = [(8, 10), (28, 40)]
    for row, column in marks:
        painting.diffuse[:, row - 1 : row + 2, column - 1 : column + 2] = 0.8
    view = np.array([0.5, -0.2, 0.8])
    view /= np.linalg.norm(view)
    image = lit(painting, Scene([DistantLight((0, 0, 1))], view=view))
    up = np.array([0.0, 1.0, 0.0]) - view[1] * view
    up /= np.linalg.norm(up)
    right = np.cross(up, view)
    height, width = image.display.shape[:2]
    assert width == np.ceil(abs(right[0]) * SIZE[1] + abs(right[1]) * SIZE[0])
    y = image.linear[1].astype(np.float64)
    rows, columns = np.mgrid[:height, :width]
    for row, column in marks:
        point = np.array([column - (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2 - row, 0.0])
        at_column = right @ point + (width - 1) / 2
        at_row = (height - 1) / 2 - up @ point
        near = np.hypot(rows - at_row, columns - at_column) < 5
        weight = y * near
        # The centre of gravity of a mark of 3 x 3 pixels; samples sit on a grid of a half to a
        # third of a pixel, so a mean over nine pixels is good to a tenth.
        assert (weight * rows).sum() / weight.sum() == pytest.approx(at_row, abs=0.1)
        assert (weight * columns).sum() / weight.sum() == pytest.approx(at_column, abs=0.1)
    assert not image.valid[0, 0]
    assert (image.display[0, 0] == 0).all()


def test_a_slanted_view_is_shaded_for_that_view() -> None:
    painting = surface()
    painting.normal[:] = np.array([0, 0, 1], np.float32)[:, None, None]
    painting.beta, painting.gamma = 3.0, 0.1
    light = np.array([0.0, 0.6, 0.8])
    mirrored = lit(painting, Scene([light], view=(0, -0.6, 0.8)))
    front = lit(painting, Scene([light]))
    difference = mirrored.xyz[1, 10:20, 10:40].mean() - front.xyz[1, 10:20, 10:40].mean()
    # At the mirror angle D = G = 1: 3 F(36.9 deg) / 0.8; the mean diffuse light is the same up to
    # resampling a hundred random pixels.
    expected = 3.0 * forward.fresnel(np.arccos(0.8)) / 0.8
    assert difference == pytest.approx(expected, rel=0.1)


# Lobes wider than any facet can be tilted, which a warning takes for degrees, make no NaN either.
@pytest.mark.filterwarnings("ignore:gamma")
@settings(max_examples=40, deadline=None)
@given(
    light=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(1e-3, 1)),
    view=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 1)),
    beta=st.floats(0, 200),
    gamma=st.floats(0, 3),
    shadows=st.booleans(),
)
def test_no_scene_makes_nan(light, view, beta, gamma, shadows) -> None:
    painting = surface(beta=beta, gamma=gamma)
    painting.normal[:, 4, 4] = (1.0, 0.0, 0.0)
    painting.normal[:, 5, 5] = (0.6, 0.0, -0.8)
    image = lit(painting, Scene([light], view=view, shadows=shadows), threads=1)
    assert np.isfinite(image.xyz).all()
    assert np.isfinite(image.linear).all()


def test_coats_add_up() -> None:
    both = surface(beta=[1.0, 2.0], gamma=[0.1, 0.3])
    scene = Scene([PAPER_LIGHT])
    matte = lit(surface(beta=0.0, gamma=0.1), scene).xyz
    parts = [lit(surface(beta=b, gamma=g), scene).xyz - matte for b, g in ((1.0, 0.1), (2.0, 0.3))]
    # Differences of single-precision numbers of order 1.
    np.testing.assert_allclose(lit(both, scene).xyz - matte, parts[0] + parts[1], atol=1e-6)


def test_one_band_is_grey() -> None:
    image = lit(surface(bands=1), Scene([PAPER_LIGHT]))
    assert int(np.ptp(image.display.astype(int), axis=2).max()) <= 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"illuminant": "A"}, "camera: without"),
        ({"adaptation": 0.5}, "camera: without"),
        ({"adaptation": 1.5}, "adaptation: expected"),
        ({"exposure": 0.0}, "exposure: expected"),
        ({"exposure": "largest"}, "exposure: expected"),
        ({"illuminant": ["A", "A"]}, "illuminant: expected one per light"),
        ({"background": (2.0, 0, 0)}, "background: expected"),
        ({"display": "crt"}, "display: expected"),
        ({"view": (0, 1, 0)}, "view: the eye"),
        ({"lights": [(0, 1, -0.1)]}, "lights: light 0"),
    ],
)
def test_what_cannot_be_shown_is_refused(options: dict, words: str) -> None:
    options = {"lights": [PAPER_LIGHT]} | options
    with pytest.raises(ArgumentError, match=words):
        lit(surface(), Scene(**options))


def test_six_bands_need_a_camera_and_point_lights_a_pitch() -> None:
    with pytest.raises(ArgumentError, match="camera: 6 bands"):
        lit(surface(bands=6), Scene([PAPER_LIGHT]))
    painting = surface()
    del painting.pitch_mm
    with pytest.raises(GeometryError, match="pitch_mm"):
        lit(painting, Scene([PointLight((0.0, 0.0, 50.0))]))


def test_shapes_that_disagree_are_refused() -> None:
    with pytest.raises(ArgumentError, match="gamma"):
        lit(surface(gamma=np.ones((2, 2))), Scene([PAPER_LIGHT]))
    with pytest.raises(ArgumentError, match="height: expected"):
        lit(surface(), Scene([PAPER_LIGHT], shadows=True), height=np.zeros((2, 2), np.float32))


def test_pictures_are_saved(tmp_path: Path) -> None:
    image = lit(surface(), Scene([PAPER_LIGHT]))
    image.save(tmp_path / "a.png")
    image.save(tmp_path / "a.exr")
    from impasto.io import read_image

    codes = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(np.moveaxis(codes, 0, 2), image.display)
    with pytest.raises(ArgumentError, match="path: expected"):
        image.save(tmp_path / "a.bmp")
    assert image.report()["covered"] == 1.0


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_bands_to_display_is_the_fold(bits: int) -> None:
    rng = np.random.default_rng(3)
    reflectance = spectral(surface(bands=6))
    fold = impasto.colour.display_from_coefficients(
        reflectance.basis, reflectance.wavelengths, "A", d=0.56
    )
    bands = rng.uniform(-0.1, 0.8, (6, 50, 60)).astype(np.float32)
    codes = impasto.display_from_bands(bands, fold, bits=bits)  # type: ignore[arg-type]
    linear = np.tensordot(fold.diffuse, bands.astype(np.float64), 1)
    full = {8: 255.0, 16: 65535.0, 32: 1.0}[bits]
    exact = full * fold.display.encode(np.clip(linear, 0, 1))
    # Half a code for integers; the table's 2.5e-6 and single precision (1e-6 near the sRGB knee,
    # where the curve is thirteen times as steep as light).
    bound = (0.5 if bits < 32 else 0.0) + 6e-6 * full
    assert np.abs(np.moveaxis(codes, 2, 0) - exact).max() < bound


def test_a_camera_makes_colours_of_bands() -> None:
    wavelengths = np.arange(400.0, 701.0, 10.0)
    sensitivities = np.exp(
        -0.5 * ((wavelengths - np.array([[600.0], [540.0], [450.0]])) / 30.0) ** 2
    )
    camera = impasto.Camera(wavelengths, sensitivities, "D65")
    painting = surface(beta=0.0, gamma=0.1)
    painting.normal[:] = np.array([0, 0, 1], np.float32)[:, None, None]
    painting.diffuse[:] = 0.5
    scene = Scene([DistantLight((0, 0, 1))], illuminant="A")
    image = lit(painting, scene, camera=camera)
    grey = 0.5 * impasto.colour.white_point("A")
    # Three bands see a flat grey as grey up to what the training set makes of it.
    np.testing.assert_allclose(image.xyz[:, 3, 3], grey, rtol=0.05)

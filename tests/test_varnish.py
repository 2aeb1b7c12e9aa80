"""A coat of varnish against sums over wavelengths in float64, pixel by pixel."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import colour
import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from impasto import ArgumentError, DistantLight, PointLight, PointView, Scene, Varnish
from oracles import forward

GRID = np.arange(360.0, 831.0)
SIZE = (5, 7)
OLD = Varnish(thickness_um=60.0, yellowness=12.0, beta=0.0)


def painting() -> tuple[impasto.Surface, Any]:
    """A matte surface of random normals, and random smooth spectra on 10 nm."""
    rng = np.random.default_rng(11)
    normal = rng.normal(0.0, 0.15, (3, *SIZE))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    wavelengths = np.arange(360.0, 831.0, 10.0)
    centres = np.linspace(380.0, 720.0, 6)[:, None]
    basis = np.exp(-0.5 * ((wavelengths - centres) / 60.0) ** 2)
    coefficients = rng.uniform(0.0, 0.4, (6, *SIZE)).astype(np.float32)
    spectra = SimpleNamespace(coefficients=coefficients, basis=basis, wavelengths=wavelengths)
    return impasto.Surface(normal, coefficients), spectra


def light_of(
    spectra: Any, illuminant: NDArray[np.float64], film: NDArray[np.float64]
) -> NDArray[np.float64]:
    """XYZ ``(3, y, x)`` of reflected light through a film, a white board without film having Y = 1.

    One sum over wavelengths of 1 nm; the basis at 10 nm is interpolated as ASTM E2022 asks.
    """
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    matching = observer.copy().align(colour.SpectralShape(360, 830, 1)).values
    rows = np.array(
        [
            lagrange(spectra.wavelengths, row) if row.size < GRID.size else row
            for row in spectra.basis
        ]
    )
    weights = matching * (illuminant * film)[:, None] / (matching[:, 1] @ illuminant)
    return np.einsum("nc,kn,kyx->cyx", weights, rows, spectra.coefficients.astype(np.float64))


def lagrange(grid: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cubic through the four nearest samples, written out for every wavelength."""
    values = np.empty(GRID.size)
    for index, at in enumerate(GRID):
        first = int(np.clip(np.searchsorted(grid, at, side="right") - 2, 0, grid.size - 4))
        nodes, samples = grid[first : first + 4], row[first : first + 4]
        values[index] = sum(
            samples[i]
            * np.prod([(at - nodes[j]) / (nodes[i] - nodes[j]) for j in range(4) if j != i])
            for i in range(4)
        )
    return values


def film(varnish: Varnish, light: Any, view: Any) -> NDArray[np.float64]:
    """Beer and Lambert along both refracted rays, traced by Snell's law."""
    way = 0.0
    for direction in (light, view):
        x, y, _ = np.asarray(direction) / np.linalg.norm(direction)
        inside = np.arcsin(np.hypot(x, y) / varnish.index)
        way += varnish.thickness_um * 1e-3 / np.cos(inside)
    return np.exp(-way * varnish.yellowness * np.exp((450.0 - GRID) / 60.0))


def board(name: str) -> NDArray[np.float64]:
    """A CIE illuminant on 1 nm."""
    table = colour.SDS_ILLUMINANTS[name]
    return np.interp(GRID, table.wavelengths, table.values)


EYES: list[Any] = [None, PointView((50.0, -80.0, 200.0))]


@pytest.mark.parametrize("eye", EYES, ids=["front", "near"])
def test_each_lamp_crosses_the_film_at_its_own_angle(eye: Any) -> None:
    surface, spectra = painting()
    lamps: list[Any] = [
        DistantLight((0.3, 0.2, 0.9), intensity=0.7),
        DistantLight((-0.9, 0.1, 0.2), intensity=1.3),
        PointLight((-100.0, 400.0, 200.0)),
        DistantLight((0.3, -0.2, 0.9)),
    ]
    names = ["A", "D65", "D65", "A"]
    scene = Scene(lamps, illuminant=names, view=eye, varnish=OLD)
    found = impasto.render(surface, scene, reflectance=spectra, pitch_mm=0.01).xyz
    seen = (0.0, 0.0, 1.0) if eye is None else eye.position
    expected = np.zeros((3, *SIZE))
    for lamp, name in zip(lamps, names, strict=True):
        alone = Scene([lamp], exposure=1.0)
        grey = impasto.Surface(surface.normal, np.ones((1, *SIZE)), pitch_mm=0.01)
        # How much light arrives, which other tests hold: Y of a white matte board.
        arrives = impasto.render(grey, alone).xyz[1].astype(np.float64)
        direction = lamp.position if isinstance(lamp, PointLight) else lamp.direction
        expected += arrives * light_of(spectra, board(name), film(OLD, direction, seen))
    # A dozen single-precision roundings of sums of six positive terms.
    np.testing.assert_allclose(found, expected, rtol=2e-6)


def test_clear_varnish_changes_no_colour_and_removal_undoes_a_coat() -> None:
    surface, spectra = painting()
    # The angles that stand for the photographs.
    light = DistantLight((0.0, 0.5**0.5, 0.5**0.5))

    def seen(varnish: Varnish | None, shown: Any = spectra) -> NDArray[np.float32]:
        return impasto.render(surface, Scene([light], varnish=varnish), reflectance=shown).xyz

    bare = seen(None)
    np.testing.assert_allclose(seen(OLD.clear()), bare, rtol=2e-6)
    assert (seen(OLD)[2] < 0.5 * bare[2]).all()
    # Spectra with the film in them, without it again: on 1 nm, where nothing is interpolated.
    rows = np.array([lagrange(spectra.wavelengths, row) for row in spectra.basis])
    pale = replace(OLD, yellowness=4.0)
    through = rows * film(pale, light.direction, (0.0, 0.0, 1.0))
    yellow = SimpleNamespace(coefficients=spectra.coefficients, basis=through, wavelengths=GRID)
    np.testing.assert_allclose(seen(None, yellow), seen(pale), rtol=2e-6)
    np.testing.assert_allclose(seen(pale.without(), yellow), bare, rtol=3e-6)


def test_the_coat_reflects_and_quiets_the_gloss_below() -> None:
    rng = np.random.default_rng(3)
    normal = rng.normal(0.0, 0.1, (3, *SIZE))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    _, spectra = painting()
    black = np.zeros_like(spectra.coefficients)
    dark = SimpleNamespace(**{**vars(spectra), "coefficients": black})
    surface = impasto.Surface.torrance_sparrow(normal, black, 7.0, 0.2, index=1.45)
    coat = Varnish(index=1.54, gamma=0.1, yellowness=10.0)
    light, view = np.array([0.2, 0.1, 0.9]), np.array([0.0, 0.0, 1.0])
    light /= np.linalg.norm(light)
    scene = Scene([DistantLight(light)], varnish=coat)
    found = impasto.render(surface, scene, reflectance=dark).xyz

    def reflected(beta: float, gamma: float, index: float) -> NDArray[np.float64]:
        none = np.zeros((1, *SIZE))
        return np.asarray(forward.radiance(normal, none, beta, gamma, light, view, index)[0])

    def at_normal(n: float) -> float:
        return ((n - 1.0) / (n + 1.0)) ** 2

    share = at_normal(1.54 / 1.45) / at_normal(1.54)
    expected = reflected(7.0 * share, 0.2, 1.54) + reflected(np.log(2) / 0.04, 0.1, 1.54)
    white = (
        board("D65")
        @ colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
        .copy()
        .align(colour.SpectralShape(360, 830, 1))
        .values
    )
    # Interface reflection has the light's colour, whatever the film. Lobes: a few roundings of an
    # exponent of up to 10.
    np.testing.assert_allclose(
        found, (white / white[1])[:, None, None] * expected, rtol=2e-5, atol=1e-6
    )


def test_metal_leaf_shines_through_a_coat() -> None:
    """Three lobes' worth of an interface under one map: none, as much as the densest, and leaf.

    The energy of a lobe relative to a smooth interface is ``4 beta gamma^2 / ln 2``, that of an
    interface of index 1.7 F(1.7) / F(1.45). What exceeds it keeps its strength: Fresnel's
    reflectance for the coat instead of the paint is divided out. One light straight in front of a
    flat surface: D = G = N.V = 1, so that each lobe is beta F.
    """

    def at_normal(n: float) -> float:
        return ((n - 1.0) / (n + 1.0)) ** 2

    most = at_normal(1.7) / at_normal(1.45)
    energies = np.array([0.9, most, 2.0 * most, 8.0 * most])
    gamma = np.array([[0.1, 0.3, 0.2, 0.15]])
    beta = energies * np.log(2.0) / 4.0 / gamma**2
    normal = np.zeros((3, 1, 4))
    normal[2] = 1.0
    black = np.zeros((6, 1, 4), np.float32)
    spectra: Any = SimpleNamespace(**{**vars(painting()[1]), "coefficients": black})
    # Half of the gloss in a second lobe, which the first pixel lacks.
    halves = np.stack([beta, beta]) * [[[1.0, 0.5, 0.5, 0.5]], [[0.0, 0.5, 0.5, 0.5]]]
    widths = np.stack([gamma, np.where(energies < 1.0, np.nan, gamma)])
    surface = impasto.Surface.torrance_sparrow(normal, black, halves, widths)
    scene = Scene([DistantLight((0.0, 0.0, 1.0))], varnish=Varnish(index=1.54, beta=0.0))
    found = impasto.render(surface, scene, reflectance=spectra).xyz[1]
    quiet = at_normal(1.54 / 1.45) * most / energies
    leaf = at_normal(1.45) * (1.0 - most / energies)
    expected = beta * np.where(energies <= most, at_normal(1.54 / 1.45), quiet + leaf)
    # Single precision: a few roundings, and 1 - most / total of numbers near each other.
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_default_coat_reflects_what_fresnel_says() -> None:
    """A lobe on a flat surface sends a rough mirror's light: F of it, summed over all lights."""
    for gamma in (0.03, 0.05, 0.1):
        coat = Varnish(gamma=gamma)
        zenith = np.linspace(0.0, 10.0 * gamma, 4001)
        lobe = coat.strength * np.exp(-np.log(2.0) * (zenith / 2.0 / gamma) ** 2)
        total = np.trapezoid(2.0 * lobe * np.sin(zenith), zenith)
        # A board of radiance 1 in every direction would reflect all: pi sr cos is 1, and a lobe
        # about the normal leaves out the cosine: 2 gamma^2 of the whole.
        assert abs(total - 1.0) < 3.0 * gamma**2


def test_the_coat_of_lafortune_lobes_has_the_same_width_and_height() -> None:
    normal = np.zeros((3, 1, 41))
    angles = np.linspace(-0.1, 0.1, 41)
    normal[0, 0], normal[2, 0] = np.sin(angles), np.cos(angles)
    none = np.zeros((0, 1, 41))
    black = np.zeros((6, 1, 41), np.float32)
    spectra: Any = SimpleNamespace(**{**vars(painting()[1]), "coefficients": black})
    phong = impasto.Surface.lafortune(normal, black, np.zeros((0, 6, 1, 41)), none, none, none)
    facets = impasto.Surface(normal, black)
    scene = Scene([DistantLight((0.0, 0.0, 1.0))], varnish=Varnish(gamma=0.05))
    one, other = (impasto.render(s, scene, reflectance=spectra).xyz[1, 0] for s in (phong, facets))
    assert other.max() > 2.0
    # cos^n is the Gaussian up to the fourth power of the angle: n (2 phi)^4 / 12 of it at phi.
    np.testing.assert_allclose(one, other, atol=0.02 * other.max())


def test_a_part_of_a_painting_is_varnished_as_the_whole() -> None:
    surface, spectra = painting()
    whole = replace(surface, pitch_mm=1.0)
    scene = Scene([PointLight((30.0, 0.0, 20.0))], varnish=replace(OLD, beta=None))
    expected = impasto.render(whole, scene, reflectance=spectra).xyz[:, 1:3, 2:5]
    part = impasto.Surface(
        surface.normal[:, 1:3, 2:5],
        surface.diffuse[:, 1:3, 2:5],
        pitch_mm=1.0,
        # The middle of the part from the middle of the whole, y up.
        origin=(3.0 - 3.0, 2.0 - 1.5),
    )
    crop: Any = SimpleNamespace(
        **{**vars(spectra), "coefficients": spectra.coefficients[:, 1:3, 2:5]}
    )
    found = impasto.render(part, scene, reflectance=crop).xyz
    # Positions relative to another origin, in single precision.
    np.testing.assert_allclose(found, expected, rtol=1e-5)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"thickness_um": 0.0}, "thickness_um"),
    ({"thickness_um": float("nan")}, "thickness_um"),
    ({"index": 0.9}, "index"),
    ({"yellowness": -1.0}, "yellowness"),
    ({"yellowness": float("inf")}, "yellowness"),
    ({"gamma": 0.0}, "gamma"),
    ({"beta": -1.0}, "beta"),
    # Beyond single precision the picture is black, and the default strength 1 / gamma^2 with it.
    ({"beta": 1e39}, r"beta: expected a strength from 0 to 1e\+30, or None, found 1e\+39"),
    ({"gamma": 1e-5}, r"gamma: expected an angle in radians from 0.0005 to 1.25, found 1e-05"),
    ({"gamma": 2.0}, r"gamma: expected an angle in radians from 0.0005 to 1.25, found 2"),
    ({"removed": 1}, "removed"),
    ({"absorption": ([400.0, 700.0], [1.0])}, "absorption"),
    ({"absorption": ([400.0, 700.0], [1.0, -1.0])}, "absorption"),
    ({"absorption": ([400.0, 700.0], [1.0, 1.0]), "yellowness": 1.0}, "not both"),
]


@pytest.mark.parametrize(("options", "words"), WRONG)
def test_what_is_no_varnish_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        Varnish(**options)


@pytest.mark.parametrize("wrong", ["a", float("nan"), 1.5, -0.1, None])
def test_cosines_that_are_none_are_refused(wrong: Any) -> None:
    for name in ("light", "view"):
        with pytest.raises(ArgumentError, match=f"{name}: expected the cosine of a zenith angle"):
            OLD.transmittance([450.0], **{name: wrong})


@pytest.mark.parametrize("gamma", [5e-4, 1.25])
def test_the_bounds_of_the_coat_make_pictures(gamma: float) -> None:
    surface, spectra = painting()
    for beta in (None, 1e30):
        scene = Scene([DistantLight((0.1, 0.0, 1.0))], varnish=Varnish(gamma=gamma, beta=beta))
        xyz = impasto.render(surface, scene, reflectance=spectra).xyz
        assert np.isfinite(xyz).all()
        assert (xyz > 0.0).all()


def test_a_film_needs_spectra_and_an_opaque_one_cannot_be_removed() -> None:
    surface, spectra = painting()
    light = DistantLight((0.0, 0.0, 1.0))
    grey = impasto.Surface(surface.normal, np.ones((1, *SIZE)))
    with pytest.raises(ArgumentError, match="varnish: a film is a factor on spectra"):
        impasto.render(grey, Scene([light], varnish=OLD))
    with pytest.raises(ArgumentError, match=r"varnish: expected an impasto\.Varnish"):
        Scene([light], varnish="old")  # type: ignore[arg-type]
    brown = replace(OLD, yellowness=60.0).without()
    with pytest.raises(ArgumentError, match=r"transmits .* % at 400 nm"):
        impasto.render(surface, Scene([light], varnish=brown), reflectance=spectra)


def test_grazing_light_and_measured_curves_stay_finite() -> None:
    surface, spectra = painting()
    measured = Varnish(absorption=([400.0, 500.0, 700.0], [20.0, 3.0, 0.0]))
    np.testing.assert_allclose(measured.coefficients([350.0, 450.0, 800.0]), [20.0, 11.5, 0.0])
    for direction in ((1.0, 0.0, 1e-9), (0.0, 1.0, 1e-3)):
        for coat in (measured, replace(measured, index=1.0)):
            scene = Scene([DistantLight(direction)], varnish=coat)
            assert np.isfinite(impasto.render(surface, scene, reflectance=spectra).xyz).all()


def test_a_plan_says_what_a_film_does() -> None:
    surface, spectra = painting()
    scene = Scene([DistantLight((0.0, 0.0, 1.0))], varnish=OLD)
    said = {}
    for name, coat in (("none", None), ("clear", OLD.clear()), ("old", OLD)):
        plan = impasto.plan(surface, scene.changed(varnish=coat), reflectance=spectra)
        effects = {effect.name: effect for effect in plan.effects}
        said[name] = effects["varnish"].decision
        if name == "old":
            # exp(-12 2 0.06)
            assert "23.7 % at 450 nm" in effects["varnish"].reason
    assert said == {"none": "absent", "clear": "no-op", "old": "folded"}


def test_a_varnish_and_its_scene_name_themselves() -> None:
    lamp = [DistantLight((0.0, 0.0, 1.0))]
    assert "varnished" in repr(Scene(lamp, varnish=OLD))
    assert "without its varnish" in repr(Scene(lamp, varnish=OLD.without()))
    assert "Varnish(thickness_um=60.0, index=1.54, yellowness=12.0" in repr(OLD)

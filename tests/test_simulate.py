"""Simulated paintings: known truth, plausible matter, the same bytes from the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from impasto import simulate
from impasto.errors import ArgumentError
from impasto.simulate import surface
from impasto.simulate.pigments import absorption, reflectance
from oracles import forward


@pytest.fixture(scope="module")
def satin() -> simulate.Painting:
    return simulate.painting(seed=3, size=(192, 224))


def arrays(painting: simulate.Painting) -> list[bytes]:
    fields = ("height", "normal", "coefficients", "basis", "beta", "gamma", "varnish")
    return [getattr(painting, field).tobytes() for field in fields]


def test_same_seed_same_bytes(satin: simulate.Painting) -> None:
    assert arrays(simulate.painting(seed=3, size=(192, 224))) == arrays(satin)


def test_another_seed_is_another_painting(satin: simulate.Painting) -> None:
    other = simulate.painting(seed=4, size=(192, 224))
    assert np.abs(other.height - satin.height).mean() > 0.01


def test_an_option_does_not_reshuffle_the_rest(satin: simulate.Painting) -> None:
    cracked = simulate.painting(seed=3, size=(192, 224), craquelure=True, varnish="patches")
    # Away from the cracks the colour is that of the same strokes: most pixels agree although the
    # basis was refitted (largest truncation error ~1e-3 per wavelength).
    rows, columns = np.mgrid[4:192:9, 4:224:9]
    change = np.abs(cracked.spectrum(rows, columns) - satin.spectrum(rows, columns)).max(axis=-1)
    assert np.median(change) < 4e-3


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (37, 5), (64, 96)])
@pytest.mark.parametrize("varnish", ["patches", None])
def test_every_size(size: tuple[int, int], varnish: str | None) -> None:
    painting = simulate.painting(seed=1, size=size, varnish=varnish, craquelure=True, layers=2)
    assert painting.size == size
    assert painting.normal.shape == (3, *size)
    assert painting.beta.shape == painting.gamma.shape == (2, *size)
    assert painting.coefficients.shape == (len(painting.basis), *size)
    for field in ("height", "normal", "coefficients", "beta", "gamma"):
        assert getattr(painting, field).dtype == np.float32
        assert np.isfinite(getattr(painting, field)).all()
    # Three float32 squares: half a unit in the last place each, 2^-24, and one for the sum.
    assert np.abs((painting.normal.astype(float) ** 2).sum(axis=0) - 1).max() < 4 * 2.0**-24
    assert sum(mask.sum() for mask in painting.masks.values()) == size[0] * size[1]


def test_normals_of_a_plane_and_of_a_wave() -> None:
    pitch = 0.25
    x = (np.arange(80) - 39.5) * pitch
    y = (29.5 - np.arange(60)) * pitch
    plane = 0.3 * x[None, :] - 0.7 * y[:, None]
    expected = np.array([-0.3, 0.7, 1.0]) / np.sqrt(0.3**2 + 0.7**2 + 1)
    normal = surface.normals(plane.astype(np.float32), pitch)
    # Heights near 10 mm in float32 are good to 1e-6 mm; over two pitches that is 2e-6 in slope.
    assert np.abs(normal - expected[:, None, None]).max() < 5e-6
    wave = np.broadcast_to(0.1 * np.sin(2 * np.pi * y / 8.0)[:, None], (60, 80))
    slope = 0.1 * 2 * np.pi / 8.0 * np.cos(2 * np.pi * y / 8.0)
    normal = surface.normals(wave.astype(np.float32), pitch)
    # A central difference of a sine of wave number k is short by (k pitch)^2 / 6 = 0.64 %.
    found = -normal[1, 1:-1, 5] / normal[2, 1:-1, 5]
    assert np.abs(found - slope[1:-1]).max() < 0.0065 * np.abs(slope).max()


def test_relief_is_that_of_oil_paint() -> None:
    # Many seeds: one picture may be quieter than the next.
    tilts = []
    for seed in range(3):
        normal = simulate.painting(seed=seed, size=(256, 256)).normal
        tilts.append(np.degrees(np.arctan2(normal[:2], normal[2]).ravel()))
    tilt = np.concatenate(tilts)
    assert 6.0 < tilt.std() < 12.0
    # Impasto: rare steep places, far beyond what a normal law of that width would have.
    assert 30.0 < np.percentile(np.abs(tilt), 99.9) < 60.0


def test_reflectances_are_physical(satin: simulate.Painting) -> None:
    flat = satin.coefficients.reshape(len(satin.basis), -1).astype(float)
    spectra = flat.T @ satin.basis
    # The truth is the product itself; the truncated basis may leave 0 by its own small error.
    assert spectra.min() > -2e-3
    assert spectra.max() < 0.98
    assert np.abs(satin.basis @ satin.basis.T - np.eye(len(satin.basis))).max() < 1e-9
    assert np.allclose(satin.spectrum(7, 11), spectra[7 * 224 + 11], rtol=0, atol=1e-12)
    assert satin.spectrum([[1, 2]], [[3, 4]]).shape == (1, 2, 81)


def test_colours_fold_into_the_coefficients(satin: simulate.Painting) -> None:
    import colour

    camera = simulate.camera("six-band")
    seen = satin.reflectance_in(camera)
    spectrum = satin.spectrum(100, 50)
    # Float32 sums of twelve terms of order one.
    assert np.allclose(seen[:, 100, 50], camera.response(spectrum, satin.wavelengths), atol=2e-6)
    shape = colour.SpectralShape(380, 780, 5)
    expected = colour.sd_to_XYZ(
        colour.SpectralDistribution(spectrum, shape),
        cmfs=colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape),
        illuminant=colour.SDS_ILLUMINANTS["D65"].copy().align(shape),
        method="Integration",
    )
    assert np.allclose(satin.xyz()[:, 100, 50], expected / 100.0, atol=1e-5)


def test_kubelka_munk_there_and_back() -> None:
    values = np.linspace(0.01, 0.98, 50)
    # R loses half its digits near 1, where K/S is a squared difference: 1e-16^(1/2) = 1e-8.
    assert np.allclose(reflectance(absorption(values)), values, rtol=0, atol=1e-8)
    # Duncan's rule by hand: equal parts of R = 0.5 (K/S 0.25) and R = 0.2 (K/S 1.6).
    mixed = reflectance(np.array(0.5 * 0.25 + 0.5 * 1.6))
    assert np.isclose(mixed, 1 + 0.925 - np.sqrt(0.925**2 + 2 * 0.925))


@pytest.mark.parametrize("gamma", [0.075, 0.12, 0.30])
def test_a_coat_reflects_no_more_than_an_interface(gamma: float) -> None:
    """Energy under the lobe against Fresnel's reflectance, by quadrature over the hemisphere."""
    beta = surface.beta_of(gamma)
    polar = (np.arange(1200) + 0.5) / 1200 * np.pi / 2
    light = np.stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)])[:, None]
    normal = np.broadcast_to(np.array([0.0, 0.0, 1.0])[:, None, None], (3, 1, 1200))
    # Reciprocity: integrate over the lights what one view (frontal) receives of a unit irradiance
    # from each, relative to the white board's cosine law.
    seen = forward.radiance(normal, np.zeros((1, 1, 1200)), beta, gamma, light, (0, 0, 1))[0, 0]
    ring = 2 * np.pi * np.sin(polar) * (np.pi / 2 / 1200)
    albedo = (seen * ring).sum() / np.pi
    # A flat interface returns F(0) = 3.4 %; a rough one loses some to shadowed grooves and gains
    # some at grazing facets. Within a quarter the coat neither glows nor vanishes.
    assert albedo == pytest.approx(forward.fresnel(0.0), rel=0.25)


def test_highlights_against_white() -> None:
    face = np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1)
    peaks = {}
    for name in ("matte", "satin", "gloss"):
        p = simulate.painting(seed=0, size=(4, 4), varnish=name)
        image = forward.radiance(
            face, np.zeros((1, 1, 1)), p.beta[0, 0, 0], p.gamma[0, 0, 0], (0, 0, 1), (0, 0, 1)
        )
        peaks[name] = float(image.item())
    assert peaks["matte"] < 0.1
    assert 0.3 < peaks["satin"] < peaks["gloss"] < 4.0


def test_varnish_patches_and_layers() -> None:
    p = simulate.painting(seed=2, size=(90, 120), varnish="patches", layers=3)
    for name in ("matte", "satin", "gloss"):
        mask = p.masks[name]
        assert 0.3 < mask.mean() < 0.37
        for coat in range(3):
            assert len(np.unique(p.beta[coat][mask])) == len(np.unique(p.gamma[coat][mask])) == 1
    assert (p.beta[1] < p.beta[0]).all()
    bare = simulate.painting(seed=2, size=(90, 120), varnish=None)
    assert (bare.beta == 0).all()
    assert bare.masks["none"].all()
    # Varnish levels the relief.
    assert p.height.std() < bare.height.std()
    assert np.abs(np.diff(p.height)).mean() < np.abs(np.diff(bare.height)).mean()


def test_yellowed_varnish_takes_the_blue() -> None:
    clear = simulate.painting(seed=2, size=(48, 48))
    old = simulate.painting(seed=2, size=(48, 48), yellowing=1.0)
    rows, columns = np.mgrid[0:48, 0:48]
    ratio = old.spectrum(rows, columns).mean((0, 1)) / clear.spectrum(rows, columns).mean((0, 1))
    blue, red = ratio[(clear.wavelengths < 450)].mean(), ratio[clear.wavelengths > 650].mean()
    assert blue < 0.75 < 0.95 < red <= 1.001


def test_craquelure_is_deep_and_dark() -> None:
    whole = simulate.painting(seed=2, size=(160, 160))
    cracked = simulate.painting(seed=2, size=(160, 160), craquelure=True)
    deeper = whole.height - cracked.height
    crack = deeper > 0.02
    assert 0.002 < crack.mean() < 0.25
    assert cracked.xyz()[1][crack].mean() < 0.7 * whole.xyz()[1][crack].mean()


def test_own_pigments() -> None:
    grid = np.arange(400.0, 701.0, 10.0)
    grey = np.linspace(0.05, 0.9, 12)[:, None] * np.ones(len(grid))
    p = simulate.painting(seed=1, size=(40, 40), pigments=(grey, grid), glazes=False)
    rows, columns = np.mgrid[0:40, 0:40]
    spectra = p.spectrum(rows, columns)
    # Grey paints mix to greys only.
    assert np.ptp(spectra, axis=-1).max() < 1e-4


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"size": (0, 4)}, "size"),
        ({"size": 5}, "size"),
        ({"varnish": "shiny"}, "varnish"),
        ({"layers": 4}, "layers"),
        ({"relief": -1.0}, "relief"),
        ({"yellowing": float("nan")}, "yellowing"),
        ({"pitch_mm": 0.0}, "pitch_mm"),
        ({"pigments": (np.ones((3, 4)), np.arange(5.0))}, "pigments"),
        ({"pigments": (np.full((3, 2), 1.5), np.array([400.0, 700.0]))}, "pigments"),
    ],
)
def test_refusals_name_the_argument(options: dict[str, object], name: str) -> None:
    with pytest.raises(ArgumentError, match=f"^{name}:"):
        simulate.painting(**({"size": (8, 8)} | options))  # type: ignore[arg-type]
